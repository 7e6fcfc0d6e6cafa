// What the daemon would say of a calibration: a homography through the points, by least squares.

import { DOOR, SIZE, corner, mark, seenAt } from "./camera.js";

/** @import { Calibration, Check, Pixel, Point } from "../../web/types.js" */

const PATCH_M = 0.3;
/** Errors beyond this are somebody's mistake. */
const WORST_PX = 5;

/**
 * A calibration whose points are where the camera sees them, a fifth of them off by some pixels if asked.
 * @param {{ extra?: Point[], off?: Pixel }} [options]
 * @returns {Calibration}
 */
export function calibration({ extra = [], off = [0, 0] } = {}) {
  const places = [corner(-1), corner(1), mark(-1), mark(1), ...extra];
  return {
    size: SIZE,
    doorway: { ...DOOR },
    floor_points: places.map((floor_m, index) => {
      const [u, v] = seenAt(floor_m);
      const [du, dv] = index === 4 ? off : [0, 0];
      return { pixel: [round(u + du), round(v + dv)], floor_m };
    }),
    lens: null,
    transfer: null,
  };
}

/** @param {number} value */
const round = (value) => Math.round(value * 100) / 100;

/**
 * @param {Calibration} calibration
 * @returns {Check}
 */
export function check({ size, doorway, floor_points }) {
  /** @type {Check} */
  const nothing = {
    ok: false,
    errors: [],
    warnings: [],
    points: [],
    error: null,
    overlay: { edges: [null, null], door_line: [], patches: { left: [], right: [] }, grid: [] },
    seen: { left: 0, right: 0 },
  };
  const fit = homography(floor_points.map(({ floor_m }) => floor_m), floor_points.map(({ pixel }) => pixel));
  if (!fit) return { ...nothing, errors: ["floor_points do not fix the floor: expected at least 4 apart, no 3 of those 4 near one line"] };
  if (turns(floor_points.map(({ pixel }) => pixel)) * turns(floor_points.map(({ floor_m }) => floor_m)) > 0) {
    return { ...nothing, errors: ["floor_points show the floor mirrored: expected x to the right for someone who faces the door"] };
  }
  const points = floor_points.map(({ pixel, floor_m }) => {
    const there = fit(floor_m);
    const residual_px = /** @type {Pixel} */ ([pixel[0] - there[0], pixel[1] - there[1]]);
    const perM = Math.hypot(fit([floor_m[0] + 0.01, floor_m[1]])[0] - there[0], fit([floor_m[0] + 0.01, floor_m[1]])[1] - there[1]) / 0.01;
    return { residual_px, residual_mm: /** @type {Point} */ (residual_px.map((px) => (1000 * px) / perM)) };
  });
  const count = points.length;
  const rms = (/** @type {"residual_px" | "residual_mm"} */ key) =>
    Math.sqrt(points.reduce((sum, point) => sum + point[key][0] ** 2 + point[key][1] ** 2, 0) / count);
  const noise_px = count > 4 ? rms("residual_px") * Math.sqrt(count / (2 * count - 8)) : null;
  const { width_m, wall_thickness_m } = doorway;
  const edge = width_m / 2;
  const near = -wall_thickness_m;
  /** @type {(from: Point, to: Point, steps?: number) => Pixel[]} */
  const line = (from, to, steps = 8) =>
    Array.from({ length: steps + 1 }, (_, i) => fit([from[0] + ((to[0] - from[0]) * i) / steps, from[1] + ((to[1] - from[1]) * i) / steps]));
  /** @type {(x: number) => Pixel[]} */
  const square = (x) => {
    const [x0, x1, y1] = [x - PATCH_M / 2, x + PATCH_M / 2, near - PATCH_M];
    return [...line([x0, near], [x1, near]), ...line([x1, near], [x1, y1]), ...line([x1, y1], [x0, y1]), ...line([x0, y1], [x0, near])];
  };
  const reach = edge + PATCH_M;
  const grid = [];
  for (let step = 0; step <= 6; step += 1) grid.push(line([-reach, near - 0.1 * step], [reach, near - 0.1 * step]));
  for (let x = -reach; x <= reach + 1e-9; x += reach / 6) grid.push(line([x, near], [x, near - 0.6]));
  const errors = [];
  const worst = points.reduce((most, { residual_px }, index) => (Math.hypot(...residual_px) > Math.hypot(...points[most].residual_px) ? index : most), 0);
  if (Math.hypot(...points[worst].residual_px) > WORST_PX) {
    errors.push(`floor_points: point ${worst + 1} is ${Math.hypot(...points[worst].residual_px).toFixed(0)} pixels from where the others put it: is its pixel or floor_m mistyped?`);
  }
  return {
    ok: errors.length === 0,
    warnings: [],
    errors,
    points,
    error: { rms_px: rms("residual_px"), rms_mm: rms("residual_mm"), noise_px, floor_mm: 1.6 * (noise_px ?? 1) + 0.2, angle_deg: 0.4 * (noise_px ?? 1) },
    overlay: {
      edges: [fit([-edge, near]), fit([edge, near])],
      door_line: line([-reach, near], [reach, near]),
      patches: { left: square(-edge), right: square(edge) },
      grid,
    },
    seen: { left: share(square(-edge), size), right: share(square(edge), size) },
  };
}

/**
 * @param {Pixel[]} outline
 * @param {[number, number]} size
 */
function share(outline, [width, height]) {
  const inside = outline.filter(([u, v]) => u >= -0.5 && v >= -0.5 && u <= width - 0.5 && v <= height - 0.5);
  return inside.length / outline.length;
}

/**
 * Which way round the first four go, as a zigzag of corners and marks.
 * @param {[number, number][]} points
 */
function turns([[x0, y0], [x1, y1], [x2, y2]]) {
  return Math.sign((x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0));
}

/**
 * The map of the plane that takes `from` to `to`, by least squares; null when they do not determine one.
 * @param {Point[]} from
 * @param {Pixel[]} to
 * @returns {((place: Point) => Pixel) | null}
 */
function homography(from, to) {
  // In hundreds of pixels, so that the sums are of one size.
  const SCALE = 100;
  /** @type {number[][]} */
  const normal = Array.from({ length: 8 }, () => Array(9).fill(0));
  from.forEach(([x, y], index) => {
    const [u, v] = to[index].map((value) => value / SCALE);
    for (const row of [[x, y, 1, 0, 0, 0, -u * x, -u * y, u], [0, 0, 0, x, y, 1, -v * x, -v * y, v]]) {
      for (let i = 0; i < 8; i += 1) for (let j = 0; j < 9; j += 1) normal[i][j] += row[i] * row[j];
    }
  });
  for (let column = 0; column < 8; column += 1) {
    let pivot = column;
    for (let row = column; row < 8; row += 1) if (Math.abs(normal[row][column]) > Math.abs(normal[pivot][column])) pivot = row;
    if (Math.abs(normal[pivot][column]) < 1e-10) return null;
    [normal[column], normal[pivot]] = [normal[pivot], normal[column]];
    for (let row = 0; row < 8; row += 1) {
      if (row === column) continue;
      const factor = normal[row][column] / normal[column][column];
      for (let j = column; j < 9; j += 1) normal[row][j] -= factor * normal[column][j];
    }
  }
  const h = normal.map((row, i) => row[8] / row[i]);
  return ([x, y]) => {
    const w = h[6] * x + h[7] * y + 1;
    return [(SCALE * (h[0] * x + h[1] * y + h[2])) / w, (SCALE * (h[3] * x + h[4] * y + h[5])) / w];
  };
}
