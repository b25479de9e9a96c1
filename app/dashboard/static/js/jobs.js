/** Jobs: what takes longer than a request. */

import { Problem, Unreachable, ask, at, events, pause } from './api.js';
import { button, h } from './elements.js';

/** @typedef {{id: string, state: string, progress: {done: number, total: number, message: string}, result: any, error: any}} Job */

const OVER = ['succeeded', 'failed', 'cancelled'];

/**
 * Follow a job to its end; return its result. Throws Problem where it has none.
 * @param {string} id
 * @param {(job: Job) => void} onChange
 * @param {AbortSignal} [signal]
 */
export async function follow(id, onChange, signal) {
  for (;;) {
    try {
      for await (const event of events(at('jobs', id, 'events'), { signal })) {
        onChange(event.data);
        if (OVER.includes(event.data.state)) return outcome(event.data);
      }
    } catch (error) {
      if (!(error instanceof Unreachable)) throw error;
    }
    await pause(1000, signal);
    signal?.throwIfAborted();
  }
}

/**
 * Return the answer to a request that may have become a job.
 * @param {Response} response
 * @param {(job: Job) => void} onChange
 * @param {AbortSignal} [signal]
 */
export async function answerOf(response, onChange, signal) {
  const told = await response.json();
  return response.status === 202 ? follow(told.id, onChange, signal) : told;
}

/** A bar that shows how far a job is. */
export class JobBar {
  constructor() {
    this.bar = h('progress', { max: 1, value: 0, 'aria-label': 'Progress of the job' });
    this.text = h('span.job-text', {}, 'waiting for a worker');
    this.cancel = button('Cancel', () => this.stop(), { class: 'quiet small', hidden: true });
    this.element = h('div.job', { hidden: true }, this.bar, this.text, this.cancel);
    this.id = '';
  }

  /** @param {Job} job */
  show(job) {
    this.id = job.id;
    this.element.hidden = false;
    this.cancel.hidden = OVER.includes(job.state);
    this.bar.value = job.state === 'succeeded' ? 1 : job.progress.total ? job.progress.done / job.progress.total : 0;
    const words = { queued: 'waiting for a worker', succeeded: 'done', failed: 'failed', cancelled: 'cancelled' };
    this.text.textContent = words[/** @type {keyof typeof words} */ (job.state)] || job.progress.message || job.state;
    this.element.dataset.state = job.state;
  }

  /** Ask for the job to be cancelled. */
  async stop() {
    this.text.textContent = 'to be cancelled at its next step';
    await ask(at('jobs', this.id), { method: 'DELETE' }).catch(() => {});
  }
}

/** @param {Job} job */
function outcome(job) {
  if (job.state === 'succeeded') return job.result;
  const detail = job.error?.detail || 'the job was cancelled';
  throw new Problem(422, { ...job.error, detail });
}
