/** Elements of the page, made without markup in strings: what comes from the server is only ever text. */

/** @typedef {Node | string | number | null | undefined | false} Child */

/**
 * Return a new element. Properties that begin with `on` are listeners, `class`, `data` and `style` what they
 * say, others properties where the element has them, otherwise attributes.
 * @param {string} tag `name.class.class`
 * @param {Record<string, any>} [properties]
 * @param {...(Child | Child[])} children
 * @returns {any}
 */
export function h(tag, properties = {}, ...children) {
  const [name, ...classes] = tag.split('.');
  const element = document.createElement(name);
  if (classes.length) element.classList.add(...classes);
  for (const [key, value] of Object.entries(properties)) give(element, key, value);
  element.append(...shown(children));
  return element;
}

/**
 * Put children in place of those an element has.
 * @param {Element} element
 * @param {...(Child | Child[])} children
 */
export function fill(element, ...children) {
  element.replaceChildren(...shown(children));
}

let fields = 0;

/**
 * Return a labelled control.
 * @param {string} text
 * @param {HTMLElement} control
 * @param {string} [hint]
 */
export function field(text, control, hint) {
  control.id ||= `field-${(fields += 1)}`;
  const described = `${control.id}-hint`;
  if (hint) control.setAttribute('aria-describedby', described);
  const name = h('label.field-name', { htmlFor: control.id }, text);
  return h('div.field', {}, name, control, hint && h('span.hint', { id: described }, hint));
}

/**
 * Return a select of values; each is a value or a pair of value and text.
 * @param {(string | [string, string])[]} options
 * @param {string} value
 * @param {Record<string, any>} [properties]
 * @returns {HTMLSelectElement}
 */
export function select(options, value, properties = {}) {
  const made = h('select', properties);
  offer(made, options, value);
  return made;
}

/**
 * Let a select offer other values.
 * @param {HTMLSelectElement} element
 * @param {(string | [string, string])[]} options
 * @param {string} value
 */
export function offer(element, options, value) {
  const pairs = options.map((option) => (Array.isArray(option) ? option : [option, option]));
  fill(element, pairs.map(([key, text]) => h('option', { value: key, selected: key === value }, text)));
}

/**
 * Return a button.
 * @param {string} text
 * @param {(event: Event) => void} onclick
 * @param {Record<string, any>} [properties]
 * @returns {HTMLButtonElement}
 */
export function button(text, onclick, properties = {}) {
  return h('button', { type: 'button', onclick, ...properties }, text);
}

/**
 * Say something in the corner for a while.
 * @param {Child} text
 * @param {'good' | 'bad'} [kind]
 */
export function tell(text, kind = 'good') {
  const notice = h(`div.notice.${kind}`, {}, text);
  document.getElementById('notices')?.append(notice);
  setTimeout(() => notice.remove(), kind === 'bad' ? 9000 : 5000);
}

/**
 * Let the user keep a file.
 * @param {Blob} content
 * @param {string} name
 */
export function offerFile(content, name) {
  const address = URL.createObjectURL(content);
  h('a', { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

/** @param {(Child | Child[])[]} children */
function shown(children) {
  return /** @type {(Node | string)[]} */ (
    children.flat().filter((child) => child !== null && child !== undefined && child !== false)
      .map((child) => (child instanceof Node ? child : String(child)))
  );
}

/** @param {HTMLElement} element @param {string} key @param {any} value */
function give(element, key, value) {
  if (value === undefined || value === null) return;
  if (key.startsWith('on')) element.addEventListener(key.slice(2), value);
  else if (key === 'class') value.split(' ').forEach((/** @type {string} */ name) => name && element.classList.add(name));
  else if (key === 'data') Object.assign(element.dataset, value);
  else if (key === 'style') for (const [name, of] of Object.entries(value)) element.style.setProperty(name, of);
  else if (key in element && key !== 'list') /** @type {any} */ (element)[key] = value;
  else element.setAttribute(key, value);
}
