/** Plays time: a playhead that runs, stops, is dragged, and tells all that follow it. */

import { button, h, select } from './elements.js';

const SPEEDS = ['0.1', '0.25', '0.5', '1', '2', '4'];

export class Player extends EventTarget {
  constructor() {
    super();
    this.begin = 0;
    this.end = 0;
    this.time = 0;
    this.playing = false;
    this.speed = 1;
    this.toggler = button('▶', () => this.toggle(), { class: 'icon', title: 'Play or pause (Space)', 'aria-label': 'Play' });
    this.slider = h('input', { type: 'range', min: '0', max: '1', step: '0.01', value: '0', 'aria-label': 'Playhead', oninput: () => this.seek(Number(this.slider.value)) });
    this.clock = h('span.clock', {}, '');
    const speeds = select(SPEEDS.map((value) => [value, `${value}×`]), '1', { 'aria-label': 'Speed', onchange: () => (this.speed = Number(speeds.value)) });
    this.element = h('div.player', {}, this.toggler, this.slider, this.clock, speeds);
  }

  /**
   * @param {number} begin @param {number} end [s]
   * @param {number} [step] of the slider [s]
   */
  open(begin, end, step = 0.01) {
    Object.assign(this, { begin, end });
    Object.assign(this.slider, { min: String(begin), max: String(end), step: String(step) });
    this.seek(Math.min(Math.max(this.time, begin), end));
  }

  toggle() {
    if (this.playing) return this.pause();
    if (this.end <= this.begin) return undefined;
    if (this.time >= this.end - 1e-6) this.seek(this.begin);
    this.playing = true;
    this.#show();
    this.last = performance.now();
    this.asked = requestAnimationFrame((now) => this.#step(now));
    return undefined;
  }

  pause() {
    this.playing = false;
    cancelAnimationFrame(this.asked || 0);
    this.#show();
  }

  /** @param {number} time [s] */
  seek(time) {
    this.time = Math.min(Math.max(time, this.begin), this.end);
    this.slider.value = String(this.time);
    this.clock.textContent = `${this.time.toFixed(2)} / ${this.end.toFixed(2)} s`;
    this.dispatchEvent(new Event('time'));
  }

  /** @param {number} now [ms] */
  #step(now) {
    if (!this.playing) return;
    this.seek(this.time + ((now - (this.last || now)) / 1000) * this.speed);
    this.last = now;
    if (this.time >= this.end) this.pause();
    else this.asked = requestAnimationFrame((next) => this.#step(next));
  }

  #show() {
    this.toggler.textContent = this.playing ? '❚❚' : '▶';
    this.toggler.setAttribute('aria-label', this.playing ? 'Pause' : 'Play');
  }
}
