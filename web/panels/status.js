import { byId, setText } from "../dom.js";
import { UNKNOWN, duration, fixed, integer, milliseconds } from "../format.js";
import { gainPercent, gapPercent } from "../health/samples.js";

/** @import { PatchView, Rgb, Status, Update, WatchState } from "../types.js" */
/** @import { Verdict } from "../freshness.js" */

/** @type {Record<WatchState, string>} */
const WATCH_WORDS = {
  learning: "Learning the background",
  watching: "Watching",
  relearning: "Learning the background anew",
  stale: "No new frames",
  obstructed: "The floor is covered",
  misaligned: "The camera has moved",
};

/** @param {Verdict} verdict */
export function showConnection({ connection, label, notice }) {
  const root = document.documentElement;
  if (root.dataset.connection !== connection) {
    root.dataset.connection = connection;
    setText(byId("connection-spoken"), notice ? `${label}. ${notice}` : label);
  }
  setText(byId("connection-label"), label);
  const element = byId("map-notice");
  element.hidden = notice === null;
  setText(element, notice ?? "");
  byId("map-frame").classList.toggle("not-live", notice !== null);
}

/** @param {Status} status */
export function showStatus(status) {
  const { frames, rate_hz: rate } = status;
  setText(byId("dropped"), integer(frames.dropped));
  setText(byId("skipped"), integer(frames.skipped));
  setText(byId("lost"), integer(frames.lost));
  byId("last-skipped-row").hidden = !frames.last_skipped;
  setText(byId("last-skipped"), frames.last_skipped ?? "");
  setText(byId("daemon-rate"), `${fixed(rate.captured, 1)}, ${fixed(rate.solved, 1)} a second`);

  const preset = status.preset && status.preset !== status.model ? `, preset ${status.preset}` : "";
  setText(byId("model"), status.model === null ? UNKNOWN : status.model + preset);
  setText(byId("lambda"), status.lambda > 0 ? String(Number(status.lambda.toPrecision(4))) : UNKNOWN);
  setText(byId("version"), `doorcam ${status.version}`);
  setText(byId("uptime"), `running for ${duration(status.uptime_s)}`);
}

/** @param {WatchState | null} watch */
export function showWatchState(watch) {
  const element = byId("watch-state");
  element.hidden = watch === null;
  setText(element, watch ? (WATCH_WORDS[watch] ?? watch) : "");
}

/**
 * @param {Update | null} update
 * @param {number | null} rateHz
 * @param {number} missed
 * @param {number | null} latencyMs
 */
export function showUpdate(update, rateHz, missed, latencyMs) {
  setText(byId("latency"), milliseconds(latencyMs));
  setText(byId("rate"), fixed(rateHz, 1));
  setText(byId("missed"), integer(missed));
  if (!update) return;
  const { solution, timing_ms: timing } = update;
  setText(byId("frame"), update.frame === null ? integer(update.sequence) : integer(update.frame));
  setText(byId("solve-ms"), milliseconds(timing.solve));
  setText(byId("total-ms"), milliseconds(timing.total));
  setText(byId("model"), update.model);
  setText(byId("lambda"), String(Number(solution.lambda.toPrecision(4))));
  setText(byId("objective"), Number.isFinite(solution.objective) ? solution.objective.toPrecision(4) : UNKNOWN);
  setText(byId("gap"), gap(solution));
  setText(byId("gain"), update.gain ? [update.gain.left, update.gain.right].map(gain).join(", ") : UNKNOWN);
  setText(byId("iterations"), `${integer(solution.iterations)}, from ${solution.warm ? "the last frame" : "nothing"}`);
}

/**
 * Where something of the camera's own side covers the floor, or lights it; nothing while both views are clear.
 * @param {Update["view"]} view
 */
export function showView(view) {
  const words = view ? [viewWords("left", view.left), viewWords("right", view.right)].filter((text) => text !== "") : [];
  const element = byId("view-words");
  element.hidden = words.length === 0;
  const text = words.join(", ");
  setText(element, `${text.charAt(0).toUpperCase()}${text.slice(1)}.`);
}

/**
 * @param {string} side
 * @param {PatchView} view
 */
function viewWords(side, { state, used }) {
  if (state === "blocked") return `${side} view blocked`;
  return state === "partial" ? `${side} view partly covered (${fixed(100 * used, 0)} % used)` : "";
}

/** @param {Rgb} rgb */
function gain(rgb) {
  const percent = gainPercent(rgb);
  return `${percent >= 0 ? "+" : ""}${fixed(percent, 1)} %`;
}

/** @param {{ objective: number, bound: number }} solution */
function gap(solution) {
  const percent = gapPercent(solution);
  if (percent === null) return UNKNOWN;
  return percent < 0.01 ? "below 0.01 %" : `${fixed(percent, percent < 1 ? 2 : 1)} %`;
}
