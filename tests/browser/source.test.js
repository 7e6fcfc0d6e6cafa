// What the page says of its source when that is a camera, and the background's reset.

import assert from "node:assert/strict";
import { describe, test } from "node:test";
import { DESKTOP, PHONE, picture, reaches, until } from "./browser.js";
import { violations } from "./axe.js";
import { cameraStatus, twoPeople, update } from "./scene.js";
import { visit } from "./visit.js";

/** @import { Mock } from "./mock.js" */
/** @import { SourceState } from "../../web/types.js" */

/** @param {Mock} mock */
const onCamera = (mock) => {
  mock.status = cameraStatus();
};

describe("source", () => {
  /** @type {[SourceState, string, RegExp, RegExp][]} */
  const troubles = [
    ["stalled", "no frame for 3.2 s", /^The camera has stopped sending pictures · last update \d+ s ago$/, /No frame for 3\.2 s\. It is given a moment, then opened anew/],
    ["lost", "/dev/video0: no such device", /^The camera is gone · last update \d+ s ago$/, /\/dev\/video0: no such device\. Check its cable and plug it in again/],
    ["backing-off", "device or resource busy", /^The camera could not be opened · last update \d+ s ago$/, /Device or resource busy\. It is tried again by itself/],
    ["failed", "not a capture device", /^Source failed: not a capture device · last update \d+ s ago$/, /^Source failed: not a capture device\. It is not tried again: .*restart doorcam/],
  ];
  for (const [state, error, notice, advice] of troubles) {
    test(`says what is wrong and what to do when it is ${state}`, async (t) => {
      const { mock, page, complaints } = await visit(t, {}, onCamera);
      mock.send(update(1, []));
      await reaches(page, "live");
      assert.equal(await page.locator("#source-trouble").isVisible(), false);
      mock.status.source = { ...mock.status.source, state, error };
      await page.locator("#map-notice", { hasText: notice }).waitFor();
      await reaches(page, "stale");
      assert.match(await page.locator("#source-trouble").innerText(), advice);
      // It comes back by itself, and nothing is left of it.
      mock.status.source = { ...mock.status.source, state: "streaming", error: null };
      const stream = setInterval(() => mock.send(update((mock.latest?.sequence ?? 0) + 1, [])), 200);
      t.after(() => clearInterval(stream));
      await reaches(page, "live");
      await page.locator("#source-trouble").waitFor({ state: "hidden" });
      assert.deepEqual(complaints, []);
    });
  }

  test("says that nobody is there only while it is watching", async (t) => {
    const { mock, page, complaints } = await visit(t, {}, onCamera);
    const nobody = (/** @type {string} */ words) => page.locator("#tracks-none", { hasText: words }).waitFor();
    await nobody("Not watching");
    mock.send(update(1, []));
    await reaches(page, "live");
    await nobody("Nobody is seen right now.");
    const since = "2026-11-29T12:00:00Z";
    mock.status.watching = { watching: false, reason: "no-camera", since, until: null };
    mock.status.state = "stale";
    await reaches(page, "stale");
    await nobody("Not watching: the camera is gone.");
    assert.equal(await page.locator("#watch-state").isVisible(), false);
    mock.status.watching = { watching: false, reason: "learning", since, until: null };
    mock.status.state = "learning";
    const stream = setInterval(() => mock.send(update((mock.latest?.sequence ?? 0) + 1, [], { state: "learning" })), 200);
    t.after(() => clearInterval(stream));
    await nobody("Not watching: the empty room is being learned.");
    await page.locator("#watch-state", { hasText: "Learning the background" }).waitFor();
    assert.deepEqual(complaints, []);
  });

  test("says how other systems are told of what happens, where there are any", async (t) => {
    const { mock, page, complaints } = await visit(t, {});
    mock.send(update(1, []));
    await reaches(page, "live");
    assert.equal(await page.locator("#broker, #hooks").filter({ visible: true }).count(), 0);
    const hook = (/** @type {number} */ dead, /** @type {string | null} */ error) => ({ url: "https://example.org/...", waiting: 1, delivered: 20, dead, error });
    mock.status.publish = {
      mqtt: { state: "connecting", broker: "mqtt://hub:1883", topic: "doorcam/hall", error: "Connection refused" },
      webhooks: [hook(0, null), hook(2, "it answered 404 Not Found")],
    };
    await page.locator("#broker", { hasText: "Connection refused" }).waitFor();
    assert.equal(await page.locator("#hooks").innerText(), "40 delivered, 2 waiting, 2 given up; it answered 404 Not Found");
    mock.status.publish = { mqtt: { state: "connected", broker: "mqtt://hub:1883", topic: "doorcam/hall", error: null }, webhooks: [] };
    await page.locator("#broker", { hasText: "connected, doorcam/hall" }).waitFor();
    assert.equal(await page.locator("#hooks").isVisible(), false);
    assert.deepEqual(complaints, []);
  });

  test("says before the first picture that the camera is not there", async (t) => {
    const { mock, page, complaints } = await visit(t, {}, (mock) => {
      onCamera(mock);
      mock.status.source = { ...mock.status.source, state: "backing-off", error: "no such device", granted: null };
    });
    await reaches(page, "waiting");
    await page.locator("#map-notice", { hasText: /^The camera could not be opened$/ }).waitFor();
    assert.equal(await page.locator("#source-state").innerText(), "Waiting before another try");
    assert.equal(await page.locator("#granted").isVisible(), false);
    mock.status.source.state = /** @type {any} */ ("defrosting");
    await page.locator("#source-state", { hasText: "defrosting" }).waitFor();
    assert.deepEqual(complaints, []);
  });

  test("shows what the camera gives, where it does not do as asked, and what it lost", async (t) => {
    const { page } = await visit(t, {}, (mock) => {
      onCamera(mock);
      mock.status.frames.lost = 12;
      const { granted } = mock.status.source;
      if (granted) granted.mismatches = ["exposure: asked for 156, the camera has 312", "format: asked for YUYV, granted MJPG"];
    });
    await page.locator("#mismatches").waitFor();
    assert.deepEqual(await page.locator("#mismatch-list li").allInnerTexts(), [
      "exposure: asked for 156, the camera has 312",
      "format: asked for YUYV, granted MJPG",
    ]);
    assert.equal(await page.locator("#lost").innerText(), "12");
    assert.equal(await page.locator("#camera").innerText(), "Example Webcam C270, /dev/video0");
    assert.equal(await page.locator("#granted").innerText(), "YUYV 640 × 360, 30 a second");
    assert.equal(await page.locator("#background").innerText(), "from 200 frames, 5 min old");
  });

  for (const [name, options] of /** @type {const} */ ([
    ["source-stalled", { viewport: DESKTOP }],
    ["source-stalled-dark", { viewport: DESKTOP, colorScheme: "dark" }],
    ["source-stalled-phone", { viewport: PHONE, deviceScaleFactor: 2, hasTouch: true }],
  ])) {
    test(`has its picture taken (${name})`, async (t) => {
      const { mock, page, complaints } = await visit(t, options, onCamera);
      mock.send(twoPeople(mock.geometry, 30));
      await reaches(page, "live");
      mock.status.frames.lost = 12;
      const granted = mock.status.source.granted && { ...mock.status.source.granted, mismatches: ["exposure: asked for 156, the camera has 312"] };
      mock.status.source = { ...mock.status.source, state: "stalled", error: "no frame for 3.2 s", granted };
      await page.locator("#source-trouble").waitFor();
      await reaches(page, "stale");
      await picture(page, name);
      assert.deepEqual(await violations(page), []);
      assert.deepEqual(complaints, []);
    });
  }
});

describe("background", () => {
  test("is reset by a button that says what came of it", async (t) => {
    const { mock, page, complaints } = await visit(t, {}, onCamera);
    mock.send(update(1, []));
    await reaches(page, "live");
    const button = page.getByRole("button", { name: "Reset background" });
    await button.press("Enter");
    await page.locator("#reset-outcome", { hasText: "is being learned anew" }).waitFor();
    assert.equal(mock.resets, 1);
    mock.send(update(2, [], { state: "learning" }));
    await page.locator("#watch-state", { hasText: "Learning the background" }).waitFor();
    mock.send(update(3, []));
    await page.locator("#reset-outcome", { hasText: "has been learned anew" }).waitFor();
    assert.equal(await page.evaluate(() => document.activeElement?.id), "reset-background", "the keyboard stays where it was");
    assert.deepEqual(complaints, []);
  });

  test("says why it was not reset", async (t) => {
    const { mock, page } = await visit(t, {}, onCamera);
    mock.send(update(1, []));
    await reaches(page, "live");
    mock.refusal = "a recording's background is its own";
    await page.getByRole("button", { name: "Reset background" }).click();
    await page.locator("#reset-outcome.failed", { hasText: "not reset: a recording's background is its own." }).waitFor();
  });

  test("cannot be reset without a connection", async (t) => {
    const { mock, page } = await visit(t, {}, onCamera);
    mock.send(update(1, []));
    await reaches(page, "live");
    const button = page.getByRole("button", { name: "Reset background" });
    assert.equal(await button.getAttribute("aria-disabled"), "false");
    await mock.stop();
    await reaches(page, "reconnecting");
    assert.equal(await button.getAttribute("aria-disabled"), "true");
    await button.click({ force: true });
    await mock.start();
    await until(() => mock.requests.filter((path) => path.endsWith("/status")).length > 1, "the page is back");
    assert.equal(mock.resets, 0);
  });
});
