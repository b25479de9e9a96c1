/** Start and goal in the scene: dragged over the table, with Shift up and down; a click on the table places one. */

import * as THREE from './three.js';

/** @typedef {import('./stage.js').Stage} Stage */
/** @typedef {'start' | 'goal'} End */

const NEAR_PX = 26;
const STILL_PX = 4;

export class Placing {
  /**
   * @param {Stage} stage
   * @param {(end: End) => number[]} placeOf
   * @param {(end: End, place: number[], over: boolean) => void} onMove over: whether the movement is over
   */
  constructor(stage, placeOf, onMove) {
    this.stage = stage;
    this.placeOf = placeOf;
    this.onMove = onMove;
    /** @type {End} which one a click places */
    this.next = 'goal';
    this.ray = new THREE.Raycaster();
    stage.canvas.addEventListener('pointerdown', (/** @type {PointerEvent} */ event) => this.#press(event), { capture: true });
    stage.canvas.addEventListener('pointermove', (/** @type {PointerEvent} */ event) => this.#hover(event));
  }

  /** @param {PointerEvent} event */
  #press(event) {
    if (event.button !== 0) return;
    const end = this.#under(event);
    if (end) this.#drag(event, end);
    else this.#maybeClick(event);
  }

  /** @param {PointerEvent} event @param {End} end */
  #drag(event, end) {
    const { canvas, controls } = this.stage;
    event.stopImmediatePropagation();
    canvas.focus();
    canvas.setPointerCapture(event.pointerId);
    controls.enabled = false;
    let place = [...this.placeOf(end)];
    const move = (/** @type {PointerEvent} */ at) => {
      place = (at.shiftKey ? this.#upright(at, place) : this.#level(at, place[2])) || place;
      this.onMove(end, place, false);
    };
    const done = () => {
      canvas.removeEventListener('pointermove', move);
      controls.enabled = true;
      this.onMove(end, place, true);
    };
    canvas.addEventListener('pointermove', move);
    canvas.addEventListener('lostpointercapture', done, { once: true });
  }

  /** A press that does not move is a click: it places an end; one that moves turns the view. @param {PointerEvent} event */
  #maybeClick(event) {
    const { canvas } = this.stage;
    canvas.addEventListener('pointerup', (/** @type {PointerEvent} */ up) => {
      if (Math.hypot(up.clientX - event.clientX, up.clientY - event.clientY) > STILL_PX) return;
      const place = this.#level(up, this.placeOf(this.next)[2]);
      if (place) this.onMove(this.next, place, true);
    }, { once: true });
  }

  /** @param {PointerEvent} event */
  #hover(event) {
    if (event.buttons === 0) this.stage.canvas.style.cursor = this.#under(event) ? 'grab' : 'default';
  }

  /** The end under the pointer. @param {PointerEvent} event @returns {End | undefined} */
  #under(event) {
    const { left, top, width, height } = this.stage.canvas.getBoundingClientRect();
    return /** @type {End[]} */ (['goal', 'start']).find((end) => {
      const spot = new THREE.Vector3(...this.placeOf(end)).project(this.stage.camera);
      const [x, y] = [left + ((spot.x + 1) * width) / 2, top + ((1 - spot.y) * height) / 2];
      return Math.hypot(event.clientX - x, event.clientY - y) < NEAR_PX;
    });
  }

  /** Where the pointer meets a height. @param {PointerEvent} event @param {number} height */
  #level(event, height) {
    const found = this.#aim(event).intersectPlane(new THREE.Plane(new THREE.Vector3(0, 0, 1), -height), new THREE.Vector3());
    return found && Math.hypot(found.x, found.y) < 5 ? [found.x, found.y, height] : null;
  }

  /** Where the pointer meets the upright line through a place. @param {PointerEvent} event @param {number[]} place */
  #upright(event, place) {
    const facing = this.stage.camera.getWorldDirection(new THREE.Vector3()).setZ(0).normalize();
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(facing, new THREE.Vector3(...place));
    const found = this.#aim(event).intersectPlane(plane, new THREE.Vector3());
    return found && [place[0], place[1], Math.min(Math.max(found.z, this.stage.table.position.z - 0.5), this.stage.table.position.z + 2)];
  }

  /** @param {PointerEvent} event */
  #aim(event) {
    const { left, top, width, height } = this.stage.canvas.getBoundingClientRect();
    const spot = new THREE.Vector2(((event.clientX - left) / width) * 2 - 1, 1 - ((event.clientY - top) / height) * 2);
    this.ray.setFromCamera(spot, this.stage.camera);
    return this.ray.ray;
  }
}
