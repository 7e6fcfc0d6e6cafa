import { Refusal, getUncertainty } from "../api.js";
import { byId, setText } from "../dom.js";

/** @import { RoomMap } from "../map/map.js" */
/** @import { Uncertainty, Update } from "../types.js" */

// It changes with the background only, which is a matter of minutes.
const PERIOD_S = 5;
// What nobody has asked for must not keep the daemon busy.
const QUIET_PERIOD_S = 60;

/**
 * Where the camera can locate somebody at all: what is not observable is always shaded, and the layer
 * shows how exactly elsewhere, and says it in words.
 */
export class UncertaintyLayer {
  /** @param {RoomMap} map */
  constructor(map) {
    this.map = map;
    this.box = byId("uncertainty", HTMLInputElement);
    this.words = byId("uncertainty-words");
    /** @type {Uncertainty | null} */
    this.known = null;
    this.askedS = -Infinity;
    this.asking = false;
    /** @type {number | null} Which calibration was asked for. */
    this.calibration = null;
    this.box.addEventListener("change", () => {
      if (this.box.checked) this.askedS = -Infinity;
      this.#show();
    });
  }

  /**
   * @param {boolean} connected
   * @param {Update | null} update
   * @param {number} nowS
   */
  follow(connected, update, nowS) {
    const calibration = this.map.geometry?.calibration ?? null;
    if (calibration !== this.calibration) {
      // Places have moved: what is shown is of another room.
      this.calibration = calibration;
      this.askedS = -Infinity;
      this.known = null;
      this.#show();
    }
    // Unless somebody wants to know why not, it is asked for only where there is an answer.
    const known =
      update?.state === "watching" && update.model !== "published" && update.calibration === calibration;
    if (!connected || calibration === null || this.asking || (!known && !this.box.checked)) return;
    if (nowS - this.askedS < (this.box.checked ? PERIOD_S : QUIET_PERIOD_S)) return;
    this.askedS = nowS;
    void this.#ask(calibration);
  }

  /** @param {number} calibration */
  async #ask(calibration) {
    this.asking = true;
    let why = "";
    try {
      const uncertainty = await getUncertainty();
      this.known = uncertainty.calibration === calibration ? uncertainty : null;
    } catch (error) {
      this.known = null;
      why = error instanceof Refusal ? `Not known: ${error.message}` : "Not known: the daemon does not answer";
    } finally {
      this.asking = false;
      this.#show(why);
    }
  }

  /** @param {string} [why]  it is not known */
  #show(why = "") {
    const { known, box } = this;
    this.map.setUncertainty(known, box.checked);
    const blind = known !== null && shareSeen(known) < 1;
    byId("uncertainty-key").hidden = !box.checked && !blind;
    if (known) setText(this.words, box.checked ? inWords(known) : "not observable now");
    else setText(this.words, why);
  }
}

/** @param {Uncertainty} uncertainty */
function shareSeen({ error_m, threshold_m }) {
  const cells = error_m.flat();
  return cells.filter((error) => error !== null && error <= threshold_m).length / Math.max(1, cells.length);
}

/** @param {Uncertainty} uncertainty */
function inWords(uncertainty) {
  const share = Math.round(100 * shareSeen(uncertainty));
  return `One frame can locate a person to ${uncertainty.threshold_m} m or better in ${share} % of the room; fog: the thicker, the less exactly; hatched: not observable now`;
}
