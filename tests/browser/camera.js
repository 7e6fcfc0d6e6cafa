// A made-up camera above a made-up doorway: where it sees the floor, and the picture it gives.

import { png } from "./png.js";

/** @import { Doorway, Pixel, Point } from "../../web/types.js" */

/** @typedef {[number, number, number]} Vector */

/** @type {[number, number]} */
export const SIZE = [640, 360];
/** @type {Doorway} */
export const DOOR = { width_m: 0.85, wall_thickness_m: 0.12, height_m: 2.03 };
/** Crosses of tape on the floor, straight out from the door's corners. */
export const MARKS_OUT_M = 0.3;

/** @type {Vector} */
const EYE = [0.1, -1.02, 1.62];
/** @type {Vector} */
const TARGET = [0.02, -0.34, 0];
const FOCAL_PX = 640;
const ROLL = 0.05;

/** @type {(a: Vector, b: Vector) => Vector} */
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @type {(a: Vector, b: Vector) => number} */
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @type {(a: Vector) => Vector} */
const unit = (a) => /** @type {Vector} */ (a.map((value) => value / Math.hypot(...a)));
/** @type {(a: Vector, s: number, b: Vector, t: number) => Vector} */
const mix = (a, s, b, t) => [s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]];

const forward = unit(mix(TARGET, 1, EYE, -1));
const level = unit(cross(forward, [0, 0, 1]));
const right = mix(level, Math.cos(ROLL), cross(forward, level), Math.sin(ROLL));
const down = cross(forward, right);

/**
 * Where the camera sees a place on the floor.
 * @param {Point} place  metres, door frame
 * @returns {Pixel}
 */
export function seenAt([x, y]) {
  const ray = mix([x, y, 0], 1, EYE, -1);
  const depth = dot(ray, forward);
  const centre = SIZE.map((size) => (size - 1) / 2);
  return [centre[0] + (FOCAL_PX * dot(ray, right)) / depth, centre[1] + (FOCAL_PX * dot(ray, down)) / depth];
}

/** @type {(side: -1 | 1) => Point} */
export const corner = (side) => [(side * DOOR.width_m) / 2, -DOOR.wall_thickness_m];
/** @type {(side: -1 | 1) => Point} */
export const mark = (side) => [(side * DOOR.width_m) / 2, -DOOR.wall_thickness_m - MARKS_OUT_M];

/** @type {Buffer | undefined} */
let picture;

/** What the camera gives: the same each time. */
export function cameraPicture() {
  picture ??= png(...SIZE, (u, v) => {
    const parts = [0.25, 0.75].flatMap((dv) => [0.25, 0.75].map((du) => colourOf(u + du - 0.5, v + dv - 0.5)));
    const mean = (/** @type {0 | 1 | 2} */ channel) => parts.reduce((sum, part) => sum + part[channel], 0) / parts.length;
    return [mean(0), mean(1), mean(2)];
  });
  return picture;
}

/**
 * @param {number} u
 * @param {number} v
 * @returns {Vector}
 */
function colourOf(u, v) {
  const ray = mix(forward, FOCAL_PX, mix(right, u - (SIZE[0] - 1) / 2, down, v - (SIZE[1] - 1) / 2), 1);
  const { width_m, wall_thickness_m, height_m } = DOOR;
  // The wall's near face, where there is wall.
  const toWall = (-wall_thickness_m - EYE[1]) / ray[1];
  const [wallX, , wallZ] = mix(EYE, 1, ray, toWall);
  const open = Math.abs(wallX) < width_m / 2 && wallZ < (height_m ?? Infinity);
  if (toWall > 0 && wallZ > 0 && !open) {
    const frame = Math.abs(wallX) < width_m / 2 + 0.06;
    const skirting = wallZ < 0.08;
    return frame ? [206, 200, 190] : skirting ? [176, 172, 165] : [196, 186, 168];
  }
  // The jambs, between the wall's two faces.
  for (const side of [-1, 1]) {
    const toJamb = ((side * width_m) / 2 - EYE[0]) / ray[0];
    const [, jambY, jambZ] = mix(EYE, 1, ray, toJamb);
    if (toJamb > 0 && jambY > -wall_thickness_m && jambY < 0 && jambZ > 0) return side < 0 ? [186, 180, 170] : [150, 145, 138];
  }
  const [x, y] = mix(EYE, 1, ray, -EYE[2] / ray[2]);
  return floorColour(x, y);
}

/**
 * Boards, the light that falls through the door, and the tape.
 * @param {number} x
 * @param {number} y
 * @returns {Vector}
 */
function floorColour(x, y) {
  for (const side of /** @type {const} */ ([-1, 1])) {
    const [dx, dy] = [x - mark(side)[0], y - mark(side)[1]].map(Math.abs);
    if ((dx < 0.035 && dy < 0.006) || (dy < 0.035 && dx < 0.006)) return [40, 90, 200];
  }
  const board = Math.floor((x + 10) / 0.12);
  const across = (x + 10) / 0.12 - board;
  const joint = (y + 10 + 0.37 * (board % 3)) % 1.1;
  const seam = across < 0.03 || joint < 0.006 ? 0.72 : 1;
  const tone = 0.92 + 0.08 * Math.sin(board * 12.9) + 0.02 * Math.sin(90 * x + 7 * Math.sin(9 * y));
  const out = -DOOR.wall_thickness_m - y;
  const fan = out <= 0 ? 1 : 1 / (1 + Math.exp((Math.abs(x) - DOOR.width_m / 2 - 0.6 * out) / (0.02 + 0.3 * out)));
  const light = (0.55 + 0.5 * fan * Math.exp(-Math.max(out, 0) / 0.9)) * tone * seam;
  return [Math.min(255, 172 * light), Math.min(255, 128 * light), Math.min(255, 92 * light)];
}
