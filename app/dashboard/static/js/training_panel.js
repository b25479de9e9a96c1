/** Training a version, and watching it. */

import { all, ask, at } from './api.js';
import { button, field, fill, h, offer, select, tell } from './elements.js';
import { JobBar, follow } from './jobs.js';
import { problemBox } from './words.js';

export class TrainingPanel {
  /** @param {() => void} onTrained */
  constructor(onTrained) {
    this.onTrained = onTrained;
    this.left = new AbortController();
    this.job = new JobBar();
    this.trouble = h('div');
    this.base = select([], '');
    this.states = h('input', { type: 'number', min: 2, max: 64, placeholder: 'chosen for each class' });
    this.begin = button('Train a version', () => this.#train(), { class: 'main' });
    this.element = h('section.panel', {}, h('h2', {}, 'Train'), h('p.soft', {}, 'Learns all actions from all demonstrations of the model. Versions that exist stay as they are.'),
      h('div.row.end', {}, field('Go on from', this.base, 'classes with the same demonstrations are kept'), field('States of each class', this.states, 'finer or coarser models')), h('div.row', {}, this.begin), this.job.element, this.trouble);
  }

  /** @param {any} model @param {any[]} versions */
  async open(model, versions) {
    if (this.model?.name !== model.name) {
      this.left.abort();
      this.left = new AbortController();
      this.job.element.hidden = true;
      fill(this.trouble);
    }
    this.model = model;
    this.begin.disabled = Object.keys(model.actions).length === 0;
    offer(this.base, [['', 'nothing: from scratch'], .../** @type {[string, string][]} */ (versions.map(({ version }) => [String(version), `version ${version}`]))], '');
    const running = this.job.element.hidden && (await all(`${at('jobs')}?model=${encodeURIComponent(model.name)}&state=running`, 'jobs', 5).catch(() => []))[0];
    if (running?.kind === 'training') this.#watch(running);
  }

  leave() {
    this.left.abort();
  }

  async #train() {
    fill(this.trouble);
    const options = this.states.value ? { n_states: Number(this.states.value) } : {};
    const body = { options, ...(this.base.value ? { base: Number(this.base.value) } : {}) };
    try {
      this.begin.disabled = true;
      await this.#watch(await ask(at('models', this.model.name, 'versions'), { body }));
    } catch (error) {
      fill(this.trouble, problemBox(error));
    }
    this.begin.disabled = false;
  }

  /** @param {import('./jobs.js').Job} job */
  async #watch(job) {
    const { signal } = this.left;
    this.job.show(job);
    try {
      const { version } = await follow(job.id, (now) => this.job.show(now), signal);
      tell(`Version ${version} is trained.`);
      this.onTrained();
    } catch (error) {
      if (!signal.aborted) fill(this.trouble, problemBox(error));
    }
  }
}
