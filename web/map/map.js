import { drawHighlight, drawLitFacets, facetAt } from "./facets.js";
import { drawRoom } from "./room.js";
import { drawTracks } from "./tracks.js";
import { Trails } from "./trails.js";
import { drawUncertainty } from "./uncertainty.js";
import { Viewport, boundsOf, heightFor } from "./viewport.js";
import { drawZones } from "./zones.js";

/** @import { Choice, Geometry, Point, Uncertainty, Update } from "../types.js" */
/** @import { Bounds } from "./viewport.js" */

/**
 * The bird's-eye map. Setters only note what is new; one animation frame draws the newest of all,
 * so that a fast stream on a slow screen costs one drawing per screen refresh.
 */
export class RoomMap {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {(sequence: number | null) => void} onDrawn
   */
  constructor(canvas, onDrawn) {
    this.canvas = canvas;
    this.onDrawn = onDrawn;
    const context = canvas.getContext("2d", { alpha: false });
    if (!context) throw new Error("this browser has no 2D canvas");
    this.ctx = context;
    /** @type {Geometry | null} */
    this.geometry = null;
    /** @type {Bounds | null} */
    this.bounds = null;
    /** @type {Viewport | null} */
    this.view = null;
    /** @type {Update | null} */
    this.update = null;
    /** @type {Choice} */
    this.choice = { layer: "unified", signs: "both", brightness: "measured" };
    this.scale = 0;
    /** @type {number | null} */
    this.highlight = null;
    /** @type {Uncertainty | null} */
    this.uncertainty = null;
    this.trails = new Trails();
    this.scheduled = false;
    new ResizeObserver(() => this.#resized()).observe(canvas);
    this.#watchPixelRatio();
  }

  /** @param {Geometry | null} geometry  null: there is nothing to draw yet */
  setGeometry(geometry) {
    this.geometry = geometry;
    this.bounds = geometry && boundsOf(geometry);
    this.highlight = null;
    this.update = null;
    this.trails.clear();
    if (geometry) return this.#resized();
    this.view = null;
    this.ctx.clearRect(0, 0, this.canvas.width, this.canvas.height);
    this.onDrawn(null);
  }

  /**
   * @param {Update} update
   * @param {number} scale
   */
  show(update, scale) {
    this.update = update;
    this.trails.follow(update);
    this.scale = scale;
    this.#schedule();
  }

  /**
   * @param {Choice} choice
   * @param {number} scale
   */
  choose(choice, scale) {
    this.choice = choice;
    this.scale = scale;
    this.#schedule();
  }

  /** @param {Uncertainty | null} uncertainty  null: not to be shown */
  setUncertainty(uncertainty) {
    if (uncertainty === this.uncertainty) return;
    this.uncertainty = uncertainty;
    this.#schedule();
  }

  /** @param {number | null} index */
  setHighlight(index) {
    if (index === this.highlight) return;
    this.highlight = index;
    this.#schedule();
  }

  /**
   * @param {Point} pointer  CSS pixels from the canvas's corner
   * @returns {number | null}
   */
  facetAt(pointer) {
    if (!this.geometry || !this.view) return null;
    const lit = new Set(this.update?.facets.map((facet) => facet.index));
    return facetAt(this.view, this.geometry, lit, pointer);
  }

  /**
   * @param {number} x
   * @param {number} y
   * @returns {Point | null} CSS pixels from the canvas's corner
   */
  pointOf(x, y) {
    return this.view ? this.view.point([x, y]) : null;
  }

  #resized() {
    if (!this.bounds) return;
    const width = this.canvas.clientWidth;
    if (width === 0) return;
    // The style sheet caps the height; what is then too wide shows more of the wall.
    this.canvas.style.height = `${Math.round(heightFor(this.bounds, width))}px`;
    const height = this.canvas.clientHeight;
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.view = new Viewport(this.bounds, width, height);
    // Setting the size has cleared the canvas: drawing now, not at the next frame, avoids a flash.
    this.#draw();
  }

  /** Zooming or moving to another screen changes the ratio without resizing anything. */
  #watchPixelRatio() {
    const query = matchMedia(`(resolution: ${window.devicePixelRatio}dppx)`);
    const changed = () => {
      this.#resized();
      this.#watchPixelRatio();
    };
    query.addEventListener("change", changed, { once: true });
  }

  #schedule() {
    if (this.scheduled) return;
    this.scheduled = true;
    requestAnimationFrame(() => {
      this.scheduled = false;
      this.#draw();
    });
  }

  #draw() {
    const { ctx, geometry, view, update } = this;
    if (!geometry || !view) return;
    drawRoom(ctx, view, geometry, this.choice.layer);
    if (this.uncertainty) drawUncertainty(ctx, view, this.uncertainty);
    if (update) drawLitFacets(ctx, view, geometry, update.facets, this.choice, this.scale);
    drawZones(ctx, view, geometry.zones ?? [], update?.zones ?? []);
    if (update) {
      this.trails.draw(ctx, view, update.tracks);
      drawTracks(ctx, view, update.tracks);
    }
    if (this.highlight !== null) drawHighlight(ctx, view, geometry, this.highlight);
    this.onDrawn(update?.sequence ?? null);
  }
}
