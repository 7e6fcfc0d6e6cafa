import { BRIGHTNESSES, lightOf } from "./brightness.js";

/** @import { Choice, Layer, LitFacet, Rgb } from "./types.js" */

/**
 * The sRGB transfer curve: what arrives is linear light, what a screen wants is not.
 * @param {number} linear  0..1, clipped
 * @returns {number} 0..255
 */
export function srgbByte(linear) {
  const u = Math.min(Math.max(linear, 0), 1);
  const encoded = u <= 0.0031308 ? 12.92 * u : 1.055 * u ** (1 / 2.4) - 0.055;
  return Math.round(255 * encoded);
}

/**
 * @param {Rgb} rgb  linear light
 * @param {number} scale  the amount shown at full brightness
 */
export function cssColour(rgb, scale) {
  const [r, g, b] = rgb.map((value) => srgbByte(scale > 0 ? value / scale : 0));
  return `rgb(${r} ${g} ${b})`;
}

/** @param {Rgb} rgb */
export const strength = (rgb) => Math.max(...rgb.map(Math.abs));

/**
 * One facet can brighten in red and darken in blue (a red coat before a white wall), so the two
 * parts are kept and drawn apart, as in the paper's positive and negative rows.
 * @param {Rgb} rgb
 * @returns {{ brighter: Rgb, darker: Rgb }} both with no negative value
 */
export function split([r, g, b]) {
  return {
    brighter: [Math.max(r, 0), Math.max(g, 0), Math.max(b, 0)],
    darker: [Math.max(-r, 0), Math.max(-g, 0), Math.max(-b, 0)],
  };
}

/**
 * The change shown at full brightness: it rises at once and sinks slowly, so that the picture
 * neither clips nor flickers from frame to frame.
 */
export class RunningScale {
  /** @param {number} halfLifeS */
  constructor(halfLifeS = 6) {
    this.halfLifeS = halfLifeS;
    this.value = 0;
    this.at = 0;
  }

  /**
   * @param {number} peak  largest change of the newest update; 0 leaves the scale as it is,
   *   or an empty room would slowly turn the gain up until noise looks like somebody
   * @param {number} nowS
   */
  follow(peak, nowS) {
    const elapsed = Math.max(nowS - this.at, 0);
    this.at = nowS;
    if (peak > 0) this.value = Math.max(peak, this.value * 0.5 ** (elapsed / this.halfLifeS));
    return this.value;
  }
}

/**
 * Left and right share one scale, so that the two views can be compared with each other; the
 * unified map has its own, for it is a combination and may be much weaker than either. Each
 * brightness has its own scales too: a map is as bright as it can be in both.
 */
export class LayerScales {
  constructor() {
    const scales = () => ({ views: new RunningScale(), unified: new RunningScale() });
    this.scales = { measured: scales(), shrunk: scales() };
  }

  /**
   * @param {LitFacet[]} facets
   * @param {number} nowS
   */
  follow(facets, nowS) {
    for (const brightness of BRIGHTNESSES) {
      let views = 0;
      let unified = 0;
      for (const facet of facets) {
        const amount = (/** @type {Layer} */ layer) => strength(lightOf(facet, layer, brightness));
        views = Math.max(views, amount("left"), amount("right"));
        unified = Math.max(unified, amount("unified"));
      }
      this.scales[brightness].views.follow(views, nowS);
      this.scales[brightness].unified.follow(unified, nowS);
    }
  }

  /** @param {Pick<Choice, "layer" | "brightness">} choice */
  of({ layer, brightness }) {
    const { views, unified } = this.scales[brightness];
    return layer === "unified" ? unified.value : views.value;
  }
}
