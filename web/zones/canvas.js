import { byId } from "../dom.js";
import { position } from "../format.js";
import { STEP_M, rounded, snapped } from "./snap.js";

/** @import { RoomMap } from "../map/map.js" */
/** @import { Point } from "../types.js" */
/** @import { ZoneDraft } from "./draft.js" */

const SNAP_PX = 9;
const CLOSE_PX = 14;

/**
 * What is drawn on the map by hand or by keys: new zones corner by corner, and handles on the corners
 * of the chosen one.
 */
export class ZoneCanvas {
  /**
   * @param {RoomMap} map
   * @param {object} handlers
   * @param {() => void} handlers.onChange
   * @param {(index: number) => void} handlers.onChoose
   * @param {(corners: Point[]) => void} handlers.onDrawn  a new zone's border is closed
   * @param {(words: string) => void} handlers.onSay
   */
  constructor(map, handlers) {
    this.map = map;
    this.handlers = handlers;
    this.layer = byId("zone-handles");
    /** @type {ZoneDraft | null} */
    this.draft = null;
    /** @type {number | null} */
    this.chosen = null;
    /** @type {Point[] | null} Corners of a zone that is being drawn. */
    this.sketch = null;
    /** @type {Point | null} Where the next corner would be. */
    this.next = null;
    this.snaps = true;
    this.layer.addEventListener("pointermove", (event) => this.#hover(event));
    this.layer.addEventListener("pointerdown", (event) => this.#press(event));
    this.layer.addEventListener("keydown", (event) => this.#key(event));
    // A press would take the focus from the name of the zone that it has just closed.
    this.layer.addEventListener("mousedown", (event) => event.preventDefault());
  }

  /** @param {ZoneDraft | null} draft  null: nothing is edited */
  edit(draft) {
    this.draft = draft;
    this.chosen = null;
    this.sketch = null;
    this.next = null;
    this.layer.hidden = draft === null;
    this.refresh();
  }

  begin() {
    this.sketch = [];
    this.chosen = null;
    const { room } = this.map.geometry ?? { room: { depth_m: 3 } };
    this.next = [0, rounded(room.depth_m / 2)];
    this.refresh();
    this.layer.focus();
  }

  cancel() {
    this.sketch = null;
    this.next = null;
    this.refresh();
  }

  /** @param {number | null} index */
  choose(index) {
    this.chosen = index;
    this.refresh();
  }

  /** Draws what is edited, and puts the handles where its corners are. */
  refresh() {
    const { draft, map } = this;
    const next = this.sketch && this.next;
    map.setEdited(draft && { zones: draft.zones, chosen: this.chosen, sketch: this.sketch && [...this.sketch, ...(next ? [next] : [])] });
    this.layer.classList.toggle("drawing", this.sketch !== null);
    this.place();
  }

  /** Also when the map has got another size. */
  place() {
    const { draft, chosen } = this;
    const corners = draft && chosen !== null && !this.sketch ? (draft.zones[chosen]?.polygon_m ?? []) : [];
    const wanted = 2 * corners.length;
    while (this.layer.children.length > wanted) this.layer.lastElementChild?.remove();
    while (this.layer.children.length < wanted) this.layer.append(this.#handle(this.layer.children.length));
    corners.forEach((corner, index) => {
      const after = corners[(index + 1) % corners.length];
      const middle = /** @type {Point} */ ([(corner[0] + after[0]) / 2, (corner[1] + after[1]) / 2]);
      const [at, between] = [this.layer.children[2 * index], this.layer.children[2 * index + 1]];
      this.#put(at, corner, `Corner ${index + 1}, ${position(...corner)}`);
      this.#put(between, middle, `Add a corner after ${index + 1}`);
    });
  }

  /** @param {number} index  even: a corner; odd: the middle of the side after it */
  #handle(index) {
    const button = document.createElement("button");
    button.type = "button";
    const corner = Math.floor(index / 2);
    button.className = index % 2 === 0 ? "corner" : "between";
    if (index % 2 === 1) button.tabIndex = -1;
    button.addEventListener("pointerdown", (event) => this.#grab(event, corner, index % 2 === 1));
    button.addEventListener("keydown", (event) => this.#nudge(event, corner));
    return button;
  }

  /**
   * @param {Element} element
   * @param {Point} place
   * @param {string} words
   */
  #put(element, place, words) {
    const at = this.map.pointOf(...place);
    if (!at || !(element instanceof HTMLElement)) return;
    element.style.transform = `translate(${at[0].toFixed(1)}px, ${at[1].toFixed(1)}px)`;
    if (element.getAttribute("aria-label") !== words) element.setAttribute("aria-label", words);
  }

  /**
   * @param {PointerEvent} event
   * @param {number} corner
   * @param {boolean} between
   */
  #grab(event, corner, between) {
    const { draft, chosen } = this;
    const handle = event.currentTarget;
    if (!draft || chosen === null || !(handle instanceof HTMLElement)) return;
    event.stopPropagation();
    const drag = {};
    let index = corner;
    if (between) {
      index += 1;
      draft.change((zones) => zones[chosen].polygon_m.splice(index, 0, this.#placeOf(event, index)), drag);
      this.#changed();
    }
    // The handles change places when a corner is added: the layer itself has the pointer.
    this.layer.setPointerCapture(event.pointerId);
    const over = new AbortController();
    const { signal } = over;
    this.layer.addEventListener("pointermove", (move) => {
      const place = this.#placeOf(move, index);
      draft.change((zones) => { zones[chosen].polygon_m[index] = place; }, drag);
      this.#changed();
    }, { signal });
    for (const end of ["pointerup", "pointercancel"]) {
      this.layer.addEventListener(end, () => {
        over.abort();
        draft.rest();
        /** @type {HTMLElement} */ (this.layer.children[2 * index])?.focus();
      }, { signal });
    }
  }

  /**
   * @param {KeyboardEvent} event
   * @param {number} corner
   */
  #nudge(event, corner) {
    const { draft, chosen } = this;
    if (!draft || chosen === null) return;
    const step = stepOf(event);
    if (step) {
      event.preventDefault();
      draft.change((zones) => {
        const [x, y] = zones[chosen].polygon_m[corner];
        zones[chosen].polygon_m[corner] = [rounded(x + step[0]), rounded(y + step[1])];
      }, `${chosen} ${corner}`);
      this.#changed();
      this.handlers.onSay(position(...draft.zones[chosen].polygon_m[corner]));
    } else if ((event.key === "Delete" || event.key === "Backspace") && draft.zones[chosen].polygon_m.length > 3) {
      event.preventDefault();
      draft.change((zones) => zones[chosen].polygon_m.splice(corner, 1));
      this.#changed();
      /** @type {HTMLElement} */ (this.layer.children[0])?.focus();
      this.handlers.onSay(`Corner ${corner + 1} removed`);
    }
  }

  /** @param {PointerEvent} event */
  #hover(event) {
    if (!this.sketch) return;
    this.next = this.#placeOf(event, null);
    this.refresh();
  }

  /** @param {PointerEvent} event */
  #press(event) {
    const { draft } = this;
    if (!draft || event.button !== 0) return;
    const place = this.#placeOf(event, null);
    if (this.sketch) {
      const [first] = this.sketch;
      if (first && this.sketch.length > 2 && this.#pixels(first, this.#placeUnder(event)) < CLOSE_PX) return this.#close();
      return this.#corner(place);
    }
    const under = this.#placeUnder(event);
    const hit = draft.zones.findIndex(({ polygon_m }) => holds(polygon_m, under));
    if (hit >= 0) this.handlers.onChoose(hit);
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    if (!this.sketch || event.target !== this.layer) return;
    const step = stepOf(event);
    if (step && this.next) {
      this.next = [rounded(this.next[0] + step[0]), rounded(this.next[1] + step[1])];
      this.handlers.onSay(position(...this.next));
    } else if (event.key === " " && this.next) {
      this.#corner(this.next);
    } else if (event.key === "Enter") {
      this.#close();
    } else if (event.key === "Backspace") {
      this.sketch = this.sketch.slice(0, -1);
    } else if (event.key === "Escape") {
      this.cancel();
      this.handlers.onSay("Nothing is drawn.");
      this.handlers.onChange();
    } else {
      return;
    }
    event.preventDefault();
    this.refresh();
  }

  /** @param {Point} place */
  #corner(place) {
    const { sketch } = this;
    const last = sketch?.at(-1);
    if (!sketch || (last && last[0] === place[0] && last[1] === place[1])) return;
    this.sketch = [...sketch, place];
    this.handlers.onSay(`Corner ${this.sketch.length} at ${position(...place)}`);
    this.refresh();
    this.handlers.onChange();
  }

  #close() {
    const corners = this.sketch;
    if (!corners || corners.length < 3) return this.handlers.onSay("A zone has three corners or more.");
    this.sketch = null;
    this.next = null;
    this.handlers.onDrawn(corners);
  }

  #changed() {
    this.refresh();
    this.handlers.onChange();
  }

  /** @param {PointerEvent} event @returns {Point} */
  #placeUnder(event) {
    const box = this.map.canvas.getBoundingClientRect();
    return this.map.placeOf([event.clientX - box.left, event.clientY - box.top]) ?? [0, 0];
  }

  /**
   * Where the corner under the pointer is meant to be; with Alt, just there.
   * @param {PointerEvent} event
   * @param {number | null} corner  of the chosen zone, which does not snap to itself
   * @returns {Point}
   */
  #placeOf(event, corner) {
    const [x, y] = this.#placeUnder(event);
    const { draft, map, chosen } = this;
    if (!draft || !map.geometry || !map.view || !this.snaps || event.altKey) return [rounded(x), rounded(y)];
    const others = draft.zones.filter((_, index) => corner === null || index !== chosen).flatMap(({ polygon_m }) => polygon_m);
    return snapped([x, y], map.geometry, others, SNAP_PX / map.view.scale);
  }

  /** @type {(a: Point, b: Point) => number} */
  #pixels(a, b) {
    return Math.hypot(a[0] - b[0], a[1] - b[1]) * (this.map.view?.scale ?? 1);
  }
}

/**
 * @param {KeyboardEvent} event
 * @returns {Point | null} metres
 */
function stepOf({ key, shiftKey, altKey }) {
  const metres = shiftKey ? 5 * STEP_M : altKey ? 0.01 : STEP_M;
  /** @type {Record<string, Point>} */
  const steps = { ArrowLeft: [-metres, 0], ArrowRight: [metres, 0], ArrowUp: [0, metres], ArrowDown: [0, -metres] };
  return steps[key] ?? null;
}

/**
 * @param {Point[]} corners
 * @param {Point} place
 */
function holds(corners, [x, y]) {
  let inside = false;
  corners.forEach(([x0, y0], k) => {
    const [x1, y1] = corners[(k + 1) % corners.length];
    if (y0 > y !== y1 > y && x < x0 + ((x1 - x0) * (y - y0)) / (y1 - y0)) inside = !inside;
  });
  return inside;
}
