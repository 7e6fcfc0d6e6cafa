/** @import { Geometry, Status, Update } from "./types.js" */

// Relative to the page, so that doorcam also works under a path of a reverse proxy.
const BASE = new URL("api/v1/", document.baseURI);

// An answer that does not come is worth as much as a refused connection.
const TIMEOUT_MS = 5000;

/** @param {string} name */
async function getJson(name) {
  const response = await fetch(new URL(name, BASE), {
    cache: "no-store",
    signal: AbortSignal.timeout(TIMEOUT_MS),
  });
  if (!response.ok) throw new Error(`${name}: HTTP ${response.status}`);
  return response.json();
}

/** @returns {Promise<Geometry>} */
export const getGeometry = () => getJson("geometry");

/** @returns {Promise<Status>} */
export const getStatus = () => getJson("status");

/** @returns {Promise<Update>} */
export const getReconstruction = () => getJson("reconstruction");

/** @param {number} sequence  keeps the browser from showing a cached picture */
export const differenceUrl = (sequence) => new URL(`difference.png?sequence=${sequence}`, BASE).href;

export function liveUrl() {
  const url = new URL("live", BASE);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  return url.href;
}
