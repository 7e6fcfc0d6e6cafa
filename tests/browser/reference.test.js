// The API's description as a page, from the document in docs/, which is the one that doorcam serves.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { describe, test } from "node:test";
import { violations } from "./axe.js";
import { DESKTOP, PHONE, picture } from "./browser.js";
import { visit } from "./visit.js";

const api = JSON.parse(await readFile(new URL("../../docs/openapi.json", import.meta.url), "utf8"));

/** @param {import("./mock.js").Mock} mock */
const described = (mock) => void (mock.description = api);

describe("the API's page", () => {
  test("shows every route and shape", async (t) => {
    const { page, complaints } = await visit(t, { viewport: DESKTOP }, described, "reference.html");
    await page.getByRole("heading", { name: "GET /api/v1/status" }).waitFor();
    const shown = await page.locator("h3").allInnerTexts();
    const routes = Object.entries(api.paths).flatMap(([path, operations]) =>
      Object.keys(operations).map((method) => `${method.toUpperCase()} ${path}`),
    );
    const shapes = Object.keys(api.components.schemas);
    assert.deepEqual(shown.toSorted(), [...routes, ...shapes].toSorted());
    assert.equal(await page.locator("dd", { hasText: "undefined" }).count(), 0);
    // A link leads to what it names.
    await page.locator("a", { hasText: /^Track$/ }).first().click();
    assert.ok(await page.locator("#Track").isVisible());
    assert.match(page.url(), /#Track$/);
    await picture(page, "reference-light");
    assert.deepEqual(await violations(page), []);
    assert.deepEqual(complaints, []);
  });

  for (const [name, options] of /** @type {const} */ ([
    ["reference-dark", { viewport: DESKTOP, colorScheme: "dark" }],
    ["reference-phone", { viewport: PHONE, deviceScaleFactor: 2, hasTouch: true }],
  ])) {
    test(`fits and can be read (${name})`, async (t) => {
      const { page, complaints } = await visit(t, options, described, "reference.html");
      await page.getByRole("heading", { name: "GET /api/v1/status" }).waitFor();
      const [content, window] = await page.evaluate(() => [document.documentElement.scrollWidth, innerWidth]);
      assert.ok(content <= window, `${content} px in ${window}`);
      await picture(page, name);
      assert.deepEqual(await violations(page), []);
      assert.deepEqual(complaints, []);
    });
  }
});
