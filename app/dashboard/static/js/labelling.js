/** What is done with the labels of a recording: asked of a version, named, saved as demonstrations, measured. */

import { ask, at, send } from './api.js';
import { confusionTable } from './confusion.js';
import { button, field, fill, h, offerFile, tell } from './elements.js';
import { counted, fixed, milliseconds, percent, seconds } from './figures.js';
import { JobBar, answerOf } from './jobs.js';
import { GROUND, asTrajectory } from './recording.js';
import { problemBox, word } from './words.js';

/** @typedef {import('./model_choice.js').ModelChoice} ModelChoice */
/** @typedef {import('./labels.js').Labels} Labels */
/** @typedef {import('./recording.js').Recording} Recording */

/** Tells of `found` when a version has said its segments. */
export class Labelling extends EventTarget {
  /** @param {ModelChoice} choice @param {Labels} labels @param {() => number} now where the playhead is */
  constructor(choice, labels, now) {
    super();
    this.choice = choice;
    this.labels = labels;
    this.now = now;
    /** @type {Recording | null} */
    this.recording = null;
    this.left = new AbortController();
    this.job = new JobBar();
    this.trouble = h('div');
    this.result = h('div');
    this.action = h('input', { list: 'actions', 'aria-label': 'Action of the chosen segment', placeholder: 'action', onchange: () => labels.name(this.action.value.trim()) });
    this.span = h('small');
    this.segment = button('Find the segments', () => this.#run(() => this.#segment()), { class: 'main' });
    this.copy = button('Take over as truth', () => labels.replace(known(this.recording)), { title: 'Copies what the model says into the lane that you can edit' });
    this.save = button('Save as demonstrations', () => this.#run(() => this.#save()));
    this.keep = button('Download', () => this.#download(), { title: 'Recording and labels as a JSON file, which this page opens again' });
    this.measure = button('Compare with the truth', () => this.#run(() => this.#evaluate()));
    this.adder = button('New segment', () => this.add(), { title: 'At the playhead (N)' });
    this.remover = button('Remove', () => labels.remove(), { class: 'danger', title: 'The chosen segment (Delete)' });
    this.undoer = button('Undo', () => labels.undo(), { title: 'Z' });
    this.actions = h('datalist', { id: 'actions' });
    this.element = h('section.panel.labels', {}, h('h2', {}, 'Recognise and label'), choice.element, this.#parts(), this.job.element, this.trouble, this.result);
    labels.addEventListener('change', () => this.#show());
    choice.addEventListener('change', () => this.#show());
  }

  #parts() {
    return [h('div.row', {}, this.segment, this.copy), h('hr'), h('h3', {}, 'Truth'), field('Action', this.action), this.actions, this.span,
      h('div.row', {}, this.adder, this.remover, this.undoer), h('div.row', {}, this.save, this.measure, this.keep)];
  }

  /** @param {Recording} recording */
  open(recording) {
    this.recording = recording;
    fill(this.trouble);
    fill(this.result);
    this.job.element.hidden = true;
    this.#show();
  }

  /** Add a segment at the playhead. */
  add() {
    const action = this.action.value.trim() || this.choice.version?.actions[0] || 'action';
    if (!this.labels.add(action, this.now())) tell('There is no room for a segment here: another one is in the way.', 'bad');
    else this.action.select(), this.action.focus();
  }

  leave() {
    this.left.abort();
  }

  #show() {
    const { labels, recording, choice } = this;
    const chosen = labels.all[labels.chosen];
    if (document.activeElement !== this.action || chosen) this.action.value = chosen?.action ?? '';
    this.span.textContent = chosen ? `${seconds(chosen.start)} to ${seconds(chosen.end)}` : labels.all.length ? 'Choose a segment in the lower lane to name or remove it.' : 'No segments yet: take over what the model finds, or add one at the playhead.';
    fill(this.actions, (choice.version?.actions || []).map((/** @type {string} */ action) => h('option', { value: action })));
    const ready = Boolean(recording);
    this.segment.disabled = !ready || !choice.version;
    this.copy.disabled = !known(recording).length;
    this.save.disabled = !labels.all.length || !choice.model;
    this.measure.disabled = !labels.all.length || !choice.version;
    this.adder.disabled = this.keep.disabled = !ready;
    this.remover.disabled = !chosen;
    this.undoer.disabled = !labels.before.length;
  }

  /** @param {() => Promise<void>} work */
  async #run(work) {
    fill(this.trouble);
    this.element.setAttribute('aria-busy', 'true');
    try {
      await work();
    } catch (error) {
      if (!this.left.signal.aborted) fill(this.trouble, problemBox(error));
    }
    this.element.removeAttribute('aria-busy');
    this.#show();
  }

  async #segment() {
    const recording = /** @type {Recording} */ (this.recording);
    const body = { ...this.#ground(), trajectory: asTrajectory(recording) };
    const response = await send(this.choice.address('segmentations'), { body, signal: this.left.signal });
    const { segments } = await answerOf(response, (job) => this.job.show(job), this.left.signal);
    recording.segments = segments;
    this.dispatchEvent(new Event('found'));
    tell(`${counted(segments.length, 'segment')} found by version ${this.choice.version.version}.`);
  }

  async #save() {
    const body = { ...this.#ground(), recording: this.#labelled() };
    const { created, duplicates } = await ask(at('models', this.choice.model.name, 'demonstrations'), { body });
    this.labels.saved();
    const known = duplicates.length ? `, ${duplicates.length} were known already` : '';
    tell(`${counted(created.length, 'demonstration')} saved for ${this.choice.model.name}${known}.`);
    fill(this.result, h('p.fine', {}, `${counted(created.length, 'demonstration')} saved${known}. `, h('a', { href: `#/models?model=${encodeURIComponent(this.choice.model.name)}` }, 'Train a version with them')));
  }

  async #evaluate() {
    const body = { ...this.#ground(), recording: this.#labelled() };
    const response = await send(this.choice.address('evaluations'), { body, signal: this.left.signal });
    fill(this.result, measures(await answerOf(response, (job) => this.job.show(job), this.left.signal)));
  }

  #download() {
    const recording = /** @type {Recording} */ (this.recording);
    const text = JSON.stringify({ ...this.#ground(), recording: this.#labelled() });
    offerFile(new Blob([text], { type: 'application/json' }), `${recording.name.replace(/\.\w+$/, '')}-labelled.json`);
    this.labels.saved();
  }

  #ground() {
    const height = this.recording?.tableHeight;
    return { geometry: GROUND, ...(height === null || height === undefined ? {} : { scene: { table_height_m: height } }) };
  }

  #labelled() {
    const segments = this.labels.all.map(({ action, start, end }) => ({ action, start_s: start, end_s: end }));
    return { trajectory: asTrajectory(/** @type {Recording} */ (this.recording)), segments };
  }
}

/**
 * Return the segments of a model that have a class, as labels.
 * @param {Recording | null} recording
 */
export function known(recording) {
  const named = (recording?.segments || []).filter((segment) => segment.action !== null);
  return named.map(({ action, t_start: start, t_end: end }) => ({ action, start, end }));
}

/** @param {any} told */
function measures(told) {
  const rows = [
    ['true and found segments', `${told.n_true} / ${told.n_found}`], [word('delineated'), percent(told.delineated)],
    [word('f1', 'F1@50'), fixed(told.f1_50)], [word('f1', 'F1@75'), fixed(told.f1_75)], [word('frames'), percent(told.frame_accuracy)],
    [word('boundary'), milliseconds(told.median_boundary_error_ms)],
  ];
  const classes = Object.keys(told.per_class);
  return h('div.measures', {}, h('h3', {}, `Version ${told.version} against the truth`),
    h('dl.figures', {}, rows.flatMap(([name, value]) => [h('dt', {}, name), h('dd', {}, value)])),
    h('h3', {}, word('confusion', 'Confusion matrix')), confusionTable([...classes, 'extra'], [...classes, 'missed'], told.confusion));
}
