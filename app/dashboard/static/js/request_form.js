/** What a generation asks for, as fields. */

import { field, h, select } from './elements.js';
import { word } from './words.js';

/** Tells of `change` whenever what is asked for has changed. */
export class RequestForm extends EventTarget {
  constructor() {
    super();
    const changed = () => this.dispatchEvent(new Event('change'));
    this.start = [0, 1, 2].map(() => coordinate(changed));
    this.goal = [0, 1, 2].map(() => coordinate(changed));
    this.duration = optional(changed, 'as shown', 0.05, 0.1);
    this.velocity = optional(changed, 'none', 0.01, 0.1);
    this.acceleration = optional(changed, 'none', 0.01, 0.5);
    this.rate = h('input', { type: 'number', min: 1, max: 1000, step: 1, value: 100, required: true, onchange: changed });
    this.method = select([['default', 'this project’s'], ['paper', 'the paper’s plain one']], 'default', { onchange: changed });
    this.element = h('div.panel-part', {}, triple('Start [m]', this.start), triple('Goal [m]', this.goal),
      h('div.row.end', {}, field('Duration [s]', this.duration), field('Rate [Hz]', this.rate)),
      h('fieldset', {}, h('legend', {}, 'Robot ', word('via', 'limits')), h('div.row.end', {}, field('speed [m/s]', this.velocity), field('acceleration [m/s²]', this.acceleration))),
      field('Method', this.method));
  }

  /** @param {'start' | 'goal'} end */
  place(end) {
    return this[end].map((input) => Number(input.value) || 0);
  }

  /** @param {'start' | 'goal'} end @param {number[]} place */
  put(end, place) {
    this[end].forEach((input, axis) => (input.value = String(Number(place[axis].toFixed(3)))));
  }

  /** Whether every field makes sense. */
  get sound() {
    const inputs = [...this.start, ...this.goal, this.duration, this.velocity, this.acceleration, this.rate];
    return inputs.every((input) => input.checkValidity());
  }

  /** The body of the request. */
  get body() {
    const given = (/** @type {HTMLInputElement} */ input, /** @type {string} */ name) => (input.value ? { [name]: Number(input.value) } : {});
    const limits = { ...given(this.velocity, 'velocity_m_s'), ...given(this.acceleration, 'acceleration_m_s2') };
    return { start: this.place('start'), goal: this.place('goal'), rate_hz: Number(this.rate.value), method: this.method.value, limits, ...given(this.duration, 'duration_s') };
  }
}

/** @param {() => void} changed @returns {HTMLInputElement} */
function coordinate(changed) {
  const made = h('input', { type: 'number', step: 'any', min: -100, max: 100, required: true, value: 0, oninput: changed });
  stepping(made, -100, 0.01, changed);
  return made;
}

/** @param {() => void} changed @param {string} placeholder @param {number} min @param {number} step @returns {HTMLInputElement} */
function optional(changed, placeholder, min, step) {
  const made = h('input', { type: 'number', step: 'any', min, placeholder, oninput: changed });
  stepping(made, min, step, changed);
  return made;
}

/** Any number is allowed, and the arrow keys go in steps. @param {HTMLInputElement} made @param {number} min @param {number} step @param {() => void} changed */
function stepping(made, min, step, changed) {
  made.addEventListener('keydown', (/** @type {KeyboardEvent} */ event) => {
    const direction = { ArrowUp: 1, ArrowDown: -1 }[event.key];
    if (!direction) return;
    event.preventDefault();
    made.value = String(Number(Math.max(min, Number(made.value || 0) + direction * step).toFixed(3)));
    changed();
  });
}

/** @param {string} name @param {HTMLInputElement[]} inputs */
function triple(name, inputs) {
  const labelled = ['x', 'y', 'z'].map((axis, at) => h('label', {}, axis, inputs[at]));
  return h('fieldset', {}, h('legend', {}, name), h('div.triple', {}, labelled));
}
