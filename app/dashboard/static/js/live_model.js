/** What is known of a running session: the last half minute of frames, segments, the newest hypothesis. */

/** @typedef {{start_seq: number, end_seq: number, t_start: number, t_end: number, action: string | null, novelty: number | null, margin: number | null, objects: Record<string, string>, segment: number}} Segment */
/** @typedef {{start_seq: number, through_seq: number, actions: {action: string | null, posterior: number, progress: number | null}[], goals?: {name: string, posterior: number}[]}} Hypothesis */

/** Frames that are remembered: half a minute at 20 a second. */
export const CAPACITY = 640;

/** A movement that is over or under way, and not yet final. @typedef {{action: string | null, start_seq: number, through_seq: number}} Pending */

/** Hypotheses come a little later than frames: so many frames are taken to go on as before. */
const SLACK = 12;

export class LiveModel {
  constructor() {
    this.seqs = new Float64Array(CAPACITY);
    this.times = new Float64Array(CAPACITY);
    this.speeds = new Float32Array(CAPACITY);
    this.hand = new Float32Array(CAPACITY * 3);
    this.n = 0;
    /** @type {Map<string, Float32Array>} where each object is */
    this.objects = new Map();
    /** @type {Segment[]} */
    this.segments = [];
    /** @type {Hypothesis | null} */
    this.hypothesis = null;
    /** @type {Pending[]} */
    this.pending = [];
    this.frames = 0;
    this.messages = 0;
  }

  /** @param {{kind: string, data: any}} event */
  hear({ kind, data }) {
    this.messages += 1;
    if (kind === 'frame') this.#frame(data);
    else if (kind === 'hypothesis') this.#suppose(data);
    else if (kind === 'segment' && data.segment >= this.segments.length) this.#decide(data);
    else if (kind === 'ended') Object.assign(this, { hypothesis: null, pending: [] });
  }

  /** The time of the newest frame [s]. */
  get now() {
    return this.n ? this.times[this.n - 1] : this.segments.at(-1)?.t_end ?? 0;
  }

  /**
   * Return when a frame was, as far as that is remembered [s].
   * @param {number} seq
   */
  timeOf(seq) {
    if (this.n < 2) return this.now;
    const last = this.n - 1;
    const first = Math.max(0, last - 20);
    const period = (this.times[last] - this.times[first]) / Math.max(this.seqs[last] - this.seqs[first], 1);
    return this.times[last] - (this.seqs[last] - seq) * period;
  }

  /** The likeliest class now: undefined where nothing is known. */
  get guess() {
    return this.hypothesis?.actions.reduce((best, each) => (each.posterior > best.posterior ? each : best));
  }

  /**
   * Return what the hand does at a remembered frame: a class, `rest`, or null.
   * @param {number} at index of the frame
   */
  actionAt(at) {
    const seq = this.seqs[at];
    for (let number = this.segments.length - 1; number >= 0; number -= 1) {
      const { start_seq: start, end_seq: end, action } = this.segments[number];
      if (seq > end) break;
      if (seq >= start) return action;
    }
    const open = this.pending.findLast((each) => seq >= each.start_seq && seq <= each.through_seq + SLACK);
    return open ? open.action : 'rest';
  }

  /** @param {Hypothesis} hypothesis */
  #suppose(hypothesis) {
    this.hypothesis = hypothesis;
    const { start_seq, through_seq } = hypothesis;
    const action = this.guess?.action ?? null;
    if (action === 'rest') return;
    while (this.pending.length && this.pending[this.pending.length - 1].through_seq > start_seq) this.pending.pop();
    this.pending.push({ action, start_seq, through_seq });
  }

  /** @param {Segment} segment */
  #decide(segment) {
    this.segments.push(segment);
    this.pending = this.pending.filter(({ start_seq: start }) => start >= segment.end_seq);
  }

  /** @param {{seq: number, t: number, hand: number[] | null, objects: Record<string, number[] | null>}} frame */
  #frame({ seq, t, hand, objects }) {
    if (this.n === CAPACITY) this.#forget();
    const at = this.n;
    this.seqs[at] = seq;
    this.times[at] = t;
    this.hand.set(hand || [NaN, NaN, NaN], 3 * at);
    this.speeds[at] = this.#speed(at);
    this.n += 1;
    this.frames += 1;
    for (const [name, position] of Object.entries(objects)) {
      const place = this.objects.get(name) || new Float32Array(3);
      place.set(position || [NaN, NaN, NaN]);
      this.objects.set(name, place);
    }
  }

  /** Forget the oldest tenth, so that moving the rest is seldom. */
  #forget() {
    const gone = CAPACITY / 10;
    for (const track of [this.seqs, this.times, this.speeds]) track.copyWithin(0, gone);
    this.hand.copyWithin(0, 3 * gone);
    this.n -= gone;
  }

  /** @param {number} at */
  #speed(at) {
    if (at === 0) return 0;
    const [a, b] = [3 * at, 3 * at - 3];
    const far = Math.hypot(this.hand[a] - this.hand[b], this.hand[a + 1] - this.hand[b + 1], this.hand[a + 2] - this.hand[b + 2]);
    return far / Math.max(this.times[at] - this.times[at - 1], 1e-3);
  }
}
