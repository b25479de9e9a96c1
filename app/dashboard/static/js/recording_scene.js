/** A recording in the scene: the paths of all that is used, and where everything is at the playhead. */

import { nameOf, theme } from './palette.js';
import { frameAt } from './recording.js';
import { Marker, Trail, linear } from './things.js';

/** @typedef {import('./stage.js').Stage} Stage */
/** @typedef {import('./recording.js').Recording} Recording */

const MOST_POINTS = 4000;

export class RecordingScene {
  /**
   * @param {Stage} stage @param {Recording} recording
   * @param {() => {action: string | null, start: number, end: number}[]} segments that colour the path
   * @param {() => {from: number, to: number}} look the time that is looked at: only its path is shown [s]
   */
  constructor(stage, recording, segments, look) {
    this.stage = stage;
    this.recording = recording;
    this.segments = segments;
    this.look = look;
    this.path = new Trail(stage, MOST_POINTS, { width: 2.5 });
    const used = [...recording.tracks.keys()].filter((name) => name === recording.hand || name in recording.objects);
    this.markers = used.slice(0, 24).map((name) => this.#marker(name));
    stage.enclose(used.map((name) => /** @type {Float64Array} */ (recording.tracks.get(name))), recording.tableHeight ?? 0);
    this.repaint = () => this.paint();
    theme.addEventListener('change', this.repaint);
    this.paint();
  }

  /** Draw the path that is looked at in the colours of its segments. */
  paint() {
    const { t, tracks, hand } = this.recording;
    const segments = [...this.segments()].sort((one, other) => one.start - other.start);
    const rest = linear('--rest');
    const colours = segments.map(({ action }) => linear(nameOf(action)));
    const { from, to } = this.look();
    let number = 0;
    this.path.show(/** @type {Float64Array} */ (tracks.get(hand)), (at) => {
      while (number < segments.length && segments[number].end < t[at]) number += 1;
      return number < segments.length && segments[number].start <= t[at] ? colours[number] : rest;
    }, frameAt(t, from), frameAt(t, to) + 1);
  }

  /** @param {number} time [s] */
  point(time) {
    const at = 3 * frameAt(this.recording.t, time);
    for (const { marker, track } of this.markers) marker.show(track[at], track[at + 1], track[at + 2]);
    this.stage.invalidate();
  }

  remove() {
    theme.removeEventListener('change', this.repaint);
    this.path.remove();
    for (const { marker } of this.markers) marker.remove();
  }

  /** @param {string} name */
  #marker(name) {
    const isHand = name === this.recording.hand;
    const role = this.recording.objects[name];
    const look = { text: isHand ? 'hand' : role === name ? name : `${name} (${role})`, colour: isHand ? '--hand' : '--object', radius: isHand ? 0.016 : 0.02, label: isHand ? 'strong' : '' };
    return { marker: new Marker(this.stage, look), track: /** @type {Float64Array} */ (this.recording.tracks.get(name)) };
  }
}
