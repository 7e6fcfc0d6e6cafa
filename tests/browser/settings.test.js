// How the reader wants to see the map, and that the browser remembers it.

import assert from "node:assert/strict";
import { describe, test } from "node:test";
import { colourAt, draws, settled } from "./browser.js";
import { lit, middle, nearest, update } from "./scene.js";
import { visit } from "./visit.js";

describe("view settings", () => {
  test("hide parts of the map, and are kept for the next visit", async (t) => {
    const { mock, page, complaints } = await visit(t);
    const index = nearest(mock.geometry, -0.6, 1.2);
    const place = middle(mock.geometry, index);
    mock.geometry.zones = [{ name: "bed", polygon_m: [[0.4, 1.9], [1.2, 1.9], [1.2, 2.5], [0.4, 2.5]] }];
    await page.reload();
    mock.send(update(1, [lit(index, [0.02, 0, 0], { left: [0, 0.02, 0] })], {
      tracks: [{ id: 1, state: "confirmed", x_m: 0.5, y_m: 1.5, vx_m_s: 0, vy_m_s: 0, covariance_m2: [[0.01, 0], [0, 0.01]], rgb: [0, 0, 0], age_s: 1 }],
    }));
    await draws(page, 1);
    assert.deepEqual(await colourAt(page, place), [255, 0, 0]);
    const zone = /** @type {[number, number]} */ ([0.4, 2.3]);
    const outlined = await colourAt(page, zone);
    await page.getByText("Shown on the map").click();
    await page.locator("#part-people").uncheck();
    await page.locator("#part-zones").uncheck();
    await page.getByLabel("Left view").check({ force: true });
    await settled(page);
    const look = async () => [await colourAt(page, place), (await colourAt(page, [0.5, 1.5]))[0] > 200, (await colourAt(page, zone)).every((c, k) => c < outlined[k] - 60)];
    assert.deepEqual(await look(), [[0, 255, 0], false, true]);
    await page.reload();
    await draws(page, 1);
    assert.equal(await page.getByLabel("Left view").isChecked(), true);
    assert.deepEqual(await look(), [[0, 255, 0], false, true], "after a reload");
    assert.deepEqual(complaints, []);
  });

  test("that this page does not know, or that are broken, change nothing", async (t) => {
    const { mock, page, complaints } = await visit(t);
    for (const kept of ['{"layer": "sideways", "part-grid": 7}', "[]", "nonsense"]) {
      await page.evaluate((kept) => localStorage.setItem("doorcam-view", kept), kept);
      await page.reload();
      mock.send(update(1, []));
      await draws(page, 1);
      assert.equal(await page.getByLabel("Unified").isChecked(), true, kept);
    }
    assert.deepEqual(complaints, []);
  });
});
