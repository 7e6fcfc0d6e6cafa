// A camera that has moved: what the calibration view says, shows and proposes.

import assert from "node:assert/strict";
import { describe, test } from "node:test";
import { violations } from "./axe.js";
import { until } from "./browser.js";
import { calibrated, calibrating, checks, near } from "./calibrating.js";

/** @import { Mock } from "./mock.js" */
/** @import { CameraMoved } from "../../web/types.js" */

/** @type {CameraMoved} */
const MOVED = { dx_px: 20, dy_px: -12, rotation_deg: 1.5, shift_px: 24.3, since: "2026-01-02T03:04:05Z", corrected: false };

/** @param {Partial<CameraMoved>} [how] */
const turned = (how) => (/** @type {Mock} */ mock) => {
  calibrated(mock);
  mock.status.state = "misaligned";
  mock.status.camera_moved = { ...MOVED, ...how };
};

describe("a camera that has moved", () => {
  test("is told with the picture of before, and its points are moved along until somebody saves them", async (t) => {
    const { mock, page, complaints } = await calibrating(t, {}, turned());
    const words = page.locator("#cal-moved-words");
    await words.filter({ hasText: "the door is about 24 pixels from where it was, turned by 1.5°" }).waitFor();
    await page.getByAltText("The empty room as the camera saw it before it moved").waitFor();
    const before = mock.calibration.inUse?.floor_points ?? [];
    const [cos, sin] = [Math.cos((1.5 * Math.PI) / 180), Math.sin((1.5 * Math.PI) / 180)];
    const [u, v] = [before[0].pixel[0] - 319.5, before[0].pixel[1] - 179.5];
    const there = [339.5 + cos * u - sin * v, 167.5 + sin * u + cos * v];
    const proposed = await checks(mock, ({ floor_points: [{ pixel }] }) => near(pixel[0], there[0], 0.01), "the proposal");
    assert.ok(near(proposed.floor_points[0].pixel[1], there[1], 0.01));
    assert.deepEqual(await violations(page), []);
    await page.locator("#cal-save-reason", { hasText: "Ready to save." }).waitFor();
    mock.status.camera_moved = null;
    await page.getByRole("button", { name: "Save", exact: true }).click();
    await until(() => mock.calibration.put.length === 1, "it is saved");
    assert.deepEqual(mock.calibration.put[0].floor_points, proposed.floor_points);
    assert.deepEqual(complaints, []);
  });

  test("is not asked for its points once the calibration has followed", async (t) => {
    const { mock, page, complaints } = await calibrating(t, {}, turned({ corrected: true }));
    assert.equal(await page.locator("#cal-moved").isVisible(), false);
    assert.equal(mock.requests.some((path) => path.includes("reference.jpg")), false);
    assert.deepEqual(complaints, []);
  });

  test("may show nothing of what it showed", async (t) => {
    const unknown = { dx_px: null, dy_px: null, rotation_deg: null, shift_px: null };
    const { page } = await calibrating(t, {}, turned(unknown));
    await page.locator("#cal-moved-words", { hasText: "shows nothing of what it showed" }).waitFor();
  });
});
