import { followPointer, placeWords } from "./handles.js";

/** @import { Pixel } from "../types.js" */
/** @import { DraftPoint } from "./points.js" */
/** @import { Stage } from "../camera/stage.js" */

/** The magnifier shows a picture pixel this large, in CSS pixels. */
const MAGNIFICATION = 8;

const DARK = "#0a0e13";
const MARK = "#ffd23f";

/**
 * The surroundings of the chosen point, enlarged, with the exact place in the middle. A finger hides
 * what it points at; here its owner sees it, and can push the picture under the cross.
 */
export class Loupe {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {HTMLCanvasElement} picture
   * @param {Stage} stage
   * @param {(point: DraftPoint, pixel: Pixel) => void} onMove
   */
  constructor(canvas, picture, stage, onMove) {
    this.canvas = canvas;
    this.picture = picture;
    this.stage = stage;
    const context = canvas.getContext("2d");
    if (!context) throw new Error("this browser has no 2D canvas");
    this.ctx = context;
    /** @type {DraftPoint | null} */
    this.point = null;
    this.editable = false;
    canvas.addEventListener("pointerdown", (event) => {
      const { point } = this;
      // Without this the point would lose the focus, and the magnifier go.
      event.preventDefault();
      if (!point || !this.editable || event.button !== 0) return;
      const pull = (/** @type {number} */ dx, /** @type {number} */ dy) => /** @type {Pixel} */ ([-dx / MAGNIFICATION, -dy / MAGNIFICATION]);
      followPointer(event, canvas, pull, point.pixel, (pixel) => onMove(point, pixel));
    });
    canvas.addEventListener("mousedown", (event) => event.preventDefault());
  }

  /**
   * @param {DraftPoint | null} point
   * @param {boolean} editable
   */
  show(point, editable) {
    this.editable = editable;
    if (point !== this.point) this.canvas.dataset.corner = "";
    this.point = point;
    this.canvas.hidden = point === null;
    this.refresh();
  }

  refresh() {
    const { canvas, ctx, point, picture } = this;
    if (!point || canvas.hidden) return;
    this.#place(point);
    const side = canvas.clientWidth;
    const ratio = window.devicePixelRatio || 1;
    const pixels = Math.round(side * ratio);
    if (canvas.width !== pixels) canvas.width = canvas.height = pixels;
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.fillStyle = DARK;
    ctx.fillRect(0, 0, side, side);
    const [u, v] = point.pixel;
    // Single pixels are to be seen as what they are.
    ctx.imageSmoothingEnabled = false;
    const left = side / 2 - (u + 0.5) * MAGNIFICATION;
    const top = side / 2 - (v + 0.5) * MAGNIFICATION;
    ctx.drawImage(picture, left, top, picture.width * MAGNIFICATION, picture.height * MAGNIFICATION);
    this.#cross(side);
    ctx.fillStyle = DARK;
    ctx.fillRect(0, side - 18, side, 18);
    ctx.fillStyle = "#ffffff";
    ctx.font = "11px system-ui, sans-serif";
    ctx.textAlign = "center";
    ctx.fillText(placeWords(point.pixel), side / 2, side - 5);
  }

  /**
   * Open in the middle: the exact place stays in sight.
   * @param {number} side
   */
  #cross(side) {
    const { ctx } = this;
    const [middle, gap] = [side / 2, 3];
    for (const [colour, width] of /** @type {[string, number][]} */ ([[DARK, 3], [MARK, 1.2]])) {
      ctx.strokeStyle = colour;
      ctx.lineWidth = width;
      ctx.beginPath();
      for (const [from, to] of [[0, middle - gap], [middle + gap, side]]) {
        ctx.moveTo(from, middle);
        ctx.lineTo(to, middle);
        ctx.moveTo(middle, from);
        ctx.lineTo(middle, to);
      }
      ctx.stroke();
    }
  }

  /**
   * In the corner farthest from the point, and there until the point comes near.
   * @param {DraftPoint} point
   */
  #place(point) {
    const { canvas } = this;
    const frame = canvas.parentElement?.getBoundingClientRect();
    if (!frame) return;
    const [x, y] = this.stage.clientOf(point.pixel);
    const reach = canvas.clientWidth + 40;
    const [right, bottom] = [x - frame.left > frame.width / 2, y - frame.top > frame.height / 2];
    const across = right ? frame.right - x < reach : x - frame.left < reach;
    const down = bottom ? frame.bottom - y < reach : y - frame.top < reach;
    const own = `${bottom ? "bottom" : "top"} ${right ? "right" : "left"}`;
    if (canvas.dataset.corner && !(canvas.dataset.corner === own && across && down)) return;
    canvas.dataset.corner = `${bottom ? "top" : "bottom"} ${right ? "left" : "right"}`;
  }
}
