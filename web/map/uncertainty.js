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
export function drawUncertainty(ctx, view, uncertainty) {
  const { threshold_m } = uncertainty;
  const blind = new Path2D();
  ctx.fillStyle = INK.fog;
  eachCell(view, uncertainty, (error, left, top, width, height) => {
    const observable = error !== null && error <= threshold_m;
    // By the root, so that a few centimetres can be told from none.
    ctx.globalAlpha = observable ? 0.5 * Math.sqrt(error / threshold_m) : 0.5;
    ctx.fillRect(left, top, width, height);
    if (!observable) blind.rect(left, top, width, height);
  });
  ctx.globalAlpha = 1;
  hatch(ctx, view, blind, INK.fogHatch);
}

/**
 * Only where one frame cannot locate anybody: shaded and hatched, whatever else is shown.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Uncertainty} uncertainty
 */
export function drawBlind(ctx, view, uncertainty) {
  const blind = new Path2D();
  eachCell(view, uncertainty, (error, left, top, width, height) => {
    if (error === null || error > uncertainty.threshold_m) blind.rect(left, top, width, height);
  });
  ctx.fillStyle = INK.blind;
  ctx.fill(blind);
  hatch(ctx, view, blind, INK.blind);
}

/**
 * @param {Viewport} view
 * @param {Uncertainty} uncertainty
 * @param {(error: number | null, left: number, top: number, width: number, height: number) => void} draw
 */
function eachCell(view, { x_m, y_m, error_m }, draw) {
  const [width, height] = [cell(x_m), cell(y_m)];
  error_m.forEach((row, j) => {
    row.forEach((error, i) => {
      // Whole pixels: seams between cells would show as a grid.
      const left = Math.round(view.x(x_m[i] - width / 2));
      const top = Math.round(view.y(y_m[j] + height / 2));
      const right = Math.round(view.x(x_m[i] + width / 2));
      const bottom = Math.round(view.y(y_m[j] - height / 2));
      draw(error, left, top, right - left, bottom - top);
    });
  });
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Path2D} area
 * @param {string} colour
 */
function hatch(ctx, view, area, colour) {
  ctx.save();
  ctx.clip(area);
  ctx.strokeStyle = colour;
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
