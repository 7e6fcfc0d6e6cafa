import { getSignal } from "../api.js";
import { byId, setText } from "../dom.js";
import { UNKNOWN, fixed } from "../format.js";

/** @import { PatchSignal } from "../types.js" */

const PERIOD_S = 0.5;
// The meters' ends, in decibels.
const LEAST_DB = -20;
const MOST_DB = 20;

/** How far the change on each patch stands out of the camera's noise. */
export class SignalMeters {
  constructor() {
    this.askedS = -Infinity;
    this.asking = false;
  }

  /** @param {number} nowS */
  refresh(nowS) {
    if (this.asking || nowS - this.askedS < PERIOD_S) return;
    this.askedS = nowS;
    void this.#ask();
  }

  /** What was measured is no longer so. */
  forget() {
    for (const side of /** @type {const} */ (["left", "right"])) showMeter(side, null);
  }

  async #ask() {
    this.asking = true;
    try {
      const signal = await getSignal();
      for (const side of /** @type {const} */ (["left", "right"])) showMeter(side, signal[side]);
      byId("signal-unknown").hidden = signal.left !== null || signal.right !== null;
    } catch {
      this.forget();
    } finally {
      this.asking = false;
    }
  }
}

/**
 * @param {"left" | "right"} side
 * @param {PatchSignal | null} signal
 */
function showMeter(side, signal) {
  const meter = byId(`signal-${side}`);
  const db = signal?.snr_db ?? null;
  const shown = Math.min(Math.max(db ?? LEAST_DB, LEAST_DB), MOST_DB);
  const words = signal ? `${db === null ? "no signal" : decibels(db)}, ${verdict(db)}` : "not known";
  meter.setAttribute("aria-valuenow", String(Math.round(shown)));
  meter.setAttribute("aria-valuetext", words);
  meter.style.setProperty("--share", String((shown - LEAST_DB) / (MOST_DB - LEAST_DB)));
  setText(byId(`signal-${side}-db`), signal && db !== null ? decibels(db) : UNKNOWN);
  setText(byId(`signal-${side}-words`), signal ? verdict(db) : "not known");
  setText(byId(`signal-${side}-change`), signal ? percent(signal.change) : UNKNOWN);
  setText(byId(`signal-${side}-noise`), signal ? percent(signal.noise) : UNKNOWN);
}

/** @param {number} db */
const decibels = (db) => `${db > 0 ? "+" : ""}${fixed(db, 1)} dB`;

/** @param {number} share */
const percent = (share) => `${fixed(100 * share, 2)} %`;

/**
 * The two thousand and more pixels of a patch tell together what one cannot: a change far below the
 * noise of a pixel is still plain.
 * @param {number | null} db
 */
function verdict(db) {
  if (db === null || db < -15) return "only noise";
  if (db < -5) return "faint";
  return db < 5 ? "clear" : "strong";
}
