/** @import { OccupancySpan } from "../types.js" */

/**
 * A stretch of time in which the number of people stayed the same.
 * @typedef {{ from: number, to: number, people: number }} Stretch  ms since 1970
 */
/** @typedef {{ zone: string | null, stretches: Stretch[] }} Lane  zone: null for the whole room */

/**
 * How many were there, as the daemon keeps it; what no stretch covers was not watched.
 * @param {OccupancySpan[]} spans
 * @param {string | null} zone
 * @returns {Lane}
 */
export const laneOfSpans = (spans, zone) => ({
  zone,
  stretches: spans.map(({ from, to, people }) => ({ from: Date.parse(from), to: Date.parse(to), people })),
});

// The daemon takes updates that are no further apart for unbroken.
const GAP_MS = 5000;

/**
 * What was so at a time, or a moment before: the newest stretch ends with the update that was the newest when it was asked for.
 * @param {Lane} lane
 * @param {number} at
 * @returns {Stretch | null} null: not watched then
 */
export const stretchAt = ({ stretches }, at) =>
  stretches.find(({ from, to }) => from <= at && at < to) ?? stretches.findLast(({ to }) => to <= at && at - to < GAP_MS) ?? null;
