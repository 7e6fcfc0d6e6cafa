import { INK } from "./ink.js";

/** @import { Uncertainty } from "../types.js" */
/** @import { Viewport } from "./viewport.js" */

const HATCH_PX = 7;

/**
 * Fog over the room: the thicker, the less exactly one frame can locate a person; hatched where it cannot.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Uncertainty} uncertainty
 */
export function drawUncertainty(ctx, view, { x_m, y_m, error_m, threshold_m }) {
  const [width, height] = [cell(x_m), cell(y_m)];
  const hatched = new Path2D();
  ctx.fillStyle = INK.fog;
  error_m.forEach((row, j) => {
    row.forEach((error, i) => {
      // Whole pixels: seams between cells would show as a grid.
      const left = Math.round(view.x(x_m[i] - width / 2));
      const top = Math.round(view.y(y_m[j] + height / 2));
      const right = Math.round(view.x(x_m[i] + width / 2));
      const bottom = Math.round(view.y(y_m[j] - height / 2));
      const observable = error !== null && error <= threshold_m;
      // By the root, so that a few centimetres can be told from none.
      ctx.globalAlpha = observable ? 0.5 * Math.sqrt(error / threshold_m) : 0.5;
      ctx.fillRect(left, top, right - left, bottom - top);
      if (!observable) hatched.rect(left, top, right - left, bottom - top);
    });
  });
  ctx.globalAlpha = 1;
  ctx.save();
  ctx.clip(hatched);
  ctx.strokeStyle = INK.fogHatch;
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  for (let x = view.left - view.height; x < view.width; x += HATCH_PX) {
    ctx.moveTo(x, view.height);
    ctx.lineTo(x + view.height, 0);
  }
  ctx.stroke();
  ctx.restore();
}

/** @param {number[]} middles */
const cell = (middles) => (middles.length > 1 ? middles[1] - middles[0] : 0);
