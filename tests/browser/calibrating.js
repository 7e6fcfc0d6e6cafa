import { until } from "./browser.js";
import { DOOR, corner, mark, seenAt } from "./camera.js";
import { calibration } from "./fit.js";
import { cameraStatus } from "./scene.js";
import { visit } from "./visit.js";

/** @import { TestContext } from "node:test" */
/** @import { BrowserContextOptions, Page } from "playwright-core" */
/** @import { Calibration, Pixel } from "../../web/types.js" */
/** @import { Mock } from "./mock.js" */

/** A webcam just plugged in. @param {Mock} mock */
export function uncalibrated(mock) {
  mock.status = { ...cameraStatus(), calibrated: false, calibration_revision: 0, state: "learning", model: null, lambda: 0 };
  mock.geometry.calibration = 0;
}

/**
 * A webcam with a calibration of five points, the fifth a little off, and one before it.
 * @param {Mock} mock
 */
export function calibrated(mock) {
  mock.status = cameraStatus();
  mock.calibration.inUse = calibration({ extra: [[0, -0.6]], off: [3, -2] });
  mock.calibration.before = calibration();
}

/**
 * The calibration view, opened and checked.
 * @param {TestContext} t
 * @param {BrowserContextOptions} [options]
 * @param {(mock: Mock) => void} [prepare]
 */
export async function calibrating(t, options, prepare = calibrated) {
  const visited = await visit(t, options, prepare, "#calibrate");
  await visited.page.locator("#cal-overlay .area").first().waitFor({ state: "attached" });
  await visited.page.locator("#cal-notice").waitFor({ state: "hidden" });
  return visited;
}

/** @param {Page} page @param {string} badge */
export const handle = (page, badge) => page.locator(".handle", { has: page.locator(`.badge:text-is("${badge}")`) });

/**
 * The middle of a handle, in CSS pixels of the window.
 * @param {Page} page
 * @param {string} badge
 * @returns {Promise<[number, number]>}
 */
export async function middleOf(page, badge) {
  const box = await handle(page, badge).boundingBox();
  if (!box) throw new Error(`no handle ${badge}`);
  return [box.x + box.width / 2, box.y + box.height / 2];
}

/**
 * Where a pixel of the camera's picture is, in CSS pixels of the window.
 * @param {Page} page
 * @param {Pixel} pixel
 * @returns {Promise<[number, number]>}
 */
export function clientOf(page, pixel) {
  return page.evaluate(([u, v]) => {
    const image = /** @type {HTMLCanvasElement} */ (document.getElementById("cal-image"));
    const box = image.getBoundingClientRect();
    return [box.left + ((u + 0.5) / image.width) * box.width, box.top + ((v + 0.5) / image.height) * box.height];
  }, pixel);
}

/**
 * The newest body that was to be checked, once it is as wanted.
 * @param {Mock} mock
 * @param {(body: Calibration) => boolean} is
 * @param {string} what
 */
export async function checks(mock, is, what) {
  await until(() => {
    const last = mock.calibration.checked.at(-1);
    return last && is(last);
  }, `${what}; last: ${JSON.stringify(mock.calibration.checked.at(-1))}`);
  return /** @type {Calibration} */ (mock.calibration.checked.at(-1));
}

/**
 * Everything the steps ask for: measure the door, drag the four points to where they belong.
 * @param {Page} page
 */
export async function followTheSteps(page) {
  await page.getByLabel("Width of the opening").fill(String(DOOR.width_m));
  await page.getByLabel("Thickness of the wall").fill(String(DOOR.wall_thickness_m));
  await page.getByLabel("Height of the opening").fill(String(DOOR.height_m));
  for (const [badge, place] of /** @type {const} */ ([["L", corner(-1)], ["R", corner(1)], ["3", mark(-1)], ["4", mark(1)]])) {
    await drag(page, badge, await clientOf(page, seenAt(place)));
  }
}

/**
 * @param {Page} page
 * @param {string} badge
 * @param {[number, number]} to  CSS pixels of the window
 */
export async function drag(page, badge, to) {
  await page.mouse.move(...(await middleOf(page, badge)));
  await page.mouse.down();
  await page.mouse.move(...to, { steps: 4 });
  await page.mouse.up();
}

/** @param {number} a @param {number} b @param {number} within */
export const near = (a, b, within = 0.02) => Math.abs(a - b) <= within;
