/** @import { Source } from "./types.js" */

/**
 * @typedef {object} SourceWords
 * @property {string} now  what the source is doing, in a few words
 * @property {string | null} trouble  why there are no pictures, for the map; null while nothing is wrong
 * @property {string | null} advice  what to do about it
 */

/** @type {Record<string, SourceWords>} */
const WORDS = {
  opening: { now: "Opening", trouble: null, advice: null },
  streaming: { now: "Streaming", trouble: null, advice: null },
  stalled: {
    now: "Stalled",
    trouble: "The camera has stopped sending pictures",
    advice: "It is given a moment, then opened anew. If that does not help, unplug it and plug it in again.",
  },
  lost: {
    now: "Lost",
    trouble: "The camera is gone",
    advice: "Check its cable and plug it in again: the map then carries on by itself.",
  },
  "backing-off": {
    now: "Waiting before another try",
    trouble: "The camera could not be opened",
    advice: "It is tried again by itself, at growing intervals. Check that it is plugged in and that no other program uses it.",
  },
  ended: { now: "Ended", trouble: "Recording ended", advice: null },
  failed: { now: "Failed", trouble: "Source failed", advice: "It is not tried again: put right what is named here, then restart doorcam." },
};

/**
 * Where a recording needs other words than a camera.
 * @type {Record<string, SourceWords>}
 */
const OF_RECORDING = {
  stalled: {
    now: "Stalled",
    trouble: "The recording's frames cannot be used",
    advice: "The log and the status name the last one and the reason.",
  },
  lost: {
    now: "Lost",
    trouble: "The recording's files cannot be read",
    advice: "Put its directory back: the map then carries on by itself.",
  },
};

/**
 * The state of the source in plain words; of one this page does not know, the daemon's own word.
 * @param {Source} source
 * @returns {SourceWords}
 */
export function sourceWords(source) {
  const special = source.kind === "replay" ? OF_RECORDING[source.state] : undefined;
  const words = special ?? WORDS[source.state] ?? { now: source.state, trouble: null, advice: null };
  if (source.state !== "failed" || !source.error) return words;
  return { ...words, trouble: `${words.trouble}: ${source.error}` };
}
