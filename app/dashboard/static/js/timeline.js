/** Segments over time in lanes: one can be edited, the others show what models say. */

import { button, fill, h } from './elements.js';
import { styleOf, wordOf } from './palette.js';

/** @typedef {import('./labels.js').Labels} Labels */
/** @typedef {{action: string | null, start: number, end: number}} Block */

export class Timeline {
  /** @param {Labels} labels @param {(time: number) => void} onSeek */
  constructor(labels, onSeek) {
    this.labels = labels;
    this.onSeek = onSeek;
    this.begin = 0;
    this.end = 1;
    /** @type {Block[]} */
    this.blocks = [];
    this.title = '';
    this.ruler = h('div.ruler', { 'aria-hidden': 'true' });
    this.truth = h('div.lane', { role: 'group', 'aria-label': 'Truth: segments that you can edit' });
    this.said = h('div.lane', { role: 'group', 'aria-label': 'What the model says' });
    this.saidName = h('span', {}, 'model');
    this.playhead = h('div.playhead');
    this.element = h('div.timeline', {}, this.ruler, h('div.lane-name', {}, this.saidName), this.said, h('div.lane-name', {}, h('span', {}, 'truth (yours: drag its boundaries)')), this.truth, this.playhead);
    for (const place of [this.ruler, this.truth, this.said]) place.addEventListener('pointerdown', (/** @type {PointerEvent} */ event) => this.#press(event, place));
    labels.addEventListener('change', () => this.#drawTruth());
  }

  /** @param {number} begin @param {number} end [s] */
  look(begin, end) {
    Object.assign(this, { begin, end });
    this.#drawRuler();
    this.#drawTruth();
    this.tell(this.blocks, this.title);
  }

  /** @param {Block[]} blocks @param {string} title */
  tell(blocks, title) {
    Object.assign(this, { blocks, title });
    this.saidName.textContent = title || 'model: nothing asked yet';
    fill(this.said, blocks.filter((block) => this.#seen(block)).map((block) => this.#block(block, () => this.onSeek(block.start))));
  }

  /** @param {number} time [s] */
  point(time) {
    const share = this.#share(time);
    this.playhead.style.left = `${100 * share}%`;
    this.playhead.hidden = share < 0 || share > 1;
  }

  /** @param {number} time */
  #share(time) {
    return (time - this.begin) / Math.max(this.end - this.begin, 1e-6);
  }

  /** Whether a block is in the time that is shown. @param {{start: number, end: number}} block */
  #seen({ start, end }) {
    return end >= this.begin && start <= this.end;
  }

  /** @param {number} clientX */
  #timeAt(clientX) {
    const { left, width } = this.ruler.getBoundingClientRect();
    return this.begin + ((clientX - left) / width) * (this.end - this.begin);
  }

  /** @param {PointerEvent} event @param {HTMLElement} place */
  #press(event, place) {
    if (event.target !== place && place !== this.ruler) return;
    place.setPointerCapture(event.pointerId);
    const move = (/** @type {PointerEvent} */ at) => this.onSeek(this.#timeAt(at.clientX));
    move(event);
    place.addEventListener('pointermove', move);
    place.addEventListener('lostpointercapture', () => place.removeEventListener('pointermove', move), { once: true });
  }

  /** @param {Block} block @param {() => void} onclick @param {Record<string, any>} [properties] */
  #block({ action, start, end }, onclick, properties = {}) {
    const left = this.#share(start);
    const told = `${wordOf(action)}, ${start.toFixed(2)} to ${end.toFixed(2)} s`;
    return button(wordOf(action), onclick, { class: 'block', title: told, 'aria-label': told, style: { ...styleOf(action), left: `${100 * left}%`, width: `${100 * (this.#share(end) - left)}%` }, ...properties });
  }

  #drawTruth() {
    if (this.dragging) return this.#moveTruth();
    const { all, chosen } = this.labels;
    const focused = /** @type {HTMLElement | null} */ (document.activeElement)?.dataset.truth;
    const shown = [...all.keys()].filter((number) => this.#seen(all[number]));
    const blocks = shown.map((number) => this.#block(all[number], () => this.labels.choose(number), { 'aria-pressed': String(number === chosen), data: { truth: `block-${number}` } }));
    const boundaries = shown.flatMap((number) => [this.#boundary(number, 'start'), this.#boundary(number, 'end')]);
    fill(this.truth, blocks, boundaries);
    if (focused) this.truth.querySelector(`[data-truth="${focused}"]`)?.focus();
    return undefined;
  }

  /** Move what is there, so that the pointer keeps what it has taken hold of. */
  #moveTruth() {
    this.labels.all.forEach((label, number) => {
      const [left, right] = [this.#share(label.start), this.#share(label.end)];
      const block = this.truth.querySelector(`[data-truth="block-${number}"]`);
      if (!block) return;
      Object.assign(block.style, { left: `${100 * left}%`, width: `${100 * (right - left)}%` });
      for (const side of /** @type {('start' | 'end')[]} */ (['start', 'end'])) {
        const boundary = this.truth.querySelector(`[data-truth="${side}-${number}"]`);
        boundary.style.left = `${100 * this.#share(label[side])}%`;
        boundary.setAttribute('aria-valuenow', label[side].toFixed(3));
      }
    });
  }

  /** @param {number} number @param {'start' | 'end'} side */
  #boundary(number, side) {
    const label = this.labels.all[number];
    const made = h(`div.boundary.${side}`, {
      tabIndex: 0, role: 'slider', 'aria-label': `${side} of ${label.action}`, 'aria-valuenow': label[side].toFixed(3),
      'aria-valuemin': this.begin, 'aria-valuemax': this.end, 'aria-valuetext': `${label[side].toFixed(2)} s`,
      data: { truth: `${side}-${number}` }, style: { left: `${100 * this.#share(label[side])}%` },
    });
    made.addEventListener('pointerdown', (/** @type {PointerEvent} */ event) => this.#drag(event, made, number, side));
    made.addEventListener('keydown', (/** @type {KeyboardEvent} */ event) => this.#nudge(event, number, side));
    return made;
  }

  /** @param {PointerEvent} event @param {HTMLElement} made @param {number} number @param {'start' | 'end'} side */
  #drag(event, made, number, side) {
    event.preventDefault();
    event.stopPropagation();
    made.focus();
    made.setPointerCapture(event.pointerId);
    this.dragging = true;
    const move = (/** @type {PointerEvent} */ at) => {
      this.labels.move(number, side, this.#timeAt(at.clientX));
      this.onSeek(this.labels.all[number][side]);
    };
    made.addEventListener('pointermove', move);
    made.addEventListener('lostpointercapture', () => {
      made.removeEventListener('pointermove', move);
      this.dragging = false;
      this.labels.choose(number);
    }, { once: true });
  }

  /** @param {KeyboardEvent} event @param {number} number @param {'start' | 'end'} side */
  #nudge(event, number, side) {
    const direction = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!direction) return;
    event.preventDefault();
    event.stopPropagation();
    this.labels.nudge(number, side, direction * (event.shiftKey ? 10 : 1));
    this.onSeek(this.labels.all[number][side]);
  }

  #drawRuler() {
    const span = this.end - this.begin;
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60, 120, 300, 600].find((each) => span / each <= 9) || 1200;
    const marks = [];
    for (let time = Math.ceil(this.begin / step) * step; time < this.end; time += step) {
      marks.push(h('span', { style: { left: `${100 * this.#share(time)}%` } }, `${Number(time.toFixed(1))} s`));
    }
    fill(this.ruler, marks);
  }
}
