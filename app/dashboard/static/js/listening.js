/** Listening to a session: it comes back where it was cut off, and misses no segment. */

import { Problem, Unreachable, at, events, pause } from './api.js';

/** @typedef {'listening' | 'returning' | 'ended' | 'refused'} State */

/**
 * Listen until the session ends or the signal says so.
 * @param {string} id
 * @param {(event: import('./server_events.js').ServerEvent) => void} onEvent
 * @param {(state: State, error?: unknown) => void} onState
 * @param {AbortSignal} signal
 */
export async function listen(id, onEvent, onState, signal) {
  const path = `${at('sessions', id, 'events')}?include=frames,hypotheses`;
  let last = '-1';
  let wait = 250;
  while (!signal.aborted) {
    try {
      onState(last === '-1' ? 'listening' : 'returning');
      let heard = false;
      for await (const event of events(path, { headers: { 'Last-Event-ID': last }, signal })) {
        if (!heard) onState('listening');
        heard = true;
        wait = 250;
        last = event.id ?? last;
        onEvent(event);
        if (event.kind === 'ended') return onState('ended');
      }
      if (!heard && !signal.aborted && wait > 250) return onState('ended');
    } catch (error) {
      if (signal.aborted) return undefined;
      if (error instanceof Problem && error.status < 500) return onState('refused', error);
      onState('returning', error instanceof Unreachable ? error : undefined);
    }
    await pause(wait, signal);
    wait = Math.min(wait * 2, 4000);
  }
  return undefined;
}
