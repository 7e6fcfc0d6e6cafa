import { Access } from "./access.js";
import { differenceUrl, getGeometry, getReconstruction, getStatus, liveUrl } from "./api.js";
import { Arrivals } from "./arrivals.js";
import { CalibrationView } from "./calibration/view.js";
import { CameraView } from "./camera/view.js";
import { LayerScales } from "./colour.js";
import { byId, setText } from "./dom.js";
import { UNKNOWN, amount } from "./format.js";
import { judge } from "./freshness.js";
import { HealthCharts } from "./health/charts.js";
import { DaemonClock } from "./health/clock.js";
import { Samples } from "./health/samples.js";
import { HistoryView } from "./history/view.js";
import { LiveSocket } from "./live.js";
import { RoomMap } from "./map/map.js";
import { showLitFacets } from "./panels/lit-facets.js";
import { Pause } from "./panels/pause.js";
import { UpdatePicture } from "./panels/pictures.js";
import { RecordingPanel } from "./panels/recording.js";
import { ResetButton } from "./panels/reset.js";
import { showSource } from "./panels/source.js";
import { showConnection, showStatus, showUpdate, showWatchState } from "./panels/status.js";
import { Tooltip } from "./panels/tooltip.js";
import { showTracks } from "./panels/tracks.js";
import { UncertaintyLayer } from "./panels/uncertainty.js";
import { Route } from "./route.js";
import { remember } from "./view-settings.js";
import { ZonesView } from "./zones/view.js";

/** @import { Choice, Parts, Status, Update } from "./types.js" */
/** @import { Phase } from "./live.js" */
/** @import { View } from "./route.js" */

const STATUS_PERIOD_MS = 2000;
// The eye needs numbers a few times a second; the map alone follows every update.
const PANEL_PERIOD_MS = 250;
const SECOND_MS = 1000;

const arrivals = new Arrivals();
const clock = new DaemonClock();
const samples = new Samples();
const charts = new HealthCharts();
const scales = new LayerScales();
const difference = new UpdatePicture(byId("difference-image", HTMLImageElement), byId("difference"), differenceUrl, 1);
const map = new RoomMap(byId("map", HTMLCanvasElement), drawn);
const tooltip = new Tooltip(map);
const pause = new Pause(held);
const reset = new ResetButton();
const recording = new RecordingPanel(() => void pollStatus());
const uncertainty = new UncertaintyLayer(map);
const camera = new CameraView();
const calibration = new CalibrationView(calibrated);
const past = new HistoryView();
const zones = new ZonesView(map, () => void pollStatus());
const route = new Route({ onShow: showView, mayLeave });
const access = new Access({
  onGranted: () => {
    live.hurry();
    void pollStatus();
  },
  onLeft: () => live.drop(),
});
const live = new LiveSocket(liveUrl(), { onPhase, onMessage });

/** @type {Update | null} */
let newest = null;
let newestAtS = 0;
/** @type {Status | null} */
let status = null;
let statusAtS = 0;
let polling = false;
let statusFailures = 0;
let isLive = false;
/** An update that has just come and is not drawn yet. @type {Update | null} */
let undrawn = null;
/** From capture to screen, of the newest update that was drawn. @type {number | null} */
let latencyMs = null;
let everConnected = false;
/** Counts connections, so that an answer to an earlier one is known and dropped. */
let connection = 0;
/** Until the geometry of this connection is here, its updates have no place on the map. */
let geometryOf = -1;
let renewing = false;
/** An update that came before the geometry of its calibration.
 * @type {{ update: Update, atS: number } | null} */
let early = null;
/** An uncalibrated camera opens the calibration by itself, but only once: its reader may leave it. */
let invited = false;

const nowS = () => performance.now() / 1000;

/** @param {Phase} phase */
function onPhase(phase) {
  if (phase === "open") {
    everConnected = true;
    connection += 1;
    arrivals.reconnected();
    clock.forget();
    latencyMs = null;
    void begin(connection);
  }
  // A socket that is refused does not say why.
  if (phase === "waiting") void access.refresh();
  refreshConnection();
}

/**
 * The daemon may have been restarted with another door or source: nothing known before holds.
 * @param {number} which
 */
async function begin(which) {
  try {
    const first = await askStatus();
    // Without a calibration there is no geometry to ask for, and the map stays empty.
    const geometry = first.calibrated === false ? null : await getGeometry();
    if (which !== connection || live.phase !== "open") return;
    // Updates that came in the meantime belong to the new geometry, the one before does not.
    const held = arrivals.sequence === null ? null : newest;
    geometryOf = which;
    early = null;
    // What is held is of another room.
    pause.resume();
    map.setGeometry(geometry);
    acceptStatus(first);
    newest = null;
    live.settled();
    if (held) accept(held, newestAtS);
    else if (first.last_update) await showLast(which, first.last_update.age_s);
  } catch {
    if (which === connection) live.drop();
  }
}

/**
 * An ended recording sends nothing any more, yet its last picture is worth showing.
 * @param {number} which
 * @param {number} ageS
 */
async function showLast(which, ageS) {
  const last = await getReconstruction();
  if (which === connection && !newest) accept(last, nowS() - ageS);
}

/** @param {string} text */
function onMessage(text) {
  /** @type {Update} */
  let update;
  try {
    update = JSON.parse(text);
  } catch {
    return; // not ours to show; staleness tells if it goes on
  }
  const now = nowS();
  // What the socket sends on opening can be old.
  undrawn = arrivals.sequence === null ? null : update;
  arrivals.record(update.sequence, now);
  samples.follow(update);
  accept(update, now);
}

/**
 * @param {Update} update
 * @param {number} atS
 */
function accept(update, atS) {
  if (geometryOf === connection && update.calibration !== map.geometry?.calibration) {
    early = { update, atS };
    if (!map.geometry || update.calibration > map.geometry.calibration) void renewGeometry();
    return;
  }
  newest = update;
  newestAtS = atS;
  if (geometryOf !== connection) return;
  scales.follow(update.facets, nowS());
  if (!pause.held) map.show(update, scales.of(choice()));
  refreshConnection();
}

async function askStatus() {
  const askedMs = Date.now();
  const fresh = await getStatus();
  clock.learn(fresh.time, askedMs, Date.now());
  return fresh;
}

/** @param {Update | null} held */
function held(held) {
  if (!held && newest && geometryOf === connection) map.show(newest, scales.of(choice()));
  refreshPanels();
}

/** @param {Status} fresh */
function acceptStatus(fresh) {
  status = fresh;
  statusAtS = nowS();
  statusFailures = 0;
  // What the socket sends on opening can be old: only the daemon knows its age.
  const last = fresh.last_update;
  if (last && last.sequence === newest?.sequence) newestAtS = Math.min(newestAtS, statusAtS - last.age_s);
  showStatus(fresh);
  showSource(fresh);
  if (fresh.calibrated === false) invite();
  else if (fresh.calibration_revision !== map.geometry?.calibration || fresh.zones_revision !== map.geometry.zones_revision) void renewGeometry();
  refreshConnection();
}

/** The camera has been calibrated anew: every place in the picture means another one in the room. Or there are other zones. */
async function renewGeometry() {
  if (renewing) return;
  renewing = true;
  const which = connection;
  try {
    const geometry = await getGeometry();
    if (which !== connection) return;
    if (geometry.calibration === map.geometry?.calibration) return map.setZones(geometry.zones ?? [], geometry.zones_revision ?? 0);
    newest = null;
    pause.resume();
    map.setGeometry(geometry);
    if (early && early.update.calibration === geometry.calibration) accept(early.update, early.atS);
    early = null;
    refreshPanels();
  } catch {
    // The next update or status asks again.
  } finally {
    renewing = false;
  }
}

function invite() {
  if (invited) return;
  invited = true;
  route.go("calibration");
}

/** @param {boolean} first */
function calibrated(first) {
  void pollStatus();
  // That was the way to the first map: here it is.
  if (first) route.go("map");
}

/** @param {View} view */
function mayLeave(view) {
  if (view === "calibration") return calibration.mayLeave();
  return view === "zones" ? zones.mayLeave() : true;
}

/** @type {Record<View, string>} */
const TITLES = { map: "doorcam", camera: "Camera – doorcam", history: "History – doorcam", zones: "Zones – doorcam", calibration: "Calibration – doorcam" };

/**
 * @param {View} view
 * @param {View} before
 */
function showView(view, before) {
  for (const each of /** @type {View[]} */ (Object.keys(TITLES))) {
    // Zones are drawn on the live map.
    if (each !== "zones") byId(`${each}-view`).hidden = each !== (view === "zones" ? "map" : view);
    if (each === view) byId(`to-${each}`).setAttribute("aria-current", "page");
    else byId(`to-${each}`).removeAttribute("aria-current");
  }
  document.title = TITLES[view];
  window.scrollTo(0, 0);
  // Only the map is held: elsewhere things go on.
  if (view !== "map" && view !== "zones") pause.resume();
  if (before === "calibration") calibration.close();
  if (before === "camera") camera.close();
  if (before === "history") past.close();
  if (before === "zones") zones.close();
  if (view === "calibration") {
    calibration.follow(status, live.phase === "open");
    calibration.open();
  }
  if (view === "camera") camera.open();
  if (view === "history") past.open();
  if (view === "zones") zones.open();
  if (view === "map") byId(`to-${before}`).focus({ preventScroll: true });
  refreshPanels();
}

async function pollStatus() {
  const which = connection;
  if (polling || live.phase !== "open" || geometryOf !== which) return;
  polling = true;
  try {
    const fresh = await askStatus();
    if (which === connection) acceptStatus(fresh);
  } catch {
    // A socket can stay "open" for long after the other side is gone; two silences settle it.
    statusFailures += 1;
    if (which === connection && live.phase === "open" && statusFailures >= 2) live.drop();
  } finally {
    polling = false;
  }
}

/** @returns {Choice} */
function choice() {
  const value = (/** @type {string} */ name) =>
    document.querySelector(`input[name="${name}"]:checked`)?.getAttribute("value");
  return /** @type {Choice} */ ({ layer: value("layer"), signs: value("signs"), brightness: value("brightness") });
}

/** @returns {Parts} */
function parts() {
  const shown = [...byId("parts").querySelectorAll("input")].map((input) => [input.id.replace("part-", ""), input.checked]);
  return /** @type {Parts} */ (Object.fromEntries(shown));
}

function choose() {
  const chosen = choice();
  map.choose(chosen, scales.of(chosen));
  refreshPanels();
}

/** @param {number | null} sequence */
function drawn(sequence) {
  if (sequence === null) delete document.documentElement.dataset.sequence;
  else document.documentElement.dataset.sequence = String(sequence);
  tooltip.refresh();
  zones.place();
  if (sequence === null || undrawn?.sequence !== sequence) return;
  latencyMs = clock.sinceMs(undrawn.time, Date.now());
  undrawn = null;
  if (latencyMs !== null) samples.drawn(latencyMs);
}

function secondIsOver() {
  samples.report(live.phase === "open" ? status : null);
  samples.close(nowS());
  if (route.view === "map" && !document.hidden) charts.show(samples.kept);
}

function refreshConnection() {
  const now = nowS();
  const verdict = judge({
    phase: live.phase,
    everConnected,
    retryInS: live.retryInS(),
    ageS: newest ? now - newestAtS : null,
    watch: newest?.state ?? null,
    status,
    statusAgeS: now - statusAtS,
    paused: pause.held !== null,
  });
  showConnection(verdict);
  isLive = verdict.connection === "live" || verdict.connection === "paused";
  pause.follow(newest, newestAtS, now);
  const known = ["live", "paused", "waiting"].includes(verdict.connection);
  const watch = newest?.state ?? status?.state ?? null;
  showWatchState(known && status?.calibrated !== false ? watch : null);
  const connected = live.phase === "open" && status !== null;
  recording.follow(status, connected);
  reset.follow(connected && status?.calibrated !== false, watch);
  calibration.follow(status, connected);
  zones.follow(connected);
}

function refreshPanels() {
  refreshConnection();
  const now = nowS();
  showUpdate(newest, arrivals.rateHz(now), arrivals.missed, isLive ? latencyMs : null);
  camera.follow({ status, update: newest, connected: live.phase === "open", live: isLive, nowS: now });
  past.follow({ status, zones: map.geometry?.zones ?? [], connected: live.phase === "open", daemonMs: clock.at(Date.now()), nowS: now });
  uncertainty.follow(live.phase === "open" && geometryOf === connection, newest, now);
  const shown = pause.held ?? newest;
  if (!shown || !map.geometry || geometryOf !== connection) return;
  const chosen = choice();
  const scale = scales.of(chosen);
  setText(byId("scale"), scale > 0 ? amount(scale) : UNKNOWN);
  showLitFacets(map.geometry, shown, chosen);
  showTracks(shown.tracks, shown.zones ?? []);
  // While the empty room is learned there is nothing that it differs from.
  if (live.phase === "open" && !pause.held && shown.state !== "learning" && route.view === "map") difference.refresh(shown.sequence, now);
}

byId("layer").addEventListener("change", choose);
byId("signs").addEventListener("change", choose);
byId("brightness").addEventListener("change", choose);
byId("uncertainty").addEventListener("change", refreshPanels);
byId("parts").addEventListener("change", () => map.setParts(parts()));
byId("lit").addEventListener("toggle", refreshPanels);
window.addEventListener("online", () => live.hurry());
document.addEventListener("visibilitychange", () => {
  if (!document.hidden) live.hurry();
});
setInterval(pollStatus, STATUS_PERIOD_MS);
setInterval(refreshPanels, PANEL_PERIOD_MS);
setInterval(secondIsOver, SECOND_MS);

// For tests that look at pixels: where a floor point in metres lies, in CSS pixels of the canvas.
Object.defineProperty(window, "doorcam", {
  value: Object.freeze({ mapPoint: (/** @type {number} */ x, /** @type {number} */ y) => map.pointOf(x, y) }),
});

remember(["layer", "signs", "brightness", "uncertainty-group", "parts", "history-span"].map((id) => byId(id)));
map.setParts(parts());
choose();
route.start();
void access.refresh();
live.connect();
