/** @import { Status, Update } from "../types.js" */

export const MINUTES = 5;
const KEPT = MINUTES * 60;

/**
 * One second of the daemon's life; null for what nobody knew then.
 * @typedef {object} Sample
 * @property {number | null} captured  frames a second
 * @property {number | null} solved  the same
 * @property {number | null} missing  frames that were dropped, lost, skipped or failed in this second
 * @property {number | null} solveMs
 * @property {number | null} latencyMs  from capture to the picture on this screen
 * @property {number | null} gap  percent
 * @property {number | null} gainLeft  percent
 * @property {number | null} gainRight  percent
 */

/** @returns {Sample} */
const unknown = () => ({ captured: null, solved: null, missing: null, solveMs: null, latencyMs: null, gap: null, gainLeft: null, gainRight: null });

/** The last minutes, second by second, from updates and the polled status. */
export class Samples {
  constructor() {
    /** @type {Sample[]} The oldest first. */
    this.kept = [];
    /** @type {Update | null} */
    this.update = null;
    /** @type {number[]} */
    this.solveMs = [];
    /** @type {number[]} */
    this.latencyMs = [];
    /** @type {Status | null} */
    this.status = null;
    /** @type {number | null} Count of missing frames that have been told. */
    this.missing = null;
    /** @type {number | null} */
    this.closedS = null;
  }

  /** @param {Update} update */
  follow(update) {
    this.update = update;
    if (update.state === "watching") this.solveMs.push(update.timing_ms.solve);
  }

  /** @param {number} ms */
  drawn(ms) {
    this.latencyMs.push(ms);
  }

  /** @param {Status | null} status  null: the daemon does not answer */
  report(status) {
    this.status = status;
    // A daemon that was started anew counts anew.
    if (status && this.missing !== null && missingOf(status) < this.missing) this.missing = null;
  }

  /**
   * A second is over; or more, where the browser has let this page sleep.
   * @param {number} nowS
   */
  close(nowS) {
    const { update, status } = this;
    const slept = this.closedS === null ? 0 : Math.round(nowS - this.closedS) - 1;
    for (let second = 0; second < Math.min(slept, KEPT); second += 1) this.kept.push(unknown());
    this.closedS = nowS;
    const sample = unknown();
    if (status) {
      sample.captured = status.rate_hz.captured;
      sample.solved = status.rate_hz.solved;
      const missing = missingOf(status);
      sample.missing = missing - (this.missing ?? missing);
      this.missing = missing;
    }
    sample.solveMs = mean(this.solveMs);
    sample.latencyMs = mean(this.latencyMs);
    if (update?.state === "watching") {
      sample.gap = gapPercent(update.solution);
      sample.gainLeft = update.gain && gainPercent(update.gain.left);
      sample.gainRight = update.gain && gainPercent(update.gain.right);
    }
    this.kept = [...this.kept, sample].slice(-KEPT);
    this.update = null;
    this.solveMs = [];
    this.latencyMs = [];
  }
}

/** @param {Status} status */
const missingOf = ({ frames }) => frames.dropped + frames.skipped + frames.lost + (frames.failed ?? 0);

/** @param {number[]} values */
const mean = (values) => (values.length === 0 ? null : values.reduce((sum, value) => sum + value, 0) / values.length);

/**
 * How far the objective can at most be above the global optimum, as a share of itself.
 * @param {{ objective: number, bound: number }} solution
 * @returns {number | null}
 */
export function gapPercent({ objective, bound }) {
  if (!Number.isFinite(bound) || !(objective > 0)) return null;
  return (100 * Math.max(objective - bound, 0)) / objective;
}

/**
 * How much brighter a patch is as a whole than when the room was empty.
 * @param {readonly number[]} rgb  factors
 */
export const gainPercent = (rgb) => 100 * ((rgb[0] + rgb[1] + rgb[2]) / 3 - 1);
