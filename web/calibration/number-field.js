import { setText } from "../dom.js";

/**
 * @typedef {object} FieldRule
 * @property {string} name  as in a sentence: "the width of the opening"
 * @property {number} least
 * @property {number} most
 * @property {string} unit
 */

/** A number somebody types, checked with words. */
export class NumberField {
  /**
   * @param {HTMLInputElement} input
   * @param {FieldRule} rule
   * @param {(value: number | null, usable: boolean) => void} onTyped  null: empty, or not usable
   * @param {HTMLElement | null} [message]  where the words about it go
   */
  constructor(input, rule, onTyped, message = null) {
    this.input = input;
    this.rule = rule;
    this.message = message;
    /** @type {string | null} */
    this.problem = null;
    /** @type {number | null} */
    this.shown = null;
    input.addEventListener("input", () => {
      const value = this.#read();
      onTyped(value, this.problem === null);
    });
  }

  /** @param {number | null} value */
  show(value) {
    const { input } = this;
    // Nothing changes under the typing hand, and what cannot be used stays to be put right.
    const before = this.shown;
    this.shown = value;
    if (document.activeElement === input && !input.readOnly) return;
    if (this.problem && value === before) return;
    const text = value === null ? "" : String(value);
    if (input.value !== text) input.value = text;
    this.#say(null);
  }

  #read() {
    const { input, rule } = this;
    // What is typed but is no number reads as empty: only the validity tells.
    if (input.value === "" && !input.validity.badInput) {
      this.#say(null);
      return null;
    }
    const value = input.valueAsNumber;
    const fits = Number.isFinite(value) && value >= rule.least && value <= rule.most;
    this.#say(fits ? null : `${rule.name[0].toUpperCase()}${rule.name.slice(1)} must be ${range(rule)}.`);
    return fits ? value : null;
  }

  /** @param {string | null} problem */
  #say(problem) {
    this.problem = problem;
    this.input.setAttribute("aria-invalid", String(problem !== null));
    if (this.message) setText(this.message, problem ?? "");
  }
}

/** @param {FieldRule} rule */
const range = ({ least, most, unit }) => `a number from ${least} to ${most} ${unit}`.trim().replace(/-/g, "\u2212");
