/** @import { Calibration, CalibrationDocument, Check, Crossings, EventPage, Geometry, OccupancyPage, RecordingReport, RecordingWish, Session, SignalReport, Status, Uncertainty, Update, Zone, ZonesDocument } from "./types.js" */

// Relative to the page, so that doorcam also works under a path of a reverse proxy.
const BASE = new URL("api/v1/", document.baseURI);

// An answer that does not come is worth as much as a refused connection.
const TIMEOUT_MS = 5000;
// A new calibration has the daemon work its whole model out anew, on whatever computer it is.
const CHANGE_TIMEOUT_MS = 30000;

/** The daemon has answered, and the answer is no: in its own words. */
export class Refusal extends Error {
  /**
   * @param {number} status
   * @param {string} detail
   */
  constructor(status, detail) {
    super(detail);
    this.status = status;
  }
}

/** @type {(change: boolean) => void} */
let refused = () => {};

/**
 * Who to tell that a token is missing, or that the one there is lets nobody change anything.
 * @param {(change: boolean) => void} listener
 */
export function onRefused(listener) {
  refused = listener;
}

/**
 * @param {string} name
 * @param {RequestInit} [options]
 */
async function ask(name, options) {
  const response = await fetch(new URL(name, BASE), {
    cache: "no-store",
    signal: AbortSignal.timeout(TIMEOUT_MS),
    ...options,
  });
  const change = options?.method !== undefined && response.status === 403;
  if (name !== "session" && (change || response.status === 401)) refused(change);
  if (!response.ok) throw new Refusal(response.status, await detailOf(response, name));
  return response;
}

/**
 * @param {Response} response
 * @param {string} name
 * @returns {Promise<string>}
 */
async function detailOf(response, name) {
  try {
    const problem = await response.json();
    if (problem.detail || problem.title) return problem.detail || problem.title;
  } catch {
    // Something between the page and the daemon has answered in its stead.
  }
  return `${name}: HTTP ${response.status}`;
}

/** @param {string} name */
const getJson = async (name) => (await ask(name)).json();

/**
 * @param {string} name
 * @param {RequestInit} options
 */
const change = async (name, options) =>
  (await ask(name, { signal: AbortSignal.timeout(CHANGE_TIMEOUT_MS), ...options })).json();

/** @param {unknown} value */
const json = (value) => ({ headers: { "content-type": "application/json" }, body: JSON.stringify(value) });

/** @returns {Promise<Geometry>} */
export const getGeometry = () => getJson("geometry");

/** @returns {Promise<Status>} */
export const getStatus = () => getJson("status");

/** @returns {Promise<Update>} */
export const getReconstruction = () => getJson("reconstruction");

/** @returns {Promise<Session>}  with the reason if doorcam takes this very page for another site's */
export const getSession = () => getJson(`session?${query({ origin: location.origin })}`);

/**
 * @param {string} token
 * @returns {Promise<Session>}
 */
export const logIn = (token) => change("session", { method: "POST", ...json({ token }) });

export const logOut = () => ask("session", { method: "DELETE" });

/** @returns {Promise<Uncertainty>} */
export const getUncertainty = () => getJson("uncertainty");

/** @returns {Promise<SignalReport>} */
export const getSignal = () => getJson("signal");

/** @returns {Promise<CalibrationDocument>} */
export const getCalibration = () => getJson("calibration");

/**
 * What a calibration would mean; changes nothing.
 * @param {Calibration} calibration
 * @returns {Promise<Check>}
 */
export const checkCalibration = async (calibration) =>
  (await ask("calibration/check", { method: "POST", ...json(calibration) })).json();

/**
 * @param {Calibration} calibration
 * @returns {Promise<CalibrationDocument>}
 */
export const putCalibration = (calibration) => change("calibration", { method: "PUT", ...json(calibration) });

/** @returns {Promise<CalibrationDocument>} */
export const restorePrevious = () => change("calibration/previous", { method: "POST" });

/** Have the still room learned anew. */
export async function resetBackground() {
  await ask("background/reset", { method: "POST" });
}

/**
 * @param {Record<string, string | number>} wanted
 * @returns {Promise<EventPage>}
 */
export const getEvents = (wanted) => getJson(`events?${query(wanted)}`);

/**
 * @param {Record<string, string | number>} wanted
 * @returns {Promise<OccupancyPage>}
 */
export const getOccupancy = (wanted) => getJson(`occupancy?${query(wanted)}`);

/** @param {Record<string, string | number>} wanted */
const query = (wanted) => new URLSearchParams(Object.entries(wanted).map(([key, value]) => [key, String(value)]));

/** @returns {Promise<ZonesDocument>} */
export const getZones = () => getJson("zones");

/**
 * @param {Zone[]} zones
 * @returns {Promise<ZonesDocument>}
 */
export const putZones = (zones) => change("zones", { method: "PUT", ...json({ zones }) });

/** @returns {Promise<ZonesDocument>} back to those of the configuration */
export const forgetZones = () => change("zones", { method: "DELETE" });

/**
 * @param {number} inside  how many people are, as somebody knows who looked
 * @returns {Promise<Crossings>}
 */
export const putInside = (inside) => change("crossings", { method: "PUT", ...json({ inside }) });

/**
 * @param {RecordingWish} wish
 * @returns {Promise<RecordingReport>}
 */
export const startRecording = (wish) => change("recording", { method: "POST", ...json(wish) });

/** @returns {Promise<RecordingReport>} when all of it is on the disk */
export const stopRecording = () => change("recording", { method: "DELETE" });

/** The camera's newest picture, and when it was taken: the same one may come again. */
export async function getFrame() {
  const response = await ask("frame.jpg");
  return { captured: response.headers.get("x-captured"), picture: await response.blob() };
}

/** @param {number} sequence  keeps the browser from showing a cached picture */
export const differenceUrl = (sequence) => new URL(`difference.png?sequence=${sequence}`, BASE).href;

/** @param {number} sequence */
export const patchesUrl = (sequence) => new URL(`patches.png?sequence=${sequence}`, BASE).href;

/** @param {string} since  keeps the browser from showing a cached picture */
export const referenceUrl = (since) =>
  new URL(`calibration/reference.jpg?since=${encodeURIComponent(since)}`, BASE).href;

export function liveUrl() {
  const url = new URL("live", BASE);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  return url.href;
}
