/** @import { Geometry, Point } from "../types.js" */

/** Distance of the grid that corners snap to. */
export const STEP_M = 0.1;

/**
 * Where a corner is meant to be: on another zone's corner, on a wall of the room, or on the grid.
 * @param {Point} place
 * @param {Geometry} geometry
 * @param {Point[]} corners  of other zones
 * @param {number} reachM
 * @returns {Point}
 */
export function snapped([x, y], { room }, corners, reachM) {
  let nearest = null;
  let reach = reachM;
  for (const corner of corners) {
    const distance = Math.hypot(corner[0] - x, corner[1] - y);
    if (distance < reach) [nearest, reach] = [corner, distance];
  }
  if (nearest) return [...nearest];
  return [along(x, [-room.half_width_m, room.half_width_m], reachM), along(y, [0, room.depth_m], reachM)];
}

/** Millimetres are enough, and rounding keeps 0.1 + 0.2 out of a file. @param {number} metres */
export const rounded = (metres) => Math.round(1000 * metres) / 1000;

/**
 * @param {number} value
 * @param {number[]} walls
 * @param {number} reachM
 */
function along(value, walls, reachM) {
  const wall = walls.find((at) => Math.abs(at - value) < reachM);
  return rounded(wall ?? STEP_M * Math.round(value / STEP_M));
}
