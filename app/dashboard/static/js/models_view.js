/** Models: what was trained, two versions side by side, which one robots use, and training another. */

import { all, ask, at } from './api.js';
import { Comparison } from './comparison.js';
import { button, field, fill, h, tell } from './elements.js';
import { ago, counted, moment, percent } from './figures.js';
import { meet } from './palette.js';
import { TrainingPanel } from './training_panel.js';
import { emptyBox, problemBox, word } from './words.js';

/** @type {import('./page.js').Show} */
export function showModels(host, query) {
  const view = new ModelsView(host);
  view.load(query.get('model'));
  return { leave: () => view.leave() };
}

class ModelsView {
  /** @param {HTMLElement} host */
  constructor(host) {
    /** @type {any} */
    this.model = null;
    /** @type {any[]} */
    this.versions = [];
    /** @type {{a: any, b: any}} the two that are compared */
    this.pair = { a: undefined, b: undefined };
    this.list = h('ul.choices', { 'aria-label': 'Models' });
    this.trouble = h('div');
    this.title = h('h2.big', {}, 'Models');
    this.about = h('p.soft');
    this.rows = h('tbody');
    this.table = h('section.panel', {}, h('header', {}, h('h2', {}, 'Versions')), this.#head());
    this.comparison = new Comparison();
    this.history = h('section.panel');
    this.training = new TrainingPanel(() => this.#open(this.model.name));
    this.body = h('div.body', {}, this.title, this.about, this.table, this.comparison.element, h('div.pair', {}, this.training.element, this.history));
    host.append(h('div.models', {}, h('div.side', {}, h('section.panel', {}, h('h2', {}, 'Models'), this.list, this.trouble, button('New model…', () => this.#ask())), this.#dialog()), this.body));
    this.body.hidden = true;
  }

  leave() {
    this.training.leave();
  }

  /** @param {string | null} [chosen] */
  async load(chosen) {
    try {
      const models = await all(at('models'), 'models');
      const none = emptyBox('No models yet', 'A model is a set of actions that are learned together. The demo makes one and teaches it; or make one here and save demonstrations for it from a recording.', ['gesta demo', 'GESTA_DATABASE_URL=sqlite:///demo/gesta.db GESTA_STORE_URL=demo/models_store gesta serve', `curl ${location.origin}/v1/models -H 'Content-Type: application/json' -d '{"name": "table-top", "objects": ["object"]}'`]);
      fill(this.list, models.map((model) => h('li', {}, this.#choice(model))));
      fill(this.trouble, models.length === 0 && none);
      const model = models.find(({ name }) => name === chosen) || models[0];
      if (model) await this.#open(model.name);
    } catch (error) {
      fill(this.trouble, problemBox(error));
    }
  }

  /** @param {any} model */
  #choice({ name, objects, description }) {
    return h('button.choice', { type: 'button', onclick: () => this.#open(name), data: { model: name } }, h('strong', {}, name), h('small', {}, description || `objects: ${objects.join(', ') || 'none'}`));
  }

  /** @param {string} name */
  async #open(name) {
    try {
      [this.model, this.versions] = await Promise.all([ask(at('models', name)), all(at('models', name, 'versions'), 'versions', 200)]);
    } catch (error) {
      return fill(this.trouble, problemBox(error));
    }
    for (const made of this.list.querySelectorAll('button')) made.setAttribute('aria-pressed', String(made.dataset.model === name));
    history.replaceState(null, '', `#/models?model=${encodeURIComponent(name)}`);
    meet(Object.keys(this.model.actions));
    this.body.hidden = false;
    this.title.textContent = name;
    const shown = Object.entries(this.model.actions).map(([action, count]) => `${count} ${action}`);
    fill(this.about, shown.length ? `Demonstrations: ${shown.join(', ')}.` : 'No demonstrations yet: save some from a recording.');
    this.#show();
    this.training.open(this.model, this.versions);
    return this.#showHistory();
  }

  #head() {
    const heads = ['A', 'B', word('version', 'version'), word('alias', 'aliases'), word('accuracy'), 'demonstrations', 'trained', h('span.unseen', {}, 'promote')];
    return h('div.scroll', {}, h('table', {}, h('thead', {}, h('tr', {}, heads.map((head) => h('th', { scope: 'col' }, head)))), this.rows));
  }

  #show() {
    const { versions } = this;
    const [newest, before] = versions;
    const promoted = versions.find((version) => version.aliases.includes('production'));
    this.pair = { a: promoted && promoted !== newest ? promoted : before || newest, b: newest };
    fill(this.rows, versions.map((version) => this.#row(version)));
    if (!versions.length) fill(this.rows, h('tr', {}, h('td', { colSpan: 8 }, emptyBox('No versions yet', 'Train one below, once there are demonstrations.'))));
    this.#compare();
  }

  /** @param {any} version */
  #row(version) {
    const { a, b } = this.pair;
    const pick = (/** @type {'a' | 'b'} */ side, /** @type {any} */ now) => h('input', { type: 'radio', name: `side-${side}`, checked: now === version, 'aria-label': `version ${version.version} as ${side.toUpperCase()}`, onchange: () => ((this.pair[side] = version), this.#compare()) });
    const promoted = version.aliases.includes('production');
    const promote = button(promoted ? 'in production' : 'Promote', () => this.#promote(version), { class: 'small', disabled: promoted, 'aria-label': promoted ? undefined : `Promote version ${version.version} to production` });
    const cells = [pick('a', a), pick('b', b), `v${version.version}`, version.aliases.map((/** @type {string} */ alias) => h('span.badge', {}, alias)), percent(version.evaluation?.accuracy, 1), version.demonstrations.length, h('span', { title: moment(version.created_at) }, ago(version.created_at)), promote];
    return h('tr', {}, cells.map((cell) => h('td', {}, cell)));
  }

  #compare() {
    this.comparison.show(this.pair.a, this.pair.b);
  }

  /** @param {any} version */
  async #promote(version) {
    try {
      await ask(at('models', this.model.name, 'aliases', 'production'), { method: 'PUT', body: { version: version.version } });
      tell(`Version ${version.version} is now “production”: new streams and robots use it; running sessions keep theirs.`);
      await this.#open(this.model.name);
    } catch (error) {
      tell(problemBox(error), 'bad');
    }
  }

  async #showHistory() {
    const named = this.versions.some((version) => version.aliases.length);
    const moves = named ? await all(at('models', this.model.name, 'aliases', 'production', 'history'), 'history', 50).catch(() => []) : [];
    const rows = moves.map((move) => h('tr', {}, h('td', {}, moment(move.at)), h('td', {}, move.version === null ? 'taken away' : `v${move.version}`), h('td.soft', {}, move.previous === null ? 'first' : `before: v${move.previous}`)));
    fill(this.history, h('h2', {}, 'Who was “production” when'), rows.length ? h('table', {}, h('tbody', {}, rows)) : h('p.soft', {}, 'Nobody yet. Until then streams take the latest version.'));
  }

  #dialog() {
    const name = h('input', { required: true, pattern: '[A-Za-z0-9][A-Za-z0-9._\\-]{0,99}', placeholder: 'table-top' });
    const objects = h('input', { placeholder: 'object, tool' });
    const trouble = h('div');
    const form = h('form', { method: 'dialog', onsubmit: (/** @type {Event} */ event) => (event.preventDefault(), this.#create(name.value, objects.value, trouble)) },
      h('h2', {}, 'New model'), field('Name', name, 'letters, digits, dots and dashes'), field('Objects that matter (their roles)', objects, 'separated by commas; their distance to the hand tells actions apart'), trouble,
      h('div.row.spread', {}, button('Cancel', () => this.asking.close()), h('button.main', { type: 'submit' }, 'Create')));
    this.asking = h('dialog', { 'aria-label': 'New model' }, form);
    return this.asking;
  }

  #ask() {
    this.asking.showModal();
  }

  /** @param {string} name @param {string} objects @param {HTMLElement} trouble */
  async #create(name, objects, trouble) {
    try {
      await ask(at('models'), { body: { name, objects: objects.split(',').map((each) => each.trim()).filter(Boolean) } });
      this.asking.close();
      tell(`Model ${name} created. ${counted(0, 'demonstration')} so far: save some from a recording.`);
      await this.load(name);
    } catch (error) {
      fill(trouble, problemBox(error));
    }
  }
}
