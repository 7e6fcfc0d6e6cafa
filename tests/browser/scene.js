// A made-up door, grid and updates, in the daemon's own words.

/** @import { Crossings, Geometry, LitFacet, Point, Rgb, RoomEvent, Status, Track, Update } from "../../web/types.js" */

/**
 * A biangular grid like the daemon's, without the care it takes at the walls: facets join diagonal corners of the cells.
 * @param {{ width?: number, thickness?: number, intervals?: number }} [door]
 * @returns {Geometry}
 */
export function geometry({ width = 0.508, thickness = 0, intervals = 45 } = {}) {
  /** @type {(i: number, j: number) => Point} */
  const corner = (i, j) => {
    const [a1, a2] = [(i * Math.PI) / intervals, (j * Math.PI) / intervals];
    const rho = (width * Math.sin(a2)) / Math.sin(a1 + a2);
    return [rho * Math.cos(a1) - width / 2, rho * Math.sin(a1)];
  };
  /** @type {[Point, Point][]} */
  const facets = [];
  for (let i = 1; i < intervals; i += 1) {
    for (let j = 1; i + j + 2 < intervals; j += 1) {
      const ends = /** @type {[Point, Point]} */ ([corner(i, j + 1), corner(i + 1, j)]);
      const [x, y] = [(ends[0][0] + ends[1][0]) / 2, (ends[0][1] + ends[1][1]) / 2];
      const toEdges = Math.hypot(x - width / 2, y) + Math.hypot(x + width / 2, y);
      if (Math.abs(x) <= 1.5 && y <= 3 && toEdges > 1.3) facets.push(ends);
    }
  }
  return {
    doorway: { width_m: width, wall_thickness_m: thickness, height_m: null },
    room: { half_width_m: 1.5, depth_m: 3 },
    patch: { fov_m: 0.15, pixels: 64 },
    facets,
    foreground: facets.map((ends) => Math.min(...ends.map(([x]) => Math.abs(x))) < 1 && Math.min(...ends.map(([, y]) => y)) < 1.875),
    calibration: 1,
    zones: [],
    zones_revision: 0,
  };
}

/** @returns {Status} */
export function status() {
  return {
    version: "0.1.0",
    state: "watching",
    time: new Date().toISOString(),
    uptime_s: 754.2,
    model: "published",
    preset: "published",
    lambda: 0.05,
    source: {
      spec: "replay:recordings/two-people,loop",
      kind: "replay",
      state: "streaming",
      notes: "Simulated: two people in an empty room, no camera involved.",
      fps: 10,
      error: null,
      granted: null,
    },
    frames: { captured: 7542, solved: 7540, dropped: 2, skipped: 1, lost: 0, last_skipped: "frames/00000003.jpg: unexpected end of file" },
    rate_hz: { captured: 10, solved: 10 },
    last_update: null,
    clients: 1,
    recording: null,
    history: { state: "stored", reason: null, file: "/var/lib/doorcam/history.sqlite", bytes: 1_200_000, lost: 0 },
    publish: { mqtt: null, webhooks: [] },
    zones_revision: 0,
    crossings: crossings(),
    calibrated: true,
    calibration_revision: 1,
    background: { age_s: 312, frames: 200, progress: null },
  };
}

/**
 * Who walked through the doorway: three came in, one went out.
 * @param {Partial<Crossings>} [rest]
 * @returns {Crossings}
 */
export function crossings(rest = {}) {
  return { available: true, reason: null, inside: 2, since: "2026-03-01T00:00:00Z", in: 3, out: 1, back: 4, last: null, ...rest };
}

/**
 * @param {RoomEvent["kind"]} kind
 * @param {number} secondsAgo
 * @returns {RoomEvent}
 */
export function crossing(kind, secondsAgo) {
  const time = new Date(Date.now() - 1000 * secondsAgo).toISOString();
  return { sequence: 7, kind, time, track: 3, x_m: 0.1, y_m: 0, zone: null, through: null, reason: null, speed_m_s: 1.2 };
}

/**
 * The same daemon on a webcam.
 * @returns {Status}
 */
export function cameraStatus() {
  const base = status();
  return {
    ...base,
    source: {
      spec: "v4l2:/dev/v4l/by-id/usb-Example_Webcam_C270-video-index0",
      kind: "v4l2",
      state: "streaming",
      notes: null,
      fps: 30,
      error: null,
      granted: { node: "/dev/video0", card: "Example Webcam C270", format: "YUYV", size: [640, 360], fps: 30, mismatches: [] },
    },
  };
}

/**
 * @param {number} sequence
 * @param {LitFacet[]} facets
 * @param {Partial<Update>} [rest]
 * @returns {Update}
 */
export function update(sequence, facets, rest = {}) {
  return {
    version: 1,
    sequence,
    time: new Date().toISOString(),
    frame: sequence % 200,
    state: "watching",
    solution: { lambda: 0.05, objective: 0.5472, data: 0.0858, penalty: 0.4614, bound: 0.5455, iterations: 14, warm: true },
    model: "published",
    illumination: { left: [-0.01, -0.01, -0.012], right: [-0.01, -0.01, -0.012] },
    gain: { left: [0.98, 0.97, 0.96], right: [1.01, 1.012, 1.014] },
    facets,
    tracks: [],
    calibration: 1,
    timing_ms: { decode: 2.1, rectify: 0.8, background: 0.2, project: 0.4, solve: 3.2, track: 0, total: 6.9 },
    ...rest,
  };
}

/**
 * @param {number} index
 * @param {Rgb} unified
 * @param {{ left?: Rgb, right?: Rgb, refit?: number }} [rest]
 * @returns {LitFacet}
 */
export const lit = (index, unified, { left = unified, right = unified, refit = 1 } = {}) => ({ index, left, right, unified, refit });

/**
 * @param {Geometry} room
 * @param {number} index
 * @returns {Point}
 */
export function middle(room, index) {
  const [[x0, y0], [x1, y1]] = room.facets[index];
  return [(x0 + x1) / 2, (y0 + y1) / 2];
}

/**
 * Index of the facet nearest to a point of the room.
 * @param {Geometry} room
 * @param {number} x
 * @param {number} y
 */
export function nearest(room, x, y) {
  const distance = (/** @type {number} */ index) => Math.hypot(middle(room, index)[0] - x, middle(room, index)[1] - y);
  return room.facets.map((_, index) => index).reduce((best, index) => (distance(index) < distance(best) ? index : best), 0);
}

/**
 * Two people who walk about: one in red, one in blue, each hiding a piece of the far wall.
 * @param {Geometry} room
 * @param {number} sequence
 */
export function twoPeople(room, sequence) {
  const t = sequence / 25;
  /** @type {{ x: number, y: number, rgb: Rgb }[]} */
  const people = [
    { x: -0.6 + 0.35 * Math.sin(t), y: 1.15 + 0.2 * Math.cos(t), rgb: [0.021, 0.006, 0.0035] },
    { x: 0.55 + 0.3 * Math.cos(0.8 * t), y: 1.05 + 0.3 * Math.sin(0.8 * t), rgb: [0.003, 0.008, 0.019] },
  ];
  /** @type {LitFacet[]} */
  const facets = [];
  room.facets.forEach((_, index) => {
    const [x, y] = middle(room, index);
    /** @type {[Rgb, Rgb]} */
    const views = [[0, 0, 0], [0, 0, 0]];
    for (const [view, side] of [-1, 1].entries()) {
      for (const person of people) {
        const edge = (side * room.doorway.width_m) / 2;
        const angle = Math.atan2(y, x - edge) - Math.atan2(person.y, person.x - edge);
        const body = Math.exp(-(((x - person.x) ** 2 + (y - person.y) ** 2) / 0.03));
        const shadow = room.foreground[index] ? 0 : Math.exp(-((angle / 0.09) ** 2));
        if (body > 0.3) views[view] = /** @type {Rgb} */ (person.rgb.map((c) => c * body * (1 - 0.25 * side * person.x)));
        else if (shadow > 0.3) views[view] = /** @type {Rgb} */ ([-0.0045, -0.0052, -0.0038].map((c) => c * shadow));
      }
    }
    const [left, right] = views;
    const both = left[1] * right[1] > 0;
    const unified = /** @type {Rgb} */ (both ? left.map((c, i) => (c + right[i]) / 2) : [0, 0, 0]);
    if ([...left, ...right].some((c) => c !== 0)) facets.push({ index, left, right, unified, refit: 1.25 });
  });
  // As people mostly do, they darken what is behind them; their speed is that of the circles they walk.
  const speeds = [[0.35 * Math.cos(t), -0.2 * Math.sin(t)], [-0.24 * Math.sin(0.8 * t), 0.24 * Math.cos(0.8 * t)]];
  const tracks = people.map(({ x, y, rgb }, index) => /** @type {Track} */ ({
    id: index + 1, state: "confirmed", x_m: x, y_m: y, vx_m_s: speeds[index][0], vy_m_s: speeds[index][1],
    covariance_m2: [[0.004, 0.001], [0.001, 0.01]], rgb, age_s: sequence / 10,
  }));
  return update(sequence, facets, { tracks });
}
