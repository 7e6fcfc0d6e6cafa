import { FONT_BOLD, INK } from "./ink.js";

/** @import { Track } from "../types.js" */
/** @import { Viewport } from "./viewport.js" */

// A two-dimensional normal lies inside this many standard deviations 95 % of the time:
// the square root of the chi-square quantile 5.991 for two degrees of freedom.
const SIGMAS_95 = Math.sqrt(5.991);

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
 */
export function drawTracks(ctx, view, tracks) {
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
    ctx.stroke();
    ctx.setLineDash([]);
    ctx.fillStyle = INK.track;
    ctx.beginPath();
    ctx.arc(x, y, 4.5, 0, 2 * Math.PI);
    ctx.fill();
    ctx.font = FONT_BOLD;
    ctx.textAlign = "left";
    ctx.textBaseline = "bottom";
    ctx.lineWidth = 3;
    ctx.strokeStyle = INK.ground;
    ctx.strokeText(String(track.id), x + 7, y - 4);
    ctx.fillText(String(track.id), x + 7, y - 4);
    ctx.globalAlpha = 1;
  }
}
