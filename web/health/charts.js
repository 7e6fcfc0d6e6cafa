import { byId, setText } from "../dom.js";
import { UNKNOWN, fixed, milliseconds } from "../format.js";
import { MINUTES } from "./samples.js";

/** @import { Sample } from "./samples.js" */

/**
 * @typedef {object} ChartKind
 * @property {string} title
 * @property {string} hint
 * @property {[keyof Sample, string][]} lines  and what they are called where there are several
 * @property {(value: number) => string} text  with its unit where that is short
 * @property {string} unit  where the text does not tell it
 * @property {number} least  of the scale: what is smaller is not worth a look
 * @property {boolean} [signed]
 */

/** @param {number} value */
const percent = (value) => `${fixed(value, Math.abs(value) < 10 ? 1 : 0)} %`;
/** @param {number} value */
const signedPercent = (value) => `${value >= 0 ? "+" : ""}${percent(value)}`;

/** @param {number} value */
const inMs = (value) => (value < 1000 ? `${milliseconds(value)} ms` : `${fixed(value / 1000, 1)} s`);

/** @type {ChartKind[]} */
const KINDS = [
  { title: "Frames", hint: "Frames a second that the source gives, and that become maps", lines: [["captured", "in"], ["solved", "out"]], text: (v) => fixed(v, 1), unit: "", least: 5 },
  { title: "Frames missing", hint: "Dropped because a newer one was there, lost by the camera, or damaged", lines: [["missing", ""]], text: (v) => fixed(v, 0), unit: "a second", least: 4 },
  { title: "Latency", hint: "From the capture of a frame to its map on this screen", lines: [["latencyMs", ""]], text: inMs, unit: "", least: 50 },
  { title: "Solve time", hint: "How long finding the map takes", lines: [["solveMs", ""]], text: inMs, unit: "", least: 5 },
  { title: "Certificate gap", hint: "How far the map can at most be from the best one, proven for each frame", lines: [["gap", ""]], text: percent, unit: "", least: 1 },
  { title: "Light gain", hint: "How much brighter the floor is as a whole than when the room was learned", lines: [["gainLeft", "left"], ["gainRight", "right"]], text: signedPercent, unit: "", least: 2, signed: true },
];

const SVG = "http://www.w3.org/2000/svg";
const SECONDS = 60 * MINUTES;
const HEIGHT = 40;

/** Small charts of the last minutes. */
export class HealthCharts {
  constructor() {
    this.charts = KINDS.map((kind) => new Chart(kind));
    byId("charts").append(...this.charts.map(({ element }) => element));
  }

  /** @param {Sample[]} samples */
  show(samples) {
    for (const chart of this.charts) chart.show(samples);
  }
}

class Chart {
  /** @param {ChartKind} kind */
  constructor(kind) {
    this.kind = kind;
    this.element = document.createElement("figure");
    this.element.className = "chart";
    this.element.title = kind.hint;
    const caption = document.createElement("figcaption");
    const title = document.createElement("span");
    setText(title, kind.title);
    this.now = document.createElement("span");
    this.now.className = "chart-now";
    caption.append(title, this.now);
    this.svg = document.createElementNS(SVG, "svg");
    this.svg.setAttribute("viewBox", `0 0 ${SECONDS - 1} ${HEIGHT}`);
    this.svg.setAttribute("preserveAspectRatio", "none");
    this.svg.setAttribute("role", "img");
    this.svg.setAttribute("class", "of-now");
    this.zero = document.createElementNS(SVG, "path");
    this.zero.setAttribute("class", "chart-zero");
    this.paths = kind.lines.map((_, index) => {
      const path = document.createElementNS(SVG, "path");
      path.setAttribute("class", `chart-line-${index}`);
      return path;
    });
    this.svg.append(this.zero, ...this.paths);
    this.range = document.createElement("span");
    this.range.className = "chart-range";
    this.range.setAttribute("aria-hidden", "true");
    this.element.append(caption, this.svg, this.range);
    // A picture needs a name before the first second is over, too.
    this.show([]);
  }

  /** @param {Sample[]} samples */
  show(samples) {
    const { kind } = this;
    const known = kind.lines.flatMap(([key]) => samples.map((sample) => sample[key])).filter((value) => value !== null);
    const top = niceAbove(1.05 * Math.max(kind.least, ...known.map(Math.abs)));
    const bottom = kind.signed ? -top : 0;
    const y = (/** @type {number} */ value) => HEIGHT - (HEIGHT * (value - bottom)) / (top - bottom);
    this.zero.setAttribute("d", `M0 ${y(0)}H${SECONDS}`);
    kind.lines.forEach(([key], index) => {
      this.paths[index].setAttribute("d", pathOf(samples.map((sample) => sample[key]), y));
    });
    const last = samples.at(-1);
    const named = (/** @type {(key: keyof Sample) => string} */ text) =>
      kind.lines.map(([key, name]) => (name ? `${text(key)} ${name}` : text(key))).join(", ");
    const now = named((key) => textOf(kind, last?.[key] ?? null));
    setText(this.now, `${now} ${kind.unit}`.trim());
    setText(this.range, `${kind.signed ? "±" : ""}${kind.text(top).replace("+", "").replace(/\.0\b/, "")}`);
    const span = known.length === 0 ? "" : `; ${kind.text(Math.min(...known))} to ${kind.text(Math.max(...known))} in the last ${MINUTES} minutes`;
    this.svg.setAttribute("aria-label", `${kind.title}: ${now} ${kind.unit}`.trim() + span);
  }
}

/**
 * @param {ChartKind} kind
 * @param {number | null} value
 */
const textOf = (kind, value) => (value === null ? UNKNOWN : kind.text(value));

/**
 * The newest at the right edge, a second a unit; what is not known is a gap.
 * @param {(number | null)[]} values
 * @param {(value: number) => number} y
 */
function pathOf(values, y) {
  let path = "";
  let drawing = false;
  values.forEach((value, index) => {
    if (value !== null) {
      const x = SECONDS - values.length + index;
      // A lone point between two gaps is drawn too.
      path += drawing ? `L${x} ${y(value).toFixed(2)}` : `M${x} ${y(value).toFixed(2)}h0`;
    }
    drawing = value !== null;
  });
  return path;
}

/**
 * The first of 1, 2, 5, 10, 20, 50 .. that is not below.
 * @param {number} value
 */
export function niceAbove(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * ([1, 2, 5].find((factor) => factor * power >= value * (1 - 1e-9)) ?? 10);
}
