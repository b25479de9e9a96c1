/** A recording as the page holds it: times, and a track of positions for each marker; metres, Z up. */

/** @typedef {{length_unit: string, up_axis: string}} Geometry */
/** @typedef {{action: string, start: number, end: number}} Label times in seconds */
/**
 * @typedef {object} Recording
 * @property {string} name
 * @property {Float64Array} t
 * @property {Map<string, Float64Array>} tracks flat positions, NaN where there is none
 * @property {string} hand the track that is the hand
 * @property {Record<string, string>} objects role or name, by track; those that are missing are not used
 * @property {Label[]} labels the truth, as far as it is known
 * @property {any[]} segments what a model said
 * @property {number | null} tableHeight
 * @property {string[]} notes
 */

/** Divided by, as the server does: the numbers become the same ones. */
const PER_METRE = { m: 1, cm: 100, mm: 1000 };
export const GROUND = { length_unit: 'm', up_axis: 'z' };

/**
 * Return tracks in metres, Z up.
 * @param {Map<string, Float64Array>} tracks
 * @param {Geometry} geometry
 */
export function grounded(tracks, { length_unit: unit, up_axis: up }) {
  const scale = PER_METRE[/** @type {keyof typeof PER_METRE} */ (unit)];
  if (scale === 1 && up === 'z') return tracks;
  return new Map([...tracks].map(([name, track]) => [name, turned(track, scale, up === 'y')]));
}

/** @param {Float64Array} track @param {number} scale @param {boolean} yUp */
function turned(track, scale, yUp) {
  const result = new Float64Array(track.length);
  for (let at = 0; at < track.length; at += 3) {
    const [x, y, z] = [track[at] / scale, track[at + 1] / scale, track[at + 2] / scale];
    result[at] = x;
    result[at + 1] = yUp ? -z : y;
    result[at + 2] = yUp ? y : z;
  }
  return result;
}

/**
 * Return a recording as the API takes it; its objects are those that have a role or a name.
 * @param {Recording} recording
 */
export function asTrajectory({ t, tracks, hand, objects }) {
  const used = Object.entries(objects).filter(([track]) => track !== hand && tracks.has(track));
  const named = used.map(([track, role]) => [role, points(/** @type {Float64Array} */ (tracks.get(track)))]);
  return { t: [...t], hand: points(/** @type {Float64Array} */ (tracks.get(hand))), objects: Object.fromEntries(named) };
}

/**
 * Return the speed of a track at each frame, over about a tenth of a second [m/s]; null where it is unknown.
 * @param {Float64Array} t @param {Float64Array} track
 * @returns {(number | null)[]}
 */
export function speeds(t, track) {
  const period = t.length > 1 ? (t[t.length - 1] - t[0]) / (t.length - 1) : 1;
  const half = Math.max(1, Math.round(0.04 / period));
  return Array.from(t, (_, at) => {
    const [a, b] = [Math.max(at - half, 0), Math.min(at + half, t.length - 1)];
    const far = Math.hypot(track[3 * b] - track[3 * a], track[3 * b + 1] - track[3 * a + 1], track[3 * b + 2] - track[3 * a + 2]);
    return Number.isNaN(far) || a === b ? null : far / (t[b] - t[a]);
  });
}

/**
 * Return the frame nearest to a time.
 * @param {Float64Array} t @param {number} time
 */
export function frameAt(t, time) {
  let [low, high] = [0, t.length - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (t[middle] <= time) low = middle;
    else high = middle;
  }
  return time - t[low] <= t[high] - time ? low : high;
}

/** @param {Float64Array} track */
export function extent(track) {
  const sides = [0, 1, 2].map((axis) => {
    let [low, high] = [Infinity, -Infinity];
    for (let at = axis; at < track.length; at += 3) {
      if (track[at] < low) low = track[at];
      if (track[at] > high) high = track[at];
    }
    return high - low;
  });
  return sides.map((side) => (Number.isFinite(side) ? side : 0));
}

/** @param {Float64Array} track */
function points(track) {
  const found = [];
  for (let at = 0; at < track.length; at += 3) {
    found.push(Number.isNaN(track[at]) ? null : [track[at], track[at + 1], track[at + 2]]);
  }
  return found;
}

/**
 * Return positions as a flat track.
 * @param {(number[] | null)[]} positions
 */
export function flat(positions) {
  const track = new Float64Array(positions.length * 3).fill(NaN);
  positions.forEach((position, at) => position && track.set(position, 3 * at));
  return track;
}
