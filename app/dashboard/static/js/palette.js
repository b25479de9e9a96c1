/** Colours: those of action classes, and what the style sheets say, for canvases. */

const N_COLOURS = 8;

/** @type {Map<string, number>} */
const numbers = new Map();
/** @type {Map<string, string>} */
let resolved = new Map();
const probe = document.createElement('span');

/** Tells of `change` when light became dark or the other way round. */
export const theme = new EventTarget();

/**
 * Let classes have colours in this order, as far as they have none yet.
 * @param {Iterable<string>} actions
 */
export function meet(actions) {
  for (const action of actions) if (!numbers.has(action)) numbers.set(action, numbers.size);
}

/**
 * Return the name of the colour of an action class, `rest` or null (unknown).
 * @param {string | null} action
 */
export function nameOf(action) {
  if (action === null || action === '') return '--unknown';
  if (action === 'rest') return '--rest';
  meet([action]);
  return `--class-${/** @type {number} */ (numbers.get(action)) % N_COLOURS}`;
}

/** @param {string | null} action */
export function styleOf(action) {
  return { '--colour': `var(${nameOf(action)})` };
}

/** @param {string | null} action */
export function wordOf(action) {
  return action === null ? 'unknown' : action;
}

/**
 * Return a colour of the style sheets as `rgb(…)`.
 * @param {string} name
 * @returns {string}
 */
export function colour(name) {
  let found = resolved.get(name);
  if (found === undefined) {
    if (!probe.isConnected) document.body.append(probe), (probe.hidden = true);
    probe.style.color = `var(${name})`;
    found = getComputedStyle(probe).color;
    resolved.set(name, found);
  }
  return found;
}

/**
 * Return a colour as red, green and blue in 0..1.
 * @param {string} name
 * @returns {[number, number, number]}
 */
export function parts(name) {
  const found = (colour(name).match(/[\d.]+/g) || ['0', '0', '0']).slice(0, 3).map((text) => Number(text) / 255);
  return [found[0], found[1], found[2]];
}

/** Change between light and dark. */
export function toggleTheme() {
  const { dataset } = document.documentElement;
  dataset.theme = isDark() ? 'light' : 'dark';
  localStorage.setItem('gesta.theme', dataset.theme);
  changed();
}

/** Whether the page is dark now. */
export function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
}

function changed() {
  resolved = new Map();
  theme.dispatchEvent(new Event('change'));
}

matchMedia('(prefers-color-scheme: dark)').addEventListener('change', changed);
