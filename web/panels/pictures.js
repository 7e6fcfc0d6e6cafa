// A daemon that has no such picture says so in the browser's console each time: ask seldom.
const RETRY_S = 30;

/** A picture that the daemon draws of the newest update, refreshed now and then and only while looked at. */
export class UpdatePicture {
  /**
   * @param {HTMLImageElement} image
   * @param {HTMLElement} panel  hidden as long as there is no picture
   * @param {(sequence: number) => string} address
   * @param {number} periodS
   */
  constructor(image, panel, address, periodS) {
    this.image = image;
    this.panel = panel;
    this.address = address;
    this.periodS = periodS;
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
    this.nextAt = nowS + this.periodS;
    this.sequence = sequence;
    // The old picture stays until the new one is complete, so nothing flickers.
    this.image.src = this.address(sequence);
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
