/** Opening a recording: a file, dropped or chosen, or a session of the server; how its numbers are meant. */

import { Problem, all, at } from './api.js';
import { button, field, fill, h, offer, select } from './elements.js';
import { ago, counted } from './figures.js';
import { GROUND, extent, grounded } from './recording.js';
import { Unreadable, ofSession, open } from './recording_file.js';
import { problemBox, word } from './words.js';

/** @typedef {import('./recording_file.js').Opened} Opened */

const UNITS = /** @type {[string, string][]} */ ([['m', 'metres'], ['cm', 'centimetres'], ['mm', 'millimetres']]);
const AXES = /** @type {[string, string][]} */ ([['z', 'Z up'], ['y', 'Y up']]);

/** Tells of `open` for another recording, of `change` where its numbers or tracks mean something else. */
export class Opening extends EventTarget {
  constructor() {
    super();
    /** @type {Opened | null} */
    this.recording = null;
    /** @type {string[]} */
    this.roles = [];
    this.file = h('input', { type: 'file', hidden: true, onchange: () => this.file.files[0] && this.take(this.file.files[0]) });
    this.trouble = h('div');
    this.drop = h('div.drop', {}, h('span', {}, 'Drop a recording here'), button('Open a file…', () => this.file.click(), { class: 'main' }), this.file,
      h('small', {}, 'CSV (t, hand.x, hand.y, hand.z, NAME.x, …) and JSON are read in this page; C3D and other motion-capture files by the server.'));
    this.sessions = select([['', 'choose…']], '', { 'aria-label': 'Finished session', onchange: () => this.#openSession() });
    this.unit = select(UNITS, 'm', { onchange: () => this.#ground() });
    this.axis = select(AXES, 'z', { onchange: () => this.#ground() });
    this.height = h('input', { type: 'number', step: 'any', placeholder: 'as the model', onchange: () => this.#ground() });
    this.reach = h('small');
    this.tracks = h('tbody');
    this.about = h('div', { hidden: true, class: 'panel-part' }, this.#aboutParts());
    this.element = h('section.panel.open', {}, h('h2', {}, 'Recording'), this.drop, this.trouble, field('or the recording of a session', this.sessions), this.about);
    this.#takeDrops();
  }

  #aboutParts() {
    this.title = h('h3');
    this.notes = h('div');
    return [h('hr'), this.title, this.notes, h('div.row', {}, field('Its unit', this.unit), field('Its axes', this.axis), field('Table height [m]', this.height)), this.reach,
      h('div.scroll.all-tracks', {}, h('table.tracks', {}, h('thead', {}, h('tr', {}, h('th', { scope: 'col' }, 'Track'), h('th', { scope: 'col' }, 'Use as ', word('role', '?')))), this.tracks))];
  }

  /** Offer the sessions that have ended. @param {string | null} chosen */
  async loadSessions(chosen) {
    try {
      this.found = (await all(at('sessions'), 'sessions', 100)).filter((session) => session.state !== 'active' && session.frames_kept && session.frames > 1);
    } catch (error) {
      return fill(this.trouble, problemBox(error));
    }
    const options = this.found.map((session) => [session.id, `${session.name || session.id.slice(0, 6)} · ${counted(session.segments, 'segment')} · ${ago(session.created_at)}`]);
    offer(this.sessions, [['', this.found.length ? 'choose…' : 'none has ended yet'], .../** @type {[string, string][]} */ (options)], chosen || '');
    return chosen ? this.#openSession() : undefined;
  }

  /** @param {File} file @param {import('./recording.js').Geometry | null} [declared] */
  async take(file, declared = null) {
    await this.#try(() => open(file, declared), (error) => silentOfGeometry(error) && this.#declare(file));
    this.file.value = '';
    this.sessions.value = '';
  }

  /** Open again what was left. @param {Opened} recording */
  restore(recording) {
    this.recording = recording;
    this.#show();
  }

  /** The roles of the model that is chosen. @param {string[]} roles */
  offerRoles(roles) {
    this.roles = roles;
    const { recording } = this;
    if (!recording) return;
    const free = roles.filter((role) => !Object.values(recording.objects).includes(role));
    const others = Object.keys(recording.objects).filter((track) => !roles.includes(recording.objects[track]));
    if (roles.length === 1 && free.length === 1 && others.length === 1) recording.objects[others[0]] = free[0];
    this.#showTracks();
  }

  async #openSession() {
    const session = this.found?.find((each) => each.id === this.sessions.value);
    if (session) await this.#try(() => ofSession(session));
  }

  /** Fields for what a file does not say of its numbers. @param {File} file */
  #declare(file) {
    const [unit, axis] = [select(UNITS, 'mm'), select(AXES, 'z')];
    const again = button('Read it so', () => this.take(file, { length_unit: unit.value, up_axis: axis.value }), { class: 'main' });
    return h('div.panel-part', {}, h('div.row', {}, field('Its unit', unit), field('Its axes', axis)), again);
  }

  /** @param {() => Promise<Opened>} read @param {(error: unknown) => any} [remedy] */
  async #try(read, remedy = () => null) {
    fill(this.trouble, h('p.soft', { role: 'status' }, 'reading…'));
    try {
      this.recording = await read();
      fill(this.trouble);
      this.#show();
    } catch (error) {
      const text = error instanceof Unreadable ? new Error(`This file cannot be read: ${error.message}`) : error;
      fill(this.trouble, problemBox(text), remedy(error));
    }
  }

  #show() {
    const { recording } = this;
    if (!recording) return;
    const geometry = recording.geometry || recording.meant || guessed(recording);
    this.unit.value = geometry.length_unit;
    this.axis.value = geometry.up_axis;
    this.unit.disabled = this.axis.disabled = recording.geometry !== null;
    this.about.hidden = false;
    this.title.textContent = recording.name;
    const { t, notes } = recording;
    const told = `${t.length.toLocaleString()} frames, ${(t[t.length - 1] - t[0]).toFixed(1)} s`;
    const further = notes.length > 0 && h('details', {}, h('summary', {}, 'How it was read'), h('ul', {}, notes.map((note) => h('li.hint', {}, note))));
    fill(this.notes, h('p.hint', {}, told), further);
    this.height.value = recording.tableHeight === null ? '' : String(recording.tableHeight);
    this.offerRoles(this.roles);
    this.#ground('open');
  }

  /** @param {unknown} [kind] */
  #ground(kind) {
    const { recording } = this;
    if (!recording) return;
    recording.tableHeight = this.height.value === '' ? null : Number(this.height.value);
    recording.meant = { length_unit: this.unit.value, up_axis: this.axis.value };
    recording.tracks = grounded(recording.raw, recording.meant);
    const sides = extent(/** @type {Float64Array} */ (recording.tracks.get(recording.hand)));
    this.reach.textContent = `So the hand moves within ${sides.map((side) => side.toFixed(2)).join(' × ')} m (the last is the height).`;
    this.dispatchEvent(new Event(kind === 'open' ? 'open' : 'change'));
  }

  #showTracks() {
    const { recording, roles } = this;
    if (!recording) return;
    const used = (/** @type {string} */ name) => name === recording.hand || name in recording.objects;
    const names = [...recording.raw.keys()];
    fill(this.tracks, [...names.filter(used), ...names.filter((name) => !used(name))].map((name) => {
      const own = name === 'hand' ? [] : [name];
      const uses = [['', 'not used'], ['/hand', 'the hand'], ...new Set([...roles, ...own])].map((use) => (Array.isArray(use) ? use : [use, use]));
      const value = name === recording.hand ? '/hand' : recording.objects[name] ?? '';
      const made = select(/** @type {[string, string][]} */ (uses), value, { 'aria-label': `Use ${name} as`, onchange: () => this.#use(name, made.value) });
      return h('tr', {}, h('td', {}, name), h('td', {}, made));
    }));
  }

  /** @param {string} track @param {string} use */
  #use(track, use) {
    const recording = /** @type {Opened} */ (this.recording);
    delete recording.objects[track];
    if (use === '/hand') {
      delete recording.objects[track];
      recording.hand = track;
    } else if (use) {
      for (const [other, role] of Object.entries(recording.objects)) if (role === use) delete recording.objects[other];
      recording.objects[track] = use;
    }
    this.#showTracks();
    this.#ground();
  }

  #takeDrops() {
    const over = (/** @type {DragEvent} */ event, /** @type {boolean} */ is) => (event.preventDefault(), this.drop.classList.toggle('over', is));
    this.element.addEventListener('dragover', (/** @type {DragEvent} */ event) => over(event, true));
    this.element.addEventListener('dragleave', (/** @type {DragEvent} */ event) => over(event, false));
    this.element.addEventListener('drop', (/** @type {DragEvent} */ event) => {
      over(event, false);
      const file = event.dataTransfer?.files[0];
      if (file) this.take(file);
    });
  }
}

/** Whether a file was refused for not saying its unit or its axes. @param {unknown} error */
function silentOfGeometry(error) {
  return error instanceof Problem && error.errors.some(({ code }) => code === 'undeclared_geometry');
}

/** Return how numbers may be meant: hands move within metres. @param {Opened} recording */
function guessed(recording) {
  const widest = Math.max(...extent(/** @type {Float64Array} */ (recording.raw.get(recording.hand))));
  return { ...GROUND, length_unit: widest > 100 ? 'mm' : widest > 10 ? 'cm' : 'm' };
}
