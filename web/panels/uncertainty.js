import { Refusal, getUncertainty } from "../api.js";
import { byId, setText } from "../dom.js";

/** @import { RoomMap } from "../map/map.js" */
/** @import { Uncertainty } from "../types.js" */

// It changes with the background only, which is a matter of minutes.
const PERIOD_S = 5;

/** The layer that shows where the camera can locate somebody at all, and what it says in words. */
export class UncertaintyLayer {
  /** @param {RoomMap} map */
  constructor(map) {
    this.map = map;
    this.box = byId("uncertainty", HTMLInputElement);
    this.words = byId("uncertainty-words");
    this.askedS = -Infinity;
    this.asking = false;
    /** @type {number | null} Which calibration was asked for. */
    this.calibration = null;
    this.box.addEventListener("change", () => {
      byId("uncertainty-key").hidden = !this.box.checked;
      this.askedS = -Infinity;
      if (!this.box.checked) this.map.setUncertainty(null);
    });
  }

  /**
   * @param {boolean} connected
   * @param {number} nowS
   */
  follow(connected, nowS) {
    const calibration = this.map.geometry?.calibration ?? null;
    if (calibration !== this.calibration) {
      // Places have moved: what is shown is of another room.
      this.calibration = calibration;
      this.askedS = -Infinity;
      this.map.setUncertainty(null);
    }
    if (!this.box.checked || !connected || calibration === null || this.asking) return;
    if (nowS - this.askedS < PERIOD_S) return;
    this.askedS = nowS;
    void this.#ask(calibration);
  }

  /** @param {number} calibration */
  async #ask(calibration) {
    this.asking = true;
    try {
      const uncertainty = await getUncertainty();
      if (!this.box.checked || uncertainty.calibration !== calibration) return;
      this.map.setUncertainty(uncertainty);
      setText(this.words, inWords(uncertainty));
    } catch (error) {
      this.map.setUncertainty(null);
      setText(this.words, error instanceof Refusal ? `Not known: ${error.message}` : "Not known: the daemon does not answer");
    } finally {
      this.asking = false;
    }
  }
}

/** @param {Uncertainty} uncertainty */
function inWords({ error_m, threshold_m }) {
  const cells = error_m.flat();
  const seen = cells.filter((error) => error !== null && error <= threshold_m).length;
  const share = Math.round((100 * seen) / Math.max(1, cells.length));
  return `One frame can locate a person to ${threshold_m} m or better in ${share} % of the room; fog: the thicker, the less exactly; hatched: not observable now`;
}
