import { byId, resizeList, setText } from "../dom.js";
import { duration, fixed, plural } from "../format.js";
import { sourceWords } from "../source-words.js";

/** @import { Status } from "../types.js" */

/**
 * Where the pictures come from, how that is going, and what to do when it is not.
 * @param {Status} status
 */
export function showSource({ source, background, publish }) {
  const { now, trouble, advice } = sourceWords(source);
  byId("source").hidden = false;
  setText(byId("source-spec"), source.spec);
  show("source-notes", "source-notes", source.notes);

  // A recording that ends is no trouble: the map says that it has.
  const sentences = advice ? [trouble, source.state === "failed" ? null : source.error, advice] : [];
  show("source-trouble", "source-trouble", sentences.map(sentence).join(" ").trim() || null);

  const { granted } = source;
  setText(byId("source-state"), now);
  show("camera-row", "camera", granted && `${granted.card}, ${granted.node}`);
  show("granted-row", "granted", granted && `${granted.format} ${granted.size.join(" × ")}, ${frameRate(granted.fps)}`);
  const mismatches = granted?.mismatches ?? [];
  byId("mismatches").hidden = mismatches.length === 0;
  const list = byId("mismatch-list");
  resizeList(list, mismatches.length, () => document.createElement("li"));
  mismatches.forEach((mismatch, row) => setText(list.children[row], mismatch));
  show("background-row", "background", background ? ofFrames(background) : null);
  const { mqtt, webhooks } = publish;
  show("broker-row", "broker", mqtt && (mqtt.state === "connected" ? `connected, ${mqtt.topic}` : `${mqtt.error ?? "connecting"}`) + (mqtt.warning ? `; ${mqtt.warning}` : ""));
  const total = (/** @type {"delivered" | "waiting" | "dead"} */ what) => webhooks.reduce((sum, hook) => sum + hook[what], 0);
  const failed = webhooks.find(({ error }) => error)?.error;
  const counts = `${total("delivered")} delivered, ${total("waiting")} waiting, ${total("dead")} given up${failed ? `; ${failed}` : ""}`;
  show("hooks-row", "hooks", webhooks.length > 0 ? counts : null);
  setText(byId("health-words"), `${now}${background ? `, background ${ofFrames(background)}` : ""}`);
}

/**
 * @param {string} rowId
 * @param {string} id
 * @param {string | null} text
 */
function show(rowId, id, text) {
  byId(rowId).hidden = !text;
  setText(byId(id), text ?? "");
}

/** @param {string | null} text */
const sentence = (text) => (text ? text[0].toUpperCase() + text.slice(1) + (/[.!?]$/.test(text) ? "" : ".") : "");

/** @param {number} fps */
const frameRate = (fps) => `${fixed(fps, Number.isInteger(fps) ? 0 : 1)} a second`;

/** @param {NonNullable<Status["background"]>} background */
function ofFrames({ frames, age_s, progress }) {
  const from = `from ${plural(frames, "frame")}`;
  if (progress === null) return age_s === null ? from : `${from}, ${duration(age_s)} old`;
  return progress < 1 ? `${Math.floor(100 * progress)} % learned` : "waiting for the room to be still";
}
