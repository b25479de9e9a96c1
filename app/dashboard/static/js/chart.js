/** A chart over time, with a line where the playhead is. */

import { h } from './elements.js';
import { colour, theme } from './palette.js';
import UPlot from './uplot.js';

/** @typedef {{values: (number | null)[], colour: string, width?: number, dash?: number[], label: string}} Curve */

export class Chart {
  /**
   * @param {string} label what is drawn, with its unit
   * @param {(time: number) => void} onSeek
   * @param {[string, string][]} [legend] texts and names of their colours
   */
  constructor(label, onSeek, legend = []) {
    this.onSeek = onSeek;
    this.plotted = h('div.chart', { role: 'img', 'aria-label': `Chart: ${label}` });
    const chips = legend.map(([text, name]) => h('span.chip', { style: { '--colour': `var(${name})` } }, text));
    this.element = h('div', {}, h('div.lane-name.indented', {}, h('span', {}, label), chips), this.plotted);
    this.time = 0;
    /** @type {{t: ArrayLike<number>, curves: Curve[], range: [number, number]} | null} */
    this.shown = null;
    this.redraw = () => this.shown && this.show(this.shown.t, this.shown.curves, this.shown.range);
    theme.addEventListener('change', this.redraw);
    this.size = new ResizeObserver(() => this.plot?.setSize(this.#size()));
    this.size.observe(this.plotted);
  }

  /** @param {ArrayLike<number>} t @param {Curve[]} curves @param {[number, number]} range of time */
  show(t, curves, range) {
    this.shown = { t, curves, range };
    this.plot?.destroy();
    const lines = curves.map(({ label, colour: name, width = 1.5, dash }) => ({ label, stroke: colour(name), width, dash, points: { show: false } }));
    const data = [t, ...curves.map((curve) => curve.values)];
    this.plot = new UPlot({ ...this.#size(), ...this.#look(), series: [{}, ...lines] }, data, this.plotted);
    this.plot.over.addEventListener('click', (/** @type {MouseEvent} */ event) => this.onSeek(this.plot.posToVal(event.offsetX, 'x')));
  }

  /** @param {number} from @param {number} to [s] */
  look(from, to) {
    if (!this.shown) return;
    this.shown.range = [from, to];
    this.plot.setScale('x', { min: from, max: to });
  }

  /** @param {number} time [s] */
  point(time) {
    this.time = time;
    if (!this.plot) return;
    if (!this.line) this.line = h('div.chart-line');
    if (!this.line.isConnected || this.line.parentElement !== this.plot.over) this.plot.over.append(this.line);
    this.line.style.transform = `translateX(${this.plot.valToPos(time, 'x')}px)`;
  }

  dispose() {
    theme.removeEventListener('change', this.redraw);
    this.size.disconnect();
    this.plot?.destroy();
  }

  #size() {
    return { width: Math.max(this.plotted.clientWidth, 120), height: 110 };
  }

  #look() {
    const [ink, line] = [colour('--soft'), colour('--line')];
    const font = `11px ${getComputedStyle(document.documentElement).fontFamily}`;
    const axis = { stroke: ink, font, grid: { stroke: line, width: 1 }, ticks: { show: false } };
    return {
      padding: [8, 0, 0, 0],
      legend: { show: false },
      cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
      scales: { x: { time: false, range: () => this.shown?.range || [0, 1] }, y: { range: (/** @type {any} */ _, /** @type {number} */ low, /** @type {number} */ high) => [Math.min(low, 0), Math.max(high * 1.08, 0.05)] } },
      axes: [{ ...axis, size: 22, gap: 2, grid: { show: false } }, { ...axis, size: 36, gap: 4, space: 26 }],
      hooks: { draw: [() => this.point(this.time)] },
    };
  }
}
