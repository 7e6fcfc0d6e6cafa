import { Refusal } from "../api.js";
import { byId, resizeList, setText, setUnavailable, tableRow } from "../dom.js";
import { fixed, integer, plural, position } from "../format.js";
import { csvOf, download } from "./export.js";
import { stretchAt } from "./occupancy.js";
import { HistoryStore } from "./store.js";
import { Timeline, clockTime } from "./timeline.js";

/** @import { RoomEvent, Status, Zone } from "../types.js" */

const REFRESH_S = 3;
// Rows that a reader may scroll through; a file has all of them.
const MOST_ROWS = 300;

/** @type {Record<RoomEvent["kind"], string>} */
const KINDS = {
  enter: "comes in",
  exit: "leaves",
  dwell: "stays in one place",
  zone_enter: "enters",
  zone_exit: "leaves",
  cross_in: "walks in through the door",
  cross_out: "walks out through the door",
  cross_back: "turns around on the threshold",
  camera_moved: "the camera has moved",
};

/** What happened in the last hours: occupancy to scrub through, and events. */
export class HistoryView {
  constructor() {
    this.shown = false;
    this.store = new HistoryStore();
    this.loading = false;
    this.askedS = -Infinity;
    this.failed = "";
    this.from = 0;
    this.to = 1;
    /** @type {number | null} Where somebody has scrubbed to; null: the newest. */
    this.cursor = null;
    /** @type {number | null} The end of the time that is shown; null: now. */
    this.until = null;
    this.timeline = new Timeline(byId("timeline", HTMLCanvasElement), (at) => this.#scrub(at));
    this.slider = byId("timeline-slider", HTMLInputElement);
    this.slider.addEventListener("input", () => {
      const share = this.slider.valueAsNumber / Number(this.slider.max);
      this.#scrub(this.from + share * (this.to - this.from));
    });
    byId("history-span").addEventListener("change", () => this.#restart());
    byId("history-earlier").addEventListener("click", () => this.#shift(-1));
    byId("history-later").addEventListener("click", () => this.#shift(1));
    byId("history-csv").addEventListener("click", () => download(this.#name("csv"), "text/csv", csvOf(this.store.events)));
    byId("history-json").addEventListener("click", () => {
      download(this.#name("json"), "application/json", `${JSON.stringify(this.store.events, null, 2)}\n`);
    });
  }

  open() {
    this.shown = true;
    this.askedS = -Infinity;
    byId("history-title").focus();
  }

  close() {
    this.shown = false;
  }

  /**
   * @param {object} now
   * @param {Status | null} now.status
   * @param {Zone[]} now.zones
   * @param {boolean} now.connected
   * @param {number | null} now.daemonMs  its clock
   * @param {number} now.nowS
   */
  follow({ status, zones, connected, daemonMs, nowS }) {
    if (!this.shown) return;
    byId("history-view").classList.toggle("not-live", !connected);
    if (!connected || !status || daemonMs === null || this.loading || nowS - this.askedS < REFRESH_S) return;
    this.askedS = nowS;
    this.to = this.until ?? daemonMs;
    this.from = this.to - 60_000 * this.#minutes;
    this.#tellKept(status.history);
    void this.#load({ from: this.from, to: this.to, zones: zones.map(({ name }) => name) });
  }

  get #minutes() {
    return Number(document.querySelector("input[name=span]:checked")?.getAttribute("value"));
  }

  /**
   * Where it is kept, and that it is not where it should be.
   * @param {Status["history"]} history
   */
  #tellKept({ state, reason, file, bytes, lost }) {
    const missing = lost > 0 ? ` ${plural(lost, "entry").replace("entrys", "entries")} could not be kept.` : "";
    const words = state === "stored" ? `Kept in ${file}, ${fixed(bytes / 1e6, 1)} MB.` : `In memory, until doorcam ends: ${reason ?? ""}.`;
    setText(byId("history-kept"), words + missing);
    byId("history-kept").classList.toggle("trouble", missing !== "" || (state === "memory" && file !== null));
  }

  /** @param {Parameters<HistoryStore["load"]>[0]} wanted */
  async #load(wanted) {
    this.loading = true;
    try {
      await this.store.load(wanted);
      this.failed = "";
    } catch (error) {
      this.failed = error instanceof Refusal ? error.message : "The daemon does not answer.";
    } finally {
      this.loading = false;
      this.#show();
    }
  }

  #restart() {
    this.askedS = -Infinity;
    this.cursor = null;
  }

  /** @param {-1 | 1} direction */
  #shift(direction) {
    const span = this.to - this.from;
    // Past the newest there is nothing: then, and shortly before, as time has passed since, it follows again.
    const until = this.to + (direction * span) / 2;
    this.until = direction > 0 && (this.until === null || until >= Date.now() - span / 4) ? null : until;
    this.#restart();
  }

  /** @param {number} at */
  #scrub(at) {
    // At its end, it goes on with the time.
    this.cursor = at >= this.to - (this.to - this.from) / 500 ? null : at;
    this.#show();
  }

  #show() {
    if (!this.shown) return;
    const { store, from, to } = this;
    const { lanes, events } = store;
    const at = Math.max(from, this.cursor ?? to - 1);
    this.timeline.show(lanes, from, to, at);
    const share = Math.round((Number(this.slider.max) * (at - from)) / (to - from));
    if (document.activeElement !== this.slider || this.cursor === null) this.slider.value = String(share);
    const words = lanes.map((lane) => {
      const stretch = stretchAt(lane, at);
      return `${lane.zone ?? "Room"}: ${stretch ? plural(stretch.people, "person").replace("persons", "people") : "not watched"}`;
    });
    const when = `${new Date(at).toLocaleDateString("en-GB", { weekday: "short", day: "numeric", month: "short" })} ${clockTime(at, true)}`;
    this.slider.setAttribute("aria-valuetext", [when, ...words].join("; "));
    setText(byId("history-when"), this.cursor === null && this.until === null ? `Now, ${when}` : when);
    const list = byId("history-who");
    resizeList(list, words.length, () => document.createElement("li"));
    words.forEach((text, row) => setText(list.children[row], text));
    const refused = byId("history-refused");
    refused.hidden = this.failed === "";
    setText(refused, this.failed);
    this.#showEvents(events, at);
    for (const id of ["history-csv", "history-json"]) setUnavailable(byId(id, HTMLButtonElement), events.length === 0);
  }

  /**
   * @param {RoomEvent[]} events
   * @param {number} at
   */
  #showEvents(events, at) {
    setText(byId("history-count"), integer(events.length));
    byId("history-none").hidden = events.length > 0;
    // Up to the time that is looked at, the newest first.
    const until = events.filter(({ time }) => Date.parse(time) <= at).slice(-MOST_ROWS).reverse();
    const body = byId("history-rows");
    resizeList(body, until.length, () => tableRow(4));
    until.forEach(({ kind, time, track, x_m, y_m, zone }, row) => {
      const cells = body.children[row].children;
      setText(cells[0], clockTime(Date.parse(time), true));
      const ofPerson = kind !== "camera_moved";
      setText(cells[1], ofPerson ? `Person ${track}` : "");
      setText(cells[2], `${KINDS[kind] ?? kind}${zone === null ? "" : ` ${zone}`}`);
      setText(cells[3], ofPerson ? position(x_m, y_m).replace(" m", "") : "");
    });
  }

  /** @param {string} extension */
  #name(extension) {
    const stamp = (/** @type {number} */ at) => new Date(at).toISOString().slice(0, 19).replaceAll(":", "");
    return `doorcam-events-${stamp(this.from)}-${stamp(this.to)}.${extension}`;
  }
}
