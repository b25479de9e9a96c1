/** The labels of a recording while they are edited. They lie in order and never overlap; ends are frames. */

import { frameAt } from './recording.js';

/** @typedef {import('./recording.js').Label} Label */
/** @typedef {'start' | 'end'} Side */

export class Labels extends EventTarget {
  constructor() {
    super();
    /** @type {Label[]} */
    this.all = [];
    this.chosen = -1;
    this.t = new Float64Array([0, 1]);
    this.unsaved = false;
    /** @type {Label[][]} what was before, to be undone */
    this.before = [];
  }

  /** @param {Float64Array} t @param {Label[]} labels */
  open(t, labels) {
    Object.assign(this, { t, before: [], unsaved: false });
    this.#set(labels, -1);
  }

  /** @param {Label[]} labels instead of those there are */
  replace(labels) {
    this.#remember();
    this.#set(labels, -1);
  }

  /** @param {number} number */
  choose(number) {
    this.chosen = number;
    this.#tell();
  }

  /** Choose the label at a time. @param {number} time [s] */
  chooseAt(time) {
    this.choose(this.all.findIndex(({ start, end }) => start <= time && time <= end));
  }

  /**
   * Add a label at a time, as long as there is room for, half a second at most.
   * @param {string} action @param {number} time [s]
   * @returns {boolean} whether there was room
   */
  add(action, time) {
    const next = this.all.findIndex((label) => label.end > time);
    const number = next === -1 ? this.all.length : next;
    const start = this.#snap(Math.max(time, this.all[number - 1]?.end ?? this.t[0]));
    const end = this.#snap(Math.min(start + 0.5, this.all[number]?.start ?? this.t[this.t.length - 1]));
    if (!(end > start)) return false;
    this.#remember();
    this.#set(this.all.toSpliced(number, 0, { action, start, end }), number);
    return true;
  }

  /** Remove the chosen label. */
  remove() {
    if (this.chosen < 0) return;
    this.#remember();
    this.#set(this.all.toSpliced(this.chosen, 1), Math.min(this.chosen, this.all.length - 2));
  }

  /** @param {string} action of the chosen label */
  name(action) {
    if (this.chosen < 0 || !action) return;
    this.#remember();
    this.all[this.chosen].action = action;
    this.#tell();
  }

  /** @param {number} number @param {Side} side @param {number} time [s] */
  move(number, side, time) {
    const { t, all } = this;
    const label = all[number];
    const frame = frameAt(t, time);
    const low = frameAt(t, side === 'start' ? all[number - 1]?.end ?? t[0] : label.start);
    const high = frameAt(t, side === 'start' ? label.end : all[number + 1]?.start ?? t[t.length - 1]);
    const within = side === 'start' ? Math.min(Math.max(frame, low), high - 1) : Math.max(Math.min(frame, high), low + 1);
    if (this.moving !== `${number} ${side}`) this.#remember();
    this.moving = `${number} ${side}`;
    label[side] = t[within];
    this.#tell();
  }

  /** @param {number} number @param {Side} side @param {number} frames */
  nudge(number, side, frames) {
    const frame = frameAt(this.t, this.all[number][side]) + frames;
    this.move(number, side, this.t[Math.min(Math.max(frame, 0), this.t.length - 1)]);
  }

  undo() {
    const last = this.before.pop();
    if (last) this.#set(last, -1);
  }

  /** @param {number} time */
  #snap(time) {
    return this.t[frameAt(this.t, time)];
  }

  /** What there is now is kept elsewhere, too. */
  saved() {
    this.unsaved = false;
  }

  #remember() {
    this.unsaved = true;
    this.before.push(this.all.map((label) => ({ ...label })));
    if (this.before.length > 100) this.before.shift();
    this.moving = '';
  }

  /** @param {Label[]} labels @param {number} chosen */
  #set(labels, chosen) {
    this.all = labels.map((label) => ({ ...label }));
    this.chosen = chosen;
    this.moving = '';
    this.#tell();
  }

  #tell() {
    this.dispatchEvent(new Event('change'));
  }
}
