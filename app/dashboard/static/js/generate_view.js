/** Generate: a movement of a learned action between two places that nobody needs to have shown. */

import { ask, send } from './api.js';
import { Chart } from './chart.js';
import { button, field, fill, h, offer, offerFile, select, tell } from './elements.js';
import { feasibilityTold } from './feasibility.js';
import { seconds } from './figures.js';
import { GenerationScene } from './generation_scene.js';
import { ModelChoice } from './model_choice.js';
import { Player } from './player.js';
import { frameAt } from './recording.js';
import { RequestForm } from './request_form.js';
import { demonstrationsOf } from './shown_demonstrations.js';
import { curves } from './speed_curves.js';
import { openStage } from './stage.js';
import { emptyBox, problemBox, word } from './words.js';

const PATIENCE_MS = 120;
/** @type {[string, string][]} */
const LEGEND = [['generated', '--accent'], ['demonstrations', '--rest'], ['limit', '--bad']];
const FORMS = [['CSV', 'text/csv', 'csv'], ['JSON', 'application/json', 'json'], ['MCAP', 'application/vnd.mcap', 'mcap'],
  ['ROS path', 'application/json;profile="nav_msgs/Path"', 'path.json'], ['ROS trajectory', 'application/json;profile="trajectory_msgs/MultiDOFJointTrajectory"', 'trajectory.json']];

/** @type {import('./page.js').Show} */
export function showGenerate(host, query) {
  const view = new GenerateView(host);
  view.choice.load(query.get('model'), query.get('version'));
  return {
    leave: () => view.leave(),
    keys: { ' ': () => view.player.toggle(), f: () => view.stage?.fit(), s: () => view.aim('start'), g: () => view.aim('goal') },
  };
}

class GenerateView {
  /** @type {HTMLButtonElement[]} */
  aims = [];
  /** @type {HTMLButtonElement[]} */
  downloads = [];
  times = new Float64Array([0, 1]);

  /** @param {HTMLElement} host */
  constructor(host) {
    this.root = host;
    this.choice = new ModelChoice();
    this.form = new RequestForm();
    this.player = new Player();
    this.chart = new Chart('speed [m/s]', (time) => this.player.seek(time), LEGEND);
    /** @type {any} */
    this.motion = null;
    /** @type {import('./shown_demonstrations.js').Shown[]} */
    this.shown = [];
    this.asking = new AbortController();
    this.action = select([], '', { onchange: () => this.#begin() });
    this.told = h('div.panel-part', { 'aria-live': 'polite' });
    this.#build(host);
    this.stage = openStage(this.place, 'The generated movement with its band, among the demonstrations of the action');
    this.scene = this.stage && new GenerationScene(this.stage, (end) => this.form.place(end), (end, place) => this.#move(end, place));
    this.choice.addEventListener('change', () => this.#offer());
    this.form.addEventListener('change', () => this.#soon());
    this.player.addEventListener('time', () => this.#point());
    this.aim('goal');
  }

  leave() {
    clearTimeout(this.timer);
    this.asking.abort();
    this.player.pause();
    this.chart.dispose();
    this.scene?.remove();
    this.stage?.dispose();
  }

  /** Let clicks in the scene place an end. @param {'start' | 'goal'} end */
  aim(end) {
    if (this.scene) this.scene.placing.next = end;
    for (const made of this.aims) made.setAttribute('aria-pressed', String(made.dataset.end === end));
  }

  /** @param {HTMLElement} host */
  #build(host) {
    this.place = h('div.stage');
    this.aims = /** @type {('start' | 'goal')[]} */ (['start', 'goal']).map((end) => button(`click places the ${end}`, () => this.aim(end), { class: 'small', data: { end }, title: `Clicks on the table place the ${end} (${end[0].toUpperCase()})` }));
    const hint = h('p.stage-hint', {}, 'drag start or goal; with Shift up and down');
    this.downloads = FORMS.map(([name, accept, ending]) => button(name, () => this.#download(accept, ending), { class: 'small', disabled: true, 'aria-label': `Download as ${name}` }));
    host.append(h('div.generate', {},
      h('section.panel.ask', {}, h('h2', {}, 'Movement'), this.choice.element, field('Action', this.action), this.form.element),
      h('section.panel.scene', {}, h('h2.unseen', {}, 'Scene'), this.place),
      h('section.panel.time', {}, this.player.element, this.chart.element),
      h('section.panel.told', {}, h('h2', {}, 'What to know'), this.told, h('h3', {}, 'Download'), h('div.row', {}, this.downloads))));
    this.place.append(h('div.stage-tools', {}, this.aims), hint);
  }

  #offer() {
    const { version } = this.choice;
    offer(this.action, version?.actions || [], this.action.value);
    if (version) return this.#begin();
    return fill(this.told, emptyBox('Nothing to generate with', 'A trained version is needed: train one under Models, from demonstrations that you save under Recordings.'));
  }

  /** Begin with an action: its demonstrations, and ends like theirs. */
  async #begin() {
    const [model, action] = [this.choice.model.name, this.action.value];
    try {
      this.shown = await demonstrationsOf(model, action);
    } catch (error) {
      this.shown = [];
      fill(this.told, problemBox(error));
    }
    if (model !== this.choice.model?.name || action !== this.action.value) return;
    const first = this.shown[Math.floor(this.shown.length / 2)];
    const ends = first ? [first.track.slice(0, 3), first.track.slice(-3)] : [[0, 0, 0.05], [0.2, 0.3, 0.05]];
    this.form.put('start', [...ends[0]]);
    this.form.put('goal', [...ends[1]]);
    this.scene?.demonstrate(this.shown.map(({ track }) => track), first?.table ?? this.choice.model.table_height_m, [...ends].map((end) => [...end]));
    await this.#ask();
  }

  /** @param {'start' | 'goal'} end @param {number[]} place */
  #move(end, place) {
    this.form.put(end, place);
    this.#soon();
  }

  #soon() {
    this.scene?.place(this.form.place('start'), this.form.place('goal'));
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.#ask(), PATIENCE_MS);
  }

  async #ask() {
    this.scene?.place(this.form.place('start'), this.form.place('goal'));
    if (!this.choice.version || !this.form.sound) return;
    this.asking.abort();
    this.asking = new AbortController();
    const { signal } = this.asking;
    try {
      const motion = await ask(this.#address(), { body: this.form.body, signal });
      if (!signal.aborted) this.#show(motion);
    } catch (error) {
      if (!signal.aborted) this.#refuse(error);
    }
  }

  #address() {
    return this.choice.address('actions', this.action.value, 'trajectories');
  }

  /** @param {any} motion */
  #show(motion) {
    this.motion = motion;
    this.times = Float64Array.from(motion.t);
    this.scene?.show(motion);
    const { t, lines } = curves(motion, this.shown, Number(this.form.velocity.value) || null);
    this.chart.show(t, lines, [0, t[t.length - 1]]);
    this.player.open(0, motion.t.at(-1));
    const spread = Math.max(...motion.std.map((/** @type {number[]} */ each) => Math.hypot(...each)));
    fill(this.told, feasibilityTold(motion.feasibility), h('dl.figures', {}, h('dt', {}, 'duration'), h('dd', {}, seconds(motion.feasibility.duration_s)), h('dt', {}, 'frames'), h('dd', {}, motion.t.length),
      h('dt', {}, 'largest ', word('std')), h('dd', {}, `${(1000 * spread).toFixed(0)} mm`), h('dt', {}, 'made by'), h('dd', {}, `${motion.model} v${motion.version}`)));
    for (const made of this.downloads) made.disabled = false;
    this.root.dataset.generated = String(Number(this.root.dataset.generated || 0) + 1);
  }

  /** @param {unknown} error */
  #refuse(error) {
    this.motion = null;
    this.scene?.show(null);
    fill(this.told, problemBox(error));
    for (const made of this.downloads) made.disabled = true;
  }

  #point() {
    if (this.motion) this.scene?.point(frameAt(this.times, this.player.time));
    this.chart.point(this.player.time);
  }

  /** @param {string} accept @param {string} ending */
  async #download(accept, ending) {
    try {
      const response = await send(this.#address(), { body: this.form.body, accept });
      offerFile(await response.blob(), `${this.choice.model.name}-${this.action.value}.${ending}`);
    } catch (error) {
      tell(problemBox(error), 'bad');
    }
  }
}
