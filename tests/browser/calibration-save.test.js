// The calibration view's way from opening to saving, and the map that follows.

import assert from "node:assert/strict";
import { describe, test } from "node:test";
import { violations } from "./axe.js";
import { DESKTOP, PHONE, colourAt, draws, picture, reaches, until } from "./browser.js";
import { calibrated, calibrating, checks, clientOf, drag, followTheSteps, handle, near, uncalibrated } from "./calibrating.js";
import { DOOR, corner, mark, seenAt } from "./camera.js";
import { calibration } from "./fit.js";
import { lit, middle, nearest, update } from "./scene.js";
import { visit } from "./visit.js";

/** @import { BrowserContextOptions, Page } from "playwright-core" */
/** @import { Calibration } from "../../web/types.js" */

/** @param {Page} page */
const save = (page) => page.getByRole("button", { name: "Save", exact: true });

/** @param {Page} page @param {RegExp | string} why */
const notSaved = (page, why) => page.locator("#cal-save-reason", { hasText: why }).waitFor();

describe("a camera that is not calibrated", () => {
  test("opens the calibration by itself and leads to a live map", async (t) => {
    const { mock, page, complaints } = await visit(t, {}, uncalibrated);
    await page.locator("#cal-welcome", { hasText: "Show doorcam where the door is." }).waitFor();
    assert.match(page.url(), /#calibrate$/);
    assert.equal(mock.requests.some((path) => path.endsWith("/geometry")), false, "there is none to ask for");
    assert.equal(await page.evaluate(() => document.activeElement?.id), "cal-title");
    // A rectangle aligned with the door, of typical measures, until somebody says otherwise.
    const guess = await checks(mock, () => true, "the page's own guess");
    assert.deepEqual(guess.floor_points.map(({ floor_m }) => floor_m), [[-0.4, -0.1], [0.4, -0.1], [-0.4, -0.4], [0.4, -0.4]]);
    await notSaved(page, "Measure the door and type its width.");
    await page.getByLabel("Width of the opening").fill("0.85");
    await notSaved(page, "Type the thickness of the wall.");
    await page.getByLabel("Thickness of the wall").fill("0.12");
    await notSaved(page, "Put point L where it belongs");
    assert.equal(await save(page).getAttribute("aria-disabled"), "true");
    await followTheSteps(page);
    await notSaved(page, "Ready to save.");
    assert.equal(await page.locator(".steps > .done").count(), 4);
    await save(page).click();
    await page.locator("#map-view").waitFor();
    assert.doesNotMatch(page.url(), /calibrate/);

    const [body] = mock.calibration.put;
    assert.deepEqual(body.size, [640, 360]);
    assert.deepEqual(body.doorway, DOOR);
    assert.deepEqual([body.lens, body.transfer], [null, null]);
    for (const [index, place] of [corner(-1), corner(1), mark(-1), mark(1)].entries()) {
      const { pixel, floor_m } = body.floor_points[index];
      assert.deepEqual(floor_m, place);
      const [u, v] = seenAt(place);
      assert.ok(near(pixel[0], u, 0.8) && near(pixel[1], v, 0.8), `${pixel} for ${[u, v]}`);
    }
    // The map is that of the new geometry.
    await until(() => mock.requests.some((path) => path.endsWith("/geometry")), "the geometry is asked for");
    const index = nearest(mock.geometry, -0.6, 1.2);
    mock.send(update(1, [lit(index, [0.02, 0, 0])], { calibration: 1 }));
    await reaches(page, "live");
    await draws(page, 1);
    assert.deepEqual(await colourAt(page, middle(mock.geometry, index)), [255, 0, 0]);
    assert.deepEqual(complaints, []);
  });

  test("lets its reader go to the map, which says what is missing, and does not insist", async (t) => {
    const { mock, page, complaints } = await visit(t, {}, (mock) => {
      uncalibrated(mock);
      mock.calibration.delayMs = 400;
    });
    // The answer comes when the picture that it is for is hidden.
    await until(() => mock.calibration.checked.length > 0, "the page's guess is checked");
    await page.getByText("Back to the map").click();
    await page.locator("#map-notice", { hasText: "Not calibrated: nobody has said yet where the door is" }).waitFor();
    assert.deepEqual([await page.locator("#model").innerText(), await page.locator("#lambda").innerText()], ["\u2013", "\u2013"]);
    await page.waitForTimeout(2500);
    assert.equal(await page.locator("#map-view").isVisible(), true);
    assert.equal(await page.getByRole("button", { name: "Reset background" }).getAttribute("aria-disabled"), "true");
    await page.getByRole("link", { name: "Calibrate" }).click();
    await page.locator("#cal-welcome").waitFor();
    await page.goBack();
    await page.locator("#map-view").waitFor();
    assert.equal(await page.evaluate(() => document.activeElement?.id), "to-calibration");
    assert.deepEqual(complaints, []);
  });
});

describe("saving", () => {
  test("says that the one before is kept, and brings it back", async (t) => {
    const { mock, page, complaints } = await calibrating(t, {}, (mock) => {
      calibrated(mock);
      mock.calibration.before = null;
      const lens = { k1: -0.1, k2: 0.01, focal_px: 640 };
      mock.calibration.inUse = { .../** @type {Calibration} */ (mock.calibration.inUse), lens, transfer: { gamma: 2.2 } };
    });
    const first = mock.calibration.inUse;
    await notSaved(page, "Nothing has changed.");
    assert.equal(await page.getByRole("button", { name: "Use the previous one" }).isVisible(), false);
    await handle(page, "L").press("Alt+ArrowRight");
    await page.getByText("Lens and light").click();
    await page.getByLabel("Distortion k1").fill("-0.12");
    await notSaved(page, "Ready to save.");
    await save(page).press("Enter");
    await page.locator("#cal-saved", { hasText: "Saved: the map uses it from now on. The one before is kept." }).waitFor();
    const [body] = mock.calibration.put;
    assert.ok(near(body.floor_points[0].pixel[0] - (first?.floor_points[0].pixel[0] ?? 0), 0.1, 0.001));
    // What the page does not know of stays what it was.
    assert.deepEqual([body.lens, body.transfer], [{ k1: -0.12, k2: 0.01, focal_px: 640 }, { gamma: 2.2 }]);
    await notSaved(page, "Nothing has changed.");
    assert.equal(await page.evaluate(() => document.activeElement?.id), "cal-save", "the keyboard stays where it was");
    await page.getByRole("button", { name: "Use the previous one" }).click();
    await page.locator("#cal-saved", { hasText: "The previous calibration is in use again." }).waitFor();
    assert.deepEqual(mock.calibration.inUse, first);
    assert.equal(await page.getByLabel("Left door corner, u, pixels").inputValue(), String(first?.floor_points[0].pixel[0]));
    assert.deepEqual(complaints, []);
  });

  test("shows why it is refused, and keeps what was made", async (t) => {
    const { mock, page } = await calibrating(t);
    await handle(page, "5").press("ArrowLeft");
    await notSaved(page, "Ready to save.");
    mock.refusal = "calibration.toml: the disk is full";
    await save(page).click();
    await page.getByRole("alert").filter({ hasText: "Not saved: calibration.toml: the disk is full" }).waitFor();
    await notSaved(page, "Ready to save.");
    mock.refusal = null;
    await save(page).click();
    await page.locator("#cal-saved", { hasText: "Saved" }).waitFor();
    assert.equal(await page.locator("#cal-refused").innerText(), "");
    assert.equal(mock.calibration.put.length, 1);
  });

  test("is not forgotten: changes are dropped only by somebody who says so", async (t) => {
    const { mock, page, complaints } = await visit(t, {}, calibrated);
    await page.getByRole("link", { name: "Calibrate" }).click();
    await page.locator("#cal-overlay .area").first().waitFor({ state: "attached" });
    const [u] = mock.calibration.inUse?.floor_points[0].pixel ?? [0];
    const shown = page.getByLabel("Left door corner, u, pixels");
    await handle(page, "L").press("Shift+ArrowRight");
    const dialog = page.getByRole("dialog", { name: "Drop your changes?" });
    for (const leave of [() => page.getByText("Back to the map").click(), () => page.goBack()]) {
      await leave();
      await dialog.waitFor();
      assert.deepEqual(await violations(page), []);
      await page.getByRole("button", { name: "Keep editing" }).click();
      await dialog.waitFor({ state: "hidden" });
      assert.match(page.url(), /#calibrate$/);
      assert.ok(near(Number(await shown.inputValue()), u + 10));
    }
    // Closing the window asks as well, in the browser's own words.
    const asked = page.waitForEvent("dialog");
    const closing = page.close({ runBeforeUnload: true });
    const question = await asked;
    assert.equal(question.type(), "beforeunload");
    await question.dismiss();
    await closing;
    await page.getByRole("button", { name: "Discard changes" }).click();
    await page.getByRole("button", { name: "Drop the changes" }).click();
    await page.locator("#cal-saved", { hasText: "Your changes are gone." }).waitFor();
    assert.ok(near(Number(await shown.inputValue()), u));
    await handle(page, "L").press("ArrowRight");
    await page.getByText("Back to the map").click();
    await page.getByRole("button", { name: "Drop the changes" }).click();
    await page.locator("#map-view").waitFor();
    assert.deepEqual(mock.calibration.put, []);
    assert.deepEqual(complaints, []);
  });

  test("by somebody else is followed, or told of to one who has changes", async (t) => {
    const { mock, page } = await calibrating(t);
    const shown = page.getByLabel("Point 5, u, pixels");
    const elsewhere = async (/** @type {number} */ off) => {
      mock.calibration.inUse = calibration({ extra: [[0, -0.6]], off: [off, 0] });
      mock.status.calibration_revision += 1;
      mock.geometry = { ...mock.geometry, calibration: mock.status.calibration_revision };
      return String(mock.calibration.inUse.floor_points[4].pixel[0]);
    };
    // The page has to have seen the count before it can see it rise.
    await page.waitForTimeout(2500);
    const wanted = await elsewhere(1);
    await until(async () => (await shown.inputValue()) === wanted, "the other's");
    await page.waitForFunction((value) => /** @type {HTMLInputElement} */ (document.querySelector("[aria-label='Point 5, u, pixels']")).value === value, wanted);
    await handle(page, "L").press("ArrowRight");
    await elsewhere(2);
    await page.locator("#cal-note", { hasText: "Somebody else has saved a calibration" }).waitFor();
    assert.equal(await shown.inputValue(), wanted, "not taken away");
  });

  test("is impossible where the calibration is not the page's to change, with the reason", async (t) => {
    const { mock, page, complaints } = await calibrating(t, {}, (mock) => {
      calibrated(mock);
      mock.calibration.editable = false;
      mock.calibration.reason = "The recording brings its own calibration.";
    });
    await page.locator("#cal-note", { hasText: "The recording brings its own calibration." }).waitFor();
    assert.equal(await save(page).isVisible(), false);
    assert.equal(await page.getByLabel("Width of the opening").isDisabled(), true);
    const before = await handle(page, "L").textContent();
    await handle(page, "L").press("ArrowRight");
    await drag(page, "L", [300, 300]);
    assert.equal(await handle(page, "L").textContent(), before);
    assert.equal(await page.locator("#cal-loupe").isVisible(), true, "looking closely is always possible");
    assert.deepEqual(mock.calibration.checked, []);
    assert.deepEqual(await violations(page), []);
    assert.deepEqual(complaints, []);
  });

  test("is no question for a source without a camera picture", async (t) => {
    const { mock, page, complaints } = await visit(t, {}, (mock) => {
      Object.assign(mock.calibration, { editable: false, reason: "The recording holds patches, not a camera's pictures.", size: null });
    }, "#calibrate");
    await page.locator("#cal-note", { hasText: "The recording holds patches" }).waitFor();
    await page.locator("#cal-notice", { hasText: "There is no camera picture" }).waitFor();
    assert.equal(await page.locator("#cal-steps").isVisible(), false);
    assert.equal(mock.requests.some((path) => path.endsWith("frame.jpg")), false);
    assert.deepEqual(await violations(page), []);
    assert.deepEqual(complaints, []);
  });
});

describe("everyone", () => {
  /** @type {[string, BrowserContextOptions][]} */
  const looks = [
    ["light", { viewport: DESKTOP, colorScheme: "light" }],
    ["dark", { viewport: DESKTOP, colorScheme: "dark" }],
    ["wide", { viewport: { width: 1920, height: 1000 }, colorScheme: "light", reducedMotion: "reduce" }],
    ["phone", { viewport: PHONE, colorScheme: "light", deviceScaleFactor: 2, hasTouch: true }],
    ["phone-dark", { viewport: { width: 360, height: 740 }, colorScheme: "dark", deviceScaleFactor: 2, hasTouch: true }],
  ];
  for (const [name, options] of looks) {
    test(`can calibrate without an accessibility violation (${name}), and its picture is taken`, async (t) => {
      const { mock, page, complaints } = await visit(t, options, uncalibrated);
      await page.locator("#cal-overlay .area").first().waitFor({ state: "attached" });
      await page.locator("#cal-notice").waitFor({ state: "hidden" });
      assert.deepEqual(await violations(page), [], "as it opens");
      await picture(page, `calibration-${name}-first`);
      // A fifth and sixth point, two pixels off: their residuals are seen.
      mock.calibration.inUse = calibration({ extra: [[0.05, -0.62], [-0.2, -0.55]], off: [4, -3] });
      mock.calibration.before = calibration();
      mock.status.calibrated = true;
      await page.reload();
      await page.locator("#cal-overlay .residual").first().waitFor({ state: "attached" });
      await handle(page, "4").press("Alt+ArrowRight");
      await notSaved(page, "Ready to save.");
      assert.deepEqual(await violations(page), [], "with residuals");
      const room = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
      assert.equal(room, 0, "no sideways scrolling");
      await picture(page, `calibration-${name}`);
      await drag(page, "5", await clientOf(page, [250, 330]));
      await page.locator("#cal-errors").waitFor();
      assert.deepEqual(await violations(page), [], "with an error");
      await picture(page, `calibration-${name}-error`);
      assert.deepEqual(complaints, []);
    });
  }
});
