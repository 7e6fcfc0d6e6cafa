import { Access } from "./access.js";
import { differenceUrl } from "./api.js";
import { CalibrationView } from "./calibration/view.js";
import { CameraView } from "./camera/view.js";
import { LayerScales } from "./colour.js";
import { Connection } from "./connection.js";
import { byId, setText } from "./dom.js";
import { UNKNOWN, amount } from "./format.js";
import { judge, watchNow } from "./freshness.js";
import { HealthCharts } from "./health/charts.js";
import { Latency } from "./health/latency.js";
import { Samples } from "./health/samples.js";
import { HistoryView } from "./history/view.js";
import { RoomMap } from "./map/map.js";
import { nowS } from "./now.js";
import { showLitFacets } from "./panels/lit-facets.js";
import { CrossingsPanel } from "./panels/crossings.js";
import { Pause } from "./panels/pause.js";
import { UpdatePicture } from "./panels/pictures.js";
import { RecordingPanel } from "./panels/recording.js";
import { ResetButton } from "./panels/reset.js";
import { showSource } from "./panels/source.js";
import { showConnection, showStatus, showUpdate, showView, showWatchState } from "./panels/status.js";
import { Tooltip } from "./panels/tooltip.js";
import { showNobody, showTracks } from "./panels/tracks.js";
import { UncertaintyLayer } from "./panels/uncertainty.js";
import { Route } from "./route.js";
import { choice, parts, remember } from "./view-settings.js";
import { turnTo } from "./views.js";
import { ZonesView } from "./zones/view.js";

/** @import { Geometry, Status, Update } from "./types.js" */
/** @import { Phase } from "./live.js" */
/** @import { View } from "./route.js" */

// People read numbers a few times a second at most; only the map follows every update.
const PANEL_PERIOD_MS = 250;
const SECOND_MS = 1000;

const connection = new Connection({
  onPhase,
  onArrival,
  onUpdate,
  onStatus,
  onGeometry,
  onZones: (zones, revision) => map.setZones(zones, revision),
  onRecalibrated: refreshPanels,
});
const access = new Access({
  onGranted: () => {
    connection.hurry();
    void connection.poll();
  },
  onLeft: () => connection.drop(),
});
const route = new Route({ onShow, mayLeave });

const map = new RoomMap(byId("map", HTMLCanvasElement), onDrawn);
const tooltip = new Tooltip(map);
const uncertainty = new UncertaintyLayer(map);
const scales = new LayerScales();
const pause = new Pause(onPause);
const difference = new UpdatePicture(byId("difference-image", HTMLImageElement), byId("difference"), differenceUrl, 1);
const reset = new ResetButton();
const recording = new RecordingPanel(() => void connection.poll());
const crossings = new CrossingsPanel(() => void connection.poll());

const samples = new Samples();
const latency = new Latency(connection.clock);
const charts = new HealthCharts();

const camera = new CameraView();
const past = new HistoryView();
const zones = new ZonesView(map, () => void connection.poll());
const calibration = new CalibrationView(onCalibrated);
/** The views that work only while they are shown, unlike the map. */
const opened = { camera, history: past, zones, calibration };

/** @param {Phase} phase */
function onPhase(phase) {
  if (phase === "open") latency.forget();
  // A refused socket does not say why. If a token is missing, this asks the reader for it.
  if (phase === "waiting") void access.refresh();
  refreshConnection();
}

/**
 * @param {Update} update
 * @param {boolean} fresh
 */
function onArrival(update, fresh) {
  latency.arrived(update, fresh);
  samples.follow(update);
}

/** @param {Update} update */
function onUpdate(update) {
  scales.follow(update.facets, nowS());
  if (!pause.held) showOnMap(update);
  refreshConnection();
}

/** @param {Status} status */
function onStatus(status) {
  showStatus(status);
  showSource(status);
  if (status.calibrated === false) route.offer("calibration");
  refreshConnection();
}

/** @param {Geometry | null} geometry */
function onGeometry(geometry) {
  // A picture held still belongs to the geometry before.
  pause.resume();
  map.setGeometry(geometry);
}

/** @param {Update | null} held */
function onPause(held) {
  if (!held && connection.newest && connection.ready) showOnMap(connection.newest);
  refreshPanels();
}

/** @param {boolean} first */
function onCalibrated(first) {
  void connection.poll();
  // After the first calibration there is a map to see.
  if (first) route.go("map");
}

/** @param {number | null} sequence */
function onDrawn(sequence) {
  if (sequence === null) delete document.documentElement.dataset.sequence;
  else document.documentElement.dataset.sequence = String(sequence);
  tooltip.refresh();
  zones.place();
  const ms = latency.drawn(sequence);
  if (ms !== null) samples.drawn(ms);
}

/** @param {View} view */
function mayLeave(view) {
  if (view === "calibration") return calibration.mayLeave();
  return view === "zones" ? zones.mayLeave() : true;
}

/**
 * @param {View} view
 * @param {View} before
 */
function onShow(view, before) {
  turnTo(view);
  // Only the map can be held still: the other views show the present.
  if (view !== "map" && view !== "zones") pause.resume();
  if (before !== "map") opened[before].close();
  if (view === "calibration") calibration.follow(connection.status, connection.open);
  if (view !== "map") opened[view].open();
  else byId(`to-${before}`).focus({ preventScroll: true });
  refreshPanels();
}

function onChoice() {
  const chosen = choice();
  map.choose(chosen, scales.of(chosen));
  refreshPanels();
}

function onSecond() {
  samples.report(connection.open ? connection.status : null);
  samples.close(nowS());
  if (route.view === "map" && !document.hidden) charts.show(samples.kept);
}

/** @param {Update} update */
function showOnMap(update) {
  map.show(update, scales.of(choice()));
}

/** @returns {boolean} whether the newest update shows the present */
function refreshConnection() {
  const { newest, status } = connection;
  const now = nowS();
  const verdict = judge({ ...connection.evidence(now), paused: pause.held !== null });
  showConnection(verdict);
  pause.follow(newest, connection.newestAtS, now);
  const calibrated = status?.calibrated !== false;
  const known = ["live", "paused", "waiting"].includes(verdict.connection);
  const watch = watchNow(connection.evidence(now)).state;
  showWatchState(known && calibrated ? watch : null);
  const connected = connection.open && status !== null;
  recording.follow(status, connected);
  reset.follow(connected && calibrated, watch);
  calibration.follow(status, connected);
  zones.follow(connected);
  return verdict.connection === "live" || verdict.connection === "paused";
}

/**
 * Why nothing can be said about the room as it is shown; null if it can.
 * @param {boolean} live
 * @param {number} now
 * @returns {string | null}
 */
function whyBlind(live, now) {
  if (pause.held) return watchNow({ ageS: 0, watch: pause.held.state, status: null, statusAgeS: 0 }).why;
  if (!connection.open) return "there is no connection";
  const { why } = watchNow(connection.evidence(now));
  return why ?? (live && connection.newest ? null : "there are no new frames");
}

function refreshPanels() {
  const live = refreshConnection();
  const { arrivals, newest, open: connected, ready, status } = connection;
  const now = nowS();
  showUpdate(newest, arrivals.rateHz(now), arrivals.missed, live ? latency.ms : null);
  camera.follow({ status, update: newest, connected, live, nowS: now });
  const daemonMs = connection.clock.at(Date.now());
  past.follow({ status, zones: map.geometry?.zones ?? [], connected, daemonMs, nowS: now });
  const mayChange = access.session?.scope === "control";
  crossings.follow({ crossings: connection.crossings, connected, mayChange, daemonMs });
  uncertainty.follow(connected && ready, newest, now);
  const shown = pause.held ?? newest;
  showNobody(whyBlind(live, now));
  showView(live ? shown?.view : undefined);
  if (!shown || !map.geometry || !ready) return;
  const chosen = choice();
  const scale = scales.of(chosen);
  setText(byId("scale"), scale > 0 ? amount(scale) : UNKNOWN);
  showLitFacets(map.geometry, shown, chosen);
  showTracks(shown.tracks, shown.zones ?? []);
  // While the background is being learned, there is nothing to compare a picture with.
  if (connected && !pause.held && shown.state !== "learning" && route.view === "map") difference.refresh(shown.sequence, now);
}

for (const id of ["layer", "signs", "brightness"]) byId(id).addEventListener("change", onChoice);
byId("uncertainty").addEventListener("change", refreshPanels);
byId("parts").addEventListener("change", () => map.setParts(parts()));
byId("lit").addEventListener("toggle", refreshPanels);
setInterval(refreshPanels, PANEL_PERIOD_MS);
setInterval(onSecond, SECOND_MS);

// For tests that look at pixels: where a floor point in metres lies, in CSS pixels of the canvas.
Object.defineProperty(window, "doorcam", {
  value: Object.freeze({ mapPoint: (/** @type {number} */ x, /** @type {number} */ y) => map.pointOf(x, y) }),
});

remember(["layer", "signs", "brightness", "uncertainty-group", "parts", "history-span"].map((id) => byId(id)));
map.setParts(parts());
onChoice();
route.start();
void access.refresh();
connection.start();
