/** What stands against a generated movement, in words. */

import { h } from './elements.js';
import { fixed, seconds } from './figures.js';

/** @typedef {{kind: string, t: number, value: number, limit: number}} Violation */

const TITLES = /** @type {Record<string, string>} */ ({
  start_far: 'The start is far from every demonstrated start.', goal_far: 'The goal is far from every demonstrated goal.',
  length_far: 'Nobody demonstrated a movement of this length.', rise_far: 'Nobody demonstrated going up or down so much.',
  mean_shape: 'The shape is the mean of the demonstrations.', slowed: 'It takes longer, to keep the limits.',
});

/**
 * Return what is to be known about a movement.
 * @param {{feasible: boolean, duration_s: number, violations: Violation[], warnings: {code: string, detail: string}[]}} told
 */
export function feasibilityTold({ feasible, duration_s: duration, violations, warnings }) {
  const verdict = feasible
    ? h('p.fine', {}, h('strong', {}, 'Feasible. '), `It takes ${seconds(duration)} and keeps to everything that was asked.`)
    : h('div.problem', { role: 'alert' }, h('strong', {}, 'Not as asked. '), h('ul', {}, violations.map((each) => h('li', {}, inWords(each)))));
  return [verdict, warnings.map(({ code, detail }) => h('div.caution', { data: { code } }, h('strong', {}, TITLES[code] || `${code.replaceAll('_', ' ')}. `), ' ', detail))].flat();
}

/** @param {Violation} violation */
function inWords({ kind, t, value, limit }) {
  const when = `at ${seconds(t)}`;
  const side = /^workspace_(min|max)_([xyz])$/.exec(kind);
  if (side) return `It leaves the workspace ${when}: ${side[2]} is ${fixed(value, 3)} m, the ${side[1] === 'min' ? 'least' : 'most'} is ${fixed(limit, 3)} m.`;
  if (kind === 'table') return `It goes below the table ${when}: ${fixed(value, 3)} m high, the table is at ${fixed(limit, 3)} m.`;
  if (kind === 'via') return `It misses a point to pass ${when} by ${fixed(value, 3)} m; ${fixed(limit, 3)} m was asked for.`;
  if (kind.startsWith('moves_at_')) return `It does not rest at the ${kind.slice(9)}: ${fixed(value, 3)} m/s.`;
  return `${kind.replaceAll('_', ' ')} ${when}: ${fixed(value, 3)} instead of ${fixed(limit, 3)}.`;
}
