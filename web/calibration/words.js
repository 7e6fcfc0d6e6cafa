import { fixed, plural } from "../format.js";

/** @import { Check, PointCheck } from "../types.js" */
/** @import { Outcome } from "./checker.js" */

/**
 * What is in doubt and how good the calibration is, in one line.
 * @param {Check} check
 */
export function summaryOf({ error, seen, warnings }) {
  return [...warnings.map((warning) => `${inWords(warning)}.`.replace("?.", "?")), accuracyOf({ error, seen })].join(" ").trim();
}

/** @param {Pick<Check, "error" | "seen">} check */
function accuracyOf({ error, seen }) {
  if (!error) return "";
  const { rms_px, noise_px, floor_mm, angle_deg } = error;
  const consequence = floor_mm === null || angle_deg === null ? "" : `, ${fixed(floor_mm, 1)} mm on the floor, ${fixed(angle_deg, 1)}° in angle`;
  if (noise_px !== null) return `Error ${fixed(rms_px, 1)} px${consequence}. ${seenWords(seen)}`;
  // What the daemon takes where nothing tells.
  const assumed = `If each is marked to 1 px${consequence}: four points always fit, and a fifth shows how well they agree.`;
  return `${assumed} ${seenWords(seen)}`;
}

/** @param {Check["seen"]} seen */
function seenWords({ left, right }) {
  if (left >= 0.9995 && right >= 0.9995) return "Both patches are wholly in the picture.";
  return `In the picture: ${share(left)} of patch L, ${share(right)} of patch R.`;
}

/** Never "100 %" of what is cut off. @param {number} part */
const share = (part) => `${fixed(part >= 0.9995 ? 100 : Math.min(99.9, 100 * part), part > 0.99 && part < 0.9995 ? 1 : 0)} %`;

/** @param {PointCheck} point */
export function residualWords({ residual_px, residual_mm }) {
  const onFloor = residual_mm ? `${fixed(Math.hypot(...residual_mm), 1)} mm` : "above the horizon";
  return `${fixed(Math.hypot(...residual_px), 1)} px, ${onFloor}`;
}

// The daemon names a key of the file; the reader sees a field of the page.
/** @type {Record<string, string>} */
const KEYS = {
  size: "Picture size",
  "doorway.width_m": "Width of the opening",
  "doorway.wall_thickness_m": "Thickness of the wall",
  "doorway.height_m": "Height of the opening",
  floor_points: "Points",
  "patch.fov_m": "Patch size",
  "lens.k1": "Distortion k1",
  "lens.k2": "Distortion k2",
  "lens.focal_px": "Focal length",
};

/** @param {string} error */
const inWords = (error) => error.replace(/^[a-z]\w*(\.\w+)?(?=[: ])/, (key) => KEYS[key] ?? key);

/**
 * What is wrong with the draft, a line each.
 * @param {Outcome | null} outcome
 */
export function errorsOf(outcome) {
  if (!outcome) return [];
  if ("refused" in outcome) return [inWords(outcome.refused)];
  if ("silent" in outcome) return ["The daemon does not answer: nothing can be checked until it does."];
  return outcome.check.errors.map(inWords);
}

/**
 * @typedef {object} Situation
 * @property {string | null} fieldProblem  a field that says nothing usable
 * @property {string | null} missing
 * @property {Outcome | null} outcome
 * @property {boolean} current  the outcome is about the draft as it is now
 * @property {boolean} changed
 * @property {boolean} busy  being saved
 */

/**
 * Why this cannot be saved now; null if it can.
 * @param {Situation} situation
 */
export function whyNotSave({ fieldProblem, missing, outcome, current, changed, busy }) {
  if (busy) return "Saving";
  if (fieldProblem) return fieldProblem;
  if (missing) return missing;
  if (!changed) return "Nothing has changed.";
  if (!outcome || !current) return "Being checked";
  const errors = errorsOf(outcome);
  if ("check" in outcome && outcome.check.ok) return null;
  return errors.length > 1 ? `${plural(errors.length, "thing")} must be put right first, see above.` : (errors[0] ?? "The check has failed.");
}
