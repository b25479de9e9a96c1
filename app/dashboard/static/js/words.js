/** Words of the field, explained where they stand; problems in words. */

import { Problem } from './api.js';
import { h } from './elements.js';

/** @type {Record<string, [string, string]>} */
const WORDS = {
  novelty: ['novelty', 'How unlike everything the version was trained on this movement is. Around 0: as usual. '
    + 'Large: nobody has shown such a movement. Unit: nat per frame.'],
  margin: ['margin', 'How clearly the best class beats the second best (difference of their log-likelihoods, '
    + 'in nat). Large: a clear case. Near 0: it could have been the other one.'],
  logLikelihood: ['log-likelihood', 'How well a class explains the movement, on a logarithmic scale (nat). '
    + 'Only differences mean something: the class with the largest one wins.'],
  posterior: ['posterior', 'How probable each class is for the movement under way, given what was seen so far. '
    + 'All add up to 100 %. Provisional: it changes with every frame.'],
  segment: ['segment', 'A stretch of the recording that shows one action. Once the server has told a segment '
    + 'it is final.'],
  rest: ['rest', 'The hand does nothing of interest: time between two actions. It belongs to no segment.'],
  role: ['role', 'What an object is for the model, for example “object”. The names in your recording may differ: '
    + 'say here which of them is which.'],
  version: ['version', 'What one training made: numbered, and never changed afterwards.'],
  alias: ['alias', 'A name that points to a version, such as “production”. Robots and streams ask for the name; '
    + 'promoting moves it to another version.'],
  accuracy: ['class accuracy', 'Share of demonstrations given the right class by a model that was trained '
    + 'without them (cross-validation).'],
  confusion: ['confusion matrix', 'Rows: what the movement truly was. Columns: what it was taken for. '
    + 'All on the diagonal is best.'],
  boundary: ['boundary error', 'How far found starts and ends of actions lie from the true ones, median.'],
  f1: ['F1', 'One figure for missed and for invented segments: 1 is perfect. F1@50 counts a segment as found '
    + 'if it overlaps the true one by at least half, F1@75 by three quarters.'],
  delineated: ['delineated', 'Share of true actions found with both ends within 0.15 s.'],
  frames: ['frame accuracy', 'Share of the frames of true actions that got the right class.'],
  std: ['standard deviation', 'How far demonstrated movements differ from this one at the same moment. '
    + 'The band is two of them wide on each side: about 95 % of demonstrations would lie in it.'],
  lineage: ['lineage', 'The versions this one was trained on from, the nearest first.'],
  via: ['limits', 'What the robot can do at most. They always hold: the movement takes longer if it must.'],
};

let count = 0;

/**
 * Return a word of the field as a button that explains it.
 * @param {keyof typeof WORDS} name
 * @param {string} [text]
 */
export function word(name, text) {
  const [usual, meaning] = WORDS[name];
  const id = `word-${(count += 1)}`;
  const note = h('span.meaning', { id, role: 'note' }, h('strong', {}, usual), ' — ', meaning);
  note.setAttribute('popover', 'auto');
  const asked = h('button.word', { type: 'button', title: meaning }, text || usual);
  asked.setAttribute('popovertarget', id);
  asked.addEventListener('click', () => place(note, asked));
  return h('span.worded', {}, asked, note);
}

/**
 * Return a box that says what went wrong.
 * @param {unknown} error
 */
export function problemBox(error) {
  const places = error instanceof Problem ? error.errors : [];
  const listed = (places.length > 1 ? places : []).slice(0, 6).map((place) => h('li', {}, place.pointer && h('code', {}, place.pointer), ' ', place.detail));
  return h('div.problem', { role: 'alert' }, h('p', {}, sentence(error)), listed.length > 0 && h('ul', {}, listed));
}

/**
 * Return an error as a sentence.
 * @param {unknown} error
 */
export function sentence(error) {
  const only = error instanceof Problem && error.errors.length === 1 && error.errors[0].detail;
  const text = only || (error instanceof Error ? error.message : String(error));
  return text.charAt(0).toUpperCase() + text.slice(1) + (/[.!?]$/.test(text) ? '' : '.');
}

/**
 * Return a box that says that there is nothing, and what to do next.
 * @param {string} title
 * @param {string} text
 * @param {string[]} [commands]
 */
export function emptyBox(title, text, commands = []) {
  return h('div.empty', {}, h('h3', {}, title), h('p', {}, text), commands.map((line) => h('pre', { tabIndex: 0 }, line)));
}

/** @param {HTMLElement} note @param {HTMLElement} beside */
function place(note, beside) {
  const { left, bottom } = beside.getBoundingClientRect();
  note.style.setProperty('left', `${Math.max(8, Math.min(left, innerWidth - 308))}px`);
  note.style.setProperty('top', `${Math.min(bottom + 6, innerHeight - 130)}px`);
}
