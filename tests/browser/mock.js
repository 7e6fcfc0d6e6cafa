// The daemon's contract without the daemon: web/ from disk, scripted answers and updates.

import { readFile } from "node:fs/promises";
import { STATUS_CODES, createServer } from "node:http";
import { extname, join, normalize } from "node:path";
import { fileURLToPath } from "node:url";
import { WebSocketServer } from "ws";
import { check } from "./fit.js";
import { SIZE, cameraPicture } from "./camera.js";
import { png } from "./png.js";
import * as scene from "./scene.js";

/** @import { IncomingMessage, ServerResponse } from "node:http" */
/** @import { AddressInfo } from "node:net" */
/** @import { Calibration, CalibrationDocument, EventPage, OccupancySpan, RecordingStatus, RecordingWish, RoomEvent, Session, SignalReport, Uncertainty, Update, Zone, ZonesDocument } from "../../web/types.js" */

const WEB = fileURLToPath(new URL("../../web/", import.meta.url));
const API = "/api/v1/";

/** @type {Record<string, string>} */
const TYPES = {
  ".html": "text/html; charset=utf-8",
  ".css": "text/css; charset=utf-8",
  ".js": "text/javascript; charset=utf-8",
  ".svg": "image/svg+xml",
};

/** The daemon's calibration and what was asked of it. */
class MockCalibration {
  constructor() {
    /** @type {Calibration | null} */
    this.inUse = null;
    /** @type {Calibration | null} */
    this.before = null;
    this.editable = true;
    /** @type {string | null} */
    this.reason = null;
    /** @type {[number, number] | null} */
    this.size = SIZE;
    /** @type {Calibration[]} Bodies that were to be checked. */
    this.checked = [];
    /** How long a check takes, and how many were under way at once. */
    this.delayMs = 0;
    this.underWay = 0;
    this.mostUnderWay = 0;
    /** @type {Calibration[]} Bodies that were to be saved. */
    this.put = [];
  }

  /** @param {Calibration} asked */
  async check(asked) {
    this.checked.push(asked);
    this.underWay += 1;
    this.mostUnderWay = Math.max(this.mostUnderWay, this.underWay);
    await new Promise((done) => setTimeout(done, this.delayMs));
    this.underWay -= 1;
    return check(asked);
  }

  /** @returns {CalibrationDocument} */
  document() {
    const { editable, reason, size, inUse, before } = this;
    return { editable, reason, size, calibration: inUse, check: inUse && check(inUse), previous: before !== null };
  }
}

export class Mock {
  constructor() {
    this.geometry = scene.geometry();
    this.status = scene.status();
    this.hasPictures = true;
    /** @type {Update | null} */
    this.latest = null;
    this.latestAt = 0;
    /** @type {Uncertainty | null} */
    this.uncertainty = null;
    /** @type {Omit<SignalReport, "sequence">} */
    this.signal = {
      left: { snr_db: 3.2, change: 0.0118, noise: 0.0082 },
      right: { snr_db: null, change: 0, noise: 0.0079 },
    };
    this.calibration = new MockCalibration();
    /** @type {Session} */
    this.session = { scope: "control", token_needed: false, exposed: false, images: true, expires_s: null, refusal: null };
    /** @type {Buffer | null} */
    this.frame = cameraPicture();
    /** @type {string | null} When the camera took its last picture, if it has stopped. */
    this.stoppedAt = null;
    /** How far its clock is ahead of this computer's. */
    this.clockAheadMs = 0;
    /** @type {RecordingWish[]} What was to be recorded. */
    this.recorded = [];
    /** @type {ZonesDocument["origin"]} */
    this.zonesFrom = "config";
    /** @type {Zone[][]} Zones that were to be saved. */
    this.drawn = [];
    /** @type {unknown[]} How many people were to be inside. */
    this.insides = [];
    /** @type {RoomEvent[]} */
    this.events = [];
    /** @type {OccupancySpan[]} */
    this.spans = [];
    /** @type {object | null} Its OpenAPI document. */
    this.description = null;
    this.resets = 0;
    /** @type {string | null} Why the next change is refused. */
    this.refusal = null;
    this.port = 0;
    /** @type {string[]} */
    this.requests = [];
  }

  get url() {
    return `http://127.0.0.1:${this.port}/`;
  }

  /** Starting again after `stop` takes the same port. */
  async start() {
    this.server = createServer((request, response) => void this.#answer(request, response));
    this.sockets = new WebSocketServer({ server: this.server, path: `${API}live` });
    this.sockets.on("connection", (socket) => {
      if (this.latest) socket.send(JSON.stringify(this.latest));
    });
    const { server } = this;
    await new Promise((done) => server.listen(this.port, "127.0.0.1", () => done(null)));
    this.port = /** @type {AddressInfo} */ (server.address()).port;
    return this;
  }

  /** As the daemon does on shutdown: open sockets are told, then everything ends. */
  async stop() {
    const { server, sockets } = this;
    if (!server || !sockets) return;
    for (const socket of sockets.clients) socket.close(1001, "shutting down");
    await new Promise((done) => {
      server.close(done);
      server.closeAllConnections();
      setTimeout(() => sockets.clients.forEach((socket) => socket.terminate()), 50);
    });
  }

  /** @param {Update} update */
  send(update) {
    this.latest = update;
    this.latestAt = Date.now();
    for (const socket of this.sockets?.clients ?? []) socket.send(JSON.stringify(update));
  }

  /**
   * @param {IncomingMessage} request
   * @param {ServerResponse} response
   */
  async #answer(request, response) {
    const { pathname, searchParams } = new URL(request.url ?? "/", this.url);
    this.requests.push(pathname);
    // The strictest policy the daemon may set: the page must work under it.
    response.setHeader("content-security-policy", "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'");
    response.setHeader("x-content-type-options", "nosniff");
    const name = pathname.slice(API.length);
    if (!pathname.startsWith(API)) return this.#answerAsset(pathname, response);
    if (request.method === "GET") return this.#answerApi(name, searchParams, response);
    this.#change(`${request.method} ${name}`, await bodyOf(request), response);
  }

  /**
   * @param {string} name
   * @param {URLSearchParams} wanted
   * @param {ServerResponse} response
   */
  #answerApi(name, wanted, response) {
    const age_s = (Date.now() - this.latestAt) / 1000;
    const last_update = this.latest && { sequence: this.latest.sequence, age_s };
    if (name === "geometry" && this.status.calibrated) return json(response, this.geometry);
    if (name === "uncertainty" && this.uncertainty) return json(response, this.uncertainty);
    if (name === "status") return json(response, { ...this.status, time: new Date(Date.now() + this.clockAheadMs).toISOString(), last_update });
    if (name === "signal") return json(response, { sequence: this.latest?.sequence ?? null, ...this.signal });
    if (name === "patches.png" && this.latest) {
      response.setHeader("content-type", "image/png");
      return response.end(patchesPicture());
    }
    if (name === "reconstruction" && this.latest) return json(response, this.latest);
    if (name === "difference.png" && this.latest && this.hasPictures) {
      response.setHeader("content-type", "image/png");
      return response.end(differencePicture(this.latest.sequence));
    }
    if (name === "openapi.json" && this.description) return json(response, this.description);
    if (name === "session") return json(response, this.session);
    if (name === "events") return json(response, this.#eventPage(wanted));
    if (name === "occupancy") {
      const zone = wanted.get("zone");
      const spans = this.spans.filter((span) => span.zone === zone && inTime(span.to, wanted) && span.from < (wanted.get("to") ?? ""));
      return json(response, { spans, next: null });
    }
    if (name === "zones") return json(response, this.#zones());
    if (name === "crossings") return json(response, this.status.crossings);
    if (name === "calibration") return json(response, this.calibration.document());
    if (name === "frame.jpg" && this.frame) {
      response.setHeader("content-type", "image/png");
      response.setHeader("x-captured", this.stoppedAt ?? new Date().toISOString());
      return response.end(this.frame);
    }
    if (name === "calibration/reference.jpg" && this.frame) {
      response.setHeader("content-type", "image/png");
      return response.end(this.frame);
    }
    return problem(response);
  }

  /**
   * @param {string} what
   * @param {string} body
   * @param {ServerResponse} response
   */
  #change(what, body, response) {
    const { calibration } = this;
    if (what === "POST calibration/check") {
      return void this.calibration.check(JSON.parse(body)).then((checked) => json(response, checked));
    }
    if (this.refusal) return problem(response, 422, this.refusal);
    if (what === "PUT calibration") {
      calibration.put.push(JSON.parse(body));
      return this.#calibrate(JSON.parse(body), response);
    }
    if (what === "POST calibration/previous" && calibration.before) return this.#calibrate(calibration.before, response);
    if (what === "PUT zones") {
      this.drawn.push(JSON.parse(body).zones);
      return this.#useZones(JSON.parse(body).zones, "saved", response);
    }
    if (what === "PUT crossings") {
      const { inside } = JSON.parse(body);
      this.insides.push(inside);
      this.status.crossings = { ...scene.crossings(), ...this.status.crossings, inside };
      return json(response, this.status.crossings);
    }
    if (what === "DELETE zones") return this.#useZones([], "config", response);
    if (what === "POST recording") {
      this.recorded.push(JSON.parse(body || "{}"));
      /** @type {RecordingStatus} */
      const begun = {
        directory: "/var/lib/doorcam/recordings/evening", state: "recording", frames: 0, seconds: 0, bytes: 1200,
        skipped: 0, lost: 0, overflowed: 0, ended: null, error: null,
      };
      return this.#record(begun, response);
    }
    if (what === "DELETE recording" && this.status.recording) {
      return this.#record({ ...this.status.recording, state: "complete", ended: "stopped" }, response);
    }
    if (what === "POST background/reset") {
      this.resets += 1;
      response.writeHead(202);
      return response.end();
    }
    return problem(response);
  }

  /**
   * @param {URLSearchParams} wanted
   * @returns {EventPage}
   */
  #eventPage(wanted) {
    const { events } = this;
    const after = Number(wanted.get("after") ?? -1);
    const limit = Number(wanted.get("limit") ?? 100);
    const found = events.filter(({ sequence, time }) => sequence > after && inTime(time, wanted) && time < (wanted.get("to") ?? "Z"));
    const paged = wanted.has("after") || wanted.has("from");
    const page = paged ? found.slice(0, limit) : found.slice(-limit);
    const next = paged && found.length > limit ? page[page.length - 1].sequence : null;
    return { events: page, oldest: events[0]?.sequence ?? null, newest: events.at(-1)?.sequence ?? null, next };
  }

  /** @returns {ZonesDocument} */
  #zones() {
    const zones = (this.geometry.zones ?? []).map((zone) => ({ ...zone, people: 0, tracks: [] }));
    return { origin: this.zonesFrom, zones };
  }

  /**
   * @param {Zone[]} zones
   * @param {ZonesDocument["origin"]} origin
   * @param {ServerResponse} response
   */
  #useZones(zones, origin, response) {
    this.zonesFrom = origin;
    this.status.zones_revision += 1;
    this.geometry = { ...this.geometry, zones, zones_revision: this.status.zones_revision };
    json(response, this.#zones());
  }

  /**
   * @param {RecordingStatus} recording
   * @param {ServerResponse} response
   */
  #record(recording, response) {
    this.status.recording = recording;
    json(response, { possible: recording.state !== "recording", reason: null, recording });
  }

  /**
   * @param {Calibration} next
   * @param {ServerResponse} response
   */
  #calibrate(next, response) {
    const { calibration, status } = this;
    calibration.before = calibration.inUse;
    calibration.inUse = next;
    status.calibrated = true;
    status.calibration_revision += 1;
    this.geometry = { ...this.geometry, doorway: next.doorway, calibration: status.calibration_revision };
    json(response, calibration.document());
  }

  /**
   * @param {string} pathname
   * @param {ServerResponse} response
   */
  async #answerAsset(pathname, response) {
    const path = normalize(join(WEB, pathname.endsWith("/") ? `${pathname}index.html` : pathname));
    try {
      if (!path.startsWith(WEB)) throw new Error("outside web/");
      const body = await readFile(path);
      response.setHeader("content-type", TYPES[extname(path)] ?? "application/octet-stream");
      response.end(body);
    } catch {
      problem(response);
    }
  }
}

/**
 * @param {ServerResponse} response
 * @param {unknown} value
 */
function json(response, value) {
  response.setHeader("content-type", "application/json");
  response.end(JSON.stringify(value));
}

/**
 * @param {ServerResponse} response
 * @param {number} [status]
 * @param {string} [detail]
 */
function problem(response, status = 404, detail) {
  response.writeHead(status, { "content-type": "application/problem+json" });
  response.end(JSON.stringify({ title: STATUS_CODES[status], status, detail }));
}

/**
 * RFC 3339 in UTC orders as text.
 * @param {string} time
 * @param {URLSearchParams} wanted
 */
const inTime = (time, wanted) => time >= (wanted.get("from") ?? "");

/** @param {IncomingMessage} request */
async function bodyOf(request) {
  let body = "";
  for await (const chunk of request) body += chunk;
  return body;
}

function patchesPicture() {
  return png(132, 64, (x, y) => (x >= 64 && x < 68 ? [255, 255, 255] : [188 - y, 170 - y, 150 - (x % 64) / 2]));
}

/** @param {number} sequence */
function differencePicture(sequence) {
  const fan = (/** @type {number} */ angle, /** @type {number} */ edge) => 1 / (1 + Math.exp((edge - angle) / 0.05));
  const swing = 0.25 * Math.sin(sequence / 25);
  return png(132, 64, (x, y) => {
    if (x >= 64 && x < 68) return [10, 14, 19];
    const left = x < 64;
    const angle = Math.atan2(y + 0.5, left ? x - 31.5 : 99.5 - x);
    const red = 70 * fan(angle, left ? 1.9 + swing : 1.1 + swing);
    const blue = 70 * fan(angle, left ? 1.2 - swing : 1.8 - swing);
    return [118 + red, 118 + (red + blue) / 6, 118 + blue];
  });
}
