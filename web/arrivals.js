const WINDOW_S = 5;

/** Counts the updates that reach this page: how many a second, and how many were left out. */
export class Arrivals {
  constructor() {
    /** @type {number[]} */
    this.times = [];
    /** @type {number | null} */
    this.sequence = null;
    this.missed = 0;
  }

  /** The daemon may have restarted: its numbers then say nothing about the ones before. */
  reconnected() {
    this.sequence = null;
    this.times = [];
  }

  /**
   * @param {number} sequence
   * @param {number} nowS
   */
  record(sequence, nowS) {
    if (this.sequence !== null && sequence > this.sequence) this.missed += sequence - this.sequence - 1;
    this.sequence = sequence;
    this.times.push(nowS);
    this.#forget(nowS);
  }

  /**
   * @param {number} nowS
   * @returns {number | null} null until two updates have come
   */
  rateHz(nowS) {
    this.#forget(nowS);
    if (this.times.length < 2) return null;
    // Up to now, not to the last arrival: the rate sinks when the stream stops. Yet one period
    // without an arrival is normal and must not make the number tremble.
    const spanS = this.times[this.times.length - 1] - this.times[0];
    const periodS = spanS / (this.times.length - 1);
    const silenceS = Math.max(0, nowS - this.times[this.times.length - 1] - periodS);
    return (this.times.length - 1) / Math.max(spanS + silenceS, 1e-3);
  }

  /** @param {number} nowS */
  #forget(nowS) {
    while (this.times.length > 0 && this.times[0] < nowS - WINDOW_S) this.times.shift();
  }
}
