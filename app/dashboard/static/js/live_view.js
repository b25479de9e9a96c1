/** Live: who is streaming, and what is recognised while it happens. */

import { all, ask, at, pause } from './api.js';
import { Bars } from './bars.js';
import { fill, h } from './elements.js';
import { ago, counted, fixed, seconds } from './figures.js';
import { LiveModel } from './live_model.js';
import { LiveScene } from './live_scene.js';
import { listen } from './listening.js';
import { meet, styleOf, theme, wordOf } from './palette.js';
import { openStage } from './stage.js';
import { Strip } from './strip.js';
import { emptyBox, problemBox, word } from './words.js';

const LOOK_AGAIN_MS = 2000;
const ROWS = 60;
/** Frames come only from the process that a session lives in: so often another connection is tried. */
const TRIES = 20;
const SILENT_MS = 1200;

/** @type {import('./page.js').Show} */
export function showLive(host, query) {
  const view = new LiveView(host, query.get('session'));
  return { leave: () => view.leave(), keys: { f: () => view.stage?.fit() } };
}

class LiveView {
  strip = new Strip();
  classes = new Bars('How probable each class is now', true);
  goals = new Bars('Where the movement may go');
  redraw = () => this.#dirty();

  /** @param {HTMLElement} host @param {string | null} chosen */
  constructor(host, chosen) {
    this.left = new AbortController();
    this.listening = new AbortController();
    this.chosen = chosen;
    this.model = new LiveModel();
    /** @type {LiveScene | null} */
    this.scene = null;
    this.root = host;
    this.told = 0;
    this.asked = 0;
    this.updates = 0;
    this.#build(host);
    this.stage = openStage(this.place, 'The hand, the objects and the path of the hand over the table');
    theme.addEventListener('change', this.redraw);
    this.#watch();
  }

  leave() {
    this.left.abort();
    this.listening.abort();
    cancelAnimationFrame(this.asked);
    theme.removeEventListener('change', this.redraw);
    this.strip.dispose();
    this.stage?.dispose();
  }

  /** @param {HTMLElement} host */
  #build(host) {
    this.sessions = h('ul.choices', { 'aria-label': 'Running sessions' });
    this.none = h('div');
    this.place = h('div.stage');
    this.state = h('p.state', { role: 'status' }, 'Choose a session.');
    this.rows = h('tbody');
    this.announced = h('p.unseen', { 'aria-live': 'polite' });
    const heads = ['action', 'from', 'to', 'object', word('margin'), word('novelty')].map((head) => h('th', { scope: 'col' }, head));
    host.append(h('div.live', {},
      h('section.panel.sessions', {}, h('h2', {}, 'Running sessions'), this.sessions, this.none),
      h('section.panel.scene', {}, h('h2.unseen', {}, 'Scene'), this.place),
      h('section.panel.now', {}, h('h2', {}, 'Now'), this.state, h('h3', {}, 'It may be ', word('posterior', '?')), this.classes.element,
        h('h3', {}, 'It may go to'), this.goals.element),
      h('section.panel.past', {}, h('h2', {}, 'Recognised ', word('segment', 'segments')), this.strip.element,
        h('div.scroll', { tabIndex: 0, role: 'region', 'aria-label': 'Segments' }, h('table', {}, h('thead', {}, h('tr', {}, heads)), this.rows)), this.announced)));
  }

  /** Look again and again for those who stream. */
  async #watch() {
    const { signal } = this.left;
    while (!signal.aborted) {
      try {
        this.#list(await all(`${at('sessions')}?state=active`, 'sessions', 100));
      } catch (error) {
        if (!signal.aborted && !this.sessions.children.length) fill(this.none, problemBox(error));
      }
      await pause(LOOK_AGAIN_MS, signal);
    }
  }

  /** @param {any[]} sessions */
  #list(sessions) {
    if (this.left.signal.aborted) return;
    const empty = emptyBox('Nobody is streaming', 'Sessions appear here by themselves, whoever streams. To see one, stream a recording as if it happened now; without a model yet, `gesta demo` shows the whole line and leaves one behind.',
      [`gesta replay recording.csv --model table-top --url ${location.origin}`, 'gesta demo']);
    fill(this.none, sessions.length === 0 && empty);
    const focused = /** @type {HTMLElement | null} */ (document.activeElement)?.dataset.session;
    fill(this.sessions, sessions.map((session) => h('li', {}, this.#choice(session))));
    /** @type {HTMLElement | null} */ (this.sessions.querySelector(`[data-session="${focused}"]`))?.focus();
    if (this.joined) return;
    const first = sessions.find((session) => session.id === this.chosen) || sessions[0];
    if (first) this.#choose(first);
  }

  /** @param {any} session */
  #choice(session) {
    const { id, name, model, version, frames, created_at: created } = session;
    return h('button.choice', { type: 'button', onclick: () => this.#choose(session), data: { session: id }, 'aria-pressed': String(id === this.chosen) },
      h('strong', {}, name || `session ${id.slice(0, 6)}`), h('small', {}, `${model} v${version} · ${counted(frames, 'frame')} · ${ago(created)}`));
  }

  /** @param {any} session */
  async #choose(session) {
    this.joined = true;
    this.listening.abort();
    this.listening = new AbortController();
    this.chosen = session.id;
    for (const made of this.sessions.querySelectorAll('button')) made.setAttribute('aria-pressed', String(made.dataset.session === session.id));
    history.replaceState(null, '', `#/live?session=${session.id}`);
    this.model = new LiveModel();
    this.told = 0;
    this.classes.clear();
    this.goals.clear();
    fill(this.rows);
    this.scene?.remove();
    this.scene = this.stage && new LiveScene(this.stage, this.model, session);
    const { signal } = this.listening;
    const version = await ask(at('models', session.model, 'versions', session.version)).catch(() => ({ actions: [] }));
    meet(version.actions);
    this.classes.show([...version.actions, 'rest', null].map((name) => ({ name, value: 0 })));
    if (!signal.aborted) this.#listen(TRIES);
  }

  /** @param {number} tries how many connections may be tried until frames come */
  #listen(tries) {
    const { model, chosen } = this;
    this.listening.abort();
    this.listening = new AbortController();
    const { signal } = this.listening;
    const told = (/** @type {import('./listening.js').State} */ state, /** @type {unknown} */ error) => {
      if (signal.aborted) return;
      this.#tell(state, error);
      if (state === 'listening') this.#expectFrames(tries, signal);
    };
    listen(/** @type {string} */ (chosen), (event) => (model.hear(event), this.#dirty()), told, signal);
  }

  /** Try another connection where no frames come over this one. @param {number} tries @param {AbortSignal} signal */
  async #expectFrames(tries, signal) {
    const before = this.model.frames;
    await pause(SILENT_MS, signal);
    if (signal.aborted || this.model.frames > before || this.root.dataset.listening !== 'listening') return;
    if (tries > 1) this.#listen(tries - 1);
    else fill(this.state, 'No frames come: nobody sends any just now, or the session lives on another server. Its segments are told all the same.');
  }

  /** @param {import('./listening.js').State} state @param {unknown} [error] */
  #tell(state, error) {
    this.root.dataset.listening = state;
    const words = { listening: 'Listening.', returning: 'Cut off; coming back where it was…', ended: 'The session has ended.', refused: '' };
    fill(this.state, words[state], state === 'refused' && problemBox(error),
      state === 'ended' && h('a', { href: `#/recordings?session=${this.chosen}` }, ' Open its recording'));
    this.#dirty();
  }

  #dirty() {
    if (!this.asked && !this.left.signal.aborted) this.asked = requestAnimationFrame(() => this.#draw());
  }

  #draw() {
    this.asked = 0;
    const { model } = this;
    if (model.n) this.scene?.update();
    if (location.search !== '?s') this.strip.draw(model);
    const { hypothesis } = model;
    if (hypothesis) {
      this.classes.show(hypothesis.actions.map(({ action, posterior, progress }) => ({
        name: action, value: posterior, note: progress === null || posterior < 0.3 ? '' : `${Math.round(100 * progress)} % done`,
      })));
      this.goals.show((hypothesis.goals || []).map(({ name, posterior }) => ({ name, value: posterior })));
    }
    while (this.told < model.segments.length) this.#row(model.segments[this.told++]);
    this.updates += 1;
    Object.assign(this.root.dataset, { updates: this.updates, frames: model.frames, messages: model.messages });
  }

  /** @param {import('./live_model.js').Segment} segment */
  #row(segment) {
    const { action, t_start: start, t_end: end, objects, margin, novelty } = segment;
    const cells = [h('span.chip', { style: styleOf(action) }, wordOf(action)), seconds(start), seconds(end),
      Object.values(objects).join(', ') || '–', fixed(margin, 1), fixed(novelty, 2)];
    this.rows.prepend(h('tr', {}, cells.map((cell) => h('td', {}, cell))));
    if (this.rows.children.length > ROWS) this.rows.lastElementChild.remove();
    this.announced.textContent = `${wordOf(action)}, ${seconds(start)} to ${seconds(end)}`;
  }
}
