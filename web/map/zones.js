import { FONT, INK } from "./ink.js";

/** @import { Occupancy, Zone } from "../types.js" */
/** @import { Viewport } from "./viewport.js" */

/**
 * Outlines, names, and how many people are inside.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Zone[]} zones
 * @param {Occupancy[]} occupancy
 */
export function drawZones(ctx, view, zones, occupancy) {
  ctx.font = FONT;
  ctx.textAlign = "center";
  ctx.textBaseline = "top";
  for (const { name, polygon_m } of zones) {
    const people = occupancy.find((zone) => zone.name === name)?.people ?? 0;
    const corners = polygon_m.map((corner) => view.point(corner));
    ctx.beginPath();
    corners.forEach((corner) => ctx.lineTo(...corner));
    ctx.closePath();
    ctx.lineWidth = people > 0 ? 2 : 1;
    ctx.strokeStyle = INK.zone;
    ctx.stroke();
    ctx.fillStyle = INK.zone;
    const xs = corners.map(([x]) => x);
    const top = Math.min(...corners.map(([, y]) => y));
    ctx.fillText(people > 0 ? `${name}: ${people}` : name, (Math.min(...xs) + Math.max(...xs)) / 2, top + 5);
  }
}
