// The page for everyone: keyboard, narrow and wide windows, assistive technology, closed networks.

import assert from "node:assert/strict";
import { describe, test } from "node:test";
import { violations } from "./axe.js";
import { DESKTOP, PHONE, draws, picture, reaches } from "./browser.js";
import { twoPeople, update } from "./scene.js";
import { visit } from "./visit.js";

/** @import { BrowserContextOptions } from "playwright-core" */

describe("everyone", () => {
  test("reaches the selectors by keyboard", async (t) => {
    const { mock, page } = await visit(t);
    mock.send(update(1, []));
    await reaches(page, "live");
    await page.keyboard.press("Tab");
    assert.equal(await page.evaluate(() => document.activeElement?.textContent), "Map");
    for (const name of ["Camera", "History", "Zones", "Calibrate"]) {
      await page.keyboard.press("Tab");
      assert.equal(await page.evaluate(() => document.activeElement?.textContent), name);
    }
    await page.keyboard.press("Tab");
    assert.equal(await page.evaluate(() => /** @type {HTMLInputElement} */ (document.activeElement).value), "unified");
    await page.keyboard.press("ArrowRight");
    assert.equal(await page.getByLabel("Left view").isChecked(), true);
    await page.keyboard.press("Tab");
    await page.keyboard.press("ArrowRight");
    assert.equal(await page.getByLabel("Brighter", { exact: true }).isChecked(), true);
    await page.keyboard.press("Tab");
    await page.keyboard.press("ArrowRight");
    assert.equal(await page.getByLabel("Shrunk light").isChecked(), true);
    await page.keyboard.press("Tab");
    await page.keyboard.press("Space");
    assert.equal(await page.getByLabel("Uncertainty").isChecked(), true);
    await page.keyboard.press("Tab");
    assert.equal(await page.evaluate(() => document.activeElement?.id), "pause");
    for (const details of ["#parts", "#lit"]) {
      await page.keyboard.press("Tab");
      await page.keyboard.press("Enter");
      await page.locator(`${details}[open]`).waitFor();
      await page.keyboard.press("Enter");
    }
  });

  for (const width of [360, PHONE.width, 768, 1024, 1920]) {
    test(`fits a window ${width} pixels wide`, async (t) => {
      const { mock, page } = await visit(t, { viewport: { width, height: 800 } });
      mock.send(twoPeople(mock.geometry, 20));
      await draws(page, 20);
      await page.getByText("Lit facets", { exact: false }).first().click();
      const room = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
      assert.equal(room, 0, "no sideways scrolling");
    });
  }

  /** @type {[string, BrowserContextOptions][]} */
  const looks = [
    ["light", { viewport: DESKTOP, colorScheme: "light" }],
    ["dark", { viewport: DESKTOP, colorScheme: "dark" }],
    ["phone", { viewport: PHONE, colorScheme: "light", deviceScaleFactor: 2, hasTouch: true }],
  ];
  for (const [name, options] of looks) {
    test(`has no accessibility violation (${name}), and its picture is taken`, async (t) => {
      const { mock, page, complaints } = await visit(t, options);
      let sequence = 0;
      const stream = setInterval(() => mock.send(twoPeople(mock.geometry, (sequence += 1))), 100);
      t.after(() => clearInterval(stream));
      await draws(page, 25);
      await page.locator("#difference-image").waitFor();
      await picture(page, name);
      for (const state of ["live", "stale"]) {
        await reaches(page, state);
        assert.deepEqual(await violations(page), [], state);
        clearInterval(stream);
      }
      await picture(page, `${name}-stale`);
      assert.deepEqual(complaints, []);
    });
  }

  test("asks nothing of any other host", async (t) => {
    const { mock, page } = await visit(t);
    /** @type {string[]} */
    const foreign = [];
    page.on("request", (request) => {
      if (!request.url().startsWith(mock.url)) foreign.push(request.url());
    });
    await page.reload();
    mock.send(update(1, []));
    await reaches(page, "live");
    assert.deepEqual(foreign, []);
  });
});
