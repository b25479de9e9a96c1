/** Two versions side by side: what they reach, what they are made of, what changed. */

import { confusionTable } from './confusion.js';
import { fill, h } from './elements.js';
import { percent } from './figures.js';
import { styleOf } from './palette.js';
import { word } from './words.js';

const KNOWN = ['n', 'accuracy', 'per_class', 'confusion'];

export class Comparison {
  constructor() {
    this.element = h('div', { class: 'comparison', 'aria-live': 'polite' });
  }

  /** @param {any} a @param {any} b */
  show(a, b) {
    if (!a || !b) return fill(this.element);
    return fill(this.element, a !== b && changes(a, b), h('div.pair', {}, card(a, 'A', null), card(b, 'B', a === b ? null : a)));
  }
}

/** @param {any} version @param {string} side @param {any} before to which figures are held */
function card(version, side, before) {
  const { evaluation } = version;
  const other = before?.evaluation;
  const figures = evaluation
    ? [h('p', {}, h('span.big', {}, percent(evaluation.accuracy, 1)), ' ', word('accuracy'), ' ', difference(evaluation.accuracy, other?.accuracy)),
      h('p.soft', {}, `${evaluation.n} demonstrations, each classified by a model that had not seen it`),
      perClass(evaluation.per_class, other?.per_class), h('h3', {}, word('confusion', 'Confusion matrix')), matrix(evaluation.confusion), further(evaluation)]
    : [h('p.soft', {}, 'Not evaluated: too few demonstrations, or imported.')];
  return h('section.panel', { 'aria-label': `Version ${version.version}` }, h('header', {}, h('h2', {}, `${side} · version ${version.version}`), version.aliases.map((/** @type {string} */ alias) => h('span.badge', {}, alias))), figures, h('h3', {}, 'Made of'), made(version));
}

/** @param {number} now @param {number | undefined} before */
function difference(now, before) {
  if (before === undefined || before === null || now === null) return null;
  const points = 100 * (now - before);
  if (Math.abs(points) < 0.05) return h('span.soft', {}, 'as A');
  return h(`span.${points > 0 ? 'better' : 'worse'}`, {}, `${points > 0 ? '+' : '−'}${Math.abs(points).toFixed(1)} points`);
}

/** @param {Record<string, number>} now @param {Record<string, number> | undefined} before */
function perClass(now, before) {
  const rows = Object.entries(now).map(([action, share]) => h('tr', {}, h('td', {}, h('span.chip', { style: styleOf(action) }, action)), h('td.number', {}, percent(share, 1)), h('td', {}, difference(share, before?.[action]))));
  return h('table', {}, h('tbody', {}, rows));
}

/** @param {Record<string, Record<string, number>>} confusion */
function matrix(confusion) {
  const rows = Object.keys(confusion);
  const columns = [...new Set([...rows, ...Object.values(confusion).flatMap((row) => Object.keys(row))])];
  return confusionTable(rows, columns, rows.map((row) => columns.map((column) => confusion[row][column] ?? 0)));
}

/** What else an evaluation tells, whatever that is. @param {Record<string, any>} evaluation */
function further(evaluation) {
  const rows = Object.entries(evaluation).filter(([name]) => !KNOWN.includes(name)).flatMap(([name, value]) => [h('dt', {}, name.replaceAll('_', ' ')), h('dd', {}, plainly(value))]);
  return rows.length > 0 && h('dl.figures', {}, rows);
}

/** @param {any} version */
function made({ actions, options, seed, base, lineage, demonstrations, library_versions: libraries, digest }) {
  const rows = [
    ['actions', actions.join(', ')], ['demonstrations', demonstrations.length],
    ['options', Object.keys(options).length ? plainly(options) : 'all chosen from the demonstrations'], ['seed', seed ?? '–'],
    [word('lineage'), lineage?.length ? lineage.map((/** @type {number} */ each) => `v${each}`).join(' ← ') : base ? `v${base}` : 'from scratch'],
    ['libraries', Object.entries(libraries).map(([name, number]) => `${name} ${number}`).join(', ') || '–'], ['digest', h('code', {}, digest.slice(0, 16))],
  ];
  return h('dl.figures', {}, rows.flatMap(([name, value]) => [h('dt', {}, name), h('dd', {}, value)]));
}

/** @param {any} a @param {any} b */
function changes(a, b) {
  const [before, after] = [new Set(a.demonstrations), new Set(b.demonstrations)];
  const [added, gone] = [[...after].filter((each) => !before.has(each)).length, [...before].filter((each) => !after.has(each)).length];
  const names = [...new Set([...Object.keys(a.options), ...Object.keys(b.options)])].filter((name) => plainly(a.options[name]) !== plainly(b.options[name]));
  const said = [
    b.actions.filter((/** @type {string} */ each) => !a.actions.includes(each)).map((/** @type {string} */ each) => `action ${each} is new`),
    a.actions.filter((/** @type {string} */ each) => !b.actions.includes(each)).map((/** @type {string} */ each) => `action ${each} is gone`),
    added ? [`${added} demonstrations more`] : [], gone ? [`${gone} demonstrations fewer`] : [],
    names.map((name) => `${name.replaceAll('_', ' ')}: ${plainly(a.options[name])} → ${plainly(b.options[name])}`),
  ].flat();
  return h('p.fine', {}, h('strong', {}, `From version ${a.version} to ${b.version}: `), said.length ? `${said.join('; ')}.` : 'trained the same way on the same demonstrations.');
}

/** @param {any} value @returns {string} */
function plainly(value) {
  if (value === null || value === undefined) return 'default';
  if (typeof value === 'number') return String(Number(value.toPrecision(4)));
  if (typeof value !== 'object') return String(value);
  return Object.entries(value).map(([name, each]) => (Array.isArray(value) ? plainly(each) : `${name.replaceAll('_', ' ')} ${plainly(each)}`)).join(', ');
}
