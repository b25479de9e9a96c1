/** Bars of probabilities: rows are made once, afterwards only their lengths change. */

import { h } from './elements.js';
import { styleOf, wordOf } from './palette.js';

/** @typedef {{name: string | null, value: number, note?: string}} Bar */

export class Bars {
  /** @param {string} label @param {boolean} [coloured] by action class */
  constructor(label, coloured = false) {
    this.coloured = coloured;
    this.element = h(coloured ? 'div.bars.coloured' : 'div.bars', { role: 'group', 'aria-label': label });
    /** @type {Map<string | null, {row: HTMLElement, fill: HTMLElement, value: Text, note: Text}>} */
    this.rows = new Map();
  }

  /** @param {Bar[]} bars those that are not told are at nothing */
  show(bars) {
    for (const [name, row] of this.rows) if (!bars.some((bar) => bar.name === name)) this.#set(row, 0, '');
    let best = -1;
    let likeliest = null;
    for (const { name, value, note = '' } of bars) {
      const row = this.rows.get(name) || this.#add(name);
      this.#set(row, value, note);
      if (value > best) [best, likeliest] = [value, row];
    }
    for (const row of this.rows.values()) row.row.classList.toggle('best', row === likeliest);
  }

  clear() {
    this.element.replaceChildren();
    this.rows.clear();
  }

  /** @param {string | null} name */
  #add(name) {
    const made = { fill: h('span.bar-fill'), value: document.createTextNode(''), note: document.createTextNode('') };
    const row = h('div.bar-row', { style: this.coloured ? styleOf(name) : { '--colour': 'var(--object)' } },
      h('span.bar-name', {}, wordOf(name)), h('span.bar-track', {}, made.fill), h('span.bar-value', {}, made.value), h('span.bar-note', {}, made.note));
    this.element.append(row);
    const added = { row, ...made };
    this.rows.set(name, added);
    return added;
  }

  /** @param {{fill: HTMLElement, value: Text, note: Text}} row @param {number} value @param {string} note */
  #set(row, value, note) {
    row.fill.style.transform = `scaleX(${value.toFixed(3)})`;
    const text = `${Math.round(100 * value)} %`;
    if (row.value.data !== text) row.value.data = text;
    if (row.note.data !== note) row.note.data = note;
  }
}
