// How the reader wants to see the map: kept in this browser, and no business of the daemon's.

const KEY = "doorcam-view";

/**
 * Puts every choice back to what it was when this page was last open, and keeps what is chosen from now on.
 * @param {HTMLElement[]} groups  with radio buttons and check boxes
 */
export function remember(groups) {
  const kept = load();
  const inputs = groups.flatMap((group) => [...group.querySelectorAll("input")]);
  for (const input of inputs) {
    const choice = kept[nameOf(input)];
    if (input.type === "radio" && known(inputs, input.name, choice)) input.checked = input.value === choice;
    if (input.type === "checkbox" && typeof choice === "boolean") input.checked = choice;
    input.addEventListener("change", () => {
      kept[nameOf(input)] = input.type === "radio" ? input.value : input.checked;
      try {
        localStorage.setItem(KEY, JSON.stringify(kept));
      } catch {
        // A browser that keeps nothing for this page: the choice is good as long as it is open.
      }
    });
  }
}

/** @param {HTMLInputElement} input */
const nameOf = (input) => input.name || input.id;

/**
 * Whether a choice is one that this version of the page has.
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
