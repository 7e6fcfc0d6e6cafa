/** @typedef {"map" | "camera" | "history" | "zones" | "calibration"} View */

// None of these is the id of an element, or the browser would scroll to it and move the focus there.
/** @type {Record<View, string>} */
const ADDRESSES = { map: "", camera: "#camera", history: "#history", zones: "#zones", calibration: "#calibrate" };

/** Which of the page's views is shown: the one named after the # in the address, or else the map. */
export class Route {
  /**
   * @param {object} handlers
   * @param {(view: View, before: View) => void} handlers.onShow
   * @param {(view: View) => true | Promise<boolean>} handlers.mayLeave  a promise where the reader is asked first
   */
  constructor({ onShow, mayLeave }) {
    this.onShow = onShow;
    this.mayLeave = mayLeave;
    /** @type {View} */
    this.view = "map";
    /** @type {Set<View>} */
    this.offered = new Set();
    window.addEventListener("hashchange", () => void this.#followed());
  }

  /** Show what the address says. */
  start() {
    const view = addressed();
    if (view !== "map") this.#show(view);
  }

  /**
   * Go to a view without asking anybody.
   * @param {View} view
   */
  go(view) {
    if (view === this.view) return;
    this.#address(view);
    this.#show(view);
  }

  /**
   * Go to a view that the reader has not asked for. This is done only once, so that they can leave it.
   * @param {View} view
   */
  offer(view) {
    if (this.offered.has(view)) return;
    this.offered.add(view);
    this.go(view);
  }

  /** The reader has used a link, the back button or the address bar. */
  async #followed() {
    const wanted = addressed();
    if (wanted === this.view) return;
    const may = this.mayLeave(this.view);
    if (may === true) return this.#show(wanted);
    // The address has already changed. It goes back to this view until the reader has answered.
    this.#address(this.view);
    if (await may) this.go(wanted);
  }

  /** @param {View} view */
  #address(view) {
    history.pushState(null, "", ADDRESSES[view] || location.pathname + location.search);
  }

  /** @param {View} view */
  #show(view) {
    const before = this.view;
    this.view = view;
    this.onShow(view, before);
  }
}

/** @returns {View} */
function addressed() {
  const views = /** @type {View[]} */ (Object.keys(ADDRESSES));
  return views.find((view) => ADDRESSES[view] && ADDRESSES[view] === location.hash) ?? "map";
}
