/** @import { Lane } from "./occupancy.js" */

const LANE_PX = 40;
const GAP_PX = 16;
const AXIS_PX = 24;
// Where ticks may be: seconds.
const TICKS_S = [10, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400];
const TICK_PX = 86;

/** Occupancy over time: a lane for the room and for each zone, the height the number of people. */
export class Timeline {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {(at: number) => void} onScrub
   */
  constructor(canvas, onScrub) {
    this.canvas = canvas;
    const context = canvas.getContext("2d");
    if (!context) throw new Error("this browser has no 2D canvas");
    this.ctx = context;
    /** @type {Lane[]} */
    this.lanes = [];
    this.from = 0;
    this.to = 1;
    this.cursor = 0;
    new ResizeObserver(() => this.#draw()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#draw());
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      onScrub(this.timeAt(event.offsetX));
    });
    canvas.addEventListener("pointermove", (event) => {
      if (canvas.hasPointerCapture(event.pointerId)) onScrub(this.timeAt(event.offsetX));
    });
  }

  /**
   * @param {Lane[]} lanes
   * @param {number} from  ms since 1970
   * @param {number} to
   * @param {number} cursor
   */
  show(lanes, from, to, cursor) {
    Object.assign(this, { lanes, from, to, cursor });
    this.#draw();
  }

  /** @param {number} x  CSS pixels */
  timeAt(x) {
    const share = Math.min(Math.max(x / this.canvas.clientWidth, 0), 1);
    return this.from + share * (this.to - this.from);
  }

  #draw() {
    const { canvas, ctx, lanes, from, to } = this;
    const height = lanes.length * (LANE_PX + GAP_PX) + AXIS_PX;
    canvas.style.height = `${height}px`;
    const width = canvas.clientWidth;
    if (width === 0) return;
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    const style = getComputedStyle(canvas);
    const ink = (/** @type {string} */ name) => style.getPropertyValue(`--${name}`);
    ctx.font = `12px ${style.fontFamily}`;
    const x = (/** @type {number} */ at) => ((at - from) / (to - from)) * width;
    this.#drawAxis(x, width, height, ink("muted"), ink("line"));
    const most = Math.max(2, ...lanes.flatMap(({ stretches }) => stretches.map(({ people }) => people)));
    lanes.forEach(({ zone, stretches }, index) => {
      const bottom = (index + 1) * (LANE_PX + GAP_PX);
      ctx.fillStyle = ink("muted");
      ctx.textAlign = "left";
      ctx.textBaseline = "alphabetic";
      ctx.fillText(zone ?? "Room", 2, bottom - LANE_PX - 3);
      this.#hatch(bottom, width, ink("line"));
      for (const stretch of stretches) {
        const left = Math.max(0, x(stretch.from));
        const right = Math.min(width, x(stretch.to));
        if (right <= left) continue;
        ctx.fillStyle = ink("page");
        ctx.fillRect(left, bottom - LANE_PX, right - left, LANE_PX);
        if (stretch.people === 0) continue;
        ctx.fillStyle = ink(index === 0 ? "accent" : "zone");
        const tall = (LANE_PX * stretch.people) / most;
        // A short visit in a long time must still be seen.
        ctx.fillRect(left, bottom - tall, Math.max(1, right - left), tall);
      }
    });
    ctx.strokeStyle = ink("ink");
    ctx.lineWidth = 1.5;
    ctx.beginPath();
    ctx.moveTo(x(this.cursor), 0);
    ctx.lineTo(x(this.cursor), height - AXIS_PX);
    ctx.stroke();
  }

  /**
   * What was not watched is not the same as nobody.
   * @param {number} bottom
   * @param {number} width
   * @param {string} colour
   */
  #hatch(bottom, width, colour) {
    const { ctx } = this;
    ctx.save();
    ctx.beginPath();
    ctx.rect(0, bottom - LANE_PX, width, LANE_PX);
    ctx.clip();
    ctx.strokeStyle = colour;
    ctx.lineWidth = 2;
    ctx.beginPath();
    for (let x = -LANE_PX; x < width; x += 7) {
      ctx.moveTo(x, bottom);
      ctx.lineTo(x + LANE_PX, bottom - LANE_PX);
    }
    ctx.stroke();
    ctx.restore();
  }

  /**
   * @param {(at: number) => number} x
   * @param {number} width
   * @param {number} height
   * @param {string} text
   * @param {string} line
   */
  #drawAxis(x, width, height, text, line) {
    const { ctx, from, to } = this;
    const least = ((to - from) / 1000) * (TICK_PX / width);
    const step = 1000 * (TICKS_S.find((seconds) => seconds >= least) ?? TICKS_S[TICKS_S.length - 1]);
    // Ticks on whole hours of the reader's day, not of Greenwich's.
    const offset = new Date(to).getTimezoneOffset() * 60_000;
    ctx.textAlign = "center";
    ctx.textBaseline = "bottom";
    for (let at = Math.ceil((from - offset) / step) * step + offset; at <= to; at += step) {
      const centre = Math.round(x(at)) + 0.5;
      ctx.strokeStyle = line;
      ctx.lineWidth = 1;
      ctx.beginPath();
      ctx.moveTo(centre, height - AXIS_PX);
      ctx.lineTo(centre, height - AXIS_PX + 5);
      ctx.stroke();
      ctx.fillStyle = text;
      if (centre > 25 && centre < width - 25) ctx.fillText(clockTime(at, step < 60_000), centre, height - 2);
    }
  }
}

/**
 * @param {number} at
 * @param {boolean} seconds
 */
export const clockTime = (at, seconds) =>
  new Date(at).toLocaleTimeString("en-GB", { hour: "2-digit", minute: "2-digit", ...(seconds && { second: "2-digit" }) });
