/** @import { DaemonClock } from "./clock.js" */
/** @import { Update } from "../types.js" */

/** How long an update takes from its capture to this screen. */
export class Latency {
  /** @param {DaemonClock} clock */
  constructor(clock) {
    this.clock = clock;
    /** @type {number | null} Of the newest update that was drawn; null: not known. */
    this.ms = null;
    /** @type {Update | null} An update that has just arrived and is not drawn yet. */
    this.undrawn = null;
  }

  /** What was measured on one connection says nothing about the next. */
  forget() {
    this.ms = null;
  }

  /**
   * @param {Update} update
   * @param {boolean} fresh  otherwise it may have waited in the daemon, and is not measured
   */
  arrived(update, fresh) {
    this.undrawn = fresh ? update : null;
  }

  /**
   * @param {number | null} sequence  of the update on the screen
   * @returns {number | null} null where this drawing is no measurement
   */
  drawn(sequence) {
    const { undrawn } = this;
    if (sequence === null || undrawn?.sequence !== sequence) return null;
    this.undrawn = null;
    this.ms = this.clock.sinceMs(undrawn.time, Date.now());
    return this.ms;
  }
}
