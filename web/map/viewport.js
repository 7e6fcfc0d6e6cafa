/** @import { Geometry, Point } from "../types.js" */

/** @typedef {{ x0: number, x1: number, y0: number, y1: number }} Bounds  metres */

const AXIS_LEFT_PX = 42;
const AXIS_BOTTOM_PX = 40;
const EDGE_PX = 12;

/**
 * What must be in sight: the room, wherever people are looked for, every facet, and on this side both patches with some floor.
 * @param {Geometry} geometry
 * @returns {Bounds}
 */
export function boundsOf({ doorway, room, searched = room, patch, facets }) {
  let halfWidth = Math.max(room.half_width_m, searched.half_width_m, doorway.width_m / 2 + patch.fov_m);
  let depth = Math.max(room.depth_m, searched.depth_m);
  for (const [x, y] of facets.flat()) {
    halfWidth = Math.max(halfWidth, Math.abs(x));
    depth = Math.max(depth, y);
  }
  return {
    x0: -halfWidth - 0.05,
    x1: halfWidth + 0.05,
    y0: -doorway.wall_thickness_m - patch.fov_m - 0.2,
    y1: depth + 0.05,
  };
}

/**
 * Height over width at which the bounds fill the canvas.
 * @param {Bounds} bounds
 * @param {number} widthPx
 */
export function heightFor(bounds, widthPx) {
  const scale = (widthPx - AXIS_LEFT_PX - EDGE_PX) / (bounds.x1 - bounds.x0);
  return scale * (bounds.y1 - bounds.y0) + AXIS_BOTTOM_PX + EDGE_PX;
}

/** Metres of the door frame to CSS pixels of the canvas and back; the same scale both ways. */
export class Viewport {
  /**
   * @param {Bounds} bounds
   * @param {number} width
   * @param {number} height
   */
  constructor(bounds, width, height) {
    this.width = width;
    this.height = height;
    this.left = AXIS_LEFT_PX;
    this.bottom = height - AXIS_BOTTOM_PX;
    const across = width - AXIS_LEFT_PX - EDGE_PX;
    const up = height - AXIS_BOTTOM_PX - EDGE_PX;
    this.scale = Math.max(1, Math.min(across / (bounds.x1 - bounds.x0), up / (bounds.y1 - bounds.y0)));
    this.originX = AXIS_LEFT_PX + across / 2 - (this.scale * (bounds.x0 + bounds.x1)) / 2;
    this.originY = this.bottom + this.scale * bounds.y0;
  }

  /** @param {number} metres */
  x(metres) {
    return this.originX + this.scale * metres;
  }

  /** @param {number} metres */
  y(metres) {
    return this.originY - this.scale * metres;
  }

  /**
   * @param {Point} point
   * @returns {Point}
   */
  point([x, y]) {
    return [this.x(x), this.y(y)];
  }

  /**
   * The other way round.
   * @param {Point} point  CSS pixels
   * @returns {Point} metres
   */
  place([x, y]) {
    return [(x - this.originX) / this.scale, (this.originY - y) / this.scale];
  }

  /** The part of the plane inside the axes: wider than the bounds when the canvas is. */
  shown() {
    return {
      x0: (this.left - this.originX) / this.scale,
      x1: (this.width - this.originX) / this.scale,
      y0: (this.originY - this.bottom) / this.scale,
      y1: this.originY / this.scale,
    };
  }
}
