import { byId } from "../dom.js";
import { NumberField } from "./number-field.js";
import { TYPICAL } from "./points.js";

/** @import { FieldRule } from "./number-field.js" */
/** @import { Transfer } from "../types.js" */
/** @import { Draft } from "./points.js" */

/** @typedef {Exclude<keyof Draft["door"], "leaf">} DoorKey */

/** @type {[DoorKey, string, FieldRule][]} */
const DOOR = [
  ["width_m", "cal-width", { name: "the width of the opening", least: 0.2, most: 5, unit: "m" }],
  ["wall_thickness_m", "cal-thickness", { name: "the thickness of the wall", least: 0, most: 1, unit: "m" }],
  ["height_m", "cal-height", { name: "the height of the opening", least: 0.5, most: 6, unit: "m" }],
];

/** @type {FieldRule} */
const DISTANCE = { name: "the distance of the marks", least: 0.05, most: 5, unit: "m" };

/** @typedef {keyof NonNullable<Draft["lens"]>} LensKey */

/** @type {[LensKey, string, FieldRule][]} */
const LENS = [
  ["k1", "cal-k1", { name: "k1", least: -10, most: 10, unit: "" }],
  ["k2", "cal-k2", { name: "k2", least: -10, most: 10, unit: "" }],
  ["focal_px", "cal-focal", { name: "the focal length", least: 1, most: 100000, unit: "pixels" }],
];

/** Value of the curve that came with the calibration. */
const OWN = "own";

/** The measures: of the door, of the marks before it, and of the lens for those who know it. */
export class MeasureForm {
  /** @param {() => void} onTyped */
  constructor(onTyped) {
    /** @type {Draft | null} */
    this.draft = null;
    /** @type {{ k1: number | null, k2: number | null, focal_px: number | null }} */
    this.lens = { k1: null, k2: null, focal_px: null };
    /** @type {Transfer | null} A curve that the page has no name for stays what it is. */
    this.ownTransfer = null;
    this.onTyped = onTyped;
    this.door = DOOR.map(([key, id, rule]) => ({
      key,
      field: this.#field(id, rule, (draft, value) => (draft.door[key] = value)),
    }));
    this.distance = this.#field("cal-distance", DISTANCE, (draft, value) => (draft.distance_m = value ?? draft.distance_m));
    this.lensFields = LENS.map(([key, id, rule]) => ({
      key,
      field: this.#field(id, rule, (draft, value) => {
        this.lens[key] = value;
        draft.lens = this.#lens();
      }),
    }));
    this.transfer = byId("cal-transfer", HTMLSelectElement);
    this.transfer.addEventListener("change", () => {
      if (this.draft) this.draft.transfer = this.#chosenTransfer();
      this.onTyped();
    });
    for (const [key, id] of DOOR) {
      const typical = key === "height_m" ? "" : String(TYPICAL[key]);
      byId(id, HTMLInputElement).placeholder = typical;
    }
  }

  /** @returns {string | null} */
  get problem() {
    const fields = [...this.door.map(({ field }) => field), this.distance, ...this.lensFields.map(({ field }) => field)];
    return fields.find((candidate) => candidate.problem)?.problem ?? null;
  }

  /** @param {Draft} draft */
  show(draft) {
    if (draft !== this.draft) {
      this.lens = { k1: null, k2: null, focal_px: null, ...draft.lens };
      this.#offer(draft.transfer);
    }
    this.draft = draft;
    for (const { key, field } of this.door) field.show(draft.door[key]);
    this.distance.show(draft.distance_m);
    // The picture may have been resized, and the focal length with it.
    if (draft.lens) this.lens.focal_px = draft.lens.focal_px ?? null;
    for (const { key, field } of this.lensFields) field.show(this.lens[key]);
  }

  /** @returns {Draft["lens"]} */
  #lens() {
    const { k1, k2, focal_px } = this.lens;
    if (k1 === null && k2 === null && focal_px === null) return null;
    return { k1: k1 ?? 0, k2: k2 ?? 0, focal_px };
  }

  /** @returns {Transfer | null} */
  #chosenTransfer() {
    const { value } = this.transfer;
    if (value === OWN) return this.ownTransfer;
    return value === "srgb" || value === "linear" ? value : null;
  }

  /** @param {Transfer | null} transfer */
  #offer(transfer) {
    [...this.transfer.options].find((option) => option.value === OWN)?.remove();
    const own = transfer !== null && transfer !== "srgb" && transfer !== "linear";
    this.ownTransfer = own ? transfer : null;
    if (own) this.transfer.add(new Option("gamma" in transfer ? `power ${transfer.gamma}` : "measured curve", OWN));
    this.transfer.value = own ? OWN : (transfer ?? "");
  }

  /**
   * @param {string} id
   * @param {FieldRule} rule
   * @param {(draft: Draft, value: number | null) => void} change
   */
  #field(id, rule, change) {
    const typed = (/** @type {number | null} */ value, /** @type {boolean} */ usable) => {
      if (this.draft && usable) change(this.draft, value);
      this.onTyped();
    };
    return new NumberField(byId(id, HTMLInputElement), rule, typed, byId(`${id}-problem`));
  }
}
