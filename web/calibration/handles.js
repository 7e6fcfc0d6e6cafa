import { resizeList, setText } from "../dom.js";
import { fixed } from "../format.js";
import { residualWords } from "./words.js";

/** @import { Pixel, PointCheck } from "../types.js" */
/** @import { Draft, DraftPoint } from "./points.js" */
/** @import { Stage } from "../camera/stage.js" */

/** With more points than this their words would lie on each other. */
const MANY = 6;

/** With Shift the hand moves this many times as far as the point. */
const FINE = 8;

/** @type {Record<string, Pixel>} */
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/**
 * @typedef {object} HandleEvents
 * @property {(point: DraftPoint, pixel: Pixel) => void} onMove
 * @property {(point: DraftPoint | null) => void} onSelect
 * @property {(point: DraftPoint) => void} onRemove
 * @property {(point: DraftPoint) => void} onNudged  moved by a key: to be said aloud
 */

/** The points on the picture as things to drag, or to move with the arrow keys. */
export class Handles {
  /**
   * @param {HTMLElement} list
   * @param {Stage} stage
   * @param {HandleEvents} events
   */
  constructor(list, stage, events) {
    this.list = list;
    this.stage = stage;
    this.events = events;
    /** @type {Draft | null} */
    this.draft = null;
    this.editable = false;
    /** @type {DraftPoint | null} */
    this.selected = null;
  }

  /**
   * @param {Draft | null} draft
   * @param {boolean} editable
   * @param {(point: DraftPoint) => PointCheck | null} residualOf  what the check says of it
   */
  show(draft, editable, residualOf) {
    this.draft = draft;
    this.editable = editable;
    const points = draft?.points ?? [];
    resizeList(this.list, points.length, () => this.#make());
    this.list.classList.toggle("many", points.length > MANY);
    points.forEach((point, index) => {
      const button = /** @type {HTMLButtonElement} */ (this.list.children[index]);
      const [left, top] = this.stage.shareOf(point.pixel);
      button.style.left = `${100 * left}%`;
      button.style.top = `${100 * top}%`;
      button.setAttribute("aria-disabled", String(!editable));
      button.dataset.role = point.role;
      button.classList.toggle("guess", !point.placed);
      const residual = residualOf(point);
      // Together the name that is heard: "L left door corner, u 172.5, v 101.2, residual 0.4 px, 1.2 mm".
      const [badge, words, note] = button.querySelectorAll("span");
      setText(badge, draft?.badgeOf(point) ?? "");
      setText(words, ` ${draft?.kindOf(point)}, ${placeWords(point.pixel)}${residual ? ", residual " : ""}`);
      setText(note, residual ? residualWords(residual) : "");
      // The words stay inside the picture, and off the line that shows what they say.
      button.classList.toggle("words-left", left > 0.6);
      button.classList.toggle("words-above", top > 0.8 || (top > 0.2 && residual !== null && residual.residual_px[1] < 0));
    });
  }

  /** @param {DraftPoint} point */
  focus(point) {
    const index = this.draft?.points.indexOf(point) ?? -1;
    /** @type {HTMLElement | undefined} */ (this.list.children[index])?.focus();
  }

  #make() {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "handle";
    for (const part of ["badge", "visually-hidden", "note"]) {
      const span = document.createElement("span");
      span.className = part;
      button.append(span);
    }
    button.addEventListener("focus", () => this.#select(this.#pointOf(button)));
    button.addEventListener("blur", () => this.#select(null));
    button.addEventListener("keydown", (event) => this.#key(event, button));
    button.addEventListener("pointerdown", (event) => this.#drag(event, button));
    return button;
  }

  /** @param {HTMLElement} button */
  #pointOf(button) {
    return this.draft?.points[[...this.list.children].indexOf(button)] ?? null;
  }

  /** @param {DraftPoint | null} point */
  #select(point) {
    this.selected = point;
    this.events.onSelect(point);
  }

  /**
   * @param {KeyboardEvent} event
   * @param {HTMLElement} button
   */
  #key(event, button) {
    const point = this.#pointOf(button);
    if (!point || !this.editable) return;
    const arrow = ARROWS[event.key];
    if (arrow) {
      // Alt with an arrow would otherwise leave the page.
      event.preventDefault();
      const step = event.altKey || event.ctrlKey ? 0.1 : event.shiftKey ? 10 : 1;
      this.events.onMove(point, [point.pixel[0] + step * arrow[0], point.pixel[1] + step * arrow[1]]);
      button.scrollIntoView({ block: "nearest", inline: "nearest" });
      this.events.onNudged(point);
    } else if (event.key === "Delete" && this.draft?.mayRemove(point)) {
      event.preventDefault();
      this.events.onRemove(point);
    }
  }

  /**
   * @param {PointerEvent} event
   * @param {HTMLElement} button
   */
  #drag(event, button) {
    const point = this.#pointOf(button);
    if (event.button !== 0 || !point) return;
    button.focus({ preventScroll: true });
    if (!this.editable) return;
    // The point follows the hand's movement, not the hand: a touch beside it does not move it.
    followPointer(event, button, (dx, dy, fine) => {
      const share = 1 / (this.stage.scale * (fine ? FINE : 1));
      return [dx * share, dy * share];
    }, point.pixel, (pixel) => this.events.onMove(point, pixel));
  }
}

/**
 * Move something with a pressed pointer until it is lifted; Escape puts it back.
 * @param {PointerEvent} start
 * @param {HTMLElement} element
 * @param {(dx: number, dy: number, fine: boolean) => Pixel} pixelsFor  of a movement in CSS pixels
 * @param {Pixel} from
 * @param {(pixel: Pixel) => void} move
 */
export function followPointer(start, element, pixelsFor, from, move) {
  start.preventDefault();
  element.setPointerCapture(start.pointerId);
  let [x, y] = [start.clientX, start.clientY];
  // Not clamped and not rounded, so that the point comes back with the hand.
  let [u, v] = from;
  const over = new AbortController();
  const on = (/** @type {string} */ type, /** @type {(event: any) => void} */ listener) =>
    element.addEventListener(type, listener, { signal: over.signal });
  on("pointermove", (/** @type {PointerEvent} */ event) => {
    if (event.pointerId !== start.pointerId) return;
    const [du, dv] = pixelsFor(event.clientX - x, event.clientY - y, event.shiftKey);
    [x, y] = [event.clientX, event.clientY];
    [u, v] = [u + du, v + dv];
    if (du !== 0 || dv !== 0) move([u, v]);
  });
  on("lostpointercapture", () => over.abort());
  on("keydown", (/** @type {KeyboardEvent} */ event) => {
    if (event.key !== "Escape") return;
    over.abort();
    move(from);
  });
}

/** @param {Pixel} pixel */
export const placeWords = ([u, v]) => `u ${fixed(u, 1)}, v ${fixed(v, 1)}`;
