/** What stands and moves in the scene: markers, trails, the band around a generated movement. */

import { colour, parts } from './palette.js';
import * as THREE from './three.js';

/** @typedef {import('./stage.js').Stage} Stage */

/** A ball with its shadow on the table and a line down to it, so that its height is seen. */
export class Marker {
  /**
   * @param {Stage} stage
   * @param {{text: string, colour: string, radius?: number, label?: string}} look
   */
  constructor(stage, { text, colour: name, radius = 0.014, label = '' }) {
    this.stage = stage;
    this.ball = new THREE.Mesh(new THREE.SphereGeometry(radius, 24, 16), new THREE.MeshLambertMaterial());
    this.shadow = new THREE.Mesh(new THREE.CircleGeometry(radius * 1.15, 24),
      new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.28, depthWrite: false, polygonOffset: true, polygonOffsetFactor: -2 }));
    this.line = new THREE.Mesh(new THREE.CylinderGeometry(0.0012, 0.0012, 1, 6), new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.35 }));
    this.line.rotation.x = Math.PI / 2;
    for (const part of [this.line, this.shadow]) paint(part, '--shadow');
    paint(this.ball, name);
    this.group = new THREE.Group();
    this.group.add(this.ball, this.shadow, this.line);
    stage.scene.add(this.group);
    this.label = text ? stage.label(this.ball, text, label) : undefined;
    this.show(NaN, NaN, NaN);
  }

  /** @param {number} x @param {number} y @param {number} z NaN: it is not to be seen */
  show(x, y, z) {
    const seen = !Number.isNaN(x);
    for (const part of [this.ball, this.shadow, this.line]) part.visible = seen;
    if (!seen) return;
    const table = this.stage.table.position.z;
    this.ball.position.set(x, y, z);
    this.shadow.position.set(x, y, table + 0.001);
    this.line.position.set(x, y, (z + table) / 2);
    this.line.scale.set(1, Math.max(Math.abs(z - table), 1e-4), 1);
    this.line.visible = Math.abs(z - table) > 0.02;
  }

  /** @param {string} name of a colour */
  paint(name) {
    if (this.ball.userData.colour !== name) paint(this.ball, name);
  }

  remove() {
    this.stage.remove(this.group, this.label);
  }
}

const LEAST = 0.002;

/** A line along a path, as wide on the screen wherever it is; each of its points has a colour. */
export class Trail {
  /** @param {Stage} stage @param {number} capacity most points @param {{width?: number, opacity?: number}} [look] */
  constructor(stage, capacity, { width = 3, opacity = 1 } = {}) {
    this.stage = stage;
    this.capacity = capacity;
    this.places = new Float32Array(capacity * 6);
    this.colours = new Float32Array(capacity * 6);
    this.geometry = new THREE.LineSegmentsGeometry();
    this.geometry.setPositions(this.places);
    this.geometry.setColors(this.colours);
    this.geometry.instanceCount = 0;
    for (const name of ['instanceStart', 'instanceColorStart']) {
      this.geometry.attributes[name].data.setUsage(THREE.DynamicDrawUsage);
    }
    const material = new THREE.LineMaterial({ linewidth: width, vertexColors: true, transparent: opacity < 1, opacity, depthWrite: opacity === 1 });
    this.line = new THREE.LineSegments2(this.geometry, material);
    this.line.frustumCulled = false;
    stage.scene.add(this.line);
  }

  /**
   * Show points `from` to `to`; a NaN interrupts the line, what lies closer than LEAST is one point.
   * @param {ArrayLike<number>} points flat positions
   * @param {(at: number) => [number, number, number]} colourAt of a point, red, green and blue in 0..1
   */
  show(points, colourAt, from = 0, to = points.length / 3) {
    const step = Math.max(1, Math.ceil((to - from) / this.capacity));
    let n = 0;
    let a = 3 * from;
    for (let at = from + step; at < to; at += step) {
      const b = 3 * at;
      const far = Math.hypot(points[b] - points[a], points[b + 1] - points[a + 1], points[b + 2] - points[a + 2]);
      if (far < LEAST) continue;
      const [red, green, blue] = colourAt(at - step);
      const before = a;
      a = b;
      if (Number.isNaN(far)) continue;
      for (let axis = 0; axis < 3; axis += 1) {
        this.places[6 * n + axis] = points[before + axis];
        this.places[6 * n + 3 + axis] = points[b + axis];
      }
      this.colours.set([red, green, blue, red, green, blue], 6 * n);
      n += 1;
    }
    this.geometry.instanceCount = n;
    this.geometry.attributes.instanceStart.data.needsUpdate = true;
    this.geometry.attributes.instanceColorStart.data.needsUpdate = true;
    this.stage.invalidate();
  }

  remove() {
    this.stage.remove(this.line);
  }
}

const AROUND = 16;

/** A translucent tube: as far from a path, in each direction, as its standard deviations say. */
export class Band {
  /** @param {Stage} stage */
  constructor(stage) {
    this.stage = stage;
    const look = { transparent: true, opacity: 0.2, side: THREE.DoubleSide, depthWrite: false };
    this.mesh = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial(look));
    this.mesh.frustumCulled = false;
    paint(this.mesh, '--accent');
    stage.scene.add(this.mesh);
  }

  /**
   * @param {number[][]} path
   * @param {number[][]} std along each axis
   * @param {number} [times] how many standard deviations
   */
  show(path, std, times = 2) {
    const step = Math.max(1, Math.floor(path.length / 120));
    const chosen = [...path.keys()].filter((at) => at % step === 0 || at === path.length - 1);
    const vertices = new Float32Array(chosen.length * AROUND * 3);
    chosen.forEach((at, ring) => {
      const [across, upward] = crossing(path, at);
      for (let spoke = 0; spoke < AROUND; spoke += 1) {
        const angle = (2 * Math.PI * spoke) / AROUND;
        const out = across.clone().multiplyScalar(Math.cos(angle)).addScaledVector(upward, Math.sin(angle));
        const far = times * Math.hypot(out.x * std[at][0], out.y * std[at][1], out.z * std[at][2]);
        vertices.set([path[at][0] + out.x * far, path[at][1] + out.y * far, path[at][2] + out.z * far], (ring * AROUND + spoke) * 3);
      }
    });
    this.mesh.geometry.dispose();
    this.mesh.geometry = new THREE.BufferGeometry();
    this.mesh.geometry.setAttribute('position', new THREE.BufferAttribute(vertices, 3));
    this.mesh.geometry.setIndex(faces(chosen.length));
    this.stage.invalidate();
  }
}

/**
 * Return a function that gives the same colour for every point.
 * @param {string} name
 */
export function plain(name) {
  const found = linear(name);
  return () => found;
}

/**
 * Return a colour as the scene calculates with it.
 * @param {string} name
 * @returns {[number, number, number]}
 */
export function linear(name) {
  const { r, g, b } = new THREE.Color().setRGB(...parts(name), 'srgb');
  return [r, g, b];
}

/** @param {any} part @param {string} name */
function paint(part, name) {
  part.userData.colour = name;
  part.material.color.set(colour(name));
}

/**
 * Return two directions across a path, the first level.
 * @param {number[][]} path @param {number} at
 */
function crossing(path, at) {
  const [before, after] = [path[Math.max(at - 1, 0)], path[Math.min(at + 1, path.length - 1)]];
  const along = new THREE.Vector3(after[0] - before[0], after[1] - before[1], after[2] - before[2]);
  if (along.lengthSq() < 1e-14) along.subVectors(new THREE.Vector3(...path[path.length - 1]), new THREE.Vector3(...path[0]));
  along.normalize();
  const across = new THREE.Vector3(-along.y, along.x, 0);
  if (across.lengthSq() < 1e-6) across.set(1, 0, 0);
  across.normalize();
  return [across, new THREE.Vector3().crossVectors(along, across).normalize()];
}

/** @param {number} rings */
function faces(rings) {
  const found = [];
  for (let ring = 0; ring + 1 < rings; ring += 1) {
    for (let spoke = 0; spoke < AROUND; spoke += 1) {
      const next = (spoke + 1) % AROUND;
      const [a, b] = [ring * AROUND + spoke, ring * AROUND + next];
      found.push(a, b, a + AROUND, b, b + AROUND, a + AROUND);
    }
  }
  return found;
}
