/** @import { Pixel } from "../types.js" */

const MOST_ZOOM = 10;
const STEP = 1.5;

/**
 * The sheet on which picture, overlay and handles lie, inside a window that scrolls. Everything on
 * the sheet is placed in shares of its size, so that zooming is nothing but resizing it.
 */
export class Stage {
  /**
   * @param {HTMLElement} viewport
   * @param {HTMLElement} sheet
   * @param {() => void} onScale
   */
  constructor(viewport, sheet, onScale) {
    this.viewport = viewport;
    this.sheet = sheet;
    this.onScale = onScale;
    /** @type {[number, number]} */
    this.size = [640, 480];
    this.zoom = 1;
    new ResizeObserver(() => this.#resize()).observe(viewport);
    // A pinch on a touchpad comes as a wheel with Ctrl; the wheel alone keeps scrolling.
    viewport.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      this.#zoomTo(this.zoom * Math.exp(-event.deltaY / 300), [event.clientX, event.clientY]);
    }, { passive: false });
  }

  /** @param {[number, number]} size */
  setSize(size) {
    if (size[0] === this.size[0] && size[1] === this.size[1]) return;
    this.size = size;
    this.#resize();
  }

  /** CSS pixels a picture pixel. */
  get scale() {
    return this.sheet.clientWidth / this.size[0];
  }

  /**
   * @param {-1 | 1} direction
   * @param {Pixel | null} around  what stays where it is
   */
  step(direction, around) {
    this.#zoomTo(this.zoom * STEP ** direction, around && this.clientOf(around));
  }

  fit() {
    this.#zoomTo(1, null);
  }

  /**
   * @param {number} clientX
   * @param {number} clientY
   * @returns {Pixel}
   */
  pixelAt(clientX, clientY) {
    const box = this.sheet.getBoundingClientRect();
    const [width, height] = this.size;
    return [((clientX - box.left) / box.width) * width - 0.5, ((clientY - box.top) / box.height) * height - 0.5];
  }

  /**
   * @param {Pixel} pixel
   * @returns {[number, number]} client coordinates
   */
  clientOf([u, v]) {
    const box = this.sheet.getBoundingClientRect();
    const [left, top] = this.shareOf([u, v]);
    return [box.left + left * box.width, box.top + top * box.height];
  }

  /**
   * Where on the sheet a pixel is: (0, 0) is the centre of the first, not its corner.
   * @param {Pixel} pixel
   * @returns {[number, number]}
   */
  shareOf([u, v]) {
    return [(u + 0.5) / this.size[0], (v + 0.5) / this.size[1]];
  }

  /**
   * @param {number} zoom
   * @param {[number, number] | null} around  client coordinates
   */
  #zoomTo(zoom, around) {
    const box = this.viewport.getBoundingClientRect();
    const [x, y] = around ?? [box.left + box.width / 2, box.top + box.height / 2];
    const pixel = this.pixelAt(x, y);
    this.zoom = Math.min(Math.max(zoom, 1), MOST_ZOOM);
    this.#resize();
    const [nowX, nowY] = this.clientOf(pixel);
    this.viewport.scrollBy(nowX - x, nowY - y);
  }

  #resize() {
    const [width, height] = this.size;
    const across = this.viewport.clientWidth;
    if (across === 0) return;
    const high = Math.max(240, 0.72 * window.innerHeight);
    const fit = Math.min(across / width, high / height);
    this.viewport.style.height = `${Math.round(fit * height)}px`;
    this.sheet.style.width = `${fit * this.zoom * width}px`;
    this.sheet.style.height = `${fit * this.zoom * height}px`;
    this.onScale();
  }
}
