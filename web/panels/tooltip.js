import { BRIGHTNESSES, BRIGHTNESS_NAMES, lightOf } from "../brightness.js";
import { LAYERS, LAYER_NAMES, middle } from "../layers.js";
import { byId, resizeList, setText } from "../dom.js";
import { amount, position } from "../format.js";

/** @import { RoomMap } from "../map/map.js" */
/** @import { LitFacet, Point } from "../types.js" */

const OFFSET_PX = 14;
/** @type {Omit<LitFacet, "index">} */
const UNLIT = { left: [0, 0, 0], right: [0, 0, 0], unified: [0, 0, 0], refit: 1 };

/** The numbers of the facet under the pointer or finger. */
export class Tooltip {
  /** @param {RoomMap} map */
  constructor(map) {
    this.map = map;
    this.element = byId("tooltip");
    /** @type {Point | null} */
    this.pointer = null;
    const { canvas } = map;
    canvas.addEventListener("pointermove", (event) => this.#point(event));
    canvas.addEventListener("pointerdown", (event) => this.#point(event));
    // A lifted finger "leaves" too, but its owner wants to read what it tapped.
    canvas.addEventListener("pointerleave", (event) => {
      if (event.pointerType !== "touch") this.hide();
    });
    document.addEventListener("pointerdown", (event) => {
      if (event.target !== canvas) this.hide();
    });
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.hide();
    });
  }

  hide() {
    this.pointer = null;
    this.refresh();
  }

  /** Also called after each drawing: the numbers change under a still pointer. */
  refresh() {
    const { map, element, pointer } = this;
    const index = pointer && map.facetAt(pointer);
    map.setHighlight(index);
    element.hidden = index === null;
    if (index === null || !pointer || !map.geometry) return;

    const [x, y] = middle(map.geometry.facets[index]);
    const kind = map.geometry.foreground[index] === false ? "far wall" : "foreground";
    setText(byId("tooltip-title"), `Facet ${index}`);
    setText(byId("tooltip-place"), `${position(x, y)}, ${kind}`);
    const lit = map.update?.facets.find((facet) => facet.index === index);
    const facet = lit ?? { index, ...UNLIT };
    // No light is none however it is counted: once is enough.
    const brightnesses = lit ? BRIGHTNESSES : BRIGHTNESSES.slice(0, 1);
    const rows = byId("tooltip-rows");
    resizeList(rows, LAYERS.length * brightnesses.length, headedRow);
    brightnesses.forEach((brightness, group) => {
      LAYERS.forEach((layer, row) => {
        const cells = rows.children[group * LAYERS.length + row].children;
        setText(cells[0], `${LAYER_NAMES[layer]}, ${BRIGHTNESS_NAMES[brightness].toLowerCase()}`);
        lightOf(facet, layer, brightness).forEach((value, channel) => setText(cells[channel + 1], amount(value)));
      });
    });
    this.#place(pointer);
  }

  /** @param {PointerEvent} event */
  #point(event) {
    this.pointer = [event.offsetX, event.offsetY];
    this.refresh();
  }

  /** @param {Point} pointer */
  #place([x, y]) {
    const { element } = this;
    const { clientWidth, clientHeight } = this.map.canvas;
    const beside = x + OFFSET_PX + element.offsetWidth <= clientWidth ? x + OFFSET_PX : x - OFFSET_PX - element.offsetWidth;
    const below = y + OFFSET_PX + element.offsetHeight <= clientHeight ? y + OFFSET_PX : y - OFFSET_PX - element.offsetHeight;
    const left = Math.max(4, Math.min(beside, clientWidth - element.offsetWidth - 4));
    element.style.transform = `translate(${Math.round(left)}px, ${Math.round(Math.max(4, below))}px)`;
  }
}

function headedRow() {
  const row = document.createElement("tr");
  const head = document.createElement("th");
  head.scope = "row";
  row.append(head);
  for (let channel = 0; channel < 3; channel += 1) row.append(document.createElement("td"));
  return row;
}
