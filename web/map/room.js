import { FONT, FONT_BOLD, INK } from "./ink.js";

/** @import { Geometry, Layer } from "../types.js" */
/** @import { Viewport } from "./viewport.js" */

const THINNEST_WALL_PX = 5;

/**
 * Everything that does not change from update to update: floor, grid, wall, door, patches.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Geometry} geometry
 * @param {Layer} layer  a view through one edge plays the other edge down
 * @param {boolean} grid  the reconstruction grid is shown
 */
export function drawRoom(ctx, view, geometry, layer, grid) {
  drawFloor(ctx, view, geometry);
  drawGrid(ctx, view);
  if (grid) drawFacetLines(ctx, view, geometry);
  drawWall(ctx, view, geometry);
  drawLeaf(ctx, view, geometry);
  drawPatch(ctx, view, geometry, -1, layer !== "right");
  drawPatch(ctx, view, geometry, +1, layer !== "left");
  drawCaptions(ctx, view, geometry);
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Geometry} geometry
 */
function drawFloor(ctx, view, { room }) {
  ctx.fillStyle = INK.ground;
  ctx.fillRect(0, 0, view.width, view.height);
  ctx.fillStyle = INK.visibleSide;
  ctx.fillRect(view.left, view.y(0), view.width - view.left, view.bottom - view.y(0));
  const x = view.x(-room.half_width_m);
  const y = view.y(room.depth_m);
  const width = view.x(room.half_width_m) - x;
  const height = view.y(0) - y;
  ctx.fillStyle = INK.room;
  ctx.fillRect(x, y, width, height);
  ctx.strokeStyle = INK.outline;
  ctx.lineWidth = 1;
  ctx.strokeRect(x, y, width, height);
}

/**
 * Lines every half metre, numbers every metre.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 */
function drawGrid(ctx, view) {
  const shown = view.shown();
  ctx.font = FONT;
  ctx.lineWidth = 1;
  ctx.textBaseline = "top";
  ctx.textAlign = "center";
  for (let half = Math.ceil(2 * shown.x0); half <= 2 * shown.x1; half += 1) {
    const x = Math.round(view.x(half / 2)) + 0.5;
    line(ctx, half % 2 === 0 ? INK.gridMetre : INK.gridHalf, x, 0, x, view.bottom);
    if (half % 2 === 0 && x < view.width - 8) tickLabel(ctx, half / 2, x, view.bottom + 6);
  }
  ctx.textBaseline = "middle";
  ctx.textAlign = "right";
  for (let half = Math.ceil(2 * shown.y0); half <= 2 * shown.y1; half += 1) {
    const y = Math.round(view.y(half / 2)) + 0.5;
    line(ctx, half % 2 === 0 ? INK.gridMetre : INK.gridHalf, view.left, y, view.width, y);
    if (half % 2 === 0 && y > 8) tickLabel(ctx, half / 2, view.left - 7, y);
  }
  ctx.fillStyle = INK.text;
  ctx.textAlign = "center";
  ctx.textBaseline = "alphabetic";
  ctx.fillText("x (m)", view.x(0), view.height - 8);
  ctx.save();
  ctx.translate(16, view.y((shown.y0 + shown.y1) / 2));
  ctx.rotate(-Math.PI / 2);
  ctx.fillText("y (m)", 0, 0);
  ctx.restore();
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {number} metres
 * @param {number} x
 * @param {number} y
 */
function tickLabel(ctx, metres, x, y) {
  ctx.fillStyle = INK.text;
  ctx.fillText(String(metres).replace("-", "\u2212"), x, y);
}

/**
 * The whole reconstruction grid, faintly; facets that only stand for the far walls are dashed.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Geometry} geometry
 */
function drawFacetLines(ctx, view, { facets, foreground }) {
  ctx.lineWidth = 1;
  for (const inForeground of [false, true]) {
    ctx.strokeStyle = inForeground ? INK.facet : INK.facetBackground;
    ctx.setLineDash(inForeground ? [] : [3, 3]);
    ctx.beginPath();
    facets.forEach(([start, end], index) => {
      if ((foreground[index] ?? true) !== inForeground) return;
      ctx.moveTo(...view.point(start));
      ctx.lineTo(...view.point(end));
    });
    ctx.stroke();
  }
  ctx.setLineDash([]);
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Geometry} geometry
 */
function drawWall(ctx, view, { doorway }) {
  // A wall without thickness must still be seen; it grows towards the visible side.
  const thickness = Math.max(THINNEST_WALL_PX, view.scale * doorway.wall_thickness_m);
  const left = view.x(-doorway.width_m / 2);
  const right = view.x(doorway.width_m / 2);
  ctx.fillStyle = INK.wall;
  ctx.fillRect(view.left, view.y(0), left - view.left, thickness);
  ctx.fillRect(right, view.y(0), view.width - right, thickness);
}

/**
 * The door, where it stands open into the room.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Geometry} geometry
 */
function drawLeaf(ctx, view, { doorway: { width_m, leaf } }) {
  if (!leaf) return;
  const side = leaf.hinge === "left" ? -1 : 1;
  const angle = (leaf.angle_deg * Math.PI) / 180;
  const hinge = (side * width_m) / 2;
  ctx.strokeStyle = INK.wall;
  ctx.lineWidth = 3;
  ctx.beginPath();
  ctx.moveTo(view.x(hinge), view.y(0));
  ctx.lineTo(view.x(hinge - side * leaf.width_m * Math.cos(angle)), view.y(leaf.width_m * Math.sin(angle)));
  ctx.stroke();
}

/**
 * The square of floor the camera reads, and the door edge that casts its fan of shadow.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Geometry} geometry
 * @param {-1 | 1} side
 * @param {boolean} used
 */
function drawPatch(ctx, view, { doorway, patch }, side, used) {
  const edge = (side * doorway.width_m) / 2;
  const size = view.scale * patch.fov_m;
  const top = view.y(-doorway.wall_thickness_m);
  const left = view.x(edge) - size / 2;
  ctx.strokeStyle = used ? INK.edge : INK.edgeFaint;
  ctx.lineWidth = 1.25;
  if (used) {
    ctx.fillStyle = INK.patchFill;
    ctx.fillRect(left, top, size, size);
  }
  ctx.strokeRect(left, top, size, size);
  ctx.fillStyle = used ? INK.edge : INK.edgeFaint;
  ctx.beginPath();
  ctx.arc(view.x(edge), view.y(0), 3.5, 0, 2 * Math.PI);
  ctx.fill();
  ctx.font = FONT_BOLD;
  ctx.textAlign = "center";
  ctx.textBaseline = "top";
  ctx.fillText(side < 0 ? "L" : "R", view.x(edge), top + size + 4);
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Geometry} geometry
 */
function drawCaptions(ctx, view, { room }) {
  ctx.font = FONT;
  ctx.fillStyle = INK.textFaint;
  ctx.textAlign = "left";
  ctx.textBaseline = "top";
  const left = Math.max(view.left, view.x(-room.half_width_m)) + 8;
  ctx.fillText("hidden room", left, view.y(room.depth_m) + 8);
  ctx.textBaseline = "bottom";
  ctx.fillText("visible side", left, view.bottom - 6);
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {string} colour
 * @param {number} x0
 * @param {number} y0
 * @param {number} x1
 * @param {number} y1
 */
function line(ctx, colour, x0, y0, x1, y1) {
  ctx.strokeStyle = colour;
  ctx.beginPath();
  ctx.moveTo(x0, y0);
  ctx.lineTo(x1, y1);
  ctx.stroke();
}
