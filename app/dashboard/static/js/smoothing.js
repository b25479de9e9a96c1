/** A path through points that come twenty times a second, rounded as the hand went (Catmull-Rom). */

/** Into so many pieces the way from one point to the next is cut. */
export const PARTS = 2;

/**
 * Write the rounded path of points `from` to `to` and return how many points it has.
 * @param {Float32Array} points flat positions
 * @param {number} from @param {number} to
 * @param {Float32Array} into room for PARTS as many
 */
export function round(points, from, to, into) {
  let n = 0;
  for (let at = from; at + 1 < to; at += 1) {
    const [before, here, next, after] = [Math.max(at - 1, from), at, at + 1, Math.min(at + 2, to - 1)].map((each) => 3 * each);
    for (let part = 0; part < PARTS; part += 1, n += 1) {
      for (let axis = 0; axis < 3; axis += 1) {
        into[3 * n + axis] = between(points[before + axis], points[here + axis], points[next + axis], points[after + axis], part / PARTS);
      }
    }
  }
  if (to > from) into.set(points.subarray(3 * (to - 1), 3 * to), 3 * n);
  return to > from ? n + 1 : 0;
}

/** @param {number} before @param {number} here @param {number} next @param {number} after @param {number} share of the way */
function between(before, here, next, after, share) {
  const [a, b] = [Number.isNaN(before) ? here : before, Number.isNaN(after) ? next : after];
  const [into, out] = [(next - a) / 2, (b - here) / 2];
  const bend = 2 * (here - next) + into + out;
  return here + share * (into + share * (3 * (next - here) - 2 * into - out + share * bend));
}
