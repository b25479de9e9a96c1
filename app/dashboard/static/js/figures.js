/** Numbers as people read them. */

const NONE = '–';

/** @param {number | null | undefined} value @param {number} [digits] */
export function percent(value, digits = 0) {
  return isNumber(value) ? `${(100 * value).toFixed(digits)} %` : NONE;
}

/** @param {number | null | undefined} value @param {number} [digits] */
export function fixed(value, digits = 2) {
  return isNumber(value) ? value.toFixed(digits) : NONE;
}

/** @param {number | null | undefined} value */
export function seconds(value) {
  return isNumber(value) ? `${value.toFixed(2)} s` : NONE;
}

/** @param {number | null | undefined} value */
export function milliseconds(value) {
  return isNumber(value) ? `${value.toFixed(0)} ms` : NONE;
}

/** @param {string} text of ISO 8601 */
export function moment(text) {
  const at = new Date(text);
  return at.toLocaleString(undefined, { dateStyle: 'medium', timeStyle: 'short' });
}

/** @param {string} text of ISO 8601 */
export function ago(text) {
  const past = Math.max(0, (Date.now() - new Date(text).getTime()) / 1000);
  if (past < 60) return 'just now';
  if (past < 3600) return `${Math.floor(past / 60)} min ago`;
  if (past < 86400) return `${Math.floor(past / 3600)} h ago`;
  return moment(text);
}

/** @param {number} count @param {string} one @param {string} [many] */
export function counted(count, one, many = `${one}s`) {
  return `${count.toLocaleString()} ${count === 1 ? one : many}`;
}

/** @param {unknown} value @returns {value is number} */
function isNumber(value) {
  return typeof value === 'number' && Number.isFinite(value);
}
