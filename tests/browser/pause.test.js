// The view is held still: what is shown, what is said of it, and what goes on.

import assert from "node:assert/strict";
import { describe, test } from "node:test";
import { violations } from "./axe.js";
import { colourAt, draws, reaches, settled, until } from "./browser.js";
import { lit, middle, nearest, update } from "./scene.js";
import { visit } from "./visit.js";

describe("pause", () => {
  test("holds the picture, says that it is old, and goes on with the newest", async (t) => {
    const { mock, page, complaints } = await visit(t);
    const index = nearest(mock.geometry, -0.6, 1.2);
    const place = middle(mock.geometry, index);
    mock.send(update(1, []));
    mock.send(update(2, [lit(index, [0.02, 0, 0])]));
    await draws(page, 2);
    await page.getByRole("button", { name: "Pause" }).click();
    await reaches(page, "paused");
    const stream = setInterval(() => mock.send(update((mock.latest?.sequence ?? 0) + 1, [lit(index, [0, 0, 0.02])])), 100);
    t.after(() => clearInterval(stream));
    await page.locator("#paused-words", { hasText: /^Paused · [1-9]\d* s old, \d+ updates behind$/ }).waitFor();
    assert.deepEqual(await colourAt(page, place), [255, 0, 0], "the picture is held");
    assert.equal(await page.locator("#connection-label").innerText(), "Paused");
    assert.equal(await page.locator("html").getAttribute("data-sequence"), "2");
    // Another layer of the held picture, and its numbers.
    await page.getByLabel("Left view").check({ force: true });
    await settled(page);
    assert.deepEqual(await colourAt(page, place), [255, 0, 0]);
    assert.deepEqual(await violations(page), []);
    // The daemon's health goes on.
    await until(async () => Number(await page.locator("#rate").innerText()) > 2, "updates are counted");
    await page.getByRole("button", { name: "Resume" }).first().click();
    await reaches(page, "live");
    await draws(page, 10);
    assert.deepEqual(await colourAt(page, place), [0, 0, 255]);
    assert.equal(await page.locator("#paused").isVisible(), false);
    assert.deepEqual(complaints, []);
  });

  test("never covers up that the daemon is gone or that no pictures come", async (t) => {
    const { mock, page } = await visit(t);
    mock.send(update(1, []));
    await reaches(page, "live");
    await page.getByRole("button", { name: "Pause" }).click();
    await reaches(page, "paused");
    await reaches(page, "stale");
    assert.equal(await page.locator("#map-notice").isVisible(), true);
    await mock.stop();
    await reaches(page, "reconnecting");
    // A restarted daemon may have another door: what was held has no place on its map.
    mock.latest = null;
    await mock.start();
    await reaches(page, "waiting");
    mock.send(update(1, []));
    await reaches(page, "live");
  });
});
