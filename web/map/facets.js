import { lightOf } from "../brightness.js";
import { cssColour, split, strength } from "../colour.js";
import { INK } from "./ink.js";

/** @import { Choice, Geometry, LitFacet, Point } from "../types.js" */
/** @import { Viewport } from "./viewport.js" */

// Brightening is a solid core, darkening a hatched sheath around it: told apart by shape and not
// only by colour, and both to be seen on a facet that does both.
const CORE_M = 0.06;
const CORE_PX = 6;
const SHEATH_M = 0.09;
const SHEATH_PX = 11;
const HATCH_PX = 5;

// Near is near enough for a finger; a lit facet wins over an unlit one that is closer.
const REACH_LIT_PX = 16;
const REACH_PX = 9;

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Geometry} geometry
 * @param {LitFacet[]} lit
 * @param {Choice} choice
 * @param {number} scale  the change drawn at full brightness
 */
export function drawLitFacets(ctx, view, geometry, lit, { layer, signs, brightness }, scale) {
  // The strongest last, so that nothing weaker covers it.
  const ordered = lit
    .map((facet) => ({ segment: geometry.facets[facet.index], light: lightOf(facet, layer, brightness) }))
    .sort((a, b) => strength(a.light) - strength(b.light));
  for (const { segment, light } of ordered) {
    if (!segment) continue;
    const { brighter, darker } = split(light);
    onFacet(ctx, view, segment, (length) => {
      if (signs !== "brighter" && strength(darker) > 0) drawSheath(ctx, length, sheath(view), cssColour(darker, scale));
      if (signs !== "darker" && strength(brighter) > 0) drawCore(ctx, length, core(view), cssColour(brighter, scale));
    });
  }
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Geometry} geometry
 * @param {number} index
 */
export function drawHighlight(ctx, view, geometry, index) {
  const segment = geometry.facets[index];
  if (!segment) return;
  onFacet(ctx, view, segment, (length) => {
    const width = sheath(view) + 6;
    ctx.strokeStyle = INK.highlight;
    ctx.lineWidth = 1.5;
    ctx.strokeRect(-length / 2 - 3, -width / 2, length + 6, width);
  });
}

/**
 * @param {Viewport} view
 * @param {Geometry} geometry
 * @param {ReadonlySet<number>} lit
 * @param {Point} pointer  CSS pixels
 * @returns {number | null} index of the facet under the pointer
 */
export function facetAt(view, geometry, lit, pointer) {
  let nearest = null;
  let nearestLit = null;
  let reach = REACH_PX;
  let reachLit = REACH_LIT_PX;
  geometry.facets.forEach(([start, end], index) => {
    const distance = distanceToSegment(pointer, view.point(start), view.point(end));
    if (distance < reach) [nearest, reach] = [index, distance];
    if (distance < reachLit && lit.has(index)) [nearestLit, reachLit] = [index, distance];
  });
  return nearestLit ?? nearest;
}

/** @param {Viewport} view */
const core = (view) => Math.max(CORE_PX, CORE_M * view.scale);
/** @param {Viewport} view */
const sheath = (view) => Math.max(SHEATH_PX, SHEATH_M * view.scale);

/**
 * Draw with the facet's middle as origin and x along it.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {[Point, Point]} segment
 * @param {(lengthPx: number) => void} draw
 */
function onFacet(ctx, view, [start, end], draw) {
  const [x0, y0] = view.point(start);
  const [x1, y1] = view.point(end);
  ctx.save();
  ctx.translate((x0 + x1) / 2, (y0 + y1) / 2);
  ctx.rotate(Math.atan2(y1 - y0, x1 - x0));
  draw(Math.hypot(x1 - x0, y1 - y0));
  ctx.restore();
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {number} length
 * @param {number} width
 * @param {string} colour
 */
function drawCore(ctx, length, width, colour) {
  ctx.fillStyle = colour;
  ctx.fillRect(-length / 2, -width / 2, length, width);
  // As in the paper's figures, a light outline: a weak facet must not drown in the dark floor.
  ctx.strokeStyle = INK.litOutline;
  ctx.lineWidth = 1;
  ctx.strokeRect(-length / 2, -width / 2, length, width);
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {number} length
 * @param {number} width
 * @param {string} colour
 */
function drawSheath(ctx, length, width, colour) {
  ctx.save();
  ctx.beginPath();
  ctx.rect(-length / 2, -width / 2, length, width);
  ctx.fillStyle = INK.ground;
  ctx.fill();
  ctx.clip();
  ctx.strokeStyle = colour;
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  for (let x = -length / 2 - width; x < length / 2; x += HATCH_PX) {
    ctx.moveTo(x, width / 2);
    ctx.lineTo(x + width, -width / 2);
  }
  ctx.stroke();
  ctx.restore();
  ctx.strokeStyle = INK.litOutline;
  ctx.lineWidth = 2.5;
  ctx.strokeRect(-length / 2, -width / 2, length, width);
  ctx.strokeStyle = colour;
  ctx.lineWidth = 1.5;
  ctx.strokeRect(-length / 2, -width / 2, length, width);
}

/**
 * @param {Point} p
 * @param {Point} a
 * @param {Point} b
 */
function distanceToSegment([px, py], [ax, ay], [bx, by]) {
  const dx = bx - ax;
  const dy = by - ay;
  const along = ((px - ax) * dx + (py - ay) * dy) / (dx * dx + dy * dy || 1);
  const t = Math.min(Math.max(along, 0), 1);
  return Math.hypot(px - ax - t * dx, py - ay - t * dy);
}
