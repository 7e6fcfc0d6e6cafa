import { byId } from "./dom.js";

/** @import { View } from "./route.js" */

/** @type {Record<View, string>} */
const TITLES = { map: "doorcam", camera: "Camera – doorcam", history: "History – doorcam", zones: "Zones – doorcam", calibration: "Calibration – doorcam" };

/**
 * Show one view and hide the others, in the page, its navigation and its title.
 * @param {View} view
 */
export function turnTo(view) {
  for (const each of /** @type {View[]} */ (Object.keys(TITLES))) {
    // Zones are drawn on the live map.
    if (each !== "zones") byId(`${each}-view`).hidden = each !== (view === "zones" ? "map" : view);
    if (each === view) byId(`to-${each}`).setAttribute("aria-current", "page");
    else byId(`to-${each}`).removeAttribute("aria-current");
  }
  document.title = TITLES[view];
  window.scrollTo(0, 0);
}
