import { getEvents, getOccupancy } from "../api.js";
import { laneOfSpans } from "./occupancy.js";

/** @import { OccupancySpan, RoomEvent } from "../types.js" */
/** @import { Lane } from "./occupancy.js" */

const PAGE = 1000;
// What a timeline can show; a file of more is asked of the daemon.
const MOST_PAGES = 10;

/** What has happened in a stretch of time, as far as the daemon keeps it. */
export class HistoryStore {
  constructor() {
    /** @type {RoomEvent[]} */
    this.events = [];
    /** @type {Lane[]} */
    this.lanes = [];
  }

  /**
   * @param {object} wanted
   * @param {number} wanted.from  ms since 1970
   * @param {number} wanted.to
   * @param {string[]} wanted.zones
   */
  async load({ from, to, zones }) {
    const span = { from: new Date(from).toISOString(), to: new Date(to).toISOString() };
    this.events = await pages((after) => getEvents({ ...span, limit: PAGE, ...after }), (page) => page.events);
    this.lanes = await Promise.all([null, ...zones].map(async (zone) => {
      const spans = await pages((after) => getOccupancy({ ...span, limit: PAGE, ...(zone !== null && { zone }), ...after }), (page) => page.spans);
      return laneOfSpans(/** @type {OccupancySpan[]} */ (spans), zone);
    }));
  }
}

/**
 * @template Page, Item
 * @param {(after: { after?: number }) => Promise<Page & { next?: number | null }>} ask
 * @param {(page: Page) => Item[]} itemsOf
 * @returns {Promise<Item[]>}
 */
async function pages(ask, itemsOf) {
  /** @type {Item[]} */
  const all = [];
  /** @type {{ after?: number }} */
  let after = {};
  for (let count = 0; count < MOST_PAGES; count += 1) {
    const page = await ask(after);
    all.push(...itemsOf(page));
    if (page.next === null || page.next === undefined) break;
    after = { after: page.next };
  }
  return all;
}
