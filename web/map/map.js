import { drawHighlight, drawLitFacets, facetAt } from "./facets.js";
import { drawRoom } from "./room.js";
import { drawTracks, trackAt } from "./tracks.js";
import { Trails } from "./trails.js";
import { drawBlind, drawUncertainty } from "./uncertainty.js";
import { Viewport, boundsOf, heightFor } from "./viewport.js";
import { drawEditedZones, drawZones } from "./zones.js";

/** @import { Choice, Geometry, Parts, Point, Track, Uncertainty, Update, Zone } from "../types.js" */
/** @import { Bounds } from "./viewport.js" */
/** @import { EditedZones } from "./zones.js" */

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
    /** @type {Parts} */
    this.parts = { grid: true, light: true, people: true, ellipses: true, headings: true, trails: true, zones: true };
    /** @type {number | null} */
    this.highlight = null;
    /** @type {Uncertainty | null} */
    this.uncertainty = null;
    /** The fog of the bound, not only where nobody can be located at all. */
    this.foggy = false;
    /** What does not change from update to update, drawn once. */
    this.still = document.createElement("canvas");
    this.stillOf = "";
    /** @type {EditedZones | null} */
    this.edited = null;
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

  /** @param {Parts} parts */
  setParts(parts) {
    this.parts = parts;
    this.stillOf = "";
    this.#schedule();
  }

  /**
   * @param {Uncertainty | null} uncertainty  null: not known
   * @param {boolean} foggy
   */
  setUncertainty(uncertainty, foggy) {
    if (uncertainty === this.uncertainty && foggy === this.foggy) return;
    this.uncertainty = uncertainty;
    this.foggy = foggy;
    this.stillOf = "";
    this.#schedule();
  }

  /**
   * The same room, with other zones.
   * @param {Zone[]} zones
   * @param {number} revision
   */
  setZones(zones, revision) {
    if (!this.geometry) return;
    this.geometry = { ...this.geometry, zones, zones_revision: revision };
    this.#schedule();
  }

  /** @param {EditedZones | null} edited  shown instead of the zones in use */
  setEdited(edited) {
    if (edited === null && this.edited === null) return;
    this.edited = edited;
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
   * @param {Point} pointer  CSS pixels from the canvas's corner
   * @returns {Track | null}
   */
  trackAt(pointer) {
    return this.view && this.update ? trackAt(this.view, this.update.tracks, pointer) : null;
  }

  /**
   * @param {number} x
   * @param {number} y
   * @returns {Point | null} CSS pixels from the canvas's corner
   */
  pointOf(x, y) {
    return this.view ? this.view.point([x, y]) : null;
  }

  /**
   * @param {Point} pointer  CSS pixels from the canvas's corner
   * @returns {Point | null} metres
   */
  placeOf(pointer) {
    return this.view ? this.view.place(pointer) : null;
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
    this.stillOf = "";
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
    this.#drawStill(geometry, view);
    const { parts } = this;
    if (update && parts.light) drawLitFacets(ctx, view, geometry, update.facets, this.choice, this.scale);
    if (this.edited) drawEditedZones(ctx, view, this.edited);
    else if (parts.zones) drawZones(ctx, view, geometry.zones ?? [], update?.zones ?? []);
    if (update && parts.trails) this.trails.draw(ctx, view, update.tracks);
    if (update && parts.people) drawTracks(ctx, view, update.tracks, parts);
    if (this.highlight !== null) drawHighlight(ctx, view, geometry, this.highlight);
    this.onDrawn(update?.sequence ?? null);
  }

  /**
   * @param {Geometry} geometry
   * @param {Viewport} view
   */
  #drawStill(geometry, view) {
    const { canvas, still } = this;
    if (this.stillOf !== this.choice.layer) {
      this.stillOf = this.choice.layer;
      still.width = canvas.width;
      still.height = canvas.height;
      const ctx = still.getContext("2d", { alpha: false });
      if (!ctx) return;
      const ratio = canvas.width / view.width;
      ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
      drawRoom(ctx, view, geometry, this.choice.layer, this.parts.grid);
      if (this.uncertainty && this.foggy) drawUncertainty(ctx, view, this.uncertainty);
      else if (this.uncertainty) drawBlind(ctx, view, this.uncertainty);
    }
    this.ctx.drawImage(still, 0, 0, view.width, view.height);
  }
}
