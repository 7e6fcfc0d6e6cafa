// The zones editor: drawn on the live map by mouse, finger and keys, undone, named, saved.

import assert from "node:assert/strict";
import { describe, test } from "node:test";
import { violations } from "./axe.js";
import { DESKTOP, PHONE, colourAt, draws, picture, reaches, settled } from "./browser.js";
import { twoPeople, update } from "./scene.js";
import { visit } from "./visit.js";

/** @import { TestContext } from "node:test" */
/** @import { BrowserContextOptions, Page } from "playwright-core" */
/** @import { Mock } from "./mock.js" */
/** @import { Point, Zone } from "../../web/types.js" */

/** @type {Zone} */
const BED = { name: "bed", polygon_m: [[-1.2, 1], [-0.4, 1], [-0.4, 2], [-1.2, 2]] };

/**
 * @param {TestContext} t
 * @param {BrowserContextOptions} [options]
 * @param {Zone[]} [zones]
 * @param {(mock: Mock) => void} [prepare]
 */
async function drawing(t, options, zones = [], prepare) {
  const visited = await visit(t, options, (mock) => {
    mock.geometry.zones = zones;
    prepare?.(mock);
  }, "#zones");
  visited.mock.send(update(1, []));
  await reaches(visited.page, "live");
  await draws(visited.page, 1);
  await visited.page.locator("#zones-origin", { hasText: /./ }).waitFor();
  return visited;
}

/**
 * Where a place of the room is, in CSS pixels of the window.
 * @param {Page} page
 * @param {Point} place
 * @returns {Promise<[number, number]>}
 */
async function clientOf(page, place) {
  const box = await page.locator("#map").boundingBox();
  const [x, y] = await page.evaluate(([x, y]) => /** @type {any} */ (window).doorcam.mapPoint(x, y), place);
  return [(box?.x ?? 0) + x, (box?.y ?? 0) + y];
}

/** @param {Page} page @param {Point[]} places */
async function click(page, ...places) {
  for (const place of places) await page.mouse.click(...(await clientOf(page, place)));
}

/** @param {Page} page @param {string} name */
const button = (page, name) => page.getByRole("button", { name, exact: true });

/** @param {Page} page @param {string} start of its label */
const handle = (page, start) => page.locator(`#zone-handles button[aria-label^="${start}"]`);

/**
 * @param {Page} page
 * @param {string} words
 */
const says = (page, words) => page.locator("#zones-outcome", { hasText: words }).waitFor();

describe("zones editor", () => {
  test("draws, snaps, names and saves a zone, in which people are then counted", async (t) => {
    const { mock, page, complaints } = await drawing(t);
    await page.getByText("There are none yet.").waitFor();
    await button(page, "Draw a zone").click();
    // Roughly: to the grid, and the last two to the wall of the room.
    await click(page, [0.52, 1.03], [0.52, 1.98], [1.48, 2.02], [1.47, 0.97], [0.5, 1]);
    await page.locator("#zones-list input").waitFor();
    await page.keyboard.type("bed");
    assert.equal(await page.locator("#zones-list span").innerText(), "1.0 m²");
    await button(page, "Save").click();
    await says(page, "Saved: people are counted in them from now on.");
    assert.deepEqual(mock.drawn, [[{ name: "bed", polygon_m: [[0.5, 1], [0.5, 2], [1.5, 2], [1.5, 1]] }]]);
    await page.getByText("These zones were saved here.").waitFor();

    await page.getByRole("link", { name: "Map", exact: true }).click();
    mock.send(update(2, [], { zones: [{ name: "bed", people: 1, tracks: [3] }] }));
    await draws(page, 2);
    await page.getByText("In zones: bed 1").waitFor();
    const [red, green] = await colourAt(page, [0.5, 1.72]);
    assert.ok(green > 120 && green > red, "the new zone is on the map without a reload");
    assert.deepEqual(complaints, []);
  });

  test("is drawn by keys alone", async (t) => {
    const { mock, page, complaints } = await drawing(t);
    await button(page, "Draw a zone").focus();
    await page.keyboard.press("Enter");
    // From the middle of the room.
    for (const key of ["Space", "Shift+ArrowRight", "Space", "Shift+ArrowUp", "ArrowUp", "Space", "Enter"]) await page.keyboard.press(key);
    await page.keyboard.type("desk");
    await button(page, "Save").focus();
    await page.keyboard.press("Enter");
    await says(page, "Saved");
    assert.deepEqual(mock.drawn, [[{ name: "desk", polygon_m: [[0, 1.5], [0.5, 1.5], [0.5, 2.1]] }]]);
    assert.deepEqual(complaints, []);
  });

  test("moves, adds and removes corners, and takes every step back", async (t) => {
    const { mock, page } = await drawing(t, {}, [BED]);
    const save = button(page, "Save");
    assert.equal(await save.getAttribute("aria-disabled"), "true");
    await click(page, [-0.8, 1.3]);
    // A drag is one step, and to another place of the grid.
    await page.mouse.move(...(await clientOf(page, [-0.4, 1])));
    await page.mouse.down();
    await page.mouse.move(...(await clientOf(page, [-0.1, 0.9])), { steps: 5 });
    await page.mouse.move(...(await clientOf(page, [-0.18, 0.81])), { steps: 5 });
    await page.mouse.up();
    // The middle of a side becomes a corner.
    await page.mouse.move(...(await clientOf(page, [-0.8, 2])));
    await page.mouse.down();
    await page.mouse.move(...(await clientOf(page, [-0.8, 2.3])), { steps: 5 });
    await page.mouse.up();
    // By keys, finely; two presses on the same corner are one step.
    await handle(page, "Corner 1,").focus();
    await page.keyboard.press("Alt+ArrowLeft");
    await page.keyboard.press("Alt+ArrowLeft");
    await handle(page, "Corner 5,").focus();
    await page.keyboard.press("Delete");
    const steps = [
      [[-1.2, 1], [-0.4, 1], [-0.4, 2], [-1.2, 2]],
      [[-1.2, 1], [-0.2, 0.8], [-0.4, 2], [-1.2, 2]],
      [[-1.2, 1], [-0.2, 0.8], [-0.4, 2], [-0.8, 2.3], [-1.2, 2]],
      [[-1.22, 1], [-0.2, 0.8], [-0.4, 2], [-0.8, 2.3], [-1.2, 2]],
      [[-1.22, 1], [-0.2, 0.8], [-0.4, 2], [-0.8, 2.3]],
    ];
    const corners = async () => {
      const labels = await page.locator("#zone-handles .corner").evaluateAll((all) => all.map((one) => one.getAttribute("aria-label") ?? ""));
      return labels.map((label) => label.replace(/^Corner \d+, | m$/g, "").replaceAll("−", "-").split(", ").map(Number));
    };
    assert.deepEqual(await corners(), steps[4]);
    for (const step of [3, 2, 1, 0]) {
      await page.keyboard.press("Control+z");
      assert.deepEqual(await corners(), steps[step], `step ${step}`);
    }
    assert.equal(await save.getAttribute("aria-disabled"), "true", "nothing is changed any more");
    for (let step = 0; step < 4; step += 1) await button(page, "Redo").click();
    assert.deepEqual(await corners(), steps[4]);
    await save.click();
    await says(page, "Saved");
    assert.deepEqual(mock.drawn, [[{ name: "bed", polygon_m: steps[4] }]]);
  });

  test("says what is wrong with a zone, in the page's words and in the daemon's", async (t) => {
    const { mock, page } = await drawing(t, {}, [BED, { ...BED, name: "desk", polygon_m: [[0, 1], [1, 1], [1, 2]] }]);
    const save = button(page, "Save");
    await page.getByLabel("Name of zone 2").fill("bed");
    await page.locator("#zones-trouble", { hasText: "Another zone is named “bed”." }).waitFor();
    assert.equal(await save.getAttribute("aria-disabled"), "true");
    await page.getByLabel("Name of zone 2").fill("sofa");
    await click(page, [0.8, 1.3]);
    await page.mouse.move(...(await clientOf(page, [1, 1])));
    await click(page, [-0.8, 1.3]);
    // Over the side on the other end.
    await handle(page, "Corner 1,").focus();
    for (let step = 0; step < 3; step += 1) await page.keyboard.press("Shift+ArrowRight");
    await page.locator("#zones-trouble", { hasText: "Its border crosses itself." }).waitFor();
    await button(page, "Undo").click();
    mock.refusal = "zones: there are 2, expected none on a Sunday";
    await save.click();
    await page.locator("#zones-outcome.failed", { hasText: "Not saved: zones: there are 2, expected none on a Sunday" }).waitFor();
  });

  test("sends back the id of a zone that gets another name", async (t) => {
    const { mock, page } = await drawing(t, {}, [{ ...BED, id: "zone-1a2b3c4d" }]);
    await page.locator("#zones-list input").fill("Спальня");
    await page.locator("#zones-save").click();
    await says(page, "Saved");
    assert.deepEqual(mock.drawn, [[{ ...BED, id: "zone-1a2b3c4d", name: "Спальня" }]]);
  });

  test("does not lose what is not saved, and goes back to the configuration's zones", async (t) => {
    const { mock, page, complaints } = await drawing(t, {}, [BED], (mock) => {
      mock.zonesFrom = "saved";
    });
    await page.getByRole("button", { name: "Remove bed" }).click();
    await page.getByRole("link", { name: "Map", exact: true }).click();
    await page.getByRole("button", { name: "Keep editing" }).click();
    assert.match(page.url(), /#zones$/);
    await page.getByRole("link", { name: "Camera", exact: true }).click();
    await page.getByRole("button", { name: "Drop the changes" }).click();
    await page.locator("#camera-view").waitFor();
    assert.deepEqual(mock.drawn, []);
    await page.goBack();
    await page.getByLabel("Name of zone 1").waitFor();
    await button(page, "Use the configuration's").click();
    await says(page, "The configuration's zones are used again.");
    assert.equal(mock.zonesFrom, "config");
    assert.deepEqual(complaints, []);
  });

  /** @type {[string, BrowserContextOptions][]} */
  const looks = [
    ["zones-light", { viewport: DESKTOP }],
    ["zones-dark", { viewport: DESKTOP, colorScheme: "dark" }],
    ["zones-phone", { viewport: PHONE, deviceScaleFactor: 2, hasTouch: true, isMobile: true }],
  ];
  for (const [name, options] of looks) {
    test(`draws under a finger or a mouse without an accessibility violation (${name}), and its picture is taken`, async (t) => {
      const { mock, page } = await drawing(t, options, [BED]);
      let sequence = 1;
      const stream = setInterval(() => mock.send(twoPeople(mock.geometry, (sequence += 1))), 100);
      t.after(() => clearInterval(stream));
      await button(page, "Draw a zone").click();
      const touch = Boolean(options.hasTouch);
      await page.locator("#map").scrollIntoViewIfNeeded();
      for (const place of /** @type {Point[]} */ ([[0.3, 1], [1.2, 1], [1.2, 2], [0.3, 2], [0.3, 1]])) {
        const at = await clientOf(page, place);
        await (touch ? page.touchscreen.tap(...at) : page.mouse.click(...at));
      }
      await page.locator("#zones-list li").nth(1).waitFor();
      await settled(page);
      await picture(page, name);
      assert.deepEqual(await violations(page), []);
      assert.equal(await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth), 0);
    });
  }
});
