/** A confusion matrix as a table. */

import { h } from './elements.js';

/**
 * @param {string[]} rows what it truly was
 * @param {string[]} columns what it was taken for
 * @param {number[][]} counts
 */
export function confusionTable(rows, columns, counts) {
  const head = h('tr', {}, h('th', {}, h('span.unseen', {}, 'truth, found')), columns.map((name) => h('th', { scope: 'col', title: `taken for ${name}` }, name)));
  const body = rows.map((name, row) => {
    const total = Math.max(1, counts[row].reduce((sum, count) => sum + count, 0));
    const cells = columns.map((column, at) => cell(counts[row][at], total, name, column));
    return h('tr', {}, h('th', { scope: 'row' }, name), cells);
  });
  return h('div.scroll', {}, h('table.confusion', {}, h('thead', {}, head), h('tbody', {}, body)));
}

/** @param {number} count @param {number} total @param {string} row @param {string} column */
function cell(count, total, row, column) {
  const share = count / total;
  const tone = row === column ? 'var(--accent)' : 'var(--bad)';
  const kind = share > 0.55 ? 'much' : '';
  return h('td', { class: kind, style: { '--share': (0.9 * share).toFixed(2), '--tone': tone }, title: `${count} of ${total} ${row} taken for ${column}` }, count === 0 ? '·' : count);
}
