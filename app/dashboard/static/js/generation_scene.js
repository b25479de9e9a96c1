/** A generated movement in the scene, among the demonstrations of its class. */

import { theme } from './palette.js';
import { Placing } from './placing.js';
import { Band, Marker, Trail, plain } from './things.js';

/** @typedef {import('./stage.js').Stage} Stage */

const POINTS_OF_A_DEMONSTRATION = 160;

export class GenerationScene {
  /**
   * @param {Stage} stage
   * @param {(end: 'start' | 'goal') => number[]} placeOf
   * @param {(end: 'start' | 'goal', place: number[], over: boolean) => void} onMove
   */
  constructor(stage, placeOf, onMove) {
    this.stage = stage;
    /** @type {{trail: Trail, track: Float64Array}[]} */
    this.shown = [];
    this.band = new Band(stage);
    this.path = new Trail(stage, 1500, { width: 4 });
    this.start = new Marker(stage, { text: 'start', colour: '--good', radius: 0.015, label: 'strong' });
    this.goal = new Marker(stage, { text: 'goal', colour: '--class-1', radius: 0.015, label: 'strong' });
    this.hand = new Marker(stage, { text: '', colour: '--hand', radius: 0.012 });
    this.placing = new Placing(stage, placeOf, onMove);
    /** @type {number[][]} */
    this.positions = [];
    this.recolour = () => this.#paint();
    theme.addEventListener('change', this.recolour);
  }

  /** @param {number[]} start @param {number[]} goal */
  place(start, goal) {
    this.start.show(start[0], start[1], start[2]);
    this.goal.show(goal[0], goal[1], goal[2]);
    this.stage.invalidate();
  }

  /** @param {Float64Array[]} tracks @param {number} tableHeight @param {number[][]} ends */
  demonstrate(tracks, tableHeight, ends) {
    for (const { trail } of this.shown) trail.remove();
    this.shown = tracks.map((track) => ({ track, trail: new Trail(this.stage, POINTS_OF_A_DEMONSTRATION, { width: 1.2, opacity: 0.55 }) }));
    this.stage.enclose([...tracks, ...ends], tableHeight);
    this.#paint();
  }

  /** @param {{position: number[][], std: number[][]} | null} motion */
  show(motion) {
    this.positions = motion?.position || [];
    this.band.mesh.visible = Boolean(motion);
    if (motion) this.band.show(motion.position, motion.std);
    this.#paint();
  }

  /** @param {number} at index of a frame */
  point(at) {
    const [x, y, z] = this.positions[at] || [NaN, NaN, NaN];
    this.hand.show(x, y, z);
    this.stage.invalidate();
  }

  remove() {
    theme.removeEventListener('change', this.recolour);
  }

  #paint() {
    for (const { trail, track } of this.shown) trail.show(track, plain('--soft'));
    this.path.show(Float32Array.from(this.positions.flat()), plain('--accent'));
  }
}
