import { byId, isUnavailable, setText, setUnavailable } from "../dom.js";
import { duration, plural } from "../format.js";

/** @import { Update } from "../types.js" */

/** Holds the picture still for whoever wants to look at it. The daemon, and the health of it, go on. */
export class Pause {
  /** @param {(held: Update | null) => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
    /** @type {Update | null} The update that is held; null: the picture goes on. */
    this.held = null;
    this.heldAtS = 0;
    /** @type {Update | null} */
    this.newest = null;
    this.button = byId("pause", HTMLButtonElement);
    this.button.addEventListener("click", () => {
      if (this.held) this.resume();
      else if (!isUnavailable(this.button)) this.#hold();
    });
    byId("resume").addEventListener("click", () => {
      this.resume();
      this.button.focus();
    });
  }

  /**
   * @param {Update | null} newest
   * @param {number} newestAtS
   * @param {number} nowS
   */
  follow(newest, newestAtS, nowS) {
    this.newest = newest;
    if (!this.held) this.heldAtS = newestAtS;
    setUnavailable(this.button, !newest && !this.held);
    const behind = this.held && newest ? newest.sequence - this.held.sequence : 0;
    const words = `Paused · ${duration(Math.max(0, nowS - this.heldAtS))} old${behind > 0 ? `, ${plural(behind, "update")} behind` : ""}`;
    if (this.held) setText(byId("paused-words"), words);
  }

  #hold() {
    this.held = this.newest;
    this.#changed();
  }

  resume() {
    if (!this.held) return;
    this.held = null;
    this.#changed();
  }

  #changed() {
    const on = this.held !== null;
    setText(this.button, on ? "Resume" : "Pause");
    byId("paused").hidden = !on;
    byId("map-frame").classList.toggle("held", on);
    this.onChange(this.held);
  }
}
