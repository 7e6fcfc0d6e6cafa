/** @import { OccupancySpan, RoomEvent } from "../types.js" */

/**
 * A stretch of time in which the number of people stayed the same.
 * @typedef {{ from: number, to: number, people: number, tracks: number[] }} Stretch  ms since 1970
 */
/** @typedef {{ zone: string | null, stretches: Stretch[] }} Lane  zone: null for the whole room */

/**
 * Who was where, as events tell it: each enter lasts to its exit.
 * @param {RoomEvent[]} events  in their order
 * @param {string[]} zones  that have a lane even where nothing has happened
 * @param {number} from  what came before is not known
 * @param {number} to
 * @returns {Lane[]}
 */
export function lanesOfEvents(events, zones, from, to) {
  const names = new Set([null, ...zones, ...events.flatMap(({ zone }) => (zone === null ? [] : [zone]))]);
  return [...names].map((zone) => ({ zone, stretches: stretchesOf(events, zone, from, to) }));
}

/**
 * @param {RoomEvent[]} events
 * @param {string | null} zone
 * @param {number} from
 * @param {number} to
 */
function stretchesOf(events, zone, from, to) {
  const [enter, exit] = zone === null ? ["enter", "exit"] : ["zone_enter", "zone_exit"];
  /** @type {Map<number, number>} */
  const inside = new Map();
  /** @type {{ track: number, from: number, to: number }[]} */
  const stays = [];
  for (const { kind, track, time, zone: of } of events) {
    const at = Date.parse(time);
    if ((zone !== null && of !== zone) || (kind !== enter && kind !== exit)) continue;
    if (kind === enter) inside.set(track, at);
    else {
      // Who leaves without having come was there before anything is known.
      stays.push({ track, from: inside.get(track) ?? from, to: at });
      inside.delete(track);
    }
  }
  for (const [track, since] of inside) stays.push({ track, from: since, to });
  return merged(stays.filter((stay) => stay.to > from && stay.from < to), from, to);
}

/**
 * @param {{ track: number, from: number, to: number }[]} stays
 * @param {number} from
 * @param {number} to
 * @returns {Stretch[]} the whole of the time, without gaps
 */
function merged(stays, from, to) {
  const borders = new Set([from, to]);
  for (const stay of stays) for (const at of [stay.from, stay.to]) if (at > from && at < to) borders.add(at);
  const sorted = [...borders].sort((a, b) => a - b);
  return sorted.slice(1).map((end, k) => {
    const tracks = stays.filter((stay) => stay.from < end && stay.to > sorted[k]).map(({ track }) => track);
    return { from: sorted[k], to: end, people: tracks.length, tracks };
  });
}

/**
 * The same as the daemon's history keeps it; what no stretch covers was not watched.
 * @param {OccupancySpan[]} spans
 * @param {string | null} zone
 * @returns {Lane}
 */
export const laneOfSpans = (spans, zone) => ({
  zone,
  stretches: spans.map(({ from, to, people }) => ({ from: Date.parse(from), to: Date.parse(to), people, tracks: [] })),
});

/**
 * @param {Lane} lane
 * @param {number} at
 * @returns {Stretch | null} null: not watched then
 */
export const stretchAt = ({ stretches }, at) => stretches.find(({ from, to }) => from <= at && at < to) ?? null;
