const FIRST_DELAY_MS = 500;
const LONGEST_DELAY_MS = 15000;
const OPEN_TIMEOUT_MS = 10000;

/**
 * Delay before reconnection attempt `attempt` (0 is the first): doubled each time up to a cap.
 * The upper half is random, so that many pages do not fall upon a restarted daemon together.
 * @param {number} attempt
 * @param {() => number} random
 */
export function backoffMs(attempt, random = Math.random) {
  const whole = Math.min(LONGEST_DELAY_MS, FIRST_DELAY_MS * 2 ** attempt);
  return whole * (0.5 + 0.5 * random());
}

/** @typedef {"connecting" | "open" | "waiting"} Phase */

/** A WebSocket that comes back by itself. */
export class LiveSocket {
  /**
   * @param {string} url
   * @param {{ onPhase: (phase: Phase) => void, onMessage: (text: string) => void }} handlers
   */
  constructor(url, handlers) {
    this.url = url;
    this.handlers = handlers;
    /** @type {Phase} */
    this.phase = "connecting";
    this.retryAt = 0;
    this.attempt = 0;
    /** @type {WebSocket | null} */
    this.socket = null;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
  }

  connect() {
    clearTimeout(this.timer);
    const socket = new WebSocket(this.url);
    this.socket = socket;
    this.#enter("connecting");
    // A firewall that swallows packets would otherwise hold us for the system's own minutes.
    this.timer = setTimeout(() => this.drop(), OPEN_TIMEOUT_MS);
    socket.addEventListener("open", () => {
      if (this.socket !== socket) return;
      clearTimeout(this.timer);
      this.#enter("open");
    });
    socket.addEventListener("message", (event) => {
      if (this.socket !== socket) return;
      this.handlers.onMessage(String(event.data));
    });
    // `close` follows every failure; `error` carries nothing to tell.
    socket.addEventListener("close", () => {
      if (this.socket === socket) this.drop();
    });
  }

  /**
   * The daemon has proved itself: the next loss starts with a short delay again. Not on mere
   * opening, for a daemon that accepts and dies at once must not be hammered.
   */
  settled() {
    this.attempt = 0;
  }

  /** Give the present connection up, whatever its state, and try again after the delay. */
  drop() {
    const socket = this.socket;
    this.socket = null;
    socket?.close();
    clearTimeout(this.timer);
    const delay = backoffMs(this.attempt);
    this.attempt += 1;
    this.retryAt = Date.now() + delay;
    this.timer = setTimeout(() => this.connect(), delay);
    this.#enter("waiting");
  }

  /** The network is back or somebody looks at the page again: do not sit the delay out. */
  hurry() {
    if (this.phase === "waiting") this.connect();
  }

  retryInS() {
    return Math.max(0, (this.retryAt - Date.now()) / 1000);
  }

  /** @param {Phase} phase */
  #enter(phase) {
    this.phase = phase;
    this.handlers.onPhase(phase);
  }
}
