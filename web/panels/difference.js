import { differenceUrl } from "../api.js";
import { byId } from "../dom.js";

const PERIOD_S = 1;
// A daemon that has no such picture says so in the browser's console each time: ask seldom.
const RETRY_S = 30;

/** The colour-magnified patches, refreshed at most once a second and only while looked at. */
export class DifferencePicture {
  constructor() {
    this.image = byId("difference-image", HTMLImageElement);
    this.panel = byId("difference");
    this.inSight = true;
    this.loading = false;
    this.nextAt = 0;
    this.sequence = -1;
    new IntersectionObserver(([entry]) => {
      // A hidden panel is never in sight, yet it must load in order to be shown.
      this.inSight = entry.isIntersecting || this.panel.hidden === true;
    }).observe(this.image);
    this.image.addEventListener("load", () => this.#settled(true));
    this.image.addEventListener("error", () => this.#settled(false));
  }

  /**
   * @param {number} sequence  of the newest update
   * @param {number} nowS
   */
  refresh(sequence, nowS) {
    if (document.hidden || !this.inSight || this.loading) return;
    if (nowS < this.nextAt || sequence === this.sequence) return;
    this.loading = true;
    this.nextAt = nowS + PERIOD_S;
    this.sequence = sequence;
    // The old picture stays until the new one is complete, so nothing flickers.
    this.image.src = differenceUrl(sequence);
  }

  /** @param {boolean} shown */
  #settled(shown) {
    this.loading = false;
    this.panel.hidden = !shown;
    if (!shown) {
      this.nextAt += RETRY_S;
      this.inSight = true;
    }
  }
}
