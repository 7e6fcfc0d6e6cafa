import { Refusal, getFrame } from "../api.js";

const PERIOD_MS = 250;
// No picture yet: the browser's console notes each refusal, so ask seldom.
const RETRY_MS = 2000;
const STALE_MS = 2000;

/** The camera's picture while somebody looks at it: four times a second, one request at a time. */
export class CameraPicture {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {{ onSize: (size: [number, number]) => void, onPicture: () => void }} handlers
   */
  constructor(canvas, handlers) {
    this.canvas = canvas;
    this.handlers = handlers;
    const context = canvas.getContext("2d", { alpha: false });
    if (!context) throw new Error("this browser has no 2D canvas");
    this.ctx = context;
    /** Counts starts and stops, so that a round of an earlier one knows that it is over. */
    this.run = 0;
    /** @type {number | null} When the last new picture was got. */
    this.gotAt = null;
    /** @type {string | null} The camera's time of it. */
    this.captured = null;
    /** @type {string | null} */
    this.refusal = null;
  }

  start() {
    this.run += 1;
    void this.#loop(this.run);
  }

  stop() {
    this.run += 1;
    this.gotAt = null;
    this.captured = null;
    this.refusal = null;
  }

  /** Seconds since the picture shown was got; null before the first. */
  get ageS() {
    return this.gotAt === null ? null : (performance.now() - this.gotAt) / 1000;
  }

  /** What is on the screen may no longer be what the camera sees. */
  get stale() {
    return this.ageS !== null && 1000 * this.ageS > STALE_MS;
  }

  /** @param {number} run */
  async #loop(run) {
    while (run === this.run) {
      const began = performance.now();
      const got = document.hidden || (await this.#load(run));
      const rest = (got ? PERIOD_MS : RETRY_MS) - (performance.now() - began);
      await new Promise((done) => setTimeout(done, Math.max(0, rest)));
    }
  }

  /**
   * @param {number} run
   * @returns {Promise<boolean>}
   */
  async #load(run) {
    try {
      // Decoded here and painted, not given to an <img>: the magnifier paints from it too, and the
      // page's policy lets no image come from a blob.
      const { captured, picture } = await getFrame();
      const bitmap = await createImageBitmap(picture);
      if (run === this.run) this.#show(bitmap, captured);
      bitmap.close();
      this.refusal = null;
      return true;
    } catch (error) {
      this.refusal = error instanceof Refusal ? error.message : null;
      return false;
    }
  }

  /**
   * @param {ImageBitmap} bitmap
   * @param {string | null} captured
   */
  #show(bitmap, captured) {
    const { canvas } = this;
    const { width, height } = bitmap;
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
    }
    this.ctx.drawImage(bitmap, 0, 0);
    // A camera that has stopped leaves its last picture behind, to be got again and again.
    if (captured === null || captured !== this.captured) this.gotAt = performance.now();
    this.captured = captured;
    this.handlers.onSize([width, height]);
    this.handlers.onPicture();
  }
}
