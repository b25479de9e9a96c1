/** The last seconds of a session as a strip on a canvas: segments above, the speed of the hand below. */

import { h } from './elements.js';
import { colour, nameOf, wordOf } from './palette.js';

/** @typedef {import('./live_model.js').LiveModel} LiveModel */

/** What is to be seen [s]. */
const SPAN = 20;
const LANE = { top: 20, height: 34 };
const FASTEST = 0.5;

export class Strip {
  constructor() {
    this.canvas = h('canvas.strip-canvas', { role: 'img', 'aria-label': 'The segments of the last 20 seconds; the list tells them in words' });
    this.element = h('div.strip', {}, this.canvas);
    this.brush = this.canvas.getContext('2d', { alpha: false });
    this.fastest = FASTEST;
    this.size = new ResizeObserver(() => this.#resize());
    this.size.observe(this.element);
  }

  /** @param {LiveModel} model */
  draw(model) {
    const { brush, width, height } = this;
    if (!width) return;
    brush.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    brush.fillStyle = colour('--panel');
    brush.fillRect(0, 0, width, height);
    brush.font = `12px ${this.font}`;
    brush.textBaseline = 'middle';
    const now = model.now;
    /** @param {number} time */
    const x = (time) => width - 14 - ((now - time) / SPAN) * (width - 28);
    this.#ticks(now, x);
    for (const segment of model.segments) {
      if (segment.t_end > now - SPAN - 1) this.#block(x(segment.t_start), x(segment.t_end), segment.action, true);
    }
    this.#open(model, x);
    this.#speed(model, x);
  }

  dispose() {
    this.size.disconnect();
  }

  /** @param {LiveModel} model @param {(time: number) => number} x */
  #open(model, x) {
    for (const { action, start_seq: start, through_seq: through } of model.pending) {
      this.#block(x(model.timeOf(start)), x(model.timeOf(through)), action, false);
    }
  }

  /** @param {number} left @param {number} right @param {string | null} action @param {boolean} final */
  #block(left, right, action, final) {
    const { brush } = this;
    const wide = Math.max(right - left, 2);
    brush.fillStyle = brush.strokeStyle = colour(nameOf(action));
    brush.globalAlpha = final ? 1 : 0.35;
    brush.beginPath();
    brush.roundRect(left, LANE.top, wide, LANE.height, 4);
    brush.fill();
    brush.globalAlpha = 1;
    if (!final) {
      brush.setLineDash([4, 3]);
      brush.stroke();
      brush.setLineDash([]);
    }
    const text = wordOf(action) + (final ? '' : '?');
    if (wide < brush.measureText(text).width + 10) return;
    brush.fillStyle = colour(final ? '--on-class' : '--ink');
    brush.fillText(text, Math.max(left, 0) + 6, LANE.top + LANE.height / 2 + 1);
  }

  /** @param {number} now @param {(time: number) => number} x */
  #ticks(now, x) {
    const { brush, height } = this;
    brush.strokeStyle = colour('--line');
    brush.fillStyle = colour('--soft');
    brush.lineWidth = 1;
    for (let time = Math.ceil((now - SPAN) / 5) * 5; time <= now; time += 5) {
      if (time < 0) continue;
      const left = Math.round(x(time)) + 0.5;
      brush.beginPath();
      brush.moveTo(left, LANE.top - 4);
      brush.lineTo(left, height - 2);
      brush.stroke();
      brush.fillText(`${time} s`, left + 3, 8);
    }
  }

  /** @param {LiveModel} model @param {(time: number) => number} x */
  #speed(model, x) {
    const { brush, height } = this;
    const [base, tall] = [height - 4, height - LANE.top - LANE.height - 14];
    for (let at = 0; at < model.n; at += 1) this.fastest = Math.max(this.fastest, Math.min(model.speeds[at], 4));
    brush.strokeStyle = colour('--soft');
    brush.lineWidth = 1.5;
    brush.beginPath();
    for (let at = model.n % 2; at < model.n; at += 2) {
      const speed = Number.isNaN(model.speeds[at]) ? 0 : model.speeds[at];
      brush.lineTo(x(model.times[at]), base - (Math.min(speed, this.fastest) / this.fastest) * tall);
    }
    brush.stroke();
    brush.fillStyle = colour('--soft');
    brush.fillText('speed', 4, base - tall + 4);
  }

  #resize() {
    this.width = this.element.clientWidth;
    this.height = this.element.clientHeight;
    this.ratio = Math.min(devicePixelRatio, 2);
    this.canvas.width = Math.round(this.width * this.ratio);
    this.canvas.height = Math.round(this.height * this.ratio);
    this.font = getComputedStyle(this.element).fontFamily;
  }
}
