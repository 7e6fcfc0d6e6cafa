/**
 * An element the page cannot do without.
 * @template {HTMLElement} [T=HTMLElement]
 * @param {string} id
 * @param {new () => T} [kind]
 * @returns {T}
 */
export function byId(id, kind) {
  const element = document.getElementById(id);
  if (!element || (kind && !(element instanceof kind))) throw new Error(`index.html lacks #${id}`);
  return /** @type {T} */ (element);
}

/**
 * Panels are refreshed several times a second with mostly the same words; an untouched node keeps
 * the user's text selection and costs no layout.
 * @param {Element} element
 * @param {string} text
 */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/**
 * Make `parent` have `count` children, adding with `make` or removing at the end.
 * @param {Element} parent
 * @param {number} count
 * @param {() => Element} make
 */
export function resizeList(parent, count, make) {
  while (parent.children.length > count) parent.lastElementChild?.remove();
  while (parent.children.length < count) parent.append(make());
}

/** @param {number} cells */
export function tableRow(cells) {
  const row = document.createElement("tr");
  for (let i = 0; i < cells; i += 1) row.append(document.createElement("td"));
  return row;
}

/**
 * A button that cannot be used now. Not `disabled`, which would take the keyboard's focus away from
 * whoever has just pressed it: its own listener must look.
 * @param {HTMLButtonElement} button
 * @param {boolean} unavailable
 */
export function setUnavailable(button, unavailable) {
  if (isUnavailable(button) !== unavailable) button.setAttribute("aria-disabled", String(unavailable));
}

/** @param {HTMLButtonElement} button */
export const isUnavailable = (button) => button.getAttribute("aria-disabled") === "true";
