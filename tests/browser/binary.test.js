// The page as the real daemon serves it, on a replayed recording.
//
//   DOORCAM_BIN        the program to test; without it this suite is skipped
//   DOORCAM_RECORDING  the recording to replay

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { after, before, describe, test } from "node:test";
import { lightOf } from "../../web/brightness.js";
import { DESKTOP, PHONE, draws, launch, look, open, picture, reaches, settled } from "./browser.js";
import { middle } from "./scene.js";

/** @import { ChildProcess } from "node:child_process" */
/** @import { Browser, Page } from "playwright-core" */
/** @import { Geometry, Rgb, Update } from "../../web/types.js" */

const program = process.env.DOORCAM_BIN;
const recording = process.env.DOORCAM_RECORDING;
const skip = program && recording ? undefined : "set DOORCAM_BIN and DOORCAM_RECORDING to test the real program";

const START_TIMEOUT_MS = 30000;
// A recording may begin with seconds of background before the first update.
const FIRST_PICTURE_MS = 60000;

/**
 * @param {string} program
 * @param {string} recording
 * @returns {Promise<{ child: ChildProcess, url: string }>}
 */
function serve(program, recording) {
  const args = ["serve", "--source", `replay:${recording},loop`, "--listen", "127.0.0.1:0"];
  const child = spawn(program, args, { stdio: ["ignore", "ignore", "pipe"] });
  return new Promise((resolve, reject) => {
    let log = "";
    const fail = (/** @type {string} */ why) => {
      child.kill();
      reject(new Error(`${why}; its log:\n${log}`));
    };
    const timer = setTimeout(() => fail("no address logged in time"), START_TIMEOUT_MS);
    child.on("error", (error) => fail(String(error)));
    child.on("exit", (code) => fail(`ended with status ${code}`));
    child.stderr?.on("data", (chunk) => {
      log += chunk;
      const address = /http:\/\/127\.0\.0\.1:\d+/.exec(log);
      if (!address) return;
      clearTimeout(timer);
      child.removeAllListeners("exit");
      resolve({ child, url: `${address[0]}/` });
    });
  });
}

describe("the real program", () => {
  /** @type {Browser} */
  let browser;
  /** @type {ChildProcess} */
  let child;
  /** @type {string} */
  let url;

  before(async () => {
    if (skip) return;
    ({ child, url } = await serve(String(program), String(recording)));
    browser = await launch();
  });
  after(async () => {
    await browser?.close();
    child?.kill();
  });

  test("shows a live map that matches the API", { skip }, async (t) => {
    const { page, complaints, close } = await open(browser, url);
    t.after(close);
    page.setDefaultTimeout(FIRST_PICTURE_MS);
    await reaches(page, "live");
    const from = Number(await page.locator("html").getAttribute("data-sequence"));
    await draws(page, from + 2);

    const { index, rgb, colour } = await drawnFacet(page);
    const peak = Math.max(...rgb.map(Math.abs));
    assert.ok(Math.max(...colour) > 100, `facet ${index} is drawn, got ${colour}`);
    // Its hue, not its exact brightness, which hangs on the running scale; a hatched one is mixed
    // with its outline.
    if (rgb.includes(peak)) assert.equal(Math.max(...colour), colour[rgb.indexOf(peak)], `${rgb} drawn as ${colour}`);

    await page.locator("#difference-image").waitFor();
    assert.match(await page.locator("#solve-ms").innerText(), /^\d/);
    assert.match(await page.locator("#source-spec").innerText(), /^replay:/);
    await picture(page, "binary-light");
    assert.deepEqual(complaints, []);
  });

  for (const [name, options] of /** @type {const} */ ([
    ["binary-dark", { viewport: DESKTOP, colorScheme: "dark" }],
    ["binary-phone", { viewport: PHONE, deviceScaleFactor: 2, hasTouch: true }],
  ])) {
    test(`has its picture taken (${name})`, { skip }, async (t) => {
      const { page, complaints, close } = await open(browser, url, options);
      t.after(close);
      page.setDefaultTimeout(FIRST_PICTURE_MS);
      await reaches(page, "live");
      await page.locator("#difference-image").waitFor();
      await picture(page, name);
      assert.deepEqual(complaints, []);
    });
  }
});

/**
 * The API's strongest facet with the colour the page draws it in. The stream goes on between
 * asking and looking, so a look counts only when it saw the very update that was asked for.
 * @param {Page} page
 * @returns {Promise<{ index: number, rgb: Rgb, colour: [number, number, number] }>}
 */
async function drawnFacet(page) {
  const geometry = /** @type {Geometry} */ (await fetchJson(page, "geometry"));
  for (const layer of /** @type {const} */ (["unified", "left", "right"])) {
    await page.locator(`input[name=layer][value=${layer}]`).check({ force: true });
    await settled(page);
    const until = Date.now() + 15000;
    while (Date.now() < until) {
      const update = /** @type {Update} */ (await fetchJson(page, "reconstruction"));
      const strength = (/** @type {Rgb} */ rgb) => Math.max(...rgb.map(Math.abs));
      // The page shows measured light unless told otherwise.
      const facets = update.facets.map((facet) => ({ ...facet, rgb: lightOf(facet, layer, "measured") }));
      const [best] = facets.sort((a, b) => strength(b.rgb) - strength(a.rgb));
      if (!best || strength(best.rgb) === 0) continue;
      const brighter = strength(best.rgb) === Math.max(...best.rgb);
      const { colour, sequence } = await look(page, middle(geometry, best.index), brighter ? 0 : 6);
      if (sequence === update.sequence) return { index: best.index, rgb: best.rgb, colour };
    }
  }
  throw new Error("no lit facet in any layer within the time");
}

/**
 * @param {Page} page
 * @param {string} name
 */
function fetchJson(page, name) {
  return page.evaluate(async (name) => (await fetch(`/api/v1/${name}`)).json(), name);
}
