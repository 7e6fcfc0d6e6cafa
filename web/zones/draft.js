/** @import { Point, Zone } from "../types.js" */

const MOST_UNDO = 100;
// As the daemon has it.
const LEAST_M2 = 0.01;
export const LONGEST_NAME = 40;

/** The zones as somebody draws them, with every step back. */
export class ZoneDraft {
  /** @param {Zone[]} zones */
  constructor(zones) {
    this.original = JSON.stringify(zones);
    /** @type {Zone[]} */
    this.zones = structuredClone(zones);
    /** @type {string[]} */
    this.before = [];
    /** @type {string[]} */
    this.after = [];
    /** @type {unknown} What the last change was of: a drag is one step, however many moves it has. */
    this.of = null;
  }

  get changed() {
    return JSON.stringify(this.zones) !== this.original;
  }

  /**
   * @param {(zones: Zone[]) => void} change
   * @param {unknown} [of]  changes of the same are one step; null: a step of its own
   */
  change(change, of = null) {
    if (of === null || of !== this.of) this.before = [...this.before, JSON.stringify(this.zones)].slice(-MOST_UNDO);
    this.of = of;
    this.after = [];
    change(this.zones);
  }

  /** What comes next is another step. */
  rest() {
    this.of = null;
  }

  undo() {
    const before = this.before.pop();
    if (before === undefined) return;
    this.after.push(JSON.stringify(this.zones));
    this.zones = JSON.parse(before);
    this.of = null;
  }

  redo() {
    const after = this.after.pop();
    if (after === undefined) return;
    this.before.push(JSON.stringify(this.zones));
    this.zones = JSON.parse(after);
    this.of = null;
  }

  /** A name that no zone has yet. */
  freeName() {
    for (let number = this.zones.length + 1; ; number += 1) {
      if (!this.zones.some(({ name }) => name === `zone ${number}`)) return `zone ${number}`;
    }
  }

  /**
   * What is wrong with a zone; the daemon has the last word.
   * @param {number} index
   * @returns {string | null}
   */
  problem(index) {
    const { name, polygon_m } = this.zones[index];
    if (name.trim() === "") return "Give it a name.";
    if ([...name].length > LONGEST_NAME) return `A name has at most ${LONGEST_NAME} characters.`;
    if (this.zones.some((other, k) => k !== index && other.name === name)) return `Another zone is named “${name}”.`;
    if (crossesItself(polygon_m)) return "Its border crosses itself.";
    return areaOf(polygon_m) < LEAST_M2 ? "It is too small." : null;
  }

  /** @returns {string | null} of any */
  get trouble() {
    for (let index = 0; index < this.zones.length; index += 1) {
      const problem = this.problem(index);
      if (problem) return `${this.zones[index].name || "A zone"}: ${problem}`;
    }
    return null;
  }
}

/** @param {Point[]} corners */
export function areaOf(corners) {
  let twice = 0;
  corners.forEach(([x, y], k) => {
    const [nextX, nextY] = corners[(k + 1) % corners.length];
    twice += x * nextY - nextX * y;
  });
  return Math.abs(twice) / 2;
}

/** @param {Point[]} corners */
export function crossesItself(corners) {
  const count = corners.length;
  for (let i = 0; i < count; i += 1) {
    for (let j = i + 2; j < count; j += 1) {
      if (i === 0 && j === count - 1) continue;
      if (cross(corners[i], corners[i + 1], corners[j], corners[(j + 1) % count])) return true;
    }
  }
  return false;
}

/** @type {(a: Point, b: Point, c: Point, d: Point) => boolean} */
function cross(a, b, c, d) {
  const turn = (/** @type {Point} */ p, /** @type {Point} */ q, /** @type {Point} */ r) =>
    Math.sign((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]));
  return turn(a, b, c) !== turn(a, b, d) && turn(c, d, a) !== turn(c, d, b);
}
