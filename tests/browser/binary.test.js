// The page as the real daemon serves it, on a replayed recording.
//
//   DOORCAM_BIN        the program to test; without it this suite is skipped
//   DOORCAM_RECORDING  the recording to replay

import assert from "node:assert/strict";
import { mkdir, mkdtemp, readFile, readdir, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, describe, test } from "node:test";
import { lightOf } from "../../web/brightness.js";
import { DESKTOP, PHONE, draws, launch, look, open, picture, reaches, settled } from "./browser.js";
import { handle } from "./calibrating.js";
import { cameraPicture } from "./camera.js";
import { serve } from "./daemon.js";
import { calibration } from "./fit.js";
import { middle } from "./scene.js";

/** @import { ChildProcess } from "node:child_process" */
/** @import { Browser, Page } from "playwright-core" */
/** @import { Geometry, Rgb, Update } from "../../web/types.js" */

const program = process.env.DOORCAM_BIN;
const recording = process.env.DOORCAM_RECORDING;
const skip = program && recording ? undefined : "set DOORCAM_BIN and DOORCAM_RECORDING to test the real program";

// A recording may begin with seconds of background before the first update.
const FIRST_PICTURE_MS = 60000;

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

  test("lists and draws the people who are really followed", { skip }, async (t) => {
    const { page, complaints, close } = await open(browser, url);
    t.after(close);
    page.setDefaultTimeout(FIRST_PICTURE_MS);
    const follows = page.locator("#tracks li", { hasText: "confirmed" }).first();
    // Somebody walks on between two looks, so that it takes some until list and map are of one update.
    for (let tries = 0, drawn = false; !drawn; tries++) {
      assert.ok(tries < 100, "no marker on the map where the list says that somebody is");
      const words = await follows.innerText();
      const place = /([−-]?\d+\.\d+), ([−-]?\d+\.\d+) m/.exec(words);
      assert.ok(place, words);
      const [x, y] = place.slice(1).map((digits) => Number(digits.replace("−", "-")));
      drawn = Math.min(...(await look(page, [x, y])).colour) > 230;
    }
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

describe("the real program, steered from the page", () => {
  /** @type {Browser} */
  let browser;
  before(async () => {
    if (!skip) browser = await launch();
  });
  after(() => browser?.close());

  /**
   * A simulated doorway that keeps things in a directory of its own.
   * @param {import("node:test").TestContext} t
   * @param {string} view
   */
  async function steered(t, view) {
    const storage = await mkdtemp(join(tmpdir(), "doorcam-"));
    t.after(() => rm(storage, { recursive: true }));
    const { child, url } = await serve(String(program), String(recording), "--storage", storage);
    t.after(() => child.kill());
    const opened = await open(browser, url + view);
    t.after(opened.close);
    opened.page.setDefaultTimeout(FIRST_PICTURE_MS);
    return { storage, child, url, ...opened };
  }

  test("shows what its camera sees, and how strong the signal is", { skip }, async (t) => {
    const { page, complaints } = await steered(t, "#camera");
    await page.locator("#camera-outlines .area").nth(1).waitFor({ state: "attached" });
    await page.locator("#camera-notice").waitFor({ state: "hidden" });
    await page.locator("#patches-image").waitFor();
    await page.locator("#change-image").waitFor();
    // Somebody walks about in this recording: the change is plain.
    await page.locator("#signal-left-db", { hasText: /^\+?[−\d]/ }).waitFor();
    const signal = await page.evaluate(async () => (await fetch("/api/v1/signal")).json());
    assert.ok(signal.left.noise > 0 && signal.left.noise < 0.2, JSON.stringify(signal));
    await picture(page, "binary-camera");
    assert.deepEqual(complaints, []);
  });

  test("records into a directory that opens", { skip }, async (t) => {
    const { page, storage, complaints } = await steered(t, "");
    await reaches(page, "live");
    await page.locator("#recording-seconds").fill("60");
    await page.locator("#recording-empty").fill("0.5");
    await page.locator("#recording-name").fill("evening");
    await page.getByRole("button", { name: "Record", exact: true }).click();
    await page.locator("#recording-words", { hasText: /^([5-9]|\d\d+) frames in .* so far/ }).waitFor();
    await page.getByRole("button", { name: "Stop recording" }).click();
    await page.locator("#recording-words", { hasText: /^The last one: \d+ frames in .*evening \(stopped\)$/ }).waitFor();
    const directory = join(storage, "recordings/evening");
    const manifest = JSON.parse(await readFile(join(directory, "recording.json"), "utf8"));
    assert.ok(manifest.background_frames[1] > manifest.background_frames[0], JSON.stringify(manifest.background_frames));
    const lines = (await readFile(join(directory, "timestamps.csv"), "utf8")).trim().split("\n");
    assert.equal((await readdir(join(directory, "frames"))).length, lines.length - 1);
    // Twice the same name is refused, in the daemon's words.
    await page.getByRole("button", { name: "Record", exact: true }).click();
    await page.locator("#recording-outcome.failed", { hasText: "there is a recording already" }).waitFor();
    assert.deepEqual(complaints.filter((line) => !line.includes("409")), []);
  });

  test("keeps zones that are drawn, and counts people in them", { skip }, async (t) => {
    const { page, storage, complaints } = await steered(t, "#zones");
    await reaches(page, "live");
    await page.getByText("These are the zones of the configuration file.").waitFor();
    await page.getByRole("button", { name: "Draw a zone" }).click();
    const box = await page.locator("#map").boundingBox();
    for (const place of [[-1.5, 0.2], [1.5, 0.2], [1.5, 3], [-1.5, 3], [-1.5, 0.2]]) {
      const [x, y] = await page.evaluate(([x, y]) => /** @type {any} */ (window).doorcam.mapPoint(x, y), place);
      await page.mouse.click((box?.x ?? 0) + x, (box?.y ?? 0) + y);
    }
    await page.keyboard.type("everywhere");
    await page.getByRole("button", { name: "Save", exact: true }).click();
    await page.locator("#zones-outcome", { hasText: "Saved" }).waitFor();
    const kept = JSON.parse(await readFile(join(storage, "zones.json"), "utf8"));
    assert.deepEqual(kept.zones.map((/** @type {{ name: string }} */ zone) => zone.name), ["everywhere"]);
    await page.getByRole("link", { name: "Map", exact: true }).click();
    await page.getByText(/In zones: everywhere [1-9]/).waitFor();
    // What they did is history.
    await page.getByRole("link", { name: "History", exact: true }).click();
    await page.locator("#history-rows tr", { hasText: "enters everywhere" }).first().waitFor();
    await page.locator("#history-who", { hasText: /Room: [1-9]/ }).waitFor();
    await picture(page, "binary-history");
    assert.deepEqual(complaints, []);
  });

  test("is found again after a restart, and never looked live meanwhile", { skip }, async (t) => {
    const { page, child, url } = await steered(t, "");
    await reaches(page, "live");
    const ended = new Promise((done) => child.once("exit", done));
    child.kill();
    await ended;
    await reaches(page, "reconnecting");
    assert.equal(await page.locator("#map-notice").isVisible(), true);
    const { port } = new URL(url);
    const again = await serve(String(program), String(recording), "--listen", `127.0.0.1:${port}`);
    t.after(() => again.child.kill());
    await reaches(page, "live");
  });

  test("weighs less than 200 kB in all, and asks nobody else", { skip }, async (t) => {
    const { child, url } = await serve(String(program), String(recording));
    t.after(() => child.kill());
    const { page, close } = await open(browser, "about:blank");
    t.after(close);
    page.setDefaultTimeout(FIRST_PICTURE_MS);
    const session = await page.context().newCDPSession(page);
    await session.send("Network.enable");
    let bytes = 0;
    /** @type {Map<string, string>} */
    const asked = new Map();
    session.on("Network.requestWillBeSent", ({ requestId, request }) => asked.set(requestId, request.url));
    session.on("Network.loadingFinished", ({ requestId, encodedDataLength }) => {
      // What the daemon says and draws comes on top: that is not the page.
      if (!asked.get(requestId)?.includes("/api/")) bytes += encodedDataLength;
    });
    await page.goto(url);
    for (const view of ["camera", "history", "zones", "calibrate", "live"]) await page.evaluate((view) => { location.hash = view; }, view);
    await reaches(page, "live");
    assert.ok(bytes > 20_000 && bytes < 200_000, `${bytes} bytes`);
    assert.deepEqual([...asked.values()].filter((one) => !one.startsWith(url)), []);
    t.diagnostic(`the page weighs ${bytes} bytes`);
  });
});

test("the real program is calibrated on the page", { skip }, async (t) => {
  const directory = await mkdtemp(join(tmpdir(), "doorcam-"));
  t.after(() => rm(directory, { recursive: true }));
  await mkdir(join(directory, "frames"));
  for (let index = 0; index < 4; index += 1) await writeFile(join(directory, `frames/0000000${index}.png`), cameraPicture());
  const { size, doorway, floor_points } = calibration({ extra: [[0, -0.6]], off: [3, -2] });
  const manifest = { fps: 10, layout: "camera", transfer: "srgb", size, doorway, floor_points, background_frames: [0, 2] };
  await writeFile(join(directory, "recording.json"), JSON.stringify(manifest));
  const kept = join(directory, "calibration.json");
  const { child, url } = await serve(String(program), directory, "--calibration", kept);
  t.after(() => child.kill());
  const browser = await launch();
  t.after(() => browser.close());
  const { page, complaints } = await open(browser, `${url}#calibrate`);

  // A place on the overlay and the numbers are the daemon's own.
  await page.locator("#cal-overlay .area").first().waitFor({ state: "attached" });
  const [u] = /** @type {[number, number]} */ (floor_points[4].pixel);
  await handle(page, "5").focus();
  for (let step = 0; step < 3; step += 1) await page.keyboard.press("ArrowLeft");
  const checked = page.waitForResponse((response) => response.url().endsWith("/calibration/check"));
  await page.keyboard.press("ArrowDown");
  assert.equal((await checked).status(), 200);
  await picture(page, "binary-calibration");
  await page.locator("#cal-save").click();
  await page.waitForResponse((response) => response.request().method() === "PUT" && response.ok());
  const saved = JSON.parse(await readFile(kept, "utf8"));
  assert.ok(Math.abs(saved.floor_points[4].pixel[0] - (u - 3)) < 1e-6, JSON.stringify(saved.floor_points[4]));
  // The map goes on in the new calibration.
  const status = await page.evaluate(async () => {
    for (;;) {
      const status = await (await fetch("/api/v1/status")).json();
      if (status.calibration_revision === 1) return status;
    }
  });
  assert.equal(status.calibrated, true);
  assert.deepEqual(complaints, []);
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
