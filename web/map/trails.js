import { INK } from "./ink.js";

/** @import { Point, Track, Update } from "../types.js" */
/** @import { Viewport } from "./viewport.js" */

const LENGTH_MS = 4000;
const MOST_POINTS = 128;

/** Where people were in the last seconds. */
export class Trails {
  /** @type {Map<number, { at: number, place: Point }[]>} */
  #of = new Map();

  /** @param {Update} update */
  follow({ time, tracks }) {
    const at = Date.parse(time);
    const before = this.#of;
    this.#of = new Map();
    for (const { id, x_m, y_m } of tracks) {
      // A time that goes back, as a recording's that begins again does, cuts the trail off.
      const kept = (before.get(id) ?? []).filter((p) => p.at < at && at - p.at <= LENGTH_MS);
      this.#of.set(id, [...kept, { at, place: /** @type {Point} */ ([x_m, y_m]) }].slice(-MOST_POINTS));
    }
  }

  clear() {
    this.#of.clear();
  }

  /**
   * @param {CanvasRenderingContext2D} ctx
   * @param {Viewport} view
   * @param {Track[]} tracks
   */
  draw(ctx, view, tracks) {
    ctx.strokeStyle = INK.trail;
    ctx.lineWidth = 2;
    for (const { id, state } of tracks) {
      const trail = this.#of.get(id) ?? [];
      if (state === "tentative" || trail.length < 2) continue;
      ctx.beginPath();
      trail.forEach(({ place }) => ctx.lineTo(...view.point(place)));
      ctx.stroke();
    }
  }
}
