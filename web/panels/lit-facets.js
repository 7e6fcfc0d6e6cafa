import { BRIGHTNESSES, BRIGHTNESS_NAMES, lightOf } from "../brightness.js";
import { strength } from "../colour.js";
import { byId, resizeList, setText, tableRow } from "../dom.js";
import { integer, plural, position, triple } from "../format.js";
import { LAYERS, middle } from "../layers.js";

/** @import { Brightness, Choice, Geometry, LitFacet, Update } from "../types.js" */

/**
 * The map in words and, when opened, in numbers: for those who cannot see or point at it.
 * @param {Geometry} geometry
 * @param {Update} update
 * @param {Choice} choice
 */
export function showLitFacets(geometry, update, choice) {
  const known = update.facets.filter((facet) => geometry.facets[facet.index]);
  const shown = (/** @type {LitFacet} */ facet) => strength(lightOf(facet, choice.layer, choice.brightness));
  const ordered = known.sort((a, b) => shown(b) - shown(a));
  setText(byId("lit-count"), integer(ordered.length));
  setText(byId("map-summary"), summary(geometry, ordered, choice.layer));
  // A few hundred cells several times a second are worth writing only when somebody reads them.
  if (!byId("lit", HTMLDetailsElement).open) return;
  const body = byId("lit-rows");
  resizeList(body, ordered.length, () => tableRow(3 + LAYERS.length));
  ordered.forEach((facet, row) => {
    const cells = body.children[row].children;
    const [x, y] = middle(geometry.facets[facet.index]);
    setText(cells[0], String(facet.index));
    setText(cells[1], position(x, y).replace(" m", ""));
    // Both in one row, a line each, for they are one facet's.
    const both = (/** @type {(brightness: Brightness) => string} */ text) => BRIGHTNESSES.map(text).join("\n");
    setText(cells[2], both((brightness) => BRIGHTNESS_NAMES[brightness].toLowerCase()));
    LAYERS.forEach((layer, column) => {
      setText(cells[3 + column], both((brightness) => triple(lightOf(facet, layer, brightness))));
    });
  });
}

/**
 * @param {Geometry} geometry
 * @param {LitFacet[]} ordered
 * @param {import("../types.js").Layer} layer
 */
function summary(geometry, ordered, layer) {
  const lit = ordered.filter((facet) => strength(facet[layer]) > 0);
  const of = `of ${plural(geometry.facets.length, "facet")} lit in the ${layer === "unified" ? "unified map" : `${layer} view`}`;
  if (lit.length === 0) return `None ${of}.`;
  const [x, y] = middle(geometry.facets[lit[0].index]);
  return `${integer(lit.length)} ${of}, the strongest at ${position(x, y)}.`;
}
