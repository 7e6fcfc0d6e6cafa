/** @import { Calibration, CameraMoved, Doorway, Leaf, Lens, Pixel, Point, Transfer } from "../types.js" */

/** @typedef {"left-corner" | "right-corner" | "left-mark" | "right-mark" | "free"} Role */

/**
 * A point of the floor and where it is in the picture. A corner or mark follows the door's measures;
 * a free one has a place of its own.
 * @typedef {object} DraftPoint
 * @property {Role} role
 * @property {Pixel} pixel
 * @property {Point} floor  used by free points only: see `Draft.floorOf`
 * @property {boolean} placed  somebody has put it where it is; the page's own guess is nothing to save
 */

export const LEAST_POINTS = 4;
/** Marks this far out from the wall span both floor patches. */
export const DISTANCE_M = 0.3;
/** Stands in for what nobody has measured yet, so that there is something to look at. */
export const TYPICAL = { width_m: 0.8, wall_thickness_m: 0.1 };

// Two floor positions this near to each other are the same one, written with fewer decimals.
const SAME_M = 0.0006;

/** @type {Record<Role, string>} */
const NAMES = {
  "left-corner": "Left door corner",
  "right-corner": "Right door corner",
  "left-mark": "Left mark",
  "right-mark": "Right mark",
  free: "Point",
};

/** A calibration while it is being made. */
export class Draft {
  /** @param {[number, number]} size  of the picture */
  constructor(size) {
    this.size = size;
    /** @type {{ width_m: number | null, wall_thickness_m: number | null, height_m: number | null, leaf?: Leaf }} */
    this.door = { width_m: null, wall_thickness_m: null, height_m: null };
    this.distance_m = DISTANCE_M;
    /** @type {Lens | null} */
    this.lens = null;
    /** @type {Transfer | null} */
    this.transfer = null;
    this.points = rectangle(size);
  }

  /**
   * @param {Calibration} calibration
   * @param {[number, number] | null} size  of the picture now; it may have changed since
   */
  static of(calibration, size) {
    const draft = new Draft(calibration.size);
    draft.door = { ...calibration.doorway };
    draft.lens = calibration.lens ?? null;
    draft.transfer = calibration.transfer ?? null;
    const { points, distance_m } = recognise(calibration);
    draft.points = points;
    draft.distance_m = distance_m ?? DISTANCE_M;
    if (size) draft.resize(size);
    return draft;
  }

  /** @returns {Doorway} */
  get doorway() {
    return {
      width_m: this.door.width_m ?? TYPICAL.width_m,
      wall_thickness_m: this.door.wall_thickness_m ?? TYPICAL.wall_thickness_m,
      height_m: this.door.height_m,
      ...(this.door.leaf ? { leaf: this.door.leaf } : {}),
    };
  }

  /**
   * Metres in the door frame: the origin is on the wall's far face, the corners stand on the near one.
   * @param {DraftPoint} point
   * @returns {Point}
   */
  floorOf(point) {
    if (point.role === "free") return point.floor;
    const { width_m, wall_thickness_m } = this.doorway;
    const side = point.role.startsWith("left") ? -0.5 : 0.5;
    const out = point.role.endsWith("mark") ? this.distance_m : 0;
    return [round(side * width_m, 4), round(-wall_thickness_m - out, 4)];
  }

  /** @param {DraftPoint} point */
  nameOf(point) {
    return point.role === "free" ? `${NAMES.free} ${this.badgeOf(point)}` : NAMES[point.role];
  }

  /** To be said after its badge. @param {DraftPoint} point */
  kindOf(point) {
    return NAMES[point.role].toLowerCase();
  }

  /** @param {DraftPoint} point */
  badgeOf(point) {
    if (point.role === "left-corner") return "L";
    if (point.role === "right-corner") return "R";
    return String(this.points.indexOf(point) + 1);
  }

  /**
   * @param {DraftPoint} point
   * @param {Pixel} pixel
   */
  place(point, [u, v]) {
    point.pixel = this.#inside([u, v]);
    point.placed = true;
  }

  /**
   * A corner or mark that is given a place of its own follows the door no longer.
   * @param {DraftPoint} point
   * @param {Point} floor
   */
  stand(point, floor) {
    if (point.role.endsWith("corner")) return;
    point.role = "free";
    point.floor = floor;
  }

  /** A further point, in the middle of the marks: any place will do that is measured and seen. */
  add() {
    const { wall_thickness_m } = this.doorway;
    const others = this.points.slice(2);
    const mean = (/** @type {0 | 1} */ axis) => others.reduce((sum, point) => sum + point.pixel[axis], 0) / others.length;
    /** @type {DraftPoint} */
    const point = {
      role: "free",
      pixel: this.#inside([mean(0), mean(1)]),
      floor: [0, round(-wall_thickness_m - this.distance_m, 4)],
      placed: false,
    };
    this.points.push(point);
    return point;
  }

  /** @param {DraftPoint} point */
  mayRemove(point) {
    return this.points.length > LEAST_POINTS && !point.role.endsWith("corner");
  }

  /** @param {DraftPoint} point */
  remove(point) {
    if (this.mayRemove(point)) this.points = this.points.filter((other) => other !== point);
  }

  /**
   * The camera gives another picture size: what is seen is taken to be the same.
   * @param {[number, number]} size
   */
  resize(size) {
    const [across, down] = [size[0] / this.size[0], size[1] / this.size[1]];
    this.size = size;
    if (across === 1 && down === 1) return;
    for (const point of this.points) {
      const [u, v] = point.pixel;
      point.pixel = this.#inside([(u + 0.5) * across - 0.5, (v + 0.5) * down - 0.5]);
    }
    if (this.lens?.focal_px) this.lens = { ...this.lens, focal_px: round(this.lens.focal_px * across, 3) };
  }

  /**
   * The camera has moved: puts the points where they should be seen now. What left the picture stays at its border.
   * @param {CameraMoved} moved
   */
  follow({ dx_px, dy_px, rotation_deg }) {
    const turn = ((rotation_deg ?? 0) * Math.PI) / 180;
    const [middle, centre] = [(this.size[0] - 1) / 2, (this.size[1] - 1) / 2];
    for (const point of this.points) {
      const [x, y] = [point.pixel[0] - middle, point.pixel[1] - centre];
      const turned = [Math.cos(turn) * x - Math.sin(turn) * y, Math.sin(turn) * x + Math.cos(turn) * y];
      point.pixel = this.#inside([middle + (dx_px ?? 0) + turned[0], centre + (dy_px ?? 0) + turned[1]]);
    }
  }

  /** @returns {Calibration} */
  body() {
    return {
      size: this.size,
      doorway: this.doorway,
      floor_points: this.points.map((point) => ({ pixel: point.pixel, floor_m: this.floorOf(point) })),
      lens: this.lens,
      transfer: this.transfer,
    };
  }

  /** What somebody must still do before this is theirs to save; null if nothing. */
  missing() {
    if (this.door.width_m === null) return "Measure the door and type its width.";
    if (this.door.wall_thickness_m === null) return "Type the thickness of the wall.";
    const point = this.points.find((candidate) => !candidate.placed);
    return point ? `Put point ${this.badgeOf(point)} where it belongs: it is still where this page put it.` : null;
  }

  /**
   * @param {Pixel} pixel
   * @returns {Pixel}
   */
  #inside([u, v]) {
    const clamp = (/** @type {number} */ value, /** @type {number} */ size) =>
      round(Math.min(Math.max(value, -0.5), size - 0.5), 3);
    return [clamp(u, this.size[0]), clamp(v, this.size[1])];
  }
}

/**
 * The corners and a mark straight out from each: a rectangle that any tape measure can make, here
 * roughly as a camera above the floor sees it.
 * @param {[number, number]} size
 * @returns {DraftPoint[]}
 */
function rectangle([width, height]) {
  /** @type {[Role, number, number][]} */
  const places = [["left-corner", 0.28, 0.3], ["right-corner", 0.72, 0.3], ["left-mark", 0.24, 0.7], ["right-mark", 0.76, 0.7]];
  return places.map(([role, u, v]) => ({ role, pixel: [Math.round(u * width), Math.round(v * height)], floor: [0, 0], placed: false }));
}

/**
 * Which points of a calibration are the door's corners and which marks straight out from them.
 * @param {Calibration} calibration
 * @returns {{ points: DraftPoint[], distance_m: number | null }}
 */
function recognise({ doorway, floor_points }) {
  /** @type {DraftPoint[]} */
  const points = floor_points.map(({ pixel, floor_m }) => ({ role: "free", pixel, floor: floor_m, placed: true }));
  const face = -doorway.wall_thickness_m;
  const at = (/** @type {number} */ x, /** @type {number} */ y) =>
    points.find(({ role, floor }) => role === "free" && Math.hypot(floor[0] - x, floor[1] - y) < SAME_M);
  const left = -doorway.width_m / 2;
  const corners = [at(left, face), at(-left, face)];
  if (corners[0]) corners[0].role = "left-corner";
  if (corners[1]) corners[1].role = "right-corner";
  /** @type {number | null} */
  let distance_m = null;
  for (const mark of points) {
    const out = face - mark.floor[1];
    const other = out > 0.01 && Math.abs(mark.floor[0] - left) < SAME_M ? at(-left, mark.floor[1]) : undefined;
    if (mark.role !== "free" || !other) continue;
    mark.role = "left-mark";
    other.role = "right-mark";
    distance_m = round(out, 4);
    break;
  }
  const order = ["left-corner", "right-corner", "left-mark", "right-mark", "free"];
  points.sort((a, b) => order.indexOf(a.role) - order.indexOf(b.role));
  return { points, distance_m };
}

/**
 * @param {number} value
 * @param {number} digits
 */
export const round = (value, digits) => Math.round(value * 10 ** digits) / 10 ** digits || 0;
