import { setText } from "../dom.js";

/** @import { Check, Pixel } from "../types.js" */
/** @import { Draft } from "../calibration/points.js" */
/** @import { Stage } from "./stage.js" */

const SVG = "http://www.w3.org/2000/svg";
// Residuals are too small to be seen at their own size: enlarged by the largest of these that keeps
// the longest below LONGEST_PX.
const ENLARGEMENTS = [200, 150, 100, 70, 50, 30, 20, 15, 10, 7, 5, 3, 2, 1];
const LONGEST_PX = 60;
const TEXT_PX = 13;

/** What the camera would see of the door and the floor, drawn over what it sees. */
export class Outlines {
  /**
   * @param {SVGSVGElement} svg
   * @param {Stage} stage
   */
  constructor(svg, stage) {
    this.svg = svg;
    this.stage = stage;
    this.enlargement = 1;
  }

  /**
   * @param {Draft | null} draft
   * @param {Check | null} check
   */
  show(draft, check) {
    const { svg } = this;
    // While the view is hidden nothing has a size. Once it shows, the stage is scaled and this is drawn again.
    if (this.stage.scale === 0) return svg.replaceChildren();
    const [width, height] = this.stage.size;
    // One unit is one pixel of the picture, and (0, 0) the centre of the first.
    svg.setAttribute("viewBox", `-0.5 -0.5 ${width} ${height}`);
    /** @type {Element[]} */
    const parts = [];
    const overlay = check?.overlay;
    if (overlay) {
      for (const line of overlay.grid) parts.push(...outlined("polyline", "grid", line));
      for (const side of /** @type {const} */ (["left", "right"])) {
        if (overlay.patches[side].length === 0) continue;
        parts.push(...outlined("polygon", `patch-${side} area`, overlay.patches[side]));
        parts.push(this.#text(side === "left" ? "patch L" : "patch R", overlay.patches[side]));
      }
      parts.push(...outlined("polyline", "door", overlay.door_line));
      for (const foot of overlay.edges) if (foot) parts.push(this.#dot("foot", foot, 2.5));
    }
    if (draft && check) parts.push(...this.#residuals(draft, check));
    svg.replaceChildren(...parts);
  }

  /**
   * @param {Draft} draft
   * @param {Check} check
   */
  #residuals(draft, check) {
    const { scale } = this.stage;
    const lengths = check.points.map(({ residual_px }) => Math.hypot(...residual_px));
    const longest = Math.max(0, ...lengths) * scale;
    this.enlargement = ENLARGEMENTS.find((factor) => factor * longest <= LONGEST_PX) ?? 1;
    /** @type {Element[]} */
    const parts = [];
    check.points.forEach(({ residual_px: [du, dv] }, index) => {
      const point = draft.points[index];
      // Of four points every fit is exact: what is left is rounding.
      if (!point || lengths[index] < 0.005) return;
      const [u, v] = point.pixel;
      /** @type {Pixel} */
      const end = [u - du * this.enlargement, v - dv * this.enlargement];
      parts.push(...outlined("polyline", "residual", [[u, v], end]), this.#dot("end", end, 3));
    });
    return parts;
  }

  /**
   * @param {string} words
   * @param {Pixel[]} around
   */
  #text(words, around) {
    const text = document.createElementNS(SVG, "text");
    const mean = (/** @type {0 | 1} */ axis) => around.reduce((sum, pixel) => sum + pixel[axis], 0) / around.length;
    text.setAttribute("x", String(mean(0)));
    text.setAttribute("y", String(mean(1)));
    text.setAttribute("font-size", String(TEXT_PX / this.stage.scale));
    text.setAttribute("stroke-width", String(3 / this.stage.scale));
    setText(text, words);
    return text;
  }

  /**
   * @param {string} name
   * @param {Pixel} at
   * @param {number} radius  CSS pixels
   */
  #dot(name, [u, v], radius) {
    const circle = document.createElementNS(SVG, "circle");
    circle.setAttribute("class", name);
    circle.setAttribute("cx", String(u));
    circle.setAttribute("cy", String(v));
    circle.setAttribute("r", String(radius / this.stage.scale));
    return circle;
  }
}

/**
 * Every line twice, dark below light: to be seen on any floor.
 * @param {"polyline" | "polygon"} shape
 * @param {string} name
 * @param {Pixel[]} pixels
 */
function outlined(shape, name, pixels) {
  return ["under", name].map((className) => {
    const line = document.createElementNS(SVG, shape);
    line.setAttribute("class", className);
    line.setAttribute("points", pixels.map((pixel) => pixel.join(",")).join(" "));
    return line;
  });
}
