/** Demonstrations of an action, to be seen beside what is generated; kept, since they never change. */

import { all, ask, at } from './api.js';
import { flat, speeds } from './recording.js';

/** @typedef {{t: Float64Array, track: Float64Array, speed: (number | null)[], table: number}} Shown */

const MOST = 14;
/** @type {Map<string, Promise<Shown>>} */
const kept = new Map();

/**
 * Return some demonstrations of an action, spread over all that there are.
 * @param {string} model @param {string} action
 * @returns {Promise<Shown[]>}
 */
export async function demonstrationsOf(model, action) {
  const listed = await all(`${at('models', model, 'demonstrations')}?action=${encodeURIComponent(action)}`, 'demonstrations', 500);
  const step = Math.max(1, Math.ceil(listed.length / MOST));
  return Promise.all(listed.filter((_, number) => number % step === 0).map(({ id }) => one(model, id)));
}

/** @param {string} model @param {string} id */
function one(model, id) {
  const key = `${model}/${id}`;
  const known = kept.get(key) || read(model, id);
  kept.set(key, known);
  known.catch(() => kept.delete(key));
  return known;
}

/** @param {string} model @param {string} id @returns {Promise<Shown>} */
async function read(model, id) {
  const { trajectory, table_height_m: table } = await ask(at('models', model, 'demonstrations', id));
  const t = Float64Array.from(trajectory.t, (/** @type {number} */ time) => time - trajectory.t[0]);
  const track = flat(trajectory.hand);
  return { t, track, speed: speeds(t, track), table };
}
