/** The page: which view is shown, theme, help, the state of the connection. */

import { connection, watchConnection } from './api.js';
import { button, fill, h } from './elements.js';
import { toggleTheme } from './palette.js';
import { emptyBox } from './words.js';

/**
 * A view fills an element and returns what takes it away again, and its keys.
 * @typedef {{leave: () => void, keys?: Record<string, (event: KeyboardEvent) => void>}} View
 * @typedef {(host: HTMLElement, query: URLSearchParams) => View} Show
 */

/** @type {Record<string, [string, () => Promise<Show>]>} */
const VIEWS = {
  live: ['Live', async () => (await import('./live_view.js')).showLive],
  recordings: ['Recordings', async () => (await import('./recordings_view.js')).showRecordings],
  models: ['Models', async () => (await import('./models_view.js')).showModels],
  generate: ['Generate', async () => (await import('./generate_view.js')).showGenerate],
};

/** @type {[string, [string, string][]][]} */
const HELP = [
  ['Everywhere', [['1 – 4', 'Live, Recordings, Models, Generate'], ['T', 'light or dark'], ['?', 'this help'],
    ['Tab', 'to the next control; Esc closes what is open']]],
  ['3-D scene', [['drag', 'turn'], ['wheel, pinch', 'nearer, farther'], ['right drag, two fingers', 'move'],
    ['arrow keys, + and −', 'turn, nearer, farther, once the scene has the focus'], ['F', 'see everything']]],
  ['Recordings', [['Space', 'play, pause'], ['← →', 'one frame; with Shift, ten'], ['Home, End', 'to the beginning, to the end'],
    ['N', 'new segment at the playhead'], ['[ and ]', 'let the chosen segment start, end at the playhead'],
    ['Delete, Z', 'remove the chosen segment; undo'], ['+ −', 'see less, more time around the playhead'], ['← → on a boundary', 'move it by a frame; with Shift, by ten']]],
  ['Generate', [['Space', 'play, pause'], ['S, G', 'clicks in the scene place the start, the goal']]],
];

const host = /** @type {HTMLElement} */ (document.getElementById('view'));
const help = /** @type {HTMLDialogElement} */ (document.getElementById('help'));
/** @type {View | null} */
let current = null;
let wanted = 0;

/** Show the view that the address names. */
async function route() {
  const [, name, query] = /^#\/(\w+)(?:\?(.*))?$/.exec(location.hash) || [];
  if (!(name in VIEWS)) {
    location.replace('#/live');
    return;
  }
  const turn = (wanted += 1);
  const [title, load] = VIEWS[name];
  document.title = `${title} · Gesta`;
  for (const link of document.querySelectorAll('nav a[data-view]')) {
    if (/** @type {HTMLElement} */ (link).dataset.view === name) link.setAttribute('aria-current', 'page');
    else link.removeAttribute('aria-current');
  }
  const show = await load();
  if (turn !== wanted) return;
  current?.leave();
  fill(host, h('h1.unseen', {}, title));
  host.dataset.view = name;
  try {
    current = show(host, new URLSearchParams(query));
  } catch (error) {
    current = null;
    fill(host, h('h1.unseen', {}, title), emptyBox('This view could not be shown', String(error)));
    throw error;
  }
  document.documentElement.dataset.ready = name;
  performance.mark('gesta:interactive');
}

/** @param {KeyboardEvent} event */
function onKey(event) {
  const target = /** @type {HTMLElement} */ (event.target);
  if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector('dialog[open]')) return;
  if (target.matches('input, select, textarea')) return;
  if (event.key === ' ' && target.matches('button, a, summary, [role=slider]')) return;
  const views = Object.keys(VIEWS);
  const own = current?.keys?.[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (own) own(event), event.preventDefault();
  else if (event.key >= '1' && event.key <= '4') location.hash = `#/${views[Number(event.key) - 1]}`;
  else if (event.key === '?') openHelp();
  else if (event.key.toLowerCase() === 't') toggleTheme();
}

function openHelp() {
  const groups = HELP.map(([title, keys]) => h('section', {}, h('h3', {}, title),
    h('dl', {}, keys.map(([key, does]) => [h('dt', {}, h('kbd', {}, key)), h('dd', {}, does)]).flat())));
  fill(help, h('h2', { id: 'help-title' }, 'What this page does'),
    h('p', {}, 'Gesta learns actions from demonstrations, recognises them while a hand moves, and makes new movements '
      + 'of the same kind. Live shows what is recognised now; Recordings is for looking at files and labelling them; '
      + 'Models compares what was trained and says which version robots use; Generate makes a movement. '
      + 'Words with a dotted line explain themselves when clicked.'),
    h('div.keys', {}, groups),
    h('p', {}, 'All of it goes over the public API: ', h('a', { href: 'v1/openapi.json', target: '_blank', rel: 'noopener' }, 'its description'), '.'),
    button('Close', () => help.close(), { autofocus: true }));
  help.showModal();
}

function showConnection() {
  const shown = /** @type {HTMLElement} */ (document.getElementById('connection'));
  shown.dataset.state = connection.state;
  shown.textContent = connection.state === 'good' ? 'connected' : connection.state === 'lost' ? 'no connection' : 'connecting';
}

connection.addEventListener('change', showConnection);
document.getElementById('theme')?.addEventListener('click', toggleTheme);
document.getElementById('help-open')?.addEventListener('click', openHelp);
document.addEventListener('keydown', onKey);
document.querySelector('.skip')?.addEventListener('click', (event) => (event.preventDefault(), host.focus()));
addEventListener('hashchange', route);
route();
watchConnection();
