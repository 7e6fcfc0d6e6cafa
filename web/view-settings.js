// How the reader wants to see the map: what the controls around it say. This browser remembers it; the daemon never learns it.

import { byId } from "./dom.js";

/** @import { Choice, Parts } from "./types.js" */

const KEY = "doorcam-view";

/** @returns {Choice} */
export function choice() {
  const value = (/** @type {string} */ name) => document.querySelector(`input[name="${name}"]:checked`)?.getAttribute("value");
  return /** @type {Choice} */ ({ layer: value("layer"), signs: value("signs"), brightness: value("brightness") });
}

/** @returns {Parts} */
export function parts() {
  const shown = [...byId("parts").querySelectorAll("input")].map((input) => [input.id.replace("part-", ""), input.checked]);
  return /** @type {Parts} */ (Object.fromEntries(shown));
}

/**
 * Restore every setting to what it was when this page was last open, and remember changes from now on.
 * @param {HTMLElement[]} groups  with radio buttons and check boxes
 */
export function remember(groups) {
  const kept = load();
  const inputs = groups.flatMap((group) => [...group.querySelectorAll("input")]);
  for (const input of inputs) {
    const last = kept[nameOf(input)];
    if (input.type === "radio" && known(inputs, input.name, last)) input.checked = input.value === last;
    if (input.type === "checkbox" && typeof last === "boolean") input.checked = last;
    input.addEventListener("change", () => {
      kept[nameOf(input)] = input.type === "radio" ? input.value : input.checked;
      try {
        localStorage.setItem(KEY, JSON.stringify(kept));
      } catch {
        // This browser stores nothing for this page: the choice lasts until the page is closed.
      }
    });
  }
}

/** @param {HTMLInputElement} input */
const nameOf = (input) => input.name || input.id;

/**
 * Whether this version of the page still offers a remembered value.
 * @param {HTMLInputElement[]} inputs
 * @param {string} name
 * @param {unknown} value
 */
const known = (inputs, name, value) => inputs.some((input) => input.name === name && input.value === value);

/** @returns {Record<string, unknown>} */
function load() {
  try {
    const kept = JSON.parse(localStorage.getItem(KEY) ?? "{}");
    return typeof kept === "object" && kept !== null && !Array.isArray(kept) ? kept : {};
  } catch {
    return {};
  }
}
