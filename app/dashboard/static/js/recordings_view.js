/** Recordings: open one, look at it, have it segmented, correct the segments, learn from them. */

import { Chart } from './chart.js';
import { button, h } from './elements.js';
import { Labelling, known } from './labelling.js';
import { Labels } from './labels.js';
import { ModelChoice } from './model_choice.js';
import { Opening } from './opening.js';
import { Player } from './player.js';
import { frameAt, speeds } from './recording.js';
import { RecordingScene } from './recording_scene.js';
import { openStage } from './stage.js';
import { Timeline } from './timeline.js';

/** What was open when the view was left. @type {import('./recording_file.js').Opened | null} */
let left = null;

/** @type {import('./page.js').Show} */
export function showRecordings(host, query) {
  const view = new RecordingsView(host);
  view.choice.load(query.get('model'), query.get('version'));
  view.opening.loadSessions(query.get('session'));
  if (left && !query.get('session')) view.opening.restore(left);
  return { leave: () => view.leave(), keys: view.keys() };
}

class RecordingsView {
  /** Labels that are kept nowhere else would be lost. @param {Event} event */
  warn = (event) => this.labels.unsaved && event.preventDefault();

  /** @param {HTMLElement} host */
  constructor(host) {
    this.choice = new ModelChoice();
    this.labels = new Labels();
    this.opening = new Opening();
    this.player = new Player();
    this.timeline = new Timeline(this.labels, (time) => this.player.seek(time));
    this.chart = new Chart('speed of the hand [m/s]', (time) => this.player.seek(time));
    this.labelling = new Labelling(this.choice, this.labels, () => this.player.time);
    /** @type {RecordingScene | null} */
    this.scene = null;
    this.window = { from: 0, to: 1 };
    const place = h('div.stage');
    host.append(h('div.recordings', {}, this.opening.element, h('section.panel.scene', {}, h('h2.unseen', {}, 'Scene'), place), this.#time(), this.labelling.element));
    this.stage = openStage(place, 'The recording: the path of the hand, and where hand and objects are at the playhead');
    this.#connect();
  }

  leave() {
    left = this.opening.recording && { ...this.opening.recording, labels: this.labels.all };
    removeEventListener('beforeunload', this.warn);
    this.player.pause();
    this.labelling.leave();
    this.chart.dispose();
    this.scene?.remove();
    this.stage?.dispose();
  }

  keys() {
    const step = (/** @type {number} */ frames) => (/** @type {KeyboardEvent} */ event) => this.#step(frames * (event.shiftKey ? 10 : 1));
    const bound = (/** @type {'start' | 'end'} */ side) => () => this.labels.chosen >= 0 && this.labels.move(this.labels.chosen, side, this.player.time);
    return {
      ' ': () => this.player.toggle(), ArrowLeft: step(-1), ArrowRight: step(1), Home: () => this.player.seek(this.player.begin), End: () => this.player.seek(this.player.end),
      n: () => this.labelling.add(), Delete: () => this.labels.remove(), Backspace: () => this.labels.remove(), '[': bound('start'), ']': bound('end'),
      f: () => this.stage?.fit(), z: () => this.labels.undo(), '+': () => this.#zoom(0.5), '-': () => this.#zoom(2),
    };
  }

  #time() {
    const zoom = h('span.row', {}, button('−', () => this.#zoom(2), { class: 'icon small', title: 'See more time (−)', 'aria-label': 'See more time' }),
      button('+', () => this.#zoom(0.5), { class: 'icon small', title: 'See less time, around the playhead (+)', 'aria-label': 'See less time' }));
    this.player.element.append(zoom);
    return h('section.panel.time', {}, h('h2.unseen', {}, 'Timeline'), this.player.element, this.timeline.element, this.chart.element);
  }

  #connect() {
    addEventListener('beforeunload', this.warn);
    this.opening.addEventListener('open', () => this.#open());
    this.opening.addEventListener('change', () => this.#lay());
    this.player.addEventListener('time', () => this.#point());
    this.labels.addEventListener('change', () => this.#paint());
    this.labelling.addEventListener('found', () => this.#told());
    this.choice.addEventListener('change', () => this.opening.offerRoles(this.choice.model?.objects || []));
    this.timeline.look(0, 1);
  }

  #open() {
    const { recording } = this.opening;
    if (!recording) return;
    const { t, labels, segments } = recording;
    this.player.pause();
    this.player.time = t[0];
    this.window = { from: t[0], to: t[t.length - 1] };
    this.player.open(t[0], t[t.length - 1], 0.001);
    this.labels.open(t, labels);
    this.labelling.open(recording);
    this.#lay();
    this.#look(t[0], t[t.length - 1]);
    if (segments.length) this.#told();
    else this.timeline.tell([], '');
  }

  /** Lay tracks out anew: they are others, or mean something else. */
  #lay() {
    const { recording } = this.opening;
    if (!recording) return;
    this.scene?.remove();
    this.scene = this.stage && new RecordingScene(this.stage, recording, () => (this.labels.all.length ? this.labels.all : known(recording)), () => this.window);
    const hand = /** @type {Float64Array} */ (recording.tracks.get(recording.hand));
    this.chart.show(recording.t, [{ values: speeds(recording.t, hand), colour: '--accent', label: 'speed' }], [this.window.from, this.window.to]);
    this.#point();
  }

  /** @param {number} from @param {number} to [s] */
  #look(from, to) {
    this.window = { from, to };
    this.timeline.look(from, to);
    this.chart.look(from, to);
    this.#paint();
    this.#point();
  }

  /** @param {number} factor */
  #zoom(factor) {
    const { begin, end, time } = this.player;
    const span = Math.min((this.window.to - this.window.from) * factor, end - begin);
    const from = Math.min(Math.max(time - span / 2, begin), end - span);
    this.#look(from, from + span);
  }

  #point() {
    const { time, begin, end } = this.player;
    const { from, to } = this.window;
    if (this.opening.recording && (time < from || time > to)) {
      const start = Math.min(Math.max(time - (to - from) / 10, begin), end - (to - from));
      this.#look(start, start + to - from);
      return;
    }
    this.timeline.point(time);
    this.chart.point(time);
    this.scene?.point(time);
  }

  /** @param {number} frames */
  #step(frames) {
    const t = this.opening.recording?.t;
    if (!t) return;
    this.player.pause();
    this.player.seek(t[Math.min(Math.max(frameAt(t, this.player.time) + frames, 0), t.length - 1)]);
  }

  #paint() {
    if (!this.painting) this.painting = requestAnimationFrame(() => ((this.painting = 0), this.scene?.paint()));
  }

  #told() {
    const segments = this.opening.recording?.segments || [];
    const blocks = segments.map(({ action, t_start: start, t_end: end }) => ({ action, start, end }));
    const version = segments[0]?.version;
    this.timeline.tell(blocks, version ? `model: what version ${version} says` : 'model: it found no action');
    this.#paint();
  }
}
