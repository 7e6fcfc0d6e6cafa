// What the camera sees: its picture with the outlines on it, the two patches, their change and the signal.

import assert from "node:assert/strict";
import { describe, test } from "node:test";
import { violations } from "./axe.js";
import { DESKTOP, PHONE, picture, reaches, until } from "./browser.js";
import { calibrated, uncalibrated } from "./calibrating.js";
import { corner, seenAt } from "./camera.js";
import { update } from "./scene.js";
import { visit } from "./visit.js";

/** @import { TestContext } from "node:test" */
/** @import { BrowserContextOptions } from "playwright-core" */
/** @import { Mock } from "./mock.js" */

/**
 * The view on a calibrated webcam that sends updates.
 * @param {TestContext} t
 * @param {BrowserContextOptions} [options]
 * @param {(mock: Mock) => void} [prepare]
 */
async function looking(t, options, prepare = calibrated) {
  const visited = await visit(t, options, prepare, "#camera");
  let sequence = 0;
  const send = () => visited.mock.send(update((sequence += 1), []));
  const stream = setInterval(send, 100);
  t.after(() => clearInterval(stream));
  return { ...visited, stream };
}

describe("camera view", () => {
  test("outlines the door's corners and the patches where they are in the picture", async (t) => {
    const { page, complaints } = await looking(t);
    await page.locator("#camera-outlines .area").first().waitFor({ state: "attached" });
    assert.equal(await page.locator("#camera-outlines .area").count(), 2);
    const feet = await page.locator("#camera-outlines .foot").evaluateAll((feet) =>
      feet.map((foot) => ["cx", "cy"].map((name) => Number(foot.getAttribute(name)))));
    for (const [index, side] of /** @type {const} */ ([[0, -1], [1, 1]])) {
      const [u, v] = seenAt(corner(side));
      assert.ok(Math.hypot(feet[index][0] - u, feet[index][1] - v) < 3, `${feet[index]} for ${[u, v]}`);
    }
    await page.locator("#camera-notice").waitFor({ state: "hidden" });
    // The picture itself is there: the floor of the made-up camera is not black.
    const brightest = await page.evaluate(() => {
      const image = /** @type {HTMLCanvasElement} */ (document.getElementById("camera-image"));
      const copy = new OffscreenCanvas(image.width, image.height).getContext("2d");
      copy?.drawImage(image, 0, 0);
      const data = copy?.getImageData(0, 0, image.width, image.height).data ?? new Uint8ClampedArray();
      return data.reduce((most, value, k) => (k % 4 < 3 ? Math.max(most, value) : most), 0);
    });
    assert.ok(brightest > 60, String(brightest));
    await page.getByLabel("Outlines").uncheck({ force: true });
    await page.locator("#camera-outlines .area").first().waitFor({ state: "detached" });
    assert.deepEqual(complaints, []);
  });

  test("shows patches and change, and says how strong the signal is", async (t) => {
    const { mock, page, complaints } = await looking(t);
    await page.locator("#patches-image").waitFor();
    await page.locator("#change-image").waitFor();
    await page.locator("#signal-left-db", { hasText: "+3.2 dB" }).waitFor();
    const left = page.getByRole("meter", { name: "Signal to noise, left patch" });
    assert.equal(await left.getAttribute("aria-valuetext"), "+3.2 dB, clear");
    assert.equal(await page.locator("#signal-right-words").innerText(), "only noise");
    assert.equal(await page.locator("#signal-left-change").innerText(), "1.18 %");
    const width = () => left.evaluate((meter) => Number(getComputedStyle(meter).getPropertyValue("--share")));
    assert.ok(Math.abs((await width()) - 0.58) < 0.001, String(await width()));
    mock.signal = { left: null, right: null };
    await page.locator("#signal-unknown").waitFor();
    assert.equal(await page.locator("#signal-left-db").innerText(), "–");
    assert.deepEqual(complaints, []);
  });

  test("asks for pictures only while it is shown", async (t) => {
    const { mock, page } = await looking(t);
    const asked = (/** @type {string} */ name) => mock.requests.filter((path) => path.endsWith(name)).length;
    await until(() => asked("frame.jpg") > 2 && asked("signal") > 1, "pictures are asked for");
    await page.getByRole("link", { name: "Map", exact: true }).click();
    await page.locator("#map-view").waitFor();
    await page.waitForTimeout(300);
    const before = asked("frame.jpg") + asked("patches.png") + asked("signal");
    await page.waitForTimeout(1200);
    assert.equal(asked("frame.jpg") + asked("patches.png") + asked("signal"), before);
    assert.equal(await page.evaluate(() => document.activeElement?.id), "to-camera");
  });

  test("never passes old pictures off as live", async (t) => {
    const { mock, page, stream } = await looking(t);
    await page.locator("#signal-left-db", { hasText: "dB" }).waitFor();
    await page.locator("#patches-image").waitFor();
    clearInterval(stream);
    mock.stoppedAt = new Date().toISOString();
    await reaches(page, "stale");
    await page.locator("#camera-notice", { hasText: /^No new picture · picture \d+ s old$/ }).waitFor();
    assert.equal(await page.locator("#signal-left-db").innerText(), "–");
    await page.waitForFunction(() => Number(getComputedStyle(/** @type {Element} */ (document.getElementById("patches-image"))).opacity) < 0.5);
  });

  test("leads to the calibration where there is none", async (t) => {
    const { page, complaints } = await visit(t, {}, uncalibrated);
    await page.locator("#cal-welcome").waitFor();
    await page.getByRole("link", { name: "Camera", exact: true }).click();
    await page.locator("#camera-uncalibrated").waitFor();
    await page.getByRole("link", { name: "calibrate the camera" }).click();
    await page.locator("#cal-title").waitFor();
    assert.deepEqual(complaints, []);
  });

  test("does not ask a recording of patches for a camera's picture", async (t) => {
    const { mock, page, complaints } = await looking(t, {}, (mock) => {
      mock.calibration.editable = false;
      mock.calibration.size = null;
      mock.frame = null;
    });
    await page.locator("#camera-notice", { hasText: "no camera picture, only the two patches" }).waitFor();
    await page.locator("#patches-image").waitFor();
    assert.equal(mock.requests.some((path) => path.endsWith("frame.jpg")), false);
    assert.deepEqual(complaints, []);
  });

  /** @type {[string, BrowserContextOptions][]} */
  const looks = [
    ["camera-light", { viewport: DESKTOP }],
    ["camera-dark", { viewport: DESKTOP, colorScheme: "dark" }],
    ["camera-phone", { viewport: PHONE, deviceScaleFactor: 2, hasTouch: true }],
  ];
  for (const [name, options] of looks) {
    test(`has no accessibility violation (${name}), and its picture is taken`, async (t) => {
      const { page } = await looking(t, options);
      await page.locator("#signal-left-db", { hasText: "dB" }).waitFor();
      await page.locator("#patches-image").waitFor();
      await page.locator("#camera-notice").waitFor({ state: "hidden" });
      await picture(page, name);
      assert.deepEqual(await violations(page), []);
      assert.equal(await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth), 0);
    });
  }
});
