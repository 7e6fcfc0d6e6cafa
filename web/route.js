// Neither this nor the map's "#live" is the id of an element: the browser would scroll there and take
// the focus along.
const CALIBRATE = "#calibrate";

/** Which of the page's two views is shown: the map, or the calibration at #calibrate. */
export class Route {
  /**
   * @param {object} handlers
   * @param {(calibrating: boolean) => void} handlers.onShow
   * @param {() => true | Promise<boolean>} handlers.mayLeave  the calibration; somebody may have to decide
   */
  constructor({ onShow, mayLeave }) {
    this.onShow = onShow;
    this.mayLeave = mayLeave;
    this.calibrating = false;
    window.addEventListener("hashchange", () => void this.#followed());
  }

  /** Show what the address says. */
  start() {
    if (location.hash === CALIBRATE) this.#show(true);
  }

  /**
   * Go to a view without asking anybody.
   * @param {boolean} calibrating
   */
  go(calibrating) {
    if (calibrating === this.calibrating) return;
    history.pushState(null, "", calibrating ? CALIBRATE : location.pathname + location.search);
    this.#show(calibrating);
  }

  /** The reader has used a link, the back button or the address bar. */
  async #followed() {
    const wanted = location.hash === CALIBRATE;
    if (wanted === this.calibrating) return;
    const may = wanted || this.mayLeave();
    if (may === true) return this.#show(wanted);
    // The address has changed before anybody could be asked: it is put back for as long.
    history.pushState(null, "", CALIBRATE);
    if (await may) this.go(false);
  }

  /** @param {boolean} calibrating */
  #show(calibrating) {
    this.calibrating = calibrating;
    this.onShow(calibrating);
  }
}
