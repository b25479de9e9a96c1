/** The public API, asked with fetch. Addresses are relative to the page, so that it works behind a proxy. */

import { eventsOf } from './server_events.js';

/** @typedef {{pointer: string, code: string, detail: string}} Place */

/** What the server refused, in its own words (RFC 9457). */
export class Problem extends Error {
  /** @param {number} status @param {any} told */
  constructor(status, told) {
    super(told.detail || `the server answered ${status}`);
    this.status = status;
    this.code = told.code || 'http_error';
    /** @type {Place[]} */
    this.errors = told.errors || [];
    this.requestId = told.request_id || '';
  }
}

/** The server did not answer at all. */
export class Unreachable extends Error {
  constructor() {
    super('the server does not answer; is `gesta serve` still running?');
  }
}

/** Tells of changes: `good`, `lost`. */
export const connection = new (class extends EventTarget {
  state = 'unknown';

  /** @param {'good' | 'lost'} state */
  note(state) {
    if (state === this.state) return;
    this.state = state;
    this.dispatchEvent(new Event('change'));
  }
})();

/**
 * @typedef {object} Asking
 * @property {string} [method]
 * @property {any} [body] sent as JSON; a FormData as it is
 * @property {string} [accept]
 * @property {Record<string, string>} [headers]
 * @property {AbortSignal} [signal]
 */

/**
 * Return the response to a request. Throws Problem, Unreachable.
 * @param {string} path below the page, without a slash at its beginning
 * @param {Asking} [asking]
 */
export async function send(path, { method, body, accept = 'application/json', headers = {}, signal } = {}) {
  const form = body instanceof FormData;
  const sent = body === undefined || form ? body : JSON.stringify(body);
  /** @type {Record<string, string>} */
  const typed = sent === undefined || form ? {} : { 'Content-Type': 'application/json' };
  const given = { method: method || (sent === undefined ? 'GET' : 'POST'), body: sent, signal };
  let response;
  try {
    response = await fetch(path, { ...given, headers: { Accept: accept, ...typed, ...headers } });
  } catch (error) {
    if (signal?.aborted) throw error;
    connection.note('lost');
    throw new Unreachable();
  }
  connection.note('good');
  if (!response.ok) throw new Problem(response.status, await told(response));
  return response;
}

/**
 * Return the JSON of an answer, null where there is none. Throws Problem, Unreachable.
 * @param {string} path
 * @param {Asking} [asking]
 * @returns {Promise<any>}
 */
export async function ask(path, asking) {
  const response = await send(path, asking);
  return response.status === 204 ? null : response.json();
}

/**
 * Return the records of all pages, `most` of them at most.
 * @param {string} path
 * @param {string} name of the field that holds the records
 * @param {number} [most]
 * @returns {Promise<any[]>}
 */
export async function all(path, name, most = 500) {
  const found = [];
  let token = null;
  do {
    const query = `${path.includes('?') ? '&' : '?'}page_size=${Math.min(most, 500)}`;
    const page = await ask(path + query + (token ? `&page_token=${encodeURIComponent(token)}` : ''));
    found.push(...page[name]);
    token = page.next_page_token;
  } while (token && found.length < most);
  return found;
}

/**
 * Yield the server-sent events of an address; nothing where it has none (204).
 * @param {string} path
 * @param {Asking} [asking]
 */
export async function* events(path, asking = {}) {
  const response = await send(path, { accept: 'text/event-stream', ...asking });
  if (response.status === 204 || !response.body) return;
  try {
    yield* eventsOf(response.body);
  } catch (error) {
    if (asking.signal?.aborted) throw error;
    throw new Unreachable();
  }
}

/**
 * Return the address of something of the API.
 * @param {...(string | number)} parts
 */
export function at(...parts) {
  return ['v1', ...parts.map((part) => encodeURIComponent(part))].join('/');
}

/** Ask again and again whether the server lives, so that its state is known. */
export async function watchConnection() {
  for (;;) {
    try {
      connection.note((await fetch('livez')).ok ? 'good' : 'lost');
    } catch {
      connection.note('lost');
    }
    await pause(connection.state === 'good' ? 10_000 : 1_500);
  }
}

/**
 * Wait.
 * @param {number} milliseconds
 * @param {AbortSignal} [signal] ends it early
 * @returns {Promise<void>}
 */
export function pause(milliseconds, signal) {
  return new Promise((resolve) => {
    const timer = setTimeout(resolve, milliseconds);
    signal?.addEventListener('abort', () => (clearTimeout(timer), resolve()), { once: true });
  });
}

/** @param {Response} response */
async function told(response) {
  try {
    return await response.json();
  } catch {
    return {};
  }
}
