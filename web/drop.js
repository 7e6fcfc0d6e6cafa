import { byId } from "../dom.js";

/**
 * Whether to drop changes: somebody has to say.
 * @returns {Promise<boolean>}
 */
export function askToDrop() {
  const dialog = byId("cal-drop", HTMLDialogElement);
  return new Promise((answer) => {
    const over = new AbortController();
    const close = (/** @type {boolean} */ drop) => {
      over.abort();
      if (dialog.open) dialog.close();
      answer(drop);
    };
    const { signal } = over;
    byId("cal-drop-yes").addEventListener("click", () => close(true), { signal });
    byId("cal-drop-no").addEventListener("click", () => close(false), { signal });
    // Escape
    dialog.addEventListener("close", () => close(false), { signal });
    if (!dialog.open) dialog.showModal();
  });
}
