import { duration } from "./format.js";
import { sourceWords } from "./source-words.js";

/** @import { Phase } from "./live.js" */
/** @import { Status, WatchState } from "./types.js" */

/** @type {Record<string, string>} Why doorcam is not watching, by the reason in its status. */
const REASONS = {
  opening: "the source is being opened",
  "no-camera": "the camera is gone",
  uncalibrated: "the camera is not calibrated",
  learning: "the empty room is being learned",
  relearning: "the empty room is being learned anew",
  obstructed: "something covers the floor before the door",
  misaligned: "the camera has moved",
  stale: "there are no new frames",
  ended: "there are no more frames",
  failed: "the source failed",
};

/** @typedef {"connecting" | "waiting" | "live" | "paused" | "stale" | "reconnecting"} Connection */

/**
 * @typedef {object} Verdict
 * @property {Connection} connection
 * @property {string} label  for the status bar
 * @property {string | null} notice  over the map; null only while the picture is live, or held still and marked as such
 */

/**
 * @typedef {object} Evidence
 * @property {Phase} phase
 * @property {boolean} everConnected
 * @property {number} retryInS
 * @property {number | null} ageS  of the picture shown; null before the first
 * @property {WatchState | null} watch  as the picture's own update says
 * @property {Status | null} status
 * @property {number} statusAgeS
 * @property {boolean} paused  somebody holds the picture still
 */

/**
 * A picture older than this is not live.
 * @param {number | null | undefined} fps
 */
export const staleAfterS = (fps) => Math.max(2, fps ? 5 / fps : 0);

/**
 * The state of now, and why doorcam is not watching; null while it is. The later word counts: the newest update, or the
 * status, which is polled and changes with time alone.
 * @param {Pick<Evidence, "ageS" | "watch" | "status" | "statusAgeS">} evidence
 * @returns {{ state: WatchState | null, why: string | null }}
 */
export function watchNow({ ageS, watch, status, statusAgeS }) {
  const isLater = ageS === null || ageS > statusAgeS;
  const state = isLater ? (status?.state ?? watch) : watch;
  const reason = (isLater ? status?.watching?.reason : null) ?? (state === "watching" ? null : state);
  return { state, why: reason === null ? null : (REASONS[reason] ?? reason) };
}

/**
 * Whether what the map shows may be called live, and if not, what to say instead. The one rule:
 * an old picture is never passed off as the present.
 * @param {Evidence} evidence
 * @returns {Verdict}
 */
export function judge(evidence) {
  const { phase, everConnected, retryInS, ageS, watch, status, statusAgeS, paused } = evidence;
  const since = ageS === null ? "" : ` · last update ${duration(ageS)} ago`;

  if (phase !== "open") {
    if (phase === "connecting" && !everConnected) {
      return { connection: "connecting", label: "Connecting", notice: "Connecting" };
    }
    const seconds = Math.ceil(retryInS);
    const label = phase === "waiting" && seconds > 0 ? `Reconnecting in ${seconds} s` : "Reconnecting";
    return { connection: "reconnecting", label, notice: `Not connected${since}` };
  }

  const trouble = sourceTrouble(status);
  if (ageS === null) {
    return { connection: "waiting", label: "Connected", notice: trouble ?? beforeFirst(status) };
  }
  // The status is polled: an update that came after it proves that its bad news is over.
  if (trouble && ageS > statusAgeS) {
    return { connection: "stale", label: "Stale", notice: trouble + since };
  }
  const now = watchNow(evidence).state;
  if (watch === "stale" || now === "stale" || ageS > staleAfterS(status?.source.fps)) {
    return { connection: "stale", label: "Stale", notice: `Stale${since}` };
  }
  if (paused) return { connection: "paused", label: "Paused", notice: null };
  return { connection: "live", label: "Live", notice: null };
}

/** @param {Status | null} status */
const sourceTrouble = (status) => status && sourceWords(status.source).trouble;

/** @param {Status | null} status */
function beforeFirst(status) {
  if (status?.calibrated === false) return "Not calibrated: nobody has said yet where the door is";
  if (status?.source.state === "opening") return "Opening the source";
  if (status?.state === "learning" || status?.state === "relearning") return "Learning the background";
  return "Waiting for the first picture";
}
