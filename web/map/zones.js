import { FONT, INK } from "./ink.js";

/** @import { Occupancy, Point, Zone } from "../types.js" */
/** @import { Viewport } from "./viewport.js" */

/** @typedef {{ zones: Zone[], chosen: number | null, sketch: Point[] | null }} EditedZones  sketch: the corners of one that is being drawn */

/**
 * Outlines, names, and how many people are inside.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Zone[]} zones
 * @param {Occupancy[]} occupancy
 */
export function drawZones(ctx, view, zones, occupancy) {
  for (const { name, polygon_m } of zones) {
    const people = occupancy.find((zone) => zone.name === name)?.people ?? 0;
    drawZone(ctx, view, polygon_m, people > 0 ? `${name}: ${people}` : name, people > 0 ? 2 : 1);
  }
}

/**
 * The zones while somebody draws them.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {EditedZones} edited
 */
export function drawEditedZones(ctx, view, { zones, chosen, sketch }) {
  zones.forEach(({ name, polygon_m }, index) => {
    drawZone(ctx, view, polygon_m, name, index === chosen ? 2 : 1);
    if (index !== chosen) return;
    ctx.fillStyle = INK.zoneChosen;
    ctx.fill();
  });
  if (!sketch) return;
  ctx.strokeStyle = INK.zone;
  ctx.fillStyle = INK.zone;
  ctx.lineWidth = 2;
  ctx.setLineDash([5, 4]);
  outline(ctx, view, sketch);
  ctx.stroke();
  ctx.setLineDash([]);
  for (const corner of sketch) {
    ctx.beginPath();
    ctx.arc(...view.point(corner), 4, 0, 2 * Math.PI);
    ctx.fill();
  }
}

/**
 * Leaves the outline as the context's path.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Point[]} corners
 * @param {string} words
 * @param {number} width
 */
function drawZone(ctx, view, corners, words, width) {
  const places = corners.map((corner) => view.point(corner));
  const xs = places.map(([x]) => x);
  ctx.font = FONT;
  ctx.textAlign = "center";
  ctx.textBaseline = "top";
  ctx.lineWidth = width;
  ctx.strokeStyle = INK.zone;
  ctx.fillStyle = INK.zone;
  ctx.fillText(words, (Math.min(...xs) + Math.max(...xs)) / 2, Math.min(...places.map(([, y]) => y)) + 5);
  outline(ctx, view, corners);
  ctx.closePath();
  ctx.stroke();
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Point[]} corners
 */
function outline(ctx, view, corners) {
  ctx.beginPath();
  corners.forEach((corner) => ctx.lineTo(...view.point(corner)));
}
