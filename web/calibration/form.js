import { byId } from "../dom.js";
import { NumberField } from "./number-field.js";
import { TYPICAL } from "./points.js";

/** @import { FieldRule } from "./number-field.js" */
/** @import { Draft } from "./points.js" */

/** @typedef {Extract<keyof Draft["door"], string>} DoorKey */

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

/** The measures: of the door, of the marks before it, and of the lens for those who know it. */
export class MeasureForm {
  /** @param {() => void} onTyped */
  constructor(onTyped) {
    /** @type {Draft | null} */
    this.draft = null;
    /** @type {{ k1: number | null, k2: number | null, focal_px: number | null }} */
    this.lens = { k1: null, k2: null, focal_px: null };
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
      if (this.draft) this.draft.transfer = this.transfer.value || null;
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
    const problem = fields.find((candidate) => candidate.problem)?.problem ?? null;
    if (problem) return problem;
    const some = Object.values(this.lens).some((value) => value !== null);
    return some && !this.#lens() ? "A lens needs its focal length." : null;
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
    if (draft.lens) this.lens = { ...draft.lens };
    for (const { key, field } of this.lensFields) field.show(this.lens[key]);
  }

  /** @returns {Draft["lens"]} */
  #lens() {
    const { k1, k2, focal_px } = this.lens;
    return focal_px === null ? null : { k1: k1 ?? 0, k2: k2 ?? 0, focal_px };
  }

  /**
   * A curve the page does not know stays what it is.
   * @param {string | null} transfer
   */
  #offer(transfer) {
    const known = [...this.transfer.options].some((option) => option.value === (transfer ?? ""));
    if (!known) this.transfer.add(new Option(String(transfer), String(transfer)));
    this.transfer.value = transfer ?? "";
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
