import { resizeList, setText } from "../dom.js";
import { fixed } from "../format.js";
import { NumberField } from "./number-field.js";
import { round } from "./points.js";
import { residualWords } from "./words.js";

/** @import { PointCheck } from "../types.js" */
/** @import { Draft, DraftPoint } from "./points.js" */

/** @typedef {"u" | "v" | "x" | "y"} Column */

/** Farther from the door than this no camera sees the floor. */
const FARTHEST_M = 20;
const COLUMNS = /** @type {const} */ (["u", "v", "x", "y"]);
const TITLES = { u: "u, pixels", v: "v, pixels", x: "x, metres", y: "y, metres" };

/**
 * @typedef {object} Row
 * @property {Record<Column, NumberField>} fields
 * @property {HTMLElement} badge
 * @property {HTMLElement} name
 * @property {HTMLElement} note
 * @property {HTMLButtonElement} remove
 */

/** The points in numbers, each to be typed as well as dragged. */
export class PointTable {
  /**
   * @param {HTMLTableElement} table
   * @param {{ onTyped: (point: DraftPoint) => void, onRemove: (point: DraftPoint) => void }} events
   */
  constructor(table, events) {
    this.table = table;
    this.events = events;
    /** @type {Draft | null} */
    this.draft = null;
    /** @type {Map<Element, Row>} */
    this.rows = new Map();
  }

  /** @returns {string | null} what is wrong with a number of it */
  get problem() {
    for (const body of this.table.tBodies) {
      const fields = Object.values(this.rows.get(body)?.fields ?? {});
      const problem = fields.find((field) => field.problem)?.problem;
      if (problem) return problem;
    }
    return null;
  }

  /**
   * @param {Draft} draft
   * @param {(point: DraftPoint) => PointCheck | null} residualOf
   */
  show(draft, residualOf) {
    this.draft = draft;
    const head = this.table.tHead ? 1 : 0;
    const bodies = [...this.table.tBodies];
    bodies.slice(draft.points.length).forEach((body) => {
      this.rows.delete(body);
      body.remove();
    });
    resizeList(this.table, (this.table.caption ? 1 : 0) + head + draft.points.length, () => this.#make());
    draft.points.forEach((point, index) => {
      const row = this.rows.get(this.table.tBodies[index]);
      if (!row) return;
      const name = draft.nameOf(point);
      setText(row.badge, draft.badgeOf(point));
      setText(row.name, name);
      const residual = residualOf(point);
      setText(row.note, residual ? residualWords(residual) : "");
      const [x, y] = draft.floorOf(point);
      const values = { u: round(point.pixel[0], 2), v: round(point.pixel[1], 2), x, y };
      const corner = point.role.endsWith("corner");
      for (const column of COLUMNS) {
        const { input, rule } = row.fields[column];
        setLabel(input, `${name}, ${TITLES[column]}`);
        rule.name = `${name}, ${column},`;
        if (column === "u" || column === "v") rule.most = draft.size[column === "u" ? 0 : 1] - 0.5;
        else input.readOnly = corner;
        row.fields[column].show(values[column]);
      }
      row.remove.hidden = corner;
      setLabel(row.remove, `Remove ${name.toLowerCase()}`);
      row.remove.disabled = !draft.mayRemove(point);
    });
  }

  #make() {
    const body = document.createElement("tbody");
    const head = body.insertRow();
    const title = document.createElement("th");
    title.scope = "rowgroup";
    title.colSpan = COLUMNS.length;
    const [badge, name, note] = ["badge", "name", "note"].map((className) => {
      const span = document.createElement("span");
      span.className = className;
      return span;
    });
    const remove = document.createElement("button");
    remove.type = "button";
    remove.className = "small";
    remove.textContent = "Remove";
    remove.addEventListener("click", () => {
      const point = this.#pointOf(body);
      if (point) this.events.onRemove(point);
    });
    const line = document.createElement("div");
    line.className = "point";
    line.append(badge, name, note, remove);
    title.append(line);
    head.append(title);
    const numbers = body.insertRow();
    const fields = /** @type {Record<Column, NumberField>} */ (
      Object.fromEntries(COLUMNS.map((column) => [column, this.#field(body, numbers.insertCell(), column)]))
    );
    this.rows.set(body, { fields, badge, name, note, remove });
    return body;
  }

  /**
   * @param {HTMLTableSectionElement} body
   * @param {HTMLTableCellElement} cell
   * @param {Column} column
   */
  #field(body, cell, column) {
    const input = document.createElement("input");
    input.type = "number";
    const inPixels = column === "u" || column === "v";
    input.step = inPixels ? "0.1" : "0.01";
    cell.append(input);
    const rule = inPixels
      ? { name: column, least: -0.5, most: Infinity, unit: "pixels" }
      : { name: column, least: -FARTHEST_M, most: FARTHEST_M, unit: "m" };
    return new NumberField(input, rule, (value) => {
      // An emptied field is about to be typed in: until then its point stays.
      const point = this.#pointOf(body);
      if (point && value !== null) this.#set(point, column, value);
      if (point) this.events.onTyped(point);
    });
  }

  /**
   * @param {DraftPoint} point
   * @param {Column} column
   * @param {number} value
   */
  #set(point, column, value) {
    const { draft } = this;
    const [u, v] = point.pixel;
    if (column === "u") draft?.place(point, [value, v]);
    else if (column === "v") draft?.place(point, [u, value]);
    else if (draft) {
      const [x, y] = draft.floorOf(point);
      draft.stand(point, column === "x" ? [value, y] : [x, value]);
    }
  }

  /** @param {HTMLTableSectionElement} body */
  #pointOf(body) {
    return this.draft?.points[[...this.table.tBodies].indexOf(body)] ?? null;
  }
}

/**
 * @param {Element} element
 * @param {string} label
 */
function setLabel(element, label) {
  if (element.getAttribute("aria-label") !== label) element.setAttribute("aria-label", label);
}

/**
 * Where a point this far out from the wall's near face is, for those who measure from there.
 * @param {Draft} draft
 */
export function yWords(draft) {
  const { wall_thickness_m } = draft.doorway;
  const y = round(-wall_thickness_m - draft.distance_m, 4);
  return `x is counted from the middle of the opening, to the right as you face the door; y from the wall's far face into the hidden room, so a place ${fixed(draft.distance_m, 2)} m out from the near face is at y = ${fixed(y, 2)} m.`;
}
