import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";

/** @import { Page } from "playwright-core" */

const source = createRequire(import.meta.url).resolve("axe-core/axe.min.js");

/**
 * What keeps people with a screen reader, a keyboard or weak eyes from the page, as axe finds it.
 * @param {Page} page
 * @returns {Promise<string[]>}
 */
export async function violations(page) {
  // Through the debugger, for the page's own policy forbids foreign scripts.
  await page.evaluate(await readFile(source, "utf8"));
  const { violations } = await page.evaluate(() => /** @type {any} */ (window).axe.run({ resultTypes: ["violations"] }));
  return violations.map((/** @type {any} */ v) => `${v.impact} ${v.id}: ${v.nodes.map((/** @type {any} */ n) => n.html).join(" | ")}`);
}
