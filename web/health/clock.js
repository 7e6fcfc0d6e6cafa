const KEPT = 8;

/** How far the daemon's clock is from this computer's: they may be on two sides of a network. */
export class DaemonClock {
  constructor() {
    /** @type {{ offsetMs: number, roundTripMs: number }[]} */
    this.measured = [];
  }

  /** Another daemon has another clock. */
  forget() {
    this.measured = [];
  }

  /**
   * @param {string} time  what the daemon's clock said
   * @param {number} askedMs  by this computer's clock
   * @param {number} answeredMs  the same
   */
  learn(time, askedMs, answeredMs) {
    const offsetMs = Date.parse(time) - (askedMs + answeredMs) / 2;
    if (!Number.isFinite(offsetMs)) return;
    this.measured = [...this.measured, { offsetMs, roundTripMs: answeredMs - askedMs }].slice(-KEPT);
  }

  /**
   * @param {number} nowMs  by this computer's clock
   * @returns {number | null} by the daemon's
   */
  at(nowMs) {
    if (this.measured.length === 0) return null;
    const best = this.measured.reduce((a, b) => (b.roundTripMs < a.roundTripMs ? b : a));
    return nowMs + best.offsetMs;
  }

  /**
   * How long ago something was by the daemon's clock; null as long as that is not known. It is known
   * to half the shortest round trip.
   * @param {string} time
   * @param {number} nowMs  by this computer's clock
   * @returns {number | null}
   */
  sinceMs(time, nowMs) {
    const daemonMs = this.at(nowMs);
    if (daemonMs === null) return null;
    const since = daemonMs - Date.parse(time);
    return Number.isFinite(since) ? Math.max(0, since) : null;
  }
}
