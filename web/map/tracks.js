import { cssColour, split, strength } from "../colour.js";
import { FONT_BOLD, INK } from "./ink.js";

/** @import { Parts, Point, Track } from "../types.js" */
/** @import { Viewport } from "./viewport.js" */

// A two-dimensional normal lies inside this many standard deviations 95 % of the time:
// the square root of the chi-square quantile 5.991 for two degrees of freedom.
const SIGMAS_95 = Math.sqrt(5.991);

// Where somebody will be in this many seconds: an arrow that is as long as a step or two.
const AHEAD_S = 0.6;
// Slower than this, the direction is that of the noise.
export const SLOWEST_M_S = 0.12;
const ARROW_PX = 6;
const RING_PX = 8;
const REACH_PX = 18;

/** Who may be a false alarm is faint; who is not seen right now is dashed. */
const ALPHA = { tentative: 0.35, confirmed: 1, coasting: 0.7 };

/**
 * The 95 % ellipse of a 2 x 2 covariance from its eigenvalues.
 * @param {[[number, number], [number, number]]} covariance
 * @returns {{ major: number, minor: number, angle: number }} half axes in metres; angle from +x
 */
export function ellipse95([[xx, xy], [, yy]]) {
  const mean = (xx + yy) / 2;
  const spread = Math.hypot((xx - yy) / 2, xy);
  return {
    major: SIGMAS_95 * Math.sqrt(Math.max(mean + spread, 0)),
    minor: SIGMAS_95 * Math.sqrt(Math.max(mean - spread, 0)),
    angle: 0.5 * Math.atan2(2 * xy, xx - yy),
  };
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Track[]} tracks
 * @param {Pick<Parts, "ellipses" | "headings">} parts
 */
export function drawTracks(ctx, view, tracks, parts) {
  for (const track of tracks) {
    const [x, y] = view.point([track.x_m, track.y_m]);
    const { major, minor, angle } = ellipse95(track.covariance_m2);
    ctx.globalAlpha = ALPHA[track.state];
    ctx.strokeStyle = INK.track;
    ctx.lineWidth = 1.25;
    ctx.setLineDash(track.state === "coasting" ? [4, 3] : []);
    ctx.beginPath();
    // The canvas's y points down, so the angle turns the other way.
    ctx.ellipse(x, y, major * view.scale, minor * view.scale, -angle, 0, 2 * Math.PI);
    if (parts.ellipses) ctx.stroke();
    ctx.setLineDash([]);
    if (parts.headings) drawHeading(ctx, view, track);
    drawColour(ctx, x, y, track);
    ctx.fillStyle = INK.track;
    ctx.beginPath();
    ctx.arc(x, y, 4.5, 0, 2 * Math.PI);
    ctx.fill();
    ctx.font = FONT_BOLD;
    ctx.textAlign = "left";
    ctx.textBaseline = "bottom";
    ctx.lineWidth = 3;
    ctx.strokeStyle = INK.ground;
    ctx.strokeText(String(track.id), x + 10, y - 7);
    ctx.fillText(String(track.id), x + 10, y - 7);
    ctx.globalAlpha = 1;
  }
}

/**
 * @param {Viewport} view
 * @param {Track[]} tracks
 * @param {Point} pointer  CSS pixels
 * @returns {Track | null} under the pointer
 */
export function trackAt(view, tracks, pointer) {
  const distance = (/** @type {Track} */ { x_m, y_m }) => {
    const [x, y] = view.point([x_m, y_m]);
    return Math.hypot(x - pointer[0], y - pointer[1]);
  };
  const near = tracks.filter((track) => distance(track) < REACH_PX);
  return near.sort((a, b) => distance(a) - distance(b))[0] ?? null;
}

/**
 * An arrow to where somebody will soon be.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Viewport} view
 * @param {Track} track
 */
function drawHeading(ctx, view, { x_m, y_m, vx_m_s, vy_m_s }) {
  if (Math.hypot(vx_m_s, vy_m_s) < SLOWEST_M_S) return;
  const [x, y] = view.point([x_m, y_m]);
  const [endX, endY] = view.point([x_m + AHEAD_S * vx_m_s, y_m + AHEAD_S * vy_m_s]);
  const angle = Math.atan2(endY - y, endX - x);
  ctx.lineWidth = 2;
  ctx.beginPath();
  ctx.moveTo(x + RING_PX * Math.cos(angle), y + RING_PX * Math.sin(angle));
  ctx.lineTo(endX, endY);
  for (const side of [-0.5, 0.5]) {
    ctx.moveTo(endX, endY);
    ctx.lineTo(endX - ARROW_PX * Math.cos(angle + side), endY - ARROW_PX * Math.sin(angle + side));
  }
  ctx.stroke();
}

/**
 * A ring in the colour of the light that the person adds; dashed, in that of the light that is missing.
 * @param {CanvasRenderingContext2D} ctx
 * @param {number} x
 * @param {number} y
 * @param {Track} track
 */
function drawColour(ctx, x, y, { rgb }) {
  const scale = strength(rgb);
  if (scale === 0) return;
  const { brighter, darker } = split(rgb);
  const adds = strength(brighter) >= strength(darker);
  ctx.strokeStyle = cssColour(adds ? brighter : darker, scale);
  ctx.lineWidth = 3;
  ctx.setLineDash(adds ? [] : [3, 2.5]);
  ctx.beginPath();
  ctx.arc(x, y, RING_PX, 0, 2 * Math.PI);
  ctx.stroke();
  ctx.setLineDash([]);
}
