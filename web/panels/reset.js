import { Refusal, resetBackground } from "../api.js";
import { byId, isUnavailable, setText, setUnavailable } from "../dom.js";

/** @import { WatchState } from "../types.js" */

/** The button that has the still room learned anew, and what came of it. */
export class ResetButton {
  constructor() {
    this.button = byId("reset-background", HTMLButtonElement);
    this.outcome = byId("reset-outcome");
    this.possible = false;
    this.asking = false;
    /** @type {"no" | "awaited" | "under way"} */
    this.learning = "no";
    this.button.addEventListener("click", () => void this.#press());
    this.#enable();
  }

  /**
   * @param {boolean} possible  there is a connection, and a background to reset
   * @param {WatchState | null} watch
   */
  follow(possible, watch) {
    this.possible = possible;
    this.#enable();
    const learns = watch === "learning" || watch === "relearning";
    if (this.learning === "awaited" && learns) this.learning = "under way";
    if (this.learning === "under way" && watch === "watching") {
      this.learning = "no";
      this.#say("The background has been learned anew.", false);
    }
  }

  async #press() {
    if (isUnavailable(this.button)) return;
    this.asking = true;
    this.#enable();
    try {
      await resetBackground();
      this.learning = "awaited";
      this.#say("The background is being learned anew: keep out of the room for a few seconds.", false);
    } catch (error) {
      const why = error instanceof Refusal ? error.message : "the daemon does not answer";
      this.#say(`The background was not reset: ${why}.`.replace(/\.\.$/, "."), true);
    } finally {
      this.asking = false;
      this.#enable();
    }
  }

  #enable() {
    setUnavailable(this.button, !this.possible || this.asking);
  }

  /**
   * @param {string} text
   * @param {boolean} failed
   */
  #say(text, failed) {
    setText(this.outcome, text);
    this.outcome.classList.toggle("failed", failed);
  }
}
