/** @import { RoomEvent } from "../types.js" */

/** @type {(keyof RoomEvent)[]} */
const COLUMNS = ["sequence", "kind", "time", "track", "x_m", "y_m", "zone", "through", "reason", "speed_m_s"];

/**
 * RFC 4180, with a header row.
 * @param {RoomEvent[]} events
 */
export function csvOf(events) {
  const field = (/** @type {unknown} */ value) => {
    const text = value === null || value === undefined ? "" : String(value);
    return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  const rows = [COLUMNS, ...events.map((event) => COLUMNS.map((column) => event[column]))];
  return rows.map((row) => `${row.map(field).join(",")}\r\n`).join("");
}

/**
 * Hands a file to the reader's browser.
 * @param {string} name
 * @param {string} type
 * @param {string} text
 */
export function download(name, type, text) {
  const url = URL.createObjectURL(new Blob([text], { type }));
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  // The browser has taken it over when this turn is done.
  setTimeout(() => URL.revokeObjectURL(url), 1000);
}
