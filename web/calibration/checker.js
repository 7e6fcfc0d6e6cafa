import { Refusal, checkCalibration } from "../api.js";

/** @import { Calibration, Check } from "../types.js" */

// Often enough to follow a dragging hand, seldom enough for a small computer.
const PERIOD_MS = 80;
const RETRY_MS = 2000;

/**
 * @typedef {{ check: Check } | { refused: string } | { silent: true }} Outcome  silent: no answer at all
 */

/** Asks the daemon what a draft would mean: one question at a time, always about the newest draft. */
export class Checker {
  /** @param {(revision: number, outcome: Outcome) => void} onOutcome */
  constructor(onOutcome) {
    this.onOutcome = onOutcome;
    /** @type {{ calibration: Calibration, revision: number } | null} */
    this.next = null;
    this.busy = false;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
  }

  /**
   * @param {Calibration} calibration
   * @param {number} revision  comes back with the answer
   */
  submit(calibration, revision) {
    this.next = { calibration, revision };
    this.#later(PERIOD_MS);
  }

  /** What has been asked is of no interest any more. */
  forget() {
    clearTimeout(this.timer);
    this.timer = undefined;
    this.next = null;
  }

  /** @param {number} delay */
  #later(delay) {
    if (this.busy || this.timer !== undefined) return;
    this.timer = setTimeout(() => void this.#ask(), delay);
  }

  async #ask() {
    this.timer = undefined;
    const asked = this.next;
    if (!asked) return;
    this.next = null;
    this.busy = true;
    const outcome = await answerTo(asked.calibration);
    this.busy = false;
    this.onOutcome(asked.revision, outcome);
    if ("silent" in outcome) this.next ??= asked;
    if (this.next) this.#later("silent" in outcome ? RETRY_MS : PERIOD_MS);
  }
}

/**
 * @param {Calibration} calibration
 * @returns {Promise<Outcome>}
 */
async function answerTo(calibration) {
  try {
    return { check: await checkCalibration(calibration) };
  } catch (error) {
    return error instanceof Refusal ? { refused: error.message } : { silent: true };
  }
}
