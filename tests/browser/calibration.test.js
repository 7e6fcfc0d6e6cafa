// The calibration view: points moved by mouse, finger and keyboard, and what is drawn of them.

import assert from "node:assert/strict";
import { describe, test } from "node:test";
import { DESKTOP, PHONE, settled, until } from "./browser.js";
import { calibrated, calibrating, checks, clientOf, drag, handle, middleOf, near } from "./calibrating.js";
import { mark, seenAt } from "./camera.js";
import { check } from "./fit.js";
import { visit } from "./visit.js";

/** @import { Page } from "playwright-core" */
/** @import { Calibration, Pixel } from "../../web/types.js" */

/** CSS pixels a picture pixel. @param {Page} page */
const scaleOf = async (page) => {
  const [[x0], [x1]] = [await clientOf(page, [0, 0]), await clientOf(page, [100, 0])];
  return (x1 - x0) / 100;
};

/** @param {Calibration} body @param {number} index @param {Pixel} pixel @param {number} [within] */
const isAt = (body, index, [u, v], within = 0.02) => {
  const { pixel } = body.floor_points[index];
  return near(pixel[0], u, within) && near(pixel[1], v, within);
};

describe("points", () => {
  test("follow the mouse, and more finely with Shift", async (t) => {
    const { mock, page, complaints } = await calibrating(t);
    const before = mock.calibration.inUse?.floor_points[2].pixel ?? [0, 0];
    const scale = await scaleOf(page);
    const [x, y] = await middleOf(page, "3");
    // Grabbed beside its middle: it does not jump there.
    await page.mouse.move(x + 9, y - 7);
    await page.mouse.down();
    await page.mouse.move(x + 49, y + 13, { steps: 5 });
    const [u, v] = [before[0] + 40 / scale, before[1] + 20 / scale];
    await checks(mock, (body) => isAt(body, 2, [u, v]), "the point is where the mouse took it");
    assert.equal(await page.locator("#cal-loupe").isVisible(), true);
    await page.keyboard.down("Shift");
    await page.mouse.move(x + 65, y + 13, { steps: 4 });
    await page.keyboard.up("Shift");
    await page.mouse.up();
    await checks(mock, (body) => isAt(body, 2, [u + 2 / scale, v]), "an eighth of the way");
    // Nothing else has moved.
    const last = mock.calibration.checked.at(-1);
    [0, 1, 3, 4].forEach((index) => assert.deepEqual(last?.floor_points[index], mock.calibration.inUse?.floor_points[index]));
    assert.deepEqual(complaints, []);
  });

  test("go back on Escape and stay inside the picture", async (t) => {
    const { mock, page } = await calibrating(t);
    const before = /** @type {Pixel} */ (mock.calibration.inUse?.floor_points[0].pixel);
    await page.mouse.move(...(await middleOf(page, "L")));
    await page.mouse.down();
    await page.mouse.move(1, 400, { steps: 3 });
    await checks(mock, (body) => body.floor_points[0].pixel[0] === -0.5, "at the picture's border");
    await page.keyboard.press("Escape");
    await checks(mock, (body) => isAt(body, 0, before), "back");
    await page.mouse.move(300, 300);
    await page.mouse.up();
    await page.waitForTimeout(200);
    await checks(mock, (body) => isAt(body, 0, before), "still there");
  });

  test("follow a finger", async (t) => {
    const { mock, page, complaints } = await calibrating(t, { viewport: PHONE, deviceScaleFactor: 2, hasTouch: true });
    const before = mock.calibration.inUse?.floor_points[3].pixel ?? [0, 0];
    const scale = await scaleOf(page);
    const [x, y] = await middleOf(page, "4");
    const box = await handle(page, "4").boundingBox();
    assert.ok(box && box.width >= 44 && box.height >= 44, "large enough for a finger");
    const touch = await page.context().newCDPSession(page);
    const send = (/** @type {"touchStart" | "touchMove" | "touchEnd"} */ type, /** @type {{ x: number, y: number }[]} */ touchPoints) =>
      touch.send("Input.dispatchTouchEvent", { type, touchPoints });
    await send("touchStart", [{ x: x + 12, y: y + 10 }]);
    for (let step = 1; step <= 6; step += 1) await send("touchMove", [{ x: x + 12 - 8 * step, y: y + 10 - 3 * step }]);
    const [u, v] = [before[0] - 48 / scale, before[1] - 18 / scale];
    await checks(mock, (body) => isAt(body, 3, [u, v], 0.05), "the point is where the finger took it");
    assert.equal(await page.locator("#cal-loupe").isVisible(), true, "the finger hides what it points at");
    await send("touchEnd", []);
    // Then finely, by pushing the picture under the magnifier's cross.
    const loupe = await page.locator("#cal-loupe").boundingBox();
    const [lx, ly] = [(loupe?.x ?? 0) + 40, (loupe?.y ?? 0) + 40];
    await send("touchStart", [{ x: lx, y: ly }]);
    for (let step = 1; step <= 4; step += 1) await send("touchMove", [{ x: lx + step, y: ly - 2 * step }]);
    await send("touchEnd", []);
    await checks(mock, (body) => isAt(body, 3, [u - 0.5, v + 1], 0.05), "an eighth of the finger's way, the other way round");
    assert.deepEqual(complaints, []);
  });

  test("follow the arrow keys, and say where they are", async (t) => {
    const { mock, page, complaints } = await calibrating(t);
    await page.locator("#cal-title").focus();
    const names = [];
    for (let press = 0; press < 9; press += 1) {
      await page.keyboard.press("Tab");
      names.push(await page.evaluate(() => document.activeElement?.textContent));
    }
    assert.deepEqual(names.slice(4).map((name) => name?.split(", ")[0]), ["L left door corner", "R right door corner", "3 left mark", "4 right mark", "5 point"]);
    await handle(page, "R").focus();
    const [u, v] = mock.calibration.inUse?.floor_points[1].pixel ?? [0, 0];
    await page.keyboard.press("ArrowRight");
    await page.keyboard.press("ArrowDown");
    await checks(mock, (body) => isAt(body, 1, [u + 1, v + 1], 0.001), "one pixel");
    await page.keyboard.press("Shift+ArrowLeft");
    await checks(mock, (body) => isAt(body, 1, [u - 9, v + 1], 0.001), "ten pixels");
    await page.keyboard.press("Alt+ArrowUp");
    await page.keyboard.press("Control+ArrowUp");
    await checks(mock, (body) => isAt(body, 1, [u - 9, v + 0.8], 0.001), "a tenth of one, twice");
    assert.match(page.url(), /#calibrate$/, "Alt with an arrow does not leave the page");
    await page.locator("#cal-spoken", { hasText: /Error .* px|pixels from where/ }).waitFor({ state: "attached" });
    const name = await handle(page, "R").textContent();
    assert.ok(name?.startsWith(`R right door corner, u ${(u - 9).toFixed(1)}, v ${(v + 0.8).toFixed(1)}, residual `), `${name}`);
    assert.deepEqual(complaints, []);
  });

  test("show under the magnifier what they are on", async (t) => {
    const { page } = await calibrating(t);
    // The middle of a blue cross of tape.
    await handle(page, "3").focus();
    await page.locator("#cal-loupe").waitFor();
    await settled(page);
    const colour = await page.evaluate(() => {
      const loupe = /** @type {HTMLCanvasElement} */ (document.getElementById("cal-loupe"));
      const probe = new OffscreenCanvas(1, 1).getContext("2d");
      probe?.drawImage(loupe, -(loupe.width / 2 - 1), -(loupe.height / 2 - 1));
      return [...(probe?.getImageData(0, 0, 1, 1).data ?? [])];
    });
    assert.ok(colour[2] > 150 && colour[0] < 90, `blue tape, got ${colour}`);
    await page.locator("#cal-title").click();
    await page.locator("#cal-loupe").waitFor({ state: "hidden" });
  });

  test("can be typed, added and removed", async (t) => {
    const { mock, page, complaints } = await calibrating(t);
    await page.getByLabel("Left mark, u, pixels").fill("150.25");
    await page.getByLabel("Left mark, v, pixels").fill("201");
    await checks(mock, (body) => isAt(body, 2, [150.25, 201], 0), "typed pixels");
    await page.getByLabel("Point 5, x, metres").fill("-0.25");
    await page.getByLabel("Point 5, y, metres").fill("-0.505");
    await checks(mock, (body) => String(body.floor_points[4].floor_m) === "-0.25,-0.505", "typed metres");
    await page.getByRole("button", { name: "Add a point" }).click();
    const body = await checks(mock, ({ floor_points }) => floor_points.length === 6, "a sixth point");
    assert.equal(body.floor_points[5].floor_m[1], -0.42);
    assert.equal(await page.evaluate(() => document.activeElement?.textContent?.split(",")[0]), "6 point");
    await page.locator("#cal-save-reason", { hasText: "Put point 6 where it belongs" }).waitFor();
    await page.getByRole("button", { name: "Remove point 5" }).click();
    await page.keyboard.press("Tab");
    await handle(page, "5").focus();
    await page.keyboard.press("Delete");
    await checks(mock, ({ floor_points }) => floor_points.length === 4, "the two are gone");
    assert.equal(await page.getByRole("button", { name: "Remove left mark" }).isDisabled(), true, "four are needed");
    assert.equal(await page.getByRole("button", { name: "Remove left door corner" }).count(), 0);
    assert.deepEqual(complaints, []);
  });

  test("at the corners and marks follow the door's measures", async (t) => {
    const { mock, page, complaints } = await calibrating(t);
    await page.getByLabel("Width of the opening").fill("1.01");
    await page.getByLabel("Thickness of the wall").fill("0.2");
    await page.getByLabel("Marks out from the wall").fill("0.5");
    const body = await checks(mock, ({ floor_points }) => floor_points[3].floor_m[1] === -0.7, "the door's measures");
    assert.deepEqual(body.floor_points.map(({ floor_m }) => floor_m), [[-0.505, -0.2], [0.505, -0.2], [-0.505, -0.7], [0.505, -0.7], [0, -0.6]]);
    assert.deepEqual(body.doorway, { width_m: 1.01, wall_thickness_m: 0.2, height_m: 2.03 });
    // A mark with a place of its own stays there.
    await page.getByLabel("Left mark, y, metres").fill("-0.66");
    await page.getByLabel("Thickness of the wall").fill("0.1");
    await checks(mock, ({ floor_points }) => String(floor_points[2].floor_m) === "-0.505,-0.66" && floor_points[3].floor_m[1] === -0.6, "its own place");
    // What is out of range is said, not sent.
    await page.getByLabel("Width of the opening").fill("85");
    assert.equal(await page.locator("#cal-width-problem").innerText(), "The width of the opening must be a number from 0.2 to 5 m.");
    assert.equal(await page.getByLabel("Width of the opening").getAttribute("aria-invalid"), "true");
    assert.match(await page.locator("#cal-save-reason").innerText(), /^The width of the opening must be/);
    await page.getByLabel("Point 5, u, pixels").fill("900");
    assert.equal(await page.locator("#cal-points-problem").innerText(), "Point 5, u, must be a number from \u22120.5 to 639.5 pixels.");
    await page.waitForTimeout(300);
    assert.ok(mock.calibration.checked.every((sent) => sent.doorway.width_m < 2 && sent.floor_points[4].pixel[0] < 640));
    await page.getByLabel("Width of the opening").fill("0.9");
    await page.getByLabel("Point 5, u, pixels").fill("320");
    await page.locator("#cal-points-problem").waitFor({ state: "hidden" });
    assert.equal(await page.locator("#cal-width-problem").isVisible(), false);
    assert.deepEqual(complaints, []);
  });
});

describe("overlay", () => {
  /**
   * The corners of a drawn shape, in CSS pixels of the window.
   * @param {Page} page
   * @param {string} selector
   * @returns {Promise<[number, number][]>}
   */
  const drawn = (page, selector) =>
    page.locator(selector).first().evaluate((/** @type {SVGPolylineElement} */ shape) => {
      const matrix = shape.getScreenCTM();
      return [...shape.points].map((point) => {
        const { x, y } = point.matrixTransform(matrix ?? undefined);
        return [x, y];
      });
    });

  test("lies where the check says, at every zoom", async (t) => {
    const { mock, page, complaints } = await calibrating(t);
    const { overlay } = check(/** @type {Calibration} */ (mock.calibration.inUse));
    assert.ok(overlay);
    for (const zoom of ["fit", "in", "in"]) {
      await page.locator(`#cal-zoom-${zoom}`).click();
      for (const [selector, pixels] of /** @type {[string, Pixel[]][]} */ ([
        [".patch-left", overlay.patches.left],
        [".patch-right", overlay.patches.right],
        [".door", overlay.door_line],
        [".grid", overlay.grid[0]],
      ])) {
        const points = await drawn(page, `#cal-overlay ${selector}`);
        assert.equal(points.length, pixels.length);
        for (const index of [0, pixels.length - 1]) {
          const [x, y] = await clientOf(page, pixels[index]);
          assert.ok(near(points[index][0], x, 0.5) && near(points[index][1], y, 0.5), `${selector} ${index}: ${points[index]} for ${[x, y]}`);
        }
      }
      // The handles too, and the picture under them.
      const [x, y] = await middleOf(page, "4");
      const [wantedX, wantedY] = await clientOf(page, seenAt(mark(1)));
      assert.ok(near(x, wantedX, 0.6) && near(y, wantedY, 0.6));
    }
    assert.ok((await scaleOf(page)) > 2, "zoomed");
    assert.deepEqual(complaints, []);
  });

  test("is zoomed around the chosen point, by buttons and keys", async (t) => {
    const { page, complaints } = await calibrating(t);
    const fit = await scaleOf(page);
    await handle(page, "R").focus();
    const [x, y] = await middleOf(page, "R");
    await page.locator("#cal-zoom-in").click();
    await page.keyboard.press("+");
    assert.ok(near(await scaleOf(page), 2.25 * fit, 0.01));
    const [nowX, nowY] = await middleOf(page, "R");
    assert.ok(near(nowX, x, 2) && near(nowY, y, 2), `${[nowX, nowY]} for ${[x, y]}`);
    assert.equal(await page.locator("#cal-loupe").isVisible(), true, "still chosen");
    await page.keyboard.press("0");
    assert.ok(near(await scaleOf(page), fit, 0.01));
    assert.deepEqual(complaints, []);
  });

  test("shows the residuals, enlarged and in numbers, as a point is dragged", async (t) => {
    const { mock, page, complaints } = await calibrating(t);
    const [x, y] = await middleOf(page, "5");
    await page.mouse.move(x, y);
    await page.mouse.down();
    const notes = new Set();
    for (let step = 1; step <= 4; step += 1) {
      await page.mouse.move(x + 3 * step, y);
      await until(() => mock.calibration.underWay === 0, "checked");
      await page.waitForTimeout(150);
      notes.add(await handle(page, "5").locator(".note").innerText());
    }
    assert.equal(notes.size, 4, `other numbers each time, while the button is down: ${[...notes]}`);
    await page.mouse.up();
    const body = /** @type {Calibration} */ (mock.calibration.checked.at(-1));
    const { points, error } = check(body);
    const [du, dv] = points[4].residual_px;
    await handle(page, "5").locator(".note", { hasText: `${Math.hypot(du, dv).toFixed(1)} px, ${Math.hypot(...(points[4].residual_mm ?? [])).toFixed(1)} mm` }).waitFor();
    const words = `Error ${error?.rms_px.toFixed(1)} px, ${error?.floor_mm?.toFixed(1)} mm on the floor, ${error?.angle_deg?.toFixed(1)}° in angle.`;
    assert.ok((await page.locator("#cal-summary").innerText()).startsWith(words), words);
    const times = Number(/(\d+) times/.exec(await page.locator("#cal-residuals").innerText())?.[1]);
    const lines = await page.locator("#cal-overlay .residual").count();
    assert.equal(lines, 5);
    const ends = await page.locator("#cal-overlay .residual").nth(4).evaluate((/** @type {SVGPolylineElement} */ line) => [...line.points].map(({ x, y }) => [x, y]));
    // A residual is measured from where the fit has the point: the line leads back there.
    assert.ok(near(ends[0][0] - ends[1][0], times * du) && near(ends[0][1] - ends[1][1], times * dv), `${ends} for ${times} times ${[du, dv]}`);
    assert.deepEqual(complaints, []);
  });

  test("asks one question at a time, and about the newest draft last", async (t) => {
    const { mock, page } = await calibrating(t);
    mock.calibration.delayMs = 250;
    const [x, y] = await middleOf(page, "5");
    const from = mock.calibration.checked.length;
    await page.mouse.move(x, y);
    await page.mouse.down();
    for (let step = 1; step <= 40; step += 1) {
      await page.mouse.move(x + step, y);
      await page.waitForTimeout(15);
    }
    await page.mouse.up();
    const last = mock.calibration.inUse?.floor_points[4].pixel ?? [0, 0];
    const scale = await scaleOf(page);
    await checks(mock, (body) => isAt(body, 4, [last[0] + 40 / scale, last[1]]), "the newest");
    assert.equal(mock.calibration.mostUnderWay, 1);
    assert.ok(mock.calibration.checked.length - from <= 10, `${mock.calibration.checked.length - from} questions for 40 movements`);
  });

  test("says in words what is wrong, and does not save it", async (t) => {
    const { mock, page, complaints } = await calibrating(t);
    // Left and right exchanged.
    const [left, right] = [await middleOf(page, "L"), await middleOf(page, "R")];
    await drag(page, "L", [right[0] - 40, right[1]]);
    await drag(page, "R", left);
    await page.locator("#cal-errors", { hasText: "Points show the floor mirrored" }).waitFor();
    const save = page.getByRole("button", { name: "Save" });
    await page.waitForFunction(() => /mirrored|put right/.test(document.getElementById("cal-save-reason")?.textContent ?? ""));
    assert.equal(await save.getAttribute("aria-disabled"), "true");
    await save.click({ force: true });
    await page.waitForTimeout(200);
    assert.deepEqual(mock.calibration.put, []);
    assert.deepEqual(complaints, []);
  });
});

describe("the camera's picture", () => {
  test("is fetched about four times a second, and is plainly old when it is", async (t) => {
    const { mock, page } = await calibrating(t, { viewport: DESKTOP });
    const frames = () => mock.requests.filter((path) => path.endsWith("frame.jpg")).length;
    const from = frames();
    await page.waitForTimeout(2000);
    const asked = frames() - from;
    assert.ok(asked >= 5 && asked <= 9, `asked ${asked} times in 2 s`);
    // The last picture, again and again, is no new one.
    mock.stoppedAt = new Date().toISOString();
    await page.locator("#cal-notice", { hasText: /^No new picture · picture \d+ s old$/ }).waitFor();
    mock.stoppedAt = null;
    await page.locator("#cal-notice").waitFor({ state: "hidden" });
    mock.frame = null;
    await page.locator("#cal-notice", { hasText: /^No new picture · picture \d+ s old$/ }).waitFor();
    mock.status.source = { ...mock.status.source, kind: "v4l2", state: "lost", error: "no such device" };
    await page.locator("#cal-notice", { hasText: "The camera is gone" }).waitFor();
    await page.locator("#source-trouble", { hasText: "plug it in again" }).waitFor();
    await page.getByText("Back to the map").click();
    await page.locator("#map").waitFor();
    await page.waitForTimeout(500);
    const then = frames();
    await page.waitForTimeout(700);
    assert.equal(frames(), then, "not fetched when nobody looks");
  });

  test("is waited for, and its change of size is followed", async (t) => {
    const { mock, page, complaints } = await visit(t, {}, (mock) => {
      calibrated(mock);
      mock.calibration.size = null;
    }, "#calibrate");
    await page.locator("#cal-notice", { hasText: "Waiting for the camera's first picture" }).waitFor();
    assert.equal(mock.requests.some((path) => path.endsWith("frame.jpg")), false);
    mock.calibration.size = [640, 360];
    const made = /** @type {Calibration} */ (mock.calibration.inUse);
    mock.calibration.inUse = { ...made, size: [1280, 720], floor_points: made.floor_points.map(({ pixel: [u, v], floor_m }) => ({ pixel: [2 * u + 0.5, 2 * v + 0.5], floor_m })) };
    await page.locator("#cal-note", { hasText: "640 × 360 pixels now, and the calibration was made for 1280 × 720" }).waitFor();
    const body = await checks(mock, ({ size }) => size[0] === 640, "the picture's own size");
    assert.ok(isAt(body, 0, made.floor_points[0].pixel, 0.01), "the points are where they were on the floor");
    await page.locator("#cal-save-reason", { hasText: "Ready to save" }).waitFor();
    assert.deepEqual(complaints, []);
  });
});
