import { BRIGHTNESSES, BRIGHTNESS_NAMES, lightOf } from "../brightness.js";
import { LAYERS, LAYER_NAMES, middle } from "../layers.js";
import { byId, resizeList, setText } from "../dom.js";
import { amount, duration, fixed, position } from "../format.js";
import { SLOWEST_M_S, ellipse95 } from "../map/tracks.js";

/** @import { RoomMap } from "../map/map.js" */
/** @import { LitFacet, Point, Track } from "../types.js" */

const OFFSET_PX = 14;
/** @type {Omit<LitFacet, "index">} */
const UNLIT = { left: [0, 0, 0], right: [0, 0, 0], unified: [0, 0, 0], refit: 1 };

/** The numbers of the facet or the person under the pointer or finger. */
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
    // A person stands on facets, and is what is meant.
    const track = pointer && map.trackAt(pointer);
    const index = track || !pointer ? null : map.facetAt(pointer);
    map.setHighlight(index);
    element.hidden = !track && index === null;
    if (!pointer || element.hidden) return;
    if (track) showTrack(track);
    else if (index !== null) this.#showFacet(index);
    this.#place(pointer);
  }

  /** @param {number} index */
  #showFacet(index) {
    const { map } = this;
    if (!map.geometry) return;

    const [x, y] = middle(map.geometry.facets[index]);
    const kind = map.geometry.foreground[index] === false ? "far wall" : "foreground";
    setText(byId("tooltip-title"), `Facet ${index}`);
    setText(byId("tooltip-place"), `${position(x, y)}, ${kind}`);
    const lit = map.update?.facets.find((facet) => facet.index === index);
    const facet = lit ?? { index, ...UNLIT };
    // No light is none however it is counted: once is enough.
    const brightnesses = lit ? BRIGHTNESSES : BRIGHTNESSES.slice(0, 1);
    showRows(brightnesses.flatMap((brightness) => LAYERS.map((layer) => [
      `${LAYER_NAMES[layer]}, ${BRIGHTNESS_NAMES[brightness].toLowerCase()}`,
      ...lightOf(facet, layer, brightness).map(amount),
    ])));
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

/** @param {Track} track */
function showTrack(track) {
  const { vx_m_s, vy_m_s, rgb } = track;
  setText(byId("tooltip-title"), `Person ${track.id}`);
  setText(byId("tooltip-place"), `${position(track.x_m, track.y_m)}, ${track.state} for ${duration(track.age_s)}`);
  const speed = Math.hypot(vx_m_s, vy_m_s);
  const { major, minor } = ellipse95(track.covariance_m2);
  const heading = speed < SLOWEST_M_S ? "stands" : headingWords(vx_m_s, vy_m_s);
  showRows([
    ["Speed", `${fixed(speed, 2)} m/s`, heading, ""],
    ["95 % ellipse", `± ${fixed(major, 2)}`, `± ${fixed(minor, 2)} m`, ""],
    ["Change of light", ...rgb.map(amount)],
  ]);
}

/**
 * In the room's own terms: where from the door's point of view.
 * @param {number} vx
 * @param {number} vy
 */
function headingWords(vx, vy) {
  const words = ["right", "away and right", "away", "away and left", "left", "nearer and left", "nearer", "nearer and right"];
  return words[(Math.round(Math.atan2(vy, vx) / (Math.PI / 4)) + 8) % 8];
}

/** @param {string[][]} rows  a head and three cells each */
function showRows(rows) {
  const body = byId("tooltip-rows");
  resizeList(body, rows.length, headedRow);
  rows.forEach((texts, row) => texts.forEach((text, cell) => setText(body.children[row].children[cell], text)));
}

function headedRow() {
  const row = document.createElement("tr");
  const head = document.createElement("th");
  head.scope = "row";
  row.append(head);
  for (let channel = 0; channel < 3; channel += 1) row.append(document.createElement("td"));
  return row;
}
