/** @import { Brightness, Layer, LitFacet, Rgb } from "./types.js" */

/** @type {Brightness[]} In the order of the selector and the tables. */
export const BRIGHTNESSES = ["measured", "shrunk"];

/** @type {Record<Brightness, string>} */
export const BRIGHTNESS_NAMES = { measured: "Measured", shrunk: "Shrunk" };

/**
 * A facet's light in a layer. What the daemon sends is shrunk by the penalty that keeps the map
 * sparse; times the facet's factor it is as bright as the floor says.
 * @param {LitFacet} facet
 * @param {Layer} layer
 * @param {Brightness} brightness
 * @returns {Rgb}
 */
export function lightOf(facet, layer, brightness) {
  const [r, g, b] = facet[layer];
  const factor = brightness === "measured" ? facet.refit : 1;
  return [factor * r, factor * g, factor * b];
}
