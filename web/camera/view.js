import { Refusal, differenceUrl, getCalibration, patchesUrl } from "../api.js";
import { byId, setText } from "../dom.js";
import { duration } from "../format.js";
import { UpdatePicture } from "../panels/pictures.js";
import { sourceWords } from "../source-words.js";
import { Outlines } from "./outlines.js";
import { CameraPicture } from "./picture.js";
import { SignalMeters } from "./signal.js";
import { Stage } from "./stage.js";

/** @import { CalibrationDocument, Status, Update } from "../types.js" */

const PATCHES_PERIOD_S = 0.5;
const RETRY_S = 2;

/** What the camera sees: its picture, the two patches of floor in it, how they change, and how surely. */
export class CameraView {
  constructor() {
    this.shown = false;
    /** @type {CalibrationDocument | null} */
    this.calibration = null;
    /** @type {number | null} Which calibration the outlines are of. */
    this.revision = null;
    this.loading = false;
    this.loadAtS = 0;
    this.stage = new Stage(byId("camera-viewport"), byId("camera-sheet"), () => this.#drawOutlines());
    this.outlines = new Outlines(/** @type {SVGSVGElement} */ (/** @type {unknown} */ (byId("camera-outlines"))), this.stage);
    this.picture = new CameraPicture(byId("camera-image", HTMLCanvasElement), {
      onSize: (size) => this.stage.setSize(size),
      onPicture: () => {},
    });
    this.patches = new UpdatePicture(byId("patches-image", HTMLImageElement), byId("patches-figure"), patchesUrl, PATCHES_PERIOD_S);
    this.difference = new UpdatePicture(byId("change-image", HTMLImageElement), byId("change-figure"), differenceUrl, PATCHES_PERIOD_S);
    this.meters = new SignalMeters();
    this.box = byId("camera-outlined", HTMLInputElement);
    this.box.addEventListener("change", () => this.#drawOutlines());
  }

  open() {
    this.shown = true;
    this.revision = null;
    this.loadAtS = 0;
    byId("camera-title").focus();
  }

  close() {
    this.shown = false;
    this.picture.stop();
    this.calibration = null;
  }

  /**
   * @param {object} now
   * @param {Status | null} now.status
   * @param {Update | null} now.update
   * @param {boolean} now.connected
   * @param {boolean} now.live  the update is of now
   * @param {number} now.nowS
   */
  follow({ status, update, connected, live, nowS }) {
    if (!this.shown) return;
    const revision = status?.calibration_revision ?? null;
    const waiting = revision !== this.revision || !this.calibration?.size;
    if (connected && waiting && !this.loading && nowS >= this.loadAtS) void this.#load(revision, nowS);
    if (connected && update) {
      this.patches.refresh(update.sequence, nowS);
      // While the empty room is learned there is nothing that it differs from.
      if (update.state === "watching") this.difference.refresh(update.sequence, nowS);
      if (live && update.state === "watching") this.meters.refresh(nowS);
    }
    if (!live || update?.state !== "watching") this.meters.forget();
    this.#showNotice(status, connected);
  }

  /**
   * @param {number | null} revision
   * @param {number} nowS
   */
  async #load(revision, nowS) {
    this.loading = true;
    this.loadAtS = nowS + RETRY_S;
    try {
      const calibration = await getCalibration();
      if (!this.shown) return;
      // Without a size there is no picture to ask for, and asking would be refused each time.
      if (calibration.size && !this.calibration?.size) this.picture.start();
      this.calibration = calibration;
      this.revision = revision;
      if (calibration.size) this.stage.setSize(calibration.size);
      this.#drawOutlines();
    } catch (error) {
      if (!(error instanceof Refusal)) return;
      this.calibration = null;
    } finally {
      this.loading = false;
    }
  }

  #drawOutlines() {
    const { calibration, box } = this;
    const check = box.checked ? (calibration?.check ?? null) : null;
    // The residuals are the calibration's business.
    this.outlines?.show(null, check);
    byId("camera-uncalibrated").hidden = !calibration || calibration.calibration !== null || !calibration.editable;
  }

  /**
   * @param {Status | null} status
   * @param {boolean} connected
   */
  #showNotice(status, connected) {
    const { picture, calibration } = this;
    const trouble = status && sourceWords(status.source).trouble;
    const old = picture.stale ? ` · picture ${duration(picture.ageS ?? 0)} old` : "";
    let words = trouble ?? (old ? `No new picture${old}` : null);
    if (!connected) words = `Not connected${old}`;
    else if (!words && calibration && !calibration.size) words = calibration.editable ? "Waiting for the camera's first picture" : "This source has no camera picture, only the two patches";
    else if (!words && picture.ageS === null) words = picture.refusal ?? "Loading the picture";
    const notice = byId("camera-notice");
    notice.hidden = words === null;
    setText(notice, words ?? "");
    byId("camera-picture").classList.toggle("not-live", words !== null);
  }
}
