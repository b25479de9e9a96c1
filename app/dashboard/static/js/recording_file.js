/** Recordings out of files: CSV and JSON are read here, every other format by the server. */

import { ask, at } from './api.js';
import { GROUND, flat } from './recording.js';

/** @typedef {import('./recording.js').Recording} Recording */
/** @typedef {Recording & {raw: Map<string, Float64Array>, geometry: import('./recording.js').Geometry | null, meant?: import('./recording.js').Geometry}} Opened geometry: as the file says, meant: as the user does */

/** What is wrong with a file. */
export class Unreadable extends Error {}

/**
 * Return what a file holds. Throws Unreadable, Problem, Unreachable.
 * @param {File} file
 * @param {import('./recording.js').Geometry | null} [declared] where the file does not say it
 * @returns {Promise<Opened>}
 */
export async function open(file, declared = null) {
  if (/\.json$/i.test(file.name)) return fromJson(file.name, await file.text());
  const ours = /\.csv$/i.test(file.name) && /^\uFEFF?"?t"?\s*[,;\t]/.test(await file.slice(0, 20).text());
  return ours ? opened(file.name, ...fromCsv(await file.text())) : fromServer(file, declared);
}

/**
 * Return the recording of a session, with what was recognised in it.
 * @param {any} session
 * @returns {Promise<Opened>}
 */
export async function ofSession(session) {
  const [told, found] = await Promise.all([ask(at('sessions', session.id, 'recording')), ask(at('sessions', session.id, 'segments'))]);
  const result = fromTold(session.name || `session ${session.id.slice(0, 6)}`, told);
  return { ...result, segments: found.segments };
}

/**
 * Return times and tracks of a table `t,hand.x,hand.y,hand.z,NAME.x,…`; an empty cell is a dropout.
 * @param {string} text
 * @returns {[Float64Array, Map<string, Float64Array>]}
 */
export function fromCsv(text) {
  const [head, ...lines] = text.replace(/^\uFEFF/, '').split(/\r?\n/).filter((line) => line.trim() && !line.startsWith('#'));
  const columns = (head || '').split(/[,;\t]/).map((name) => name.trim().replace(/^"|"$/g, ''));
  if (columns[0] !== 't') throw new Unreadable('the first column must be “t”, the time in seconds, and then hand.x, hand.y, hand.z, …');
  const separator = /** @type {RegExpExecArray} */ (/[,;\t]/.exec(head))?.[0];
  const names = columns.filter((name) => name.endsWith('.x')).map((name) => name.slice(0, -2));
  const places = names.map((name) => ['x', 'y', 'z'].map((axis) => columns.indexOf(`${name}.${axis}`)));
  const incomplete = names.find((_, number) => places[number].includes(-1));
  if (incomplete || !names.length) throw new Unreadable(`${incomplete || 'a track'} needs the columns .x, .y and .z`);
  if (lines.length < 2) throw new Unreadable('there are no frames in it');
  const t = new Float64Array(lines.length);
  const tracks = new Map(names.map((name) => [name, new Float64Array(lines.length * 3)]));
  lines.forEach((line, at) => {
    const cells = line.split(separator);
    t[at] = numberIn(cells[0], at);
    if (at && !(t[at] > t[at - 1])) throw new Unreadable(`row ${at + 2}: the time must increase`);
    names.forEach((name, number) => tracks.get(name)?.set(places[number].map((column) => numberIn(cells[column], at)), 3 * at));
  });
  return [t, tracks];
}

/** @param {string | undefined} cell @param {number} at */
function numberIn(cell, at) {
  const text = (cell || '').trim();
  if (!text || /^nan$/i.test(text)) return NaN;
  const value = Number(text);
  if (Number.isNaN(value)) throw new Unreadable(`row ${at + 2}: “${text.slice(0, 20)}” is no number`);
  return value;
}

/** @param {string} name @param {string} text */
function fromJson(name, text) {
  let told;
  try {
    told = JSON.parse(text);
  } catch (error) {
    throw new Unreadable(`it is no JSON: ${error instanceof Error ? error.message : error}`);
  }
  return fromTold(name, told);
}

/**
 * Return a recording of JSON: a trajectory, or a request or answer of the API that holds one.
 * @param {string} name @param {any} told
 * @returns {Opened}
 */
function fromTold(name, told) {
  const holder = told.recording || told;
  const motion = holder.trajectory || holder;
  if (!Array.isArray(motion.hand)) throw new Unreadable('it holds no trajectory: `hand`, and `t` or `rate_hz`');
  const t = motion.t ? Float64Array.from(motion.t) : Float64Array.from(motion.hand, (/** @type {any} */ _, /** @type {number} */ frame) => frame / motion.rate_hz);
  const tracks = Object.entries({ hand: motion.hand, ...motion.objects });
  const made = opened(name, t, new Map(tracks.map(([track, positions]) => [track, flat(/** @type {any} */ (positions))])));
  return { ...made, geometry: told.geometry || null, tableHeight: told.scene?.table_height_m ?? null, labels: labelsOf(holder.segments || []) };
}

/** @param {File} file @param {import('./recording.js').Geometry | null} declared @returns {Promise<Opened>} */
async function fromServer(file, declared) {
  const form = new FormData();
  form.append('file', file);
  for (const [name, value] of Object.entries(declared || {})) form.append(name, value);
  const told = await ask(at('captures'), { body: form });
  const tracks = new Map(Object.entries(told.tracks).map(([name, positions]) => [name, flat(/** @type {any} */ (positions))]));
  const { proposal } = told;
  const hand = proposal && together('hand', proposal.hand, tracks);
  const objects = Object.entries(proposal?.objects || {}).map(([role, names]) => [together(role, names, tracks), role]);
  const made = opened(file.name, Float64Array.from(told.t), tracks);
  const rate = told.rate_hz ? `, ${Number(told.rate_hz.toFixed(1))} Hz` : '';
  return {
    ...made, ...(proposal ? { hand, objects: Object.fromEntries(objects) } : {}), geometry: GROUND, labels: labelsOf(told.labels || []),
    notes: [`read as ${told.format}${rate}`, ...(told.reasons || []), ...(told.notes || [])],
  };
}

/**
 * Return the track that several stand for: their mean, which is added, missing where one of them is.
 * @param {string} role @param {string | string[]} names @param {Map<string, Float64Array>} tracks
 */
function together(role, names, tracks) {
  const list = Array.isArray(names) ? names : [names];
  if (list.length === 1) return list[0];
  const all = list.map((name) => /** @type {Float64Array} */ (tracks.get(name)));
  const name = `${role}: mean of ${list.length}`;
  tracks.set(name, all[0].map((_, at) => all.reduce((sum, track) => sum + track[at], 0) / all.length));
  return name;
}

/** @param {any[]} told @returns {import('./recording.js').Label[]} */
function labelsOf(told) {
  return told.filter((each) => each.action && 'start_s' in each).map((each) => ({ action: each.action, start: each.start_s, end: each.end_s }));
}

/**
 * @param {string} name @param {Float64Array} t @param {Map<string, Float64Array>} raw
 * @returns {Opened}
 */
function opened(name, t, raw) {
  const hand = [...raw.keys()].find((track) => /hand|wrist/i.test(track)) || [...raw.keys()][0];
  const others = [...raw.keys()].filter((track) => track !== hand);
  const objects = others.length <= 16 ? Object.fromEntries(others.map((track) => [track, track])) : {};
  return { name, t, raw, tracks: raw, hand, objects, labels: [], segments: [], tableHeight: null, geometry: null, notes: [] };
}
