import { Refusal, putInside } from "../api.js";
import { byId, isUnavailable, setText, setUnavailable } from "../dom.js";
import { duration, integer } from "../format.js";

/** @import { Crossings, RoomEvent } from "../types.js" */

/** @type {Partial<Record<RoomEvent["kind"], string>>} */
const DID = { cross_in: "came in", cross_out: "went out", cross_back: "turned around on the threshold" };

/** Who walked through the door today, how many that leaves inside, and a way to set that right. */
export class CrossingsPanel {
  /** @param {() => void} onChanged  the status says more now */
  constructor(onChanged) {
    this.onChanged = onChanged;
    this.field = byId("inside-number", HTMLInputElement);
    this.button = byId("inside-set", HTMLButtonElement);
    this.form = byId("inside-form", HTMLFormElement);
    this.connected = false;
    this.busy = false;
    this.form.addEventListener("submit", (event) => {
      // The daemon is asked by script; the form is one for its Enter key and its checks.
      event.preventDefault();
      void this.#set();
    });
  }

  /**
   * @param {object} now
   * @param {Crossings | null} now.crossings
   * @param {boolean} now.connected
   * @param {boolean} now.mayChange  this browser may set it right
   * @param {number | null} now.daemonMs  its clock
   */
  follow({ crossings, connected, mayChange, daemonMs }) {
    this.connected = connected;
    this.#enable();
    this.form.hidden = !mayChange || !crossings;
    const figures = byId("crossings-figures");
    figures.hidden = !crossings;
    if (!crossings) return setText(byId("crossings-words"), "Nothing is known of them yet.");
    const { available, inside, out, back } = crossings;
    figures.classList.toggle("of-before", !connected || !available);
    setText(byId("crossed-in"), integer(crossings.in));
    setText(byId("crossed-out"), integer(out));
    setText(byId("crossed-back"), integer(back));
    setText(byId("inside-label"), available ? "Inside, about" : "Inside, when last seen");
    setText(byId("inside"), integer(inside));
    setText(byId("crossings-words"), words(crossings, connected, daemonMs));
  }

  async #set() {
    if (isUnavailable(this.button)) return;
    const inside = this.field.valueAsNumber;
    this.busy = true;
    this.#enable();
    try {
      await putInside(inside);
      this.field.value = "";
      this.#say(`Counted on from ${integer(inside)}.`, false);
      this.onChanged();
    } catch (error) {
      const why = error instanceof Refusal ? error.message : "the daemon does not answer";
      this.#say(`It was not set: ${why}.`.replace(/\.\.$/, "."), true);
    } finally {
      this.busy = false;
      this.#enable();
    }
  }

  #enable() {
    setUnavailable(this.button, !this.connected || this.busy);
  }

  /**
   * @param {string} text
   * @param {boolean} failed
   */
  #say(text, failed) {
    const outcome = byId("inside-outcome");
    setText(outcome, text);
    outcome.classList.toggle("failed", failed);
  }
}

/**
 * What is to be said above the numbers: why nobody is counted, or who was the last.
 * @param {Crossings} crossings
 * @param {boolean} connected
 * @param {number | null} daemonMs
 */
function words({ available, reason, last }, connected, daemonMs) {
  if (!connected) return "Nobody is counted on this page: there is no connection.";
  const newest = last && daemonMs !== null ? lastWords(last, daemonMs) : "";
  if (!available) return `Nobody is counted: ${reason ?? "it is not known why"}.${newest && ` ${newest}`}`;
  return newest || "Nobody has walked through yet.";
}

/**
 * @param {RoomEvent} last
 * @param {number} daemonMs
 */
function lastWords({ kind, time }, daemonMs) {
  const ageS = Math.max(0, (daemonMs - Date.parse(time)) / 1000);
  return `Somebody ${DID[kind] ?? kind} ${ageS < 5 ? "just now" : `${duration(ageS)} ago`}.`;
}
