/** @import { Layer, Point } from "./types.js" */

/** @type {Layer[]} In the order of the selector and the tables. */
export const LAYERS = ["unified", "left", "right"];

/** @type {Record<Layer, string>} */
export const LAYER_NAMES = { unified: "Unified", left: "Left", right: "Right" };

/**
 * @param {[Point, Point]} segment
 * @returns {Point}
 */
export const middle = ([[x0, y0], [x1, y1]]) => [(x0 + x1) / 2, (y0 + y1) / 2];
