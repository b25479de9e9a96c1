/** The scene of a running session: the hand glides from frame to frame, its trail has the colours of the actions. */

import { nameOf, theme } from './palette.js';
import { PARTS, round } from './smoothing.js';
import { Marker, Trail, linear } from './things.js';

/** @typedef {import('./stage.js').Stage} Stage */
/** @typedef {import('./live_model.js').LiveModel} LiveModel */

const GLIDE_S = 0.035;
/** Frames of the trail, eleven seconds; the older, the paler. */
const SHOWN = 220;

export class LiveScene {
  /** @param {Stage} stage @param {LiveModel} model @param {any} session */
  constructor(stage, model, session) {
    this.stage = stage;
    this.model = model;
    this.table = session.scene.table_height_m;
    this.trail = new Trail(stage, SHOWN * PARTS, { width: 3.5 });
    this.hand = new Marker(stage, { text: 'hand', colour: '--hand', radius: 0.016, label: 'strong' });
    /** @type {Map<string, Marker>} */
    this.objects = new Map();
    this.goals = Object.entries(session.goals).map(([name, place]) => this.#goal(name, /** @type {number[]} */ (place)));
    /** @type {Map<string, [number, number, number]>} */
    this.colours = new Map();
    this.rounded = new Float32Array(3 * (SHOWN * PARTS + 1));
    this.at = new Float32Array([NaN, NaN, NaN]);
    /** @type {[number, number, number]} */
    this.mixed = [0, 0, 0];
    this.laidOut = 0;
    this.recolour = () => this.colours.clear();
    theme.addEventListener('change', this.recolour);
  }

  /** Take in what the model has heard. */
  update() {
    const { model, stage } = this;
    this.#layOut();
    const from = Math.max(0, model.n - SHOWN);
    if (location.search === '?t') { this.trail.line.visible = false; } else {} const n = round(model.hand, from, model.n, this.rounded);
    this.trail.show(this.rounded, (at) => this.#faded(model.actionAt(from + Math.floor(at / PARTS)), 1 - (n - at) / PARTS / SHOWN), 0, n);
    const goal = model.hypothesis?.goals?.[0];
    for (const [name, place] of model.objects) {
      const marker = this.objects.get(name) || this.#object(name);
      marker.show(place[0], place[1], place[2]);
      marker.label?.classList.toggle('likely', goal?.name === name && goal.posterior > 0.5);
    }
    stage.animate(this.glide);
  }

  /** @param {number} elapsed */
  glide = (elapsed) => {
    const { at, model } = this;
    const share = Number.isNaN(at[0]) ? 1 : 1 - Math.exp(-elapsed / GLIDE_S);
    let far = 0;
    for (let axis = 0; axis < 3; axis += 1) {
      const to = model.hand[3 * (model.n - 1) + axis];
      at[axis] = Number.isNaN(at[axis]) || share === 1 ? to : at[axis] + share * (to - at[axis]);
      far += Math.abs(to - at[axis]);
    }
    this.hand.show(at[0], at[1], at[2]);
    return far > 2e-4;
  };

  remove() {
    theme.removeEventListener('change', this.recolour);
    this.stage.animations.delete(this.glide);
    for (const thing of [this.trail, this.hand, ...this.objects.values(), ...this.goals]) thing.remove();
  }

  /** Look at where the hand goes: at once, and again when it has been about. */
  #layOut() {
    const { model } = this;
    if (model.frames < this.laidOut) return;
    this.laidOut = model.frames < 40 ? Math.max(model.frames * 3, 2) : Infinity;
    const reach = new Float32Array([-0.3, -0.05, this.table, 0.3, 0.45, this.table + 0.25]);
    const [x, y] = [model.hand[0], model.hand[1]];
    const near = Math.abs(x) < 0.6 && Math.abs(y) < 0.8;
    this.stage.enclose([...(near ? [reach] : []), model.hand.subarray(0, 3 * model.n), ...model.objects.values()], this.table);
  }

  /** @param {string} name */
  #object(name) {
    const marker = new Marker(this.stage, { text: name, colour: '--object', radius: 0.02 });
    this.objects.set(name, marker);
    return marker;
  }

  /** @param {string} name @param {number[]} place */
  #goal(name, place) {
    const marker = new Marker(this.stage, { text: name, colour: '--soft', radius: 0.01 });
    marker.show(place[0], place[1], place[2]);
    return marker;
  }

  /** @param {string | null} action @param {number} share 0: long ago, 1: now @returns {[number, number, number]} */
  #faded(action, share) {
    const [now, gone, mixed] = [this.#colour(nameOf(action)), this.#colour('--table'), this.mixed];
    const strength = Math.min(1, 0.12 + 1.3 * share);
    for (let at = 0; at < 3; at += 1) mixed[at] = gone[at] + strength * (now[at] - gone[at]);
    return mixed;
  }

  /** @param {string} name */
  #colour(name) {
    let found = this.colours.get(name);
    if (!found) this.colours.set(name, (found = linear(name)));
    return found;
  }
}
