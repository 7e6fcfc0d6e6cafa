import { referenceUrl } from "../api.js";
import { byId, setText } from "../dom.js";

/** @import { CameraMoved, Status } from "../types.js" */

/**
 * How the camera has moved, if the calibration has not followed: then there is no map until it is calibrated anew.
 * @param {Status | null} status
 * @returns {CameraMoved | null}
 */
export function away(status) {
  const moved = status?.camera_moved ?? null;
  return moved && !moved.corrected ? moved : null;
}

/** @param {CameraMoved} moved */
export function movedWords({ shift_px, rotation_deg }) {
  const next = "There is no map until it is calibrated anew, or back in its place.";
  if (shift_px === null) {
    return `The camera shows nothing of what it showed: it was turned away, or something stands before it. ${next}`;
  }
  const turned = rotation_deg && Math.abs(rotation_deg) >= 0.1 ? `, turned by ${Math.abs(rotation_deg).toFixed(1)}°` : "";
  return `The camera has moved: the door is about ${Math.round(shift_px)} pixels from where it was${turned}. ${next} The points
    have been moved along, as a proposal: put each where it belongs, and save.`.replace(/\s+/g, " ");
}

/** The notice in the calibration view that the camera has moved, with the picture of before. */
export class MovedNotice {
  constructor() {
    /** @type {string | null} */
    this.since = null;
    const picture = byId("cal-reference", HTMLImageElement);
    // Pictures may be switched off, and there may be none any more.
    picture.addEventListener("error", () => {
      byId("cal-reference-figure").hidden = true;
    });
    picture.addEventListener("load", () => {
      byId("cal-reference-figure").hidden = false;
    });
  }

  /** @param {CameraMoved | null} moved */
  show(moved) {
    byId("cal-moved").hidden = moved === null;
    setText(byId("cal-moved-words"), moved ? movedWords(moved) : "");
    const since = moved?.since ?? null;
    if (since === this.since) return;
    this.since = since;
    byId("cal-reference-figure").hidden = true;
    if (since) byId("cal-reference", HTMLImageElement).src = referenceUrl(since);
  }
}
