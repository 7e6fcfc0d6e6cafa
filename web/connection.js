import { getGeometry, getReconstruction, getStatus, liveUrl } from "./api.js";
import { Arrivals } from "./arrivals.js";
import { DaemonClock } from "./health/clock.js";
import { LiveSocket } from "./live.js";
import { nowS } from "./now.js";

/** @import { Evidence } from "./freshness.js" */
/** @import { Phase } from "./live.js" */
/** @import { Crossings, Geometry, Status, Update, Zone } from "./types.js" */

const STATUS_PERIOD_MS = 2000;
// A single failed poll may be chance.
const LOST_AFTER_FAILED_POLLS = 2;

/**
 * Whom the connection tells of changes.
 * @typedef {object} Listeners
 * @property {(phase: Phase) => void} onPhase
 * @property {(update: Update, fresh: boolean) => void} onArrival  every update as it arrives; one that is not fresh may be old
 * @property {(update: Update) => void} onUpdate  an update to show: its geometry is known
 * @property {(status: Status) => void} onStatus
 * @property {(geometry: Geometry | null) => void} onGeometry  it replaces the one before, and no earlier update fits it; null: the camera is not calibrated
 * @property {(zones: Zone[], revision: number) => void} onZones  the geometry is the same, with other zones
 * @property {() => void} onRecalibrated  the calibration has changed while the connection was open; onGeometry comes before
 */

/** The connection to the daemon: whether there is one, what the daemon last sent, and how old that is. */
export class Connection {
  #listeners;
  #socket;
  #everConnected = false;
  /** Counts connections, so that a late answer to an earlier one is recognised and dropped. */
  #count = 0;
  #polling = false;
  #failedPolls = 0;
  #statusAtS = 0;
  /** @type {Geometry | null} null: not known yet, or the camera is not calibrated */
  #geometry = null;
  #fetchingGeometry = false;
  /** An update that arrived before the geometry of its calibration. @type {{ update: Update, atS: number } | null} */
  #early = null;

  /** @param {Listeners} listeners */
  constructor(listeners) {
    this.#listeners = listeners;
    this.#socket = new LiveSocket(liveUrl(), {
      onPhase: (phase) => this.#enter(phase),
      onMessage: (text) => this.#receive(text),
    });
    this.arrivals = new Arrivals();
    this.clock = new DaemonClock();
    /** Whether the geometry has been received since this connection opened. Until then its updates have no place on the map. */
    this.ready = false;
    /** @type {Update | null} */
    this.newest = null;
    this.newestAtS = 0;
    /** @type {Status | null} */
    this.status = null;
    /** @type {Crossings | null} */
    this.crossings = null;
  }

  get open() {
    return this.#socket.phase === "open";
  }

  start() {
    window.addEventListener("online", () => this.hurry());
    document.addEventListener("visibilitychange", () => {
      if (!document.hidden) this.hurry();
    });
    setInterval(() => void this.poll(), STATUS_PERIOD_MS);
    this.#socket.connect();
  }

  /** If there is no connection, try now instead of after the delay. */
  hurry() {
    this.#socket.hurry();
  }

  drop() {
    this.#socket.drop();
  }

  /** Ask for the status now, between the regular polls. */
  async poll() {
    const which = this.#count;
    if (this.#polling || !this.open || !this.ready) return;
    this.#polling = true;
    try {
      const status = await this.#fetchStatus();
      if (which === this.#count) this.#takeStatus(status);
    } catch {
      // A socket can seem open long after the other side is gone. Failed polls reveal it sooner.
      this.#failedPolls += 1;
      if (which === this.#count && this.open && this.#failedPolls >= LOST_AFTER_FAILED_POLLS) this.drop();
    } finally {
      this.#polling = false;
    }
  }

  /**
   * What there is to know when judging whether the picture is live.
   * @param {number} atS
   * @returns {Omit<Evidence, "paused">}
   */
  evidence(atS) {
    const { newest, status } = this;
    return {
      phase: this.#socket.phase,
      everConnected: this.#everConnected,
      retryInS: this.#socket.retryInS(),
      ageS: newest ? atS - this.newestAtS : null,
      watch: newest?.state ?? null,
      status,
      statusAgeS: atS - this.#statusAtS,
    };
  }

  /** @param {Phase} phase */
  #enter(phase) {
    if (phase === "open") {
      this.#everConnected = true;
      this.#count += 1;
      this.ready = false;
      this.arrivals.reconnected();
      this.clock.forget();
      void this.#begin();
    }
    this.#listeners.onPhase(phase);
  }

  /** Ask for everything anew: the daemon may have been restarted with another door or source. */
  async #begin() {
    const which = this.#count;
    try {
      const status = await this.#fetchStatus();
      // Without a calibration there is no geometry to ask for, and the map stays empty.
      const geometry = status.calibrated === false ? null : await getGeometry();
      if (which !== this.#count || !this.open) return;
      // An update that has arrived on this connection belongs to the new geometry; an earlier one does not.
      const arrived = this.arrivals.sequence === null ? null : this.newest;
      this.ready = true;
      this.#early = null;
      this.#takeGeometry(geometry);
      // The status comes first: it corrects the age of the update that has arrived.
      this.#takeStatus(status);
      this.newest = null;
      this.#socket.settled();
      if (arrived) this.#take(arrived, this.newestAtS);
      else if (status.last_update) await this.#fetchLast(status.last_update.age_s);
    } catch {
      if (which === this.#count) this.drop();
    }
  }

  /**
   * A recording that has ended sends nothing any more, yet its last picture is worth showing.
   * @param {number} ageS
   */
  async #fetchLast(ageS) {
    const which = this.#count;
    const last = await getReconstruction();
    if (which === this.#count && !this.newest) this.#take(last, nowS() - ageS);
  }

  /** @param {string} text */
  #receive(text) {
    /** @type {Update} */
    let update;
    try {
      update = JSON.parse(text);
    } catch {
      return; // If no valid update follows, the picture grows stale, and the page says so.
    }
    const atS = nowS();
    // On opening, the daemon sends its newest update, however old that is.
    const fresh = this.arrivals.sequence !== null;
    this.arrivals.record(update.sequence, atS);
    this.crossings = update.crossings ?? this.crossings;
    this.#listeners.onArrival(update, fresh);
    this.#take(update, atS);
  }

  /**
   * @param {Update} update
   * @param {number} atS
   */
  #take(update, atS) {
    const geometry = this.#geometry;
    if (this.ready && update.calibration !== geometry?.calibration) {
      this.#early = { update, atS };
      if (!geometry || update.calibration > geometry.calibration) void this.#renewGeometry();
      return;
    }
    this.newest = update;
    this.newestAtS = atS;
    if (this.ready) this.#listeners.onUpdate(update);
  }

  async #fetchStatus() {
    const askedMs = Date.now();
    const status = await getStatus();
    this.clock.learn(status.time, askedMs, Date.now());
    return status;
  }

  /** @param {Status} status */
  #takeStatus(status) {
    this.status = status;
    this.#statusAtS = nowS();
    this.#failedPolls = 0;
    this.crossings = status.crossings ?? null;
    // The first update of a connection may have been old when it arrived. Only the daemon knows its age.
    const last = status.last_update;
    if (last && last.sequence === this.newest?.sequence) this.newestAtS = Math.min(this.newestAtS, this.#statusAtS - last.age_s);
    const geometry = this.#geometry;
    const same = status.calibration_revision === geometry?.calibration && status.zones_revision === geometry.zones_revision;
    if (status.calibrated !== false && !same) void this.#renewGeometry();
    this.#listeners.onStatus(status);
  }

  /** @param {Geometry | null} geometry */
  #takeGeometry(geometry) {
    this.#geometry = geometry;
    this.#listeners.onGeometry(geometry);
  }

  /** The calibration has changed, and with it where everything in the picture lies in the room. Or only the zones have changed. */
  async #renewGeometry() {
    if (this.#fetchingGeometry) return;
    this.#fetchingGeometry = true;
    const which = this.#count;
    try {
      const geometry = await getGeometry();
      if (which !== this.#count) return;
      if (geometry.calibration === this.#geometry?.calibration) return this.#takeZones(geometry);
      this.newest = null;
      this.#takeGeometry(geometry);
      const early = this.#early;
      if (early?.update.calibration === geometry.calibration) this.#take(early.update, early.atS);
      this.#early = null;
      this.#listeners.onRecalibrated();
    } catch {
      // The next update or status asks again.
    } finally {
      this.#fetchingGeometry = false;
    }
  }

  /** @param {Geometry} geometry  the known one, with other zones */
  #takeZones(geometry) {
    const { zones = [], zones_revision = 0 } = geometry;
    this.#geometry = { ...geometry, zones, zones_revision };
    this.#listeners.onZones(zones, zones_revision);
  }
}
