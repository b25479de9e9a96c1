/** The 3-D scene: a table seen by a camera, Z up, in metres. Drawn only when something has changed. */

import { button, h } from './elements.js';
import { colour, parts, theme } from './palette.js';
import * as THREE from './three.js';

/** @typedef {[number, number, number]} Point */

const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const TURN = Math.PI / 36;
const STILL_MS = 300;
/** Labels nearer to the right edge stand to the left of their place. */
const ROOM_PX = 120;
const NOTHING = { min: [-0.4, -0.1, 0], max: [0.4, 0.6, 0.3] };

/**
 * Return a scene in an element, or null where the browser has no WebGL; then the element says so.
 * @param {HTMLElement} host
 * @param {string} label what is to be seen, for those who do not see it
 */
export function openStage(host, label) {
  try {
    return new Stage(host, label);
  } catch (error) {
    host.append(h('div.no-stage', { role: 'note' }, h('strong', {}, 'No 3-D here. '),
      'This browser has no WebGL, or it is switched off. Everything else on this page works: timeline, charts and figures.'));
    return null;
  }
}

/** A scene. What changes in it calls `invalidate`. */
export class Stage {
  recolour = () => (this.#colour(), this.invalidate());

  /** @param {HTMLElement} host @param {string} label */
  constructor(host, label) {
    this.canvas = document.createElement('canvas');
    this.#begin();
    Object.assign(this.canvas, { tabIndex: 0, className: 'stage-canvas' });
    this.canvas.setAttribute('role', 'img');
    this.canvas.setAttribute('aria-label', `${label}. Arrow keys turn the view.`);
    this.overlay = h('div.stage-overlay', { 'aria-hidden': 'true' });
    this.corner = h('div.stage-corner', {}, h('span', {}, 'grid 10 cm'),
      button('⤢', () => this.fit(), { class: 'quiet icon', title: 'See everything (F)', 'aria-label': 'See everything' }));
    host.append(this.canvas, this.overlay, this.corner);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(36, 1, 0.02, 60);
    this.camera.up.set(0, 0, 1);
    this.controls = new THREE.OrbitControls(this.camera, this.canvas);
    Object.assign(this.controls, { enableDamping: false, maxPolarAngle: Math.PI * 0.54, minDistance: 0.15, maxDistance: 20 });
    /** @type {Set<(elapsed: number) => boolean>} each returns whether it wants to go on */
    this.animations = new Set();
    /** @type {{at: any, element: HTMLElement, off: () => boolean}[]} */
    this.labels = [];
    this.bounds = NOTHING;
    this.drawn = 0;
    this.asked = 0;
    this.lastTime = 0;
    this.size = new ResizeObserver(() => this.#resize(host));
    this.size.observe(host);
    this.#listen();
    this.#furnish();
    this.fit();
  }

  /** Let the scene be drawn soon. */
  invalidate() {
    if (!this.asked) this.asked = requestAnimationFrame((now) => this.#draw(now));
  }

  /** @param {(elapsed: number) => boolean} animation is called before each drawing until it returns false */
  animate(animation) {
    this.animations.add(animation);
    this.invalidate();
  }

  /**
   * Say what is to be seen: the view and the table are laid out for it.
   * @param {ArrayLike<number>[]} tracks flat positions
   * @param {number} [tableHeight]
   */
  enclose(tracks, tableHeight = 0) {
    const min = [Infinity, Infinity, tableHeight];
    const max = [-Infinity, -Infinity, tableHeight + 0.1];
    for (const track of tracks) {
      for (let at = 0; at < track.length; at += 1) {
        const value = track[at];
        if (value < min[at % 3]) min[at % 3] = value;
        if (value > max[at % 3]) max[at % 3] = value;
      }
    }
    this.bounds = Number.isFinite(min[0] + max[0] + min[1] + max[1]) ? { min, max } : NOTHING;
    this.#layTable(tableHeight);
    this.fit();
  }

  /** Look at everything. */
  fit() {
    const { min, max } = this.bounds;
    const middle = [0, 1, 2].map((axis) => (min[axis] + max[axis]) / 2);
    const size = Math.hypot(...[0, 1, 2].map((axis) => max[axis] - min[axis]));
    const narrow = Math.min(1, this.camera.aspect * 0.82);
    const far = (Math.max(size, 0.35) * 1.5) / narrow;
    this.controls.target.set(middle[0], middle[1], middle[2]);
    this.camera.position.set(middle[0] + far * 0.34, middle[1] - far * 0.78, middle[2] + far * 0.52);
    this.controls.update();
    this.invalidate();
  }

  /**
   * Put a text at a moving place.
   * @param {any} at an object of the scene
   * @param {string} text
   * @param {string} [kind]
   */
  label(at, text, kind = '') {
    const element = h('span.tag', { class: kind }, text);
    this.overlay.append(element);
    this.labels.push({ at, element, off: () => !at.visible || !at.parent });
    return element;
  }

  /** @param {any} thing @param {HTMLElement} [label] */
  remove(thing, label) {
    thing.parent?.remove(thing);
    thing.traverse?.((/** @type {any} */ part) => (part.geometry?.dispose(), part.material?.dispose()));
    if (label) {
      label.remove();
      this.labels = this.labels.filter((each) => each.element !== label);
    }
    this.invalidate();
  }

  /** Take it away. */
  dispose() {
    cancelAnimationFrame(this.asked);
    clearTimeout(this.refining);
    this.asked = -1;
    this.size.disconnect();
    theme.removeEventListener('change', this.recolour);
    this.controls.dispose();
    this.scene.traverse((/** @type {any} */ part) => (part.geometry?.dispose(), part.material?.dispose()));
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }

  /** Smooth edges come from the graphics card; where the processor has to draw, only from pictures that stand still. */
  #begin() {
    const { canvas } = this;
    const asked = { antialias: true, alpha: false, powerPreference: 'low-power' };
    let context = canvas.getContext('webgl2', { ...asked, failIfMajorPerformanceCaveat: true });
    this.quick = context !== null;
    context ||= canvas.getContext('webgl2', { ...asked, antialias: false });
    if (!context) throw new Error('no WebGL');
    this.renderer = new THREE.WebGLRenderer({ canvas, context });
    this.renderer.debug.checkShaderErrors = false;
    this.ratio = this.quick ? Math.min(devicePixelRatio, 2) : 1;
  }

  #listen() {
    this.controls.addEventListener('change', () => this.invalidate());
    theme.addEventListener('change', this.recolour);
    this.canvas.addEventListener('keydown', (event) => this.#onKey(event));
  }

  /** @param {KeyboardEvent} event */
  #onKey(event) {
    const turn = KEYS[/** @type {keyof typeof KEYS} */ (event.key)];
    const nearer = { '+': 0.9, '=': 0.9, '-': 1.1, '−': 1.1 }[event.key];
    if (event.key.toLowerCase() === 'f') this.fit();
    else if (turn) this.#turn(turn[0] * TURN, turn[1] * TURN, 1);
    else if (nearer) this.#turn(0, 0, nearer);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  /** @param {number} around @param {number} down @param {number} farther */
  #turn(around, down, farther) {
    const arm = this.camera.position.clone().sub(this.controls.target);
    const length = arm.length() * farther;
    const azimuth = Math.atan2(arm.y, arm.x) + around;
    const polar = Math.min(Math.max(Math.acos(arm.z / arm.length()) + down, 0.05), this.controls.maxPolarAngle);
    arm.set(Math.sin(polar) * Math.cos(azimuth), Math.sin(polar) * Math.sin(azimuth), Math.cos(polar)).multiplyScalar(length);
    this.camera.position.copy(this.controls.target).add(arm);
    this.controls.update();
    this.invalidate();
  }

  #furnish() {
    this.sky = new THREE.HemisphereLight(0xffffff, 0x8a8a8a, 2.2);
    this.sky.position.set(0, 0, 1);
    this.sun = new THREE.DirectionalLight(0xffffff, 1.4);
    this.sun.position.set(-0.6, -0.8, 2);
    this.table = new THREE.Mesh(new THREE.PlaneGeometry(1, 1), new THREE.MeshBasicMaterial({ side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2 }));
    this.grid = new THREE.Group();
    this.scene.add(this.sky, this.sun, this.table, this.grid);
    this.#layTable(0);
  }

  /** @param {number} height */
  #layTable(height) {
    const { min, max } = this.bounds;
    const widths = [0, 1].map((axis) => Math.max(Math.ceil((max[axis] - min[axis]) * 10) + 2, 6) / 10);
    const side = Math.max(...widths);
    const middle = [0, 1].map((axis) => Math.round((min[axis] + max[axis]) * 5) / 10);
    this.table.scale.set(side, side, 1);
    this.table.position.set(middle[0], middle[1], height);
    for (const line of [...this.grid.children]) this.remove(line);
    const lines = new THREE.GridHelper(side, Math.round(side * 10));
    lines.rotation.x = Math.PI / 2;
    lines.position.set(middle[0], middle[1], height + 0.0005);
    lines.material.vertexColors = false;
    lines.material.transparent = true;
    this.grid.add(lines);
    this.#colour();
  }

  #colour() {
    this.scene.background = new THREE.Color(colour('--stage'));
    this.table.material.color.set(colour('--table'));
    for (const line of this.grid.children) {
      line.material.color.set(colour('--grid'));
      line.material.opacity = 0.9;
    }
    this.scene.traverse((/** @type {any} */ part) => {
      if (part.userData.colour) part.material.color.setRGB(...parts(part.userData.colour), 'srgb');
    });
  }

  /** @param {HTMLElement} host */
  #resize(host) {
    const { clientWidth: width, clientHeight: height } = host;
    if (!width || !height) return;
    const first = this.drawn === 0;
    this.renderer.setPixelRatio(this.ratio);
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (first) this.fit();
    this.invalidate();
  }

  /** @param {number} now [ms] */
  #draw(now) {
    this.asked = 0;
    const elapsed = Math.min((now - this.lastTime) / 1000, 0.1);
    this.lastTime = now;
    for (const animation of [...this.animations]) if (!animation(elapsed)) this.animations.delete(animation);
    if (this.renderer.getPixelRatio() !== this.ratio) this.renderer.setPixelRatio(this.ratio);
    this.renderer.render(this.scene, this.camera);
    this.#placeLabels();
    if (!this.quick) this.#refineSoon();
    this.drawn += 1;
    this.canvas.dataset.drawn = String(this.drawn);
    if (this.animations.size) this.invalidate();
  }

  /** Draw once more and finer when the picture has stood still for a moment. */
  #refineSoon() {
    clearTimeout(this.refining);
    this.refining = setTimeout(() => {
      this.renderer.setPixelRatio(2);
      this.renderer.render(this.scene, this.camera);
    }, STILL_MS);
  }

  #placeLabels() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    for (const { at, element, off } of this.labels) {
      const spot = at.getWorldPosition(new THREE.Vector3()).project(this.camera);
      const hidden = off() || Math.abs(spot.x) > 1 || Math.abs(spot.y) > 1 || spot.z > 1;
      element.style.visibility = hidden ? 'hidden' : 'visible';
      const [x, y] = [((spot.x + 1) * width) / 2, ((1 - spot.y) * height) / 2];
      const left = x > width - ROOM_PX ? ' translateX(calc(-100% - 22px))' : '';
      element.style.transform = `translate(${x}px, ${y}px)${left}`;
    }
  }
}
