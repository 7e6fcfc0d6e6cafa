// Numbers for people: true minus signs, fixed widths, an en dash for what is not known.

export const UNKNOWN = "–";

/** @param {string} text */
const withMinus = (text) => text.replace(/-/g, "\u2212");

/**
 * @param {number | null | undefined} value
 * @param {number} digits
 */
export function fixed(value, digits) {
  return Number.isFinite(value) ? withMinus(Number(value).toFixed(digits)) : UNKNOWN;
}

/**
 * An amount of light: four decimals where they say something, else a power of ten.
 * @param {number} value
 */
export function amount(value) {
  if (value === 0) return "0";
  return withMinus(Math.abs(value) >= 0.001 ? value.toFixed(4) : value.toExponential(1));
}

/** @param {readonly number[]} rgb */
export const triple = (rgb) => rgb.map(amount).join("  ");

/** @param {number | null | undefined} ms */
export function milliseconds(ms) {
  return fixed(ms, Number.isFinite(ms) && Number(ms) >= 100 ? 0 : 1);
}

/**
 * @param {number} x
 * @param {number} y
 */
export const position = (x, y) => `${fixed(x, 2)}, ${fixed(y, 2)} m`;

/** @param {number} seconds */
export function duration(seconds) {
  if (seconds < 100) return `${Math.floor(seconds)} s`;
  if (seconds < 6000) return `${Math.floor(seconds / 60)} min`;
  if (seconds < 48 * 3600) return `${Math.floor(seconds / 3600)} h`;
  return `${Math.floor(seconds / 86400)} days`;
}

/** @param {number} count */
export const integer = (count) => count.toLocaleString("en").replace(/,/g, "\u202f");

/**
 * @param {number} count
 * @param {string} noun
 */
export const plural = (count, noun) => `${integer(count)} ${noun}${count === 1 ? "" : "s"}`;
