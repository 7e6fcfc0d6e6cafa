import { Refusal, forgetZones, getZones, putZones } from "../api.js";
import { byId, isUnavailable, resizeList, setText, setUnavailable } from "../dom.js";
import { askToDrop } from "../drop.js";
import { fixed } from "../format.js";
import { ZoneCanvas } from "./canvas.js";
import { LONGEST_NAME, ZoneDraft, areaOf } from "./draft.js";

/** @import { RoomMap } from "../map/map.js" */
/** @import { Point, ZonesDocument } from "../types.js" */

/** @type {Record<ZonesDocument["origin"], string>} */
const ORIGINS = {
  config: "These are the zones of the configuration file. What is saved here is used instead.",
  saved: "These zones were saved here. They are used instead of the configuration file's.",
  run: "These zones were drawn here. They end with this run of doorcam, for there is no place to keep them.",
};

/** The zones editor, beside the live map: people walk on while somebody draws. */
export class ZonesView {
  /**
   * @param {RoomMap} map
   * @param {() => void} onSaved
   */
  constructor(map, onSaved) {
    this.onSaved = onSaved;
    this.shown = false;
    this.busy = false;
    this.connected = false;
    /** @type {ZoneDraft | null} */
    this.draft = null;
    /** @type {ZonesDocument | null} */
    this.document = null;
    this.canvas = new ZoneCanvas(map, {
      onChange: () => this.#refresh(),
      onChoose: (index) => this.#choose(index),
      onDrawn: (corners) => this.#drawn(corners),
      onSay: (words) => setText(byId("zones-spoken"), words),
    });
    this.list = byId("zones-list");
    byId("zones-new").addEventListener("click", () => this.#begin());
    byId("zones-undo").addEventListener("click", () => this.#step("undo"));
    byId("zones-redo").addEventListener("click", () => this.#step("redo"));
    byId("zones-save").addEventListener("click", () => void this.#save());
    byId("zones-discard").addEventListener("click", () => void this.#discard());
    byId("zones-forget").addEventListener("click", () => void this.#change(forgetZones, "The configuration's zones are used again."));
    const snap = byId("zones-snap", HTMLInputElement);
    snap.addEventListener("change", () => { this.canvas.snaps = snap.checked; });
    document.addEventListener("keydown", (event) => this.#key(event));
    window.addEventListener("beforeunload", (event) => {
      if (this.draft?.changed) event.preventDefault();
    });
  }

  open() {
    this.shown = true;
    byId("map-view").classList.add("drawing-zones");
    byId("zones-panel").hidden = false;
    this.#say("", false);
    this.#refresh();
    void this.#load();
    byId("zones-title").focus();
  }

  close() {
    this.shown = false;
    this.draft = null;
    byId("map-view").classList.remove("drawing-zones");
    byId("zones-panel").hidden = true;
    this.canvas.edit(null);
  }

  /** @returns {true | Promise<boolean>} */
  mayLeave() {
    return this.draft?.changed ? askToDrop() : true;
  }

  /** @param {boolean} connected */
  follow(connected) {
    if (!this.shown || connected === this.connected) return;
    this.connected = connected;
    if (connected && !this.draft) void this.#load();
    this.#refresh();
  }

  /** The map has been drawn, perhaps in another size. */
  place() {
    if (this.shown) this.canvas.place();
  }

  async #load() {
    try {
      this.#take(await getZones());
    } catch (error) {
      this.#say(error instanceof Refusal ? error.message : "The daemon does not answer.", true);
    }
  }

  /** @param {ZonesDocument} document */
  #take(document) {
    if (!this.shown) return;
    this.document = document;
    this.draft = new ZoneDraft(document.zones.map(({ id, name, polygon_m }) => ({ id, name, polygon_m })));
    this.canvas.edit(this.draft);
    this.#refresh();
  }

  #begin() {
    if (!this.draft) return;
    this.#say("", false);
    this.canvas.begin();
    this.#refresh();
  }

  /** @param {Point[]} corners */
  #drawn(corners) {
    const { draft } = this;
    if (!draft) return;
    draft.change((zones) => zones.push({ name: draft.freeName(), polygon_m: corners }));
    this.#choose(draft.zones.length - 1);
    const name = /** @type {HTMLInputElement} */ (this.list.lastElementChild?.querySelector("input"));
    name.focus();
    name.select();
  }

  /** @param {number | null} index */
  #choose(index) {
    this.canvas.choose(index);
    this.#refresh();
  }

  /** @param {"undo" | "redo"} which */
  #step(which) {
    const { draft, canvas } = this;
    if (!draft) return;
    if (canvas.sketch) canvas.cancel();
    else draft[which]();
    const { chosen } = canvas;
    this.#choose(chosen !== null && chosen < draft.zones.length ? chosen : null);
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    const key = event.key.toLowerCase();
    if (!this.shown || !(event.ctrlKey || event.metaKey) || (key !== "z" && key !== "y")) return;
    // A field has an undo of its own.
    if (event.target instanceof HTMLInputElement && event.target.type === "text") return;
    event.preventDefault();
    this.#step(key === "y" || event.shiftKey ? "redo" : "undo");
  }

  async #save() {
    const { draft } = this;
    if (!draft || isUnavailable(byId("zones-save", HTMLButtonElement))) return;
    const count = draft.zones.length;
    await this.#change(() => putZones(draft.zones), count === 0 ? "Saved: there are no zones." : "Saved: people are counted in them from now on.");
  }

  async #discard() {
    if (!this.draft?.changed || !(await askToDrop()) || !this.document) return;
    this.#take(this.document);
    this.#say("Your changes are gone.", false);
  }

  /**
   * @param {() => Promise<ZonesDocument>} ask
   * @param {string} done
   */
  async #change(ask, done) {
    if (this.busy) return;
    this.busy = true;
    this.#say("", false);
    this.#refresh();
    try {
      this.#take(await ask());
      this.#say(done, false);
      this.onSaved();
    } catch (error) {
      const why = error instanceof Refusal ? error.message : "the daemon does not answer; try again when it does";
      this.#say(`Not saved: ${why}`, true);
    } finally {
      this.busy = false;
      this.#refresh();
    }
  }

  #refresh() {
    const { draft, canvas, document } = this;
    const drawing = canvas.sketch !== null;
    this.#showList();
    const trouble = draft?.trouble ?? null;
    setText(byId("zones-trouble"), trouble ?? "");
    setText(byId("zones-origin"), document ? ORIGINS[document.origin] : "");
    byId("zones-forget").hidden = !document || document.origin === "config";
    byId("zones-how").hidden = !drawing;
    byId("zones-none").hidden = !draft || draft.zones.length > 0 || drawing;
    setUnavailable(byId("zones-new", HTMLButtonElement), !draft || drawing);
    setUnavailable(byId("zones-undo", HTMLButtonElement), !draft || (draft.before.length === 0 && !drawing));
    setUnavailable(byId("zones-redo", HTMLButtonElement), !draft || draft.after.length === 0);
    setUnavailable(byId("zones-save", HTMLButtonElement), !draft?.changed || drawing || trouble !== null || this.busy || !this.connected);
    setUnavailable(byId("zones-discard", HTMLButtonElement), !draft?.changed || this.busy);
  }

  #showList() {
    const zones = this.draft?.zones ?? [];
    resizeList(this.list, zones.length, () => this.#item(this.list.children.length));
    zones.forEach(({ name, polygon_m }, index) => {
      const item = this.list.children[index];
      const [input, area, remove] = item.children;
      item.classList.toggle("chosen", index === this.canvas.chosen);
      if (input instanceof HTMLInputElement) {
        if (input.value !== name) input.value = name;
        input.setAttribute("aria-label", `Name of zone ${index + 1}`);
        input.setAttribute("aria-invalid", String(this.draft?.problem(index) !== null));
      }
      setText(area, `${fixed(areaOf(polygon_m), 1)} m²`);
      remove.setAttribute("aria-label", `Remove ${name}`);
    });
  }

  /** @param {number} index */
  #item(index) {
    const item = document.createElement("li");
    const input = document.createElement("input");
    input.type = "text";
    input.maxLength = LONGEST_NAME;
    input.addEventListener("focus", () => {
      if (this.canvas.chosen !== index) this.#choose(index);
    });
    input.addEventListener("input", () => {
      this.draft?.change((zones) => { zones[index].name = input.value; }, input);
      this.canvas.refresh();
      this.#refresh();
    });
    input.addEventListener("blur", () => this.draft?.rest());
    const remove = document.createElement("button");
    remove.type = "button";
    setText(remove, "Remove");
    remove.addEventListener("click", () => {
      this.draft?.change((zones) => zones.splice(index, 1));
      this.#choose(null);
      byId("zones-new").focus();
    });
    item.append(input, document.createElement("span"), remove);
    return item;
  }

  /**
   * @param {string} text
   * @param {boolean} failed
   */
  #say(text, failed) {
    const outcome = byId("zones-outcome");
    setText(outcome, text);
    outcome.classList.toggle("failed", failed);
  }
}
