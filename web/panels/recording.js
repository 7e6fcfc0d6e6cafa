import { Refusal, startRecording, stopRecording } from "../api.js";
import { byId, isUnavailable, setText, setUnavailable } from "../dom.js";
import { fixed, integer, plural } from "../format.js";

/** @import { RecordingStatus, Status } from "../types.js" */

/** Has the daemon record what the camera sees, and says how that goes. */
export class RecordingPanel {
  /** @param {() => void} onChanged  the status says more now */
  constructor(onChanged) {
    this.onChanged = onChanged;
    this.button = byId("record", HTMLButtonElement);
    this.form = byId("recording-form", HTMLFormElement);
    this.connected = false;
    this.busy = false;
    /** @type {RecordingStatus | null} */
    this.recording = null;
    this.form.addEventListener("submit", (event) => {
      // The daemon is asked by script; the form is one for its Enter key and its checks.
      event.preventDefault();
      void this.#press();
    });
  }

  /**
   * @param {Status | null} status
   * @param {boolean} connected
   */
  follow(status, connected) {
    this.connected = connected;
    const before = this.recording;
    this.recording = status?.recording ?? null;
    const { recording } = this;
    const now = byId("recording-now");
    now.hidden = !connected || recording?.state !== "recording";
    if (recording) {
      setText(now, `Recording ${fixed(recording.seconds, 0)} s`);
      setText(byId("recording-words"), words(recording));
    }
    byId("recording-trouble").hidden = !recording?.error;
    setText(byId("recording-trouble"), recording?.error ?? "");
    // One that was begun elsewhere, or ended by itself: what was said of the last press is over.
    if (before && recording && before.state !== recording.state && !this.busy) this.#say("", false);
    this.#enable();
  }

  get #running() {
    return this.recording?.state === "recording";
  }

  async #press() {
    if (isUnavailable(this.button)) return;
    this.busy = true;
    this.#enable();
    const stopping = this.#running;
    try {
      const report = stopping ? await stopRecording() : await startRecording(this.#wish());
      this.recording = report.recording;
      this.#say(stopping ? "Recorded." : "Recording.", false);
      this.onChanged();
    } catch (error) {
      const why = error instanceof Refusal ? error.message : "the daemon does not answer";
      this.#say(`${stopping ? "The recording was not ended" : "Nothing is recorded"}: ${why}.`.replace(/\.\.$/, "."), true);
    } finally {
      this.busy = false;
      this.#enable();
    }
  }

  #wish() {
    const number = (/** @type {string} */ id) => byId(id, HTMLInputElement).valueAsNumber;
    const name = byId("recording-name", HTMLInputElement).value.trim();
    const [seconds, empty] = [number("recording-seconds"), number("recording-empty")];
    return {
      ...(name && { name }),
      ...(Number.isFinite(seconds) && { seconds }),
      ...(Number.isFinite(empty) && { empty_seconds: empty }),
    };
  }

  #enable() {
    setText(this.button, this.#running ? "Stop recording" : "Record");
    setUnavailable(this.button, !this.connected || this.busy);
    byId("recording-fields", HTMLFieldSetElement).disabled = this.#running || this.busy;
  }

  /**
   * @param {string} text
   * @param {boolean} failed
   */
  #say(text, failed) {
    const outcome = byId("recording-outcome");
    setText(outcome, text);
    outcome.classList.toggle("failed", failed);
  }
}

/** @type {Record<string, string>} */
const ENDS = { seconds: "its time is over", bytes: "it had become as large as it may", frames: "it had its frames", stopped: "stopped" };

/** @param {RecordingStatus} recording */
function words({ directory, state, frames, seconds, bytes, lost, overflowed, skipped, ended }) {
  const missing = lost + overflowed + skipped;
  const size = bytes < 1e9 ? `${fixed(bytes / 1e6, 1)} MB` : `${fixed(bytes / 1e9, 2)} GB`;
  const amount = `${plural(frames, "frame")} in ${fixed(seconds, 0)} s, ${size}${missing > 0 ? `, ${integer(missing)} missing` : ""}`;
  if (state === "recording") return `${amount} so far, into ${directory}`;
  if (state === "finishing") return `${amount}; it is being brought to the disk`;
  return `The last one: ${amount}, in ${directory}${ended ? ` (${ENDS[ended] ?? ended})` : ""}`;
}
