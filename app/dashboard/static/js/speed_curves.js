/** Speeds over time: of a generated movement, of demonstrations behind it, and what a robot can do. */

/** @typedef {import('./chart.js').Curve} Curve */
/** @typedef {import('./shown_demonstrations.js').Shown} Shown */

const N_TIMES = 160;

/**
 * Return times and the curves over them.
 * @param {{t: number[], velocity: number[][]}} motion
 * @param {Shown[]} shown
 * @param {number | null} limit [m/s]
 * @returns {{t: number[], lines: Curve[]}}
 */
export function curves(motion, shown, limit) {
  const own = motion.t[motion.t.length - 1];
  const longest = Math.max(own, ...shown.map(({ t }) => t[t.length - 1]));
  const t = Array.from({ length: N_TIMES + 1 }, (_, at) => (longest * at) / N_TIMES);
  const speed = motion.velocity.map((each) => Math.hypot(...each));
  /** @type {Curve[]} */
  const lines = shown.map((each, number) => ({ values: sampled(each.t, each.speed, t), colour: '--rest', width: 1, label: `demonstration ${number + 1}` }));
  lines.push({ values: sampled(motion.t, speed, t), colour: '--accent', width: 2.5, label: 'generated' });
  if (limit) lines.push({ values: t.map(() => limit), colour: '--bad', width: 1.5, dash: [6, 4], label: 'limit' });
  return { t, lines };
}

/** @param {ArrayLike<number>} t @param {ArrayLike<number | null>} values @param {number[]} times @returns {(number | null)[]} */
function sampled(t, values, times) {
  let at = 0;
  return times.map((time) => {
    if (time > t[t.length - 1] + 1e-9) return null;
    while (at + 2 < t.length && t[at + 1] < time) at += 1;
    const [low, high] = [values[at], values[Math.min(at + 1, t.length - 1)]];
    if (low === null || high === null) return low ?? high;
    const share = Math.min(Math.max((time - t[at]) / Math.max(t[at + 1] - t[at], 1e-9), 0), 1);
    return low + share * (high - low);
  });
}
