import { byId } from "./dom.js";

/**
 * Whether to drop changes: somebody has to say.
 * @returns {Promise<boolean>}
 */
export function askToDrop() {
  const dialog = byId("drop", HTMLDialogElement);
  return new Promise((answer) => {
    const over = new AbortController();
    const close = (/** @type {boolean} */ drop) => {
      over.abort();
      if (dialog.open) dialog.close();
      answer(drop);
    };
    const { signal } = over;
    byId("drop-yes").addEventListener("click", () => close(true), { signal });
    byId("drop-no").addEventListener("click", () => close(false), { signal });
    // Escape
    dialog.addEventListener("close", () => close(false), { signal });
    if (!dialog.open) dialog.showModal();
  });
}
