/** Which model, and which of its versions. */

import { all, at } from './api.js';
import { field, fill, h, offer, select } from './elements.js';
import { meet } from './palette.js';
import { problemBox, word } from './words.js';

/** Models that are tried, to begin with one that has been trained. */
const MOST_TRIED = 8;

/** Tells of `change` when another version is chosen. */
export class ModelChoice extends EventTarget {
  constructor() {
    super();
    this.models = select([], '', { 'aria-label': 'Model', onchange: () => this.#open() });
    this.numbers = select([], '', { 'aria-label': 'Version', onchange: () => this.#tell() });
    this.trouble = h('div');
    const version = h('div.field', {}, h('span.field-name', {}, word('version', 'Version')), this.numbers);
    this.element = h('div', {}, h('div.row', {}, field('Model', this.models), version), this.trouble);
    /** @type {any[]} */
    this.known = [];
    /** @type {any[]} */
    this.versions = [];
  }

  /** The model that is chosen, undefined where there is none. */
  get model() {
    return this.known.find((model) => model.name === this.models.value);
  }

  /** The version that is chosen, undefined where there is none. */
  get version() {
    return this.versions.find((version) => String(version.version) === this.numbers.value);
  }

  /** The address of the chosen version. @param {...string} further */
  address(...further) {
    return at('models', this.version.model, 'versions', this.version.version, ...further);
  }

  /** @param {string | null} [model] @param {string | null} [version] preferred ones */
  async load(model, version) {
    try {
      this.known = await all(at('models'), 'models');
      const names = this.known.map(({ name }) => name);
      offer(this.models, names, model || '');
      await this.#open(version);
      for (const name of model ? [] : names.slice(1, MOST_TRIED)) {
        if (this.versions.length) break;
        this.models.value = name;
        await this.#open();
      }
    } catch (error) {
      fill(this.trouble, problemBox(error));
    }
  }

  /** @param {unknown} [preferred] */
  async #open(preferred) {
    try {
      this.versions = this.model ? await all(at('models', this.model.name, 'versions'), 'versions', 100) : [];
      fill(this.trouble, this.#missing());
    } catch (error) {
      this.versions = [];
      fill(this.trouble, problemBox(error));
    }
    for (const version of this.versions.toReversed()) meet(version.actions);
    const promoted = this.versions.find((each) => each.aliases.includes('production')) || this.versions[0];
    const chosen = typeof preferred === 'string' ? preferred : String(promoted?.version ?? '');
    offer(this.numbers, this.versions.map((each) => [String(each.version), [each.version, ...each.aliases].join(' · ')]), chosen);
    this.#tell();
  }

  /** What has to be done before there is something to choose. */
  #missing() {
    if (this.versions.length) return null;
    const link = h('a', { href: '#/models' }, 'Models');
    return h('p.hint', {}, this.model ? 'No version yet: train one under ' : 'No model yet: make one under ', link, '.');
  }

  #tell() {
    this.dispatchEvent(new Event('change'));
  }
}
