import { Refusal, getCalibration, putCalibration, restorePrevious } from "../api.js";
import { byId, isUnavailable, setText, setUnavailable } from "../dom.js";
import { duration } from "../format.js";
import { sourceWords } from "../source-words.js";
import { CameraPicture } from "../camera/picture.js";
import { Checker } from "./checker.js";
import { Editor } from "./editor.js";
import { MovedNotice, away } from "./moved.js";
import { askToDrop } from "../drop.js";
import { Draft } from "./points.js";
import { whyNotSave } from "./words.js";

/** @import { CalibrationDocument, Status } from "../types.js" */

const REFRESH_MS = 500;
// Until the camera has given its first picture there is nothing to calibrate.
const RETRY_MS = 2000;

/** The calibration view from its opening to its closing: what is loaded, asked, saved. */
export class CalibrationView {
  /** @param {(first: boolean) => void} onSaved  first: there was none before */
  constructor(onSaved) {
    this.onSaved = onSaved;
    this.shown = false;
    /** @type {CalibrationDocument | null} */
    this.document = null;
    /** @type {Status | null} */
    this.status = null;
    this.connected = false;
    this.changed = false;
    /** The camera gives another picture size than the calibration in use was made for. */
    this.rescaled = false;
    /** The points were moved with the camera, which nobody has confirmed yet. */
    this.proposed = false;
    /** @type {string | null} When the motion was noticed that was proposed last. */
    this.proposedFor = null;
    this.moved = new MovedNotice();
    this.busy = false;
    /** Counts changes of the draft, so that an answer is known to be about this one. */
    this.revision = 0;
    this.checkedRevision = -1;
    this.loadAt = 0;
    this.loading = false;
    /** @type {number | null} The daemon's count of saved calibrations when this one was loaded. */
    this.loadedRevision = null;
    this.overtaken = false;
    this.checker = new Checker((revision, outcome) => {
      this.checkedRevision = revision;
      this.editor.learn(outcome);
      this.#refreshSave();
    });
    this.editor = new Editor(() => this.#edited());
    this.camera = new CameraPicture(byId("cal-image", HTMLCanvasElement), {
      onSize: (size) => this.#pictureIs(size),
      onPicture: () => this.editor.pictured(),
    });
    byId("cal-save").addEventListener("click", () => void this.#save());
    byId("cal-previous").addEventListener("click", () => void this.#restore());
    byId("cal-discard").addEventListener("click", () => void this.#discard());
    window.addEventListener("beforeunload", (event) => {
      if (this.changed) event.preventDefault();
    });
    setInterval(() => this.#tick(), REFRESH_MS);
  }

  open() {
    this.shown = true;
    this.document = null;
    this.loadedRevision = null;
    this.changed = false;
    this.loadAt = 0;
    this.#say("", "");
    byId("cal-welcome").hidden = true;
    this.editor.open(null, false, null);
    this.#tick();
    byId("cal-title").focus();
  }

  close() {
    this.shown = false;
    this.changed = false;
    this.checker.forget();
    this.camera.stop();
  }

  /** @returns {true | Promise<boolean>} */
  mayLeave() {
    return this.changed ? askToDrop() : true;
  }

  /**
   * @param {Status | null} status
   * @param {boolean} connected
   */
  follow(status, connected) {
    this.status = status;
    this.connected = connected;
    if (this.shown) this.#refreshNotice();
    if (!this.shown || !this.document || !status || this.busy || this.loading) return;
    if (this.loadedRevision === status.calibration_revision) return;
    // Saved here, saved elsewhere, or another daemon.
    const known = this.loadedRevision !== null;
    this.loadedRevision = status.calibration_revision;
    if (this.changed) this.overtaken = known;
    else if (known) void this.#load();
  }

  #tick() {
    if (!this.shown) return;
    const size = this.document?.size ?? null;
    if (!size && !this.loading && performance.now() >= this.loadAt) void this.#load();
    this.#refreshNotice();
    this.#refreshSave();
  }

  async #load() {
    this.loading = true;
    try {
      const fresh = await getCalibration();
      if (this.shown && !this.changed) this.#take(fresh);
    } catch (error) {
      if (error instanceof Refusal) this.#say("", error.message);
    } finally {
      this.loading = false;
      this.loadAt = performance.now() + RETRY_MS;
    }
  }

  /** @param {CalibrationDocument} fresh */
  #take(fresh) {
    const pictured = this.document?.size;
    this.document = fresh;
    this.changed = false;
    this.overtaken = false;
    this.checker.forget();
    this.revision += 1;
    const { calibration, size, check, editable } = fresh;
    const draft = calibration ? Draft.of(calibration, size) : size && editable ? new Draft(size) : null;
    this.rescaled = calibration !== null && size !== null && String(calibration.size) !== String(size);
    const moved = away(this.status);
    this.proposed = moved !== null && draft !== null && calibration !== null && editable;
    this.proposedFor = moved?.since ?? null;
    if (moved && this.proposed) draft?.follow(moved);
    const known = check && !this.rescaled && !this.proposed ? { check } : null;
    this.editor.open(draft, editable && size !== null, known);
    if (known) this.checkedRevision = this.revision;
    else if (draft && editable) this.checker.submit(draft.body(), this.revision);
    if (size && !pictured) this.camera.start();
    byId("cal-welcome").hidden = calibration !== null || !editable;
    this.#refreshNotice();
    this.#refreshSave();
  }

  /** @param {[number, number]} size */
  #pictureIs(size) {
    const { draft } = this.editor;
    if (!draft || !this.document || (draft.size[0] === size[0] && draft.size[1] === size[1])) return;
    this.document.size = size;
    this.rescaled = true;
    draft.resize(size);
    this.editor.stage.setSize(size);
    this.editor.refresh();
    this.revision += 1;
    this.checker.submit(draft.body(), this.revision);
  }

  #edited() {
    const { draft } = this.editor;
    if (!draft) return;
    this.changed = true;
    this.revision += 1;
    this.#say("", "");
    this.checker.submit(draft.body(), this.revision);
    this.#refreshSave();
  }

  async #save() {
    const { draft } = this.editor;
    if (!draft || isUnavailable(byId("cal-save", HTMLButtonElement))) return;
    const first = this.document?.calibration === null;
    await this.#change(() => putCalibration(draft.body()), "Not saved", (fresh) => {
      const kept = fresh.previous ? " The one before is kept." : "";
      this.#say(`Saved: the map uses it from now on.${kept}`, "");
      this.onSaved(first);
    });
  }

  async #restore() {
    await this.#change(restorePrevious, "Not brought back", () => {
      this.#say("The previous calibration is in use again.", "");
      this.onSaved(false);
    });
  }

  /**
   * @param {() => Promise<CalibrationDocument>} ask
   * @param {string} failure
   * @param {(fresh: CalibrationDocument) => void} done
   */
  async #change(ask, failure, done) {
    if (this.busy) return;
    this.busy = true;
    this.#say("", "");
    this.#refreshSave();
    const { revision } = this;
    try {
      const fresh = await ask();
      if (!this.shown) return;
      // What was changed while it was being saved is a change still.
      if (revision === this.revision) this.#take(fresh);
      else this.document = fresh;
      done(fresh);
    } catch (error) {
      const why = error instanceof Refusal ? error.message : "the daemon does not answer; try again when it does";
      this.#say("", `${failure}: ${why}`);
    } finally {
      this.busy = false;
      this.#refreshSave();
    }
  }

  async #discard() {
    if (isUnavailable(byId("cal-discard", HTMLButtonElement)) || !(await this.mayLeave())) return;
    this.changed = false;
    // What this was made from is at hand; what is in use may be newer.
    if (this.document) this.#take(this.document);
    void this.#load();
    this.#say("Your changes are gone.", "");
  }

  #refreshSave() {
    const { draft, outcome, problem } = this.editor;
    const why = whyNotSave({
      fieldProblem: problem,
      missing: draft?.missing() ?? null,
      outcome,
      current: this.checkedRevision === this.revision,
      changed: this.changed || this.rescaled || this.proposed,
      busy: this.busy,
    });
    setUnavailable(byId("cal-save", HTMLButtonElement), why !== null);
    setText(byId("cal-save-reason"), why ?? "Ready to save.");
    setUnavailable(byId("cal-discard", HTMLButtonElement), !this.changed || this.busy);
    byId("cal-previous").hidden = !this.document?.previous;
    setUnavailable(byId("cal-previous", HTMLButtonElement), this.busy);
  }

  #refreshNotice() {
    const { document, camera, status, connected } = this;
    const note = byId("cal-note");
    const words = document ? this.#noteWords(document) : null;
    note.hidden = words === null;
    setText(note, words ?? "");
    const moved = away(status);
    this.moved.show(moved);
    // It moved while this was open: what nobody has changed yet is proposed anew.
    if (status && document && !this.changed && !this.busy && (moved?.since ?? null) !== this.proposedFor) return this.#take(document);
    const notice = byId("cal-notice");
    const trouble = status && sourceWords(status.source).trouble;
    const old = camera.ageS !== null && camera.stale ? ` · picture ${duration(camera.ageS)} old` : "";
    const missing = !connected ? `Not connected${old}` : (trouble ?? (old ? `No new picture${old}` : this.#beforeFirst()));
    notice.hidden = missing === null;
    setText(notice, missing ?? "");
    byId("cal-picture").classList.toggle("not-live", missing !== null);
  }

  /**
   * @param {CalibrationDocument} document
   * @returns {string | null}
   */
  #noteWords({ editable, reason, calibration, size }) {
    if (!editable) return reason ?? "This calibration cannot be changed here.";
    if (this.overtaken) return "Somebody else has saved a calibration since you began: saving yours replaces it.";
    if (!this.rescaled || !calibration || !size) return null;
    return `The camera gives ${size.join(" × ")} pixels now, and the calibration was made for ${calibration.size.join(" × ")}: the points have been moved in proportion. Look where they are, and save.`;
  }

  /** @returns {string | null} */
  #beforeFirst() {
    if (this.camera.ageS !== null) return null;
    if (this.document && !this.document.size) return this.document.editable ? "Waiting for the camera's first picture" : "There is no camera picture";
    return this.camera.refusal ?? "Loading the picture";
  }

  /**
   * @param {string} saved
   * @param {string} refused
   */
  #say(saved, refused) {
    setText(byId("cal-saved"), saved);
    setText(byId("cal-refused"), refused);
  }
}
