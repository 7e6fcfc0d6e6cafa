// The page against the scripted mock: what it draws and what it says about its connection.

import assert from "node:assert/strict";
import { describe, test } from "node:test";
import { colourAt, draws, pixels, reaches, settled } from "./browser.js";
import { geometry, lit, middle, nearest, twoPeople, update } from "./scene.js";
import { visit } from "./visit.js";

/** @import { Track } from "../../web/types.js" */

const RED = /** @type {const} */ ([0.02, 0, 0]);
/** @type {(rgb: readonly [number, number, number]) => [number, number, number]} */
const rgb = ([r, g, b]) => [r, g, b];

describe("map", () => {
  test("draws a lit facet in its colour where it stands", async (t) => {
    const { mock, page, complaints } = await visit(t);
    const index = nearest(mock.geometry, -0.6, 1.2);
    const place = middle(mock.geometry, index);
    mock.send(update(1, []));
    await reaches(page, "live");
    await draws(page, 1);
    const unlit = await colourAt(page, place);
    assert.ok(Math.max(...unlit) < 90, `an unlit facet is faint, got ${unlit}`);
    // Full red and a quarter of it in green: linear 0.25 is 137 in sRGB.
    mock.send(update(2, [lit(index, [0.02, 0.005, 0])]));
    await draws(page, 2);
    assert.deepEqual(await colourAt(page, place), [255, 137, 0]);
    await page.getByText("1 of", { exact: false }).first().waitFor();
    assert.deepEqual(complaints, []);
  });

  test("follows a new calibration, and draws no update in another one's geometry", async (t) => {
    const { mock, page, complaints } = await visit(t);
    mock.send(update(1, [lit(5, [0.02, 0, 0])]));
    await draws(page, 1);
    const asked = () => mock.requests.filter((path) => path.endsWith("/geometry")).length;
    assert.equal(asked(), 1);
    mock.status.calibration_revision = 2;
    mock.geometry = { ...mock.geometry, doorway: { ...mock.geometry.doorway, width_m: 0.9 }, calibration: 2 };
    mock.send(update(2, [lit(6, [0.02, 0, 0])], { calibration: 2 }));
    await draws(page, 2);
    assert.equal(asked(), 2);
    mock.send(update(3, [lit(7, [0.02, 0, 0])], { calibration: 1 }));
    mock.send(update(4, [lit(8, [0.02, 0, 0])], { calibration: 2 }));
    await draws(page, 4);
    assert.equal(asked(), 2, "the late one is left out");
    assert.deepEqual(complaints, []);
  });

  test("keeps brightness while the strongest change sinks", async (t) => {
    const { mock, page } = await visit(t);
    const index = nearest(mock.geometry, 0.6, 1.2);
    mock.send(update(1, [lit(index, rgb(RED))]));
    await draws(page, 1);
    mock.send(update(2, [lit(index, [0.01, 0, 0])]));
    await draws(page, 2);
    const [red] = await colourAt(page, middle(mock.geometry, index));
    assert.ok(red > 180 && red < 215, `half of the running maximum is about 188, got ${red}`);
  });

  test("follows the layer selector", async (t) => {
    const { mock, page } = await visit(t);
    const index = nearest(mock.geometry, 0.4, 1.3);
    const place = middle(mock.geometry, index);
    mock.send(update(1, [lit(index, [0.01, 0.01, 0.01], { left: [0.02, 0, 0], right: [0, 0, 0.02] })]));
    await draws(page, 1);
    assert.deepEqual(await colourAt(page, place), [255, 255, 255]);
    await page.getByLabel("Left view").check({ force: true });
    await settled(page);
    assert.deepEqual(await colourAt(page, place), [255, 0, 0]);
    await page.getByLabel("Right view").check({ force: true });
    await settled(page);
    assert.deepEqual(await colourAt(page, place), [0, 0, 255]);
  });

  test("draws the measured brightness, or the shrunk one when asked", async (t) => {
    const { mock, page } = await visit(t);
    const strong = nearest(mock.geometry, -0.6, 1.2);
    const weak = nearest(mock.geometry, 0.6, 1.2);
    /** @type {[import("../../web/types.js").Layer, string][]} */
    const layers = [["unified", "Unified"], ["left", "Left view"], ["right", "Right view"]];
    // The weak one is shrunk most: as measured it is half as bright as the other, as shrunk an eighth.
    mock.send(update(1, [lit(strong, [0.016, 0, 0], { refit: 1.25 }), lit(weak, [0, 0.002, 0], { refit: 5 })]));
    await draws(page, 1);
    // An eighth is linear 0.125, in sRGB 99; a half is 188.
    for (const [brightness, green] of /** @type {const} */ ([["Measured light", 188], ["Shrunk light", 99], ["Measured light", 188]])) {
      await page.getByLabel(brightness).check({ force: true });
      for (const [layer, label] of layers) {
        await page.getByLabel(label).check({ force: true });
        await settled(page);
        assert.deepEqual(await colourAt(page, middle(mock.geometry, strong)), [255, 0, 0], `${brightness}, ${layer}`);
        assert.deepEqual(await colourAt(page, middle(mock.geometry, weak)), [0, green, 0], `${brightness}, ${layer}`);
      }
      // The scale says what full brightness is.
      const scale = brightness === "Measured light" ? "0.0200" : "0.0160";
      await page.waitForFunction((text) => document.getElementById("scale")?.textContent === text, scale);
    }
    // An update that comes later is drawn in the chosen one.
    await page.getByLabel("Shrunk light").check({ force: true });
    mock.send(update(2, [lit(strong, [0.016, 0, 0], { refit: 1.25 }), lit(weak, [0, 0.004, 0], { refit: 4 })]));
    await draws(page, 2);
    assert.deepEqual(await colourAt(page, middle(mock.geometry, weak)), [0, 137, 0], "a quarter");
  });

  test("orders facets by the brightness that is shown", async (t) => {
    const { mock, page } = await visit(t);
    const [near, far] = [nearest(mock.geometry, 0.7, 1.2), nearest(mock.geometry, -0.7, 1.2)];
    mock.send(update(1, [lit(near, [0.003, 0, 0], { refit: 5 }), lit(far, [0.01, 0, 0], { refit: 1.2 })]));
    await draws(page, 1);
    await page.getByText("Lit facets", { exact: false }).first().click();
    const first = page.locator("#lit-rows tr").first();
    for (const [brightness, index] of /** @type {const} */ ([["Measured light", near], ["Shrunk light", far]])) {
      await page.getByLabel(brightness).check({ force: true });
      await page.waitForFunction((wanted) => document.querySelector("#lit-rows td")?.textContent === wanted, String(index));
      const summary = await page.locator("#map-summary").innerText();
      assert.ok(summary.includes(middle(mock.geometry, index)[0] < 0 ? "at \u22120." : "at 0."), summary);
    }
    await page.getByLabel("Measured light").check({ force: true });
    await page.waitForFunction((wanted) => document.querySelector("#lit-rows td")?.textContent === wanted, String(near));
    const cells = await first.locator("td").allInnerTexts();
    assert.deepEqual(cells.slice(2, 4), ["measured\nshrunk", "0.0150  0  0\n0.0030  0  0"]);
  });

  test("shows a darker facet as a hatched outline, not as a bright one", async (t) => {
    const { mock, page } = await visit(t);
    const index = nearest(mock.geometry, -0.5, 1.4);
    mock.send(update(1, [lit(index, rgb(RED))]));
    await draws(page, 1);
    const brighter = await pixels(page);
    mock.send(update(2, [lit(index, [-0.02, 0, 0])]));
    await draws(page, 2);
    const darker = await pixels(page);
    assert.notEqual(darker, brighter);
    await page.getByLabel("Brighter", { exact: true }).check({ force: true });
    await settled(page);
    const onlyBrighter = await pixels(page);
    assert.notEqual(onlyBrighter, darker, "a darker facet is left out");
    await page.getByLabel("Darker", { exact: true }).check({ force: true });
    await settled(page);
    assert.equal(await pixels(page), darker);
  });

  test("shows a facet's numbers under the pointer, and the strongest first in a table", async (t) => {
    const { mock, page } = await visit(t);
    const [weak, strong] = [nearest(mock.geometry, 0.7, 1.2), nearest(mock.geometry, -0.7, 1.2)];
    mock.send(update(1, [lit(weak, [0.004, 0, 0]), lit(strong, [0, -0.0123, 0], { left: [0, -0.02, 0], refit: 2 })]));
    await draws(page, 1);
    const [x, y] = middle(mock.geometry, strong);
    const at = await page.evaluate(([x, y]) => /** @type {any} */ (window).doorcam.mapPoint(x, y), [x, y]);
    await page.locator("#map").hover({ position: { x: at[0], y: at[1] } });
    const tooltip = page.locator("#tooltip");
    await tooltip.waitFor();
    const text = await tooltip.innerText();
    assert.match(text, new RegExp(`Facet ${strong}\\b`));
    assert.match(text, /Unified, measured\s+0\s+\u22120\.0246\s+0/);
    assert.match(text, /Left, measured\s+0\s+\u22120\.0400\s+0/);
    assert.match(text, /Unified, shrunk\s+0\s+\u22120\.0123\s+0/);
    assert.match(text, /Left, shrunk\s+0\s+\u22120\.0200\s+0/);
    await page.keyboard.press("Escape");
    await tooltip.waitFor({ state: "hidden" });

    await page.getByText("Lit facets", { exact: false }).first().click();
    const first = page.locator("#lit-rows tr").first();
    await first.waitFor();
    assert.equal(await first.locator("td").first().innerText(), String(strong));
    assert.equal(await page.locator("#lit-rows tr").count(), 2);
  });

  test("lists and draws tracks when there are any", async (t) => {
    const { mock, page } = await visit(t);
    mock.send(update(1, []));
    await draws(page, 1);
    await page.getByText("Nobody is seen right now.").waitFor();
    /** @type {Track} */
    const track = {
      id: 7, state: "confirmed", x_m: 0.31, y_m: 1.4, vx_m_s: 0.3, vy_m_s: 0.4,
      covariance_m2: [[0.02, 0.008], [0.008, 0.04]], rgb: [0.01, 0, 0], age_s: 4.2,
    };
    mock.send(update(2, [], { tracks: [track] }));
    await draws(page, 2);
    assert.deepEqual(await colourAt(page, [0.31, 1.4]), [244, 247, 250]);
    await page.locator("#tracks li").waitFor();
    assert.match(await page.locator("#tracks li").innerText(), /7\s+0\.31, 1\.40 m\s+0\.5 m\/s, confirmed for 4 s/);
    assert.equal(await page.locator("#tracks-none").isVisible(), false);
  });

  test("tells apart who is sure, who may be nobody and who is not seen, and shows where they came from", async (t) => {
    const { mock, page } = await visit(t);
    /** @type {(id: number, state: Track["state"], x_m: number) => Track} */
    const track = (id, state, x_m) => ({
      id, state, x_m, y_m: 1.4, vx_m_s: 0, vy_m_s: 0, covariance_m2: [[0.01, 0], [0, 0.01]], rgb: [0, 0, 0], age_s: 1,
    });
    const at = (/** @type {number} */ ms) => new Date(Date.UTC(2026, 0, 1) + ms).toISOString();
    mock.send(update(1, [], { time: at(0) }));
    await draws(page, 1);
    const between = /** @type {[number, number]} */ ([-0.2, 1.4]);
    const bare = await colourAt(page, between);
    mock.send(update(2, [], { time: at(0), tracks: [track(1, "confirmed", -0.4)] }));
    await draws(page, 2);
    const tracks = [track(1, "confirmed", 0), track(2, "tentative", 0.5), track(3, "coasting", 1)];
    mock.send(update(3, [], { time: at(100), tracks }));
    await draws(page, 3);
    const [sure, faint, unseen] = await Promise.all([0, 0.5, 1].map((x) => colourAt(page, [x, 1.4])));
    assert.deepEqual(sure, [244, 247, 250]);
    assert.ok(faint[0] < unseen[0] && unseen[0] < sure[0], `${faint} ${unseen} ${sure}`);
    const trail = await colourAt(page, between);
    assert.ok(trail[0] > bare[0] + 40, `${trail} where ${bare} was`);
    // Five seconds later, the trail is gone.
    mock.send(update(4, [], { time: at(5100), tracks: [track(1, "confirmed", 0)] }));
    await draws(page, 4);
    assert.deepEqual(await colourAt(page, between), bare);
  });

  test("outlines zones and says how many people are in them", async (t) => {
    const { mock, page } = await visit(t, {}, (mock) => {
      mock.geometry.zones = [{ name: "bed", polygon_m: [[-1, 1.2], [0.2, 1.2], [0.2, 2.2], [-1, 2.2]] }];
    });
    mock.send(update(1, [], { zones: [{ name: "bed", people: 2, tracks: [1, 4] }] }));
    await draws(page, 1);
    const [red, green, blue] = await colourAt(page, [0.2, 1.9]);
    assert.ok(green > red && green > blue && green > 120, `${red} ${green} ${blue}`);
    await page.getByText("In zones: bed 2").waitFor();
  });

  test("shows where somebody can be located at all, and where not", async (t) => {
    const { mock, page, complaints } = await visit(t, {}, (mock) => {
      mock.uncertainty = {
        x_m: [-1, 0, 1],
        y_m: [0.5, 1.5, 2.5],
        error_m: [[0.02, 0.01, 0.02], [0.2, 0.1, 0.2], [null, 0.4, 0.9]],
        threshold_m: 0.5,
        calibration: mock.geometry.calibration,
      };
    });
    mock.send(update(1, []));
    await draws(page, 1);
    // Off the lines of facets and grid.
    const near = /** @type {const} */ ([0.13, 0.43]);
    const far = /** @type {const} */ ([0.13, 2.36]);
    const bare = await colourAt(page, [...far]);
    await page.getByLabel("Uncertainty").check({ force: true });
    await page.getByText("0.5 m or better in 78 % of the room").waitFor();
    await settled(page);
    const [nearNow, farNow] = [await colourAt(page, [...near]), await colourAt(page, [...far])];
    assert.ok(farNow[2] > nearNow[2] + 30, `fog thickens with the error: ${nearNow} ${farNow}`);
    await page.getByLabel("Uncertainty").uncheck({ force: true });
    await settled(page);
    assert.deepEqual(await colourAt(page, [...far]), bare);
    // Where nobody can be located at all stays shaded.
    assert.equal(await page.locator("#uncertainty-words").innerText(), "not observable now");
    // What is not known is said in the daemon's words.
    mock.uncertainty = null;
    await page.getByLabel("Uncertainty").check({ force: true });
    await page.getByText("Not known: Not Found").waitFor();
    assert.deepEqual(complaints.filter((line) => !line.includes("404")), []);
  });

  test("shades what is not observable without being asked, once there is something to know", async (t) => {
    const { mock, page, complaints } = await visit(t);
    const blind = /** @type {const} */ ([0.62, 2.36]);
    mock.send(update(1, [], { state: "learning", model: "signed" }));
    await draws(page, 1);
    const bare = await colourAt(page, [...blind]);
    mock.uncertainty = {
      x_m: [-1, 0, 1], y_m: [0.5, 1.5, 2.5], error_m: [[0.02, 0.01, 0.02], [0.2, 0.1, 0.2], [0.3, 0.4, 0.9]],
      threshold_m: 0.5, calibration: mock.geometry.calibration,
    };
    mock.send(update(2, [], { model: "signed" }));
    await page.locator("#uncertainty-key", { hasText: "not observable now" }).waitFor();
    await settled(page);
    assert.ok((await colourAt(page, [...blind]))[2] > bare[2] + 8, "shaded");
    assert.deepEqual(await colourAt(page, [0.13, 2.36]), await colourAt(page, [-0.13, 2.36]), "and nothing else is");
    assert.deepEqual(complaints, []);
  });

  test("shows where a person is heading, the colour of the change, and the numbers under pointer or finger", async (t) => {
    const { mock, page } = await visit(t);
    /** @type {Track} */
    const track = {
      id: 7, state: "confirmed", x_m: 0.3, y_m: 1.4, vx_m_s: 0, vy_m_s: 1,
      covariance_m2: [[0.01, 0], [0, 0.04]], rgb: [-0.01, 0, 0], age_s: 4.2,
    };
    mock.send(update(1, []));
    await draws(page, 1);
    const ahead = /** @type {[number, number]} */ ([0.3, 1.9]);
    const bare = await colourAt(page, ahead);
    mock.send(update(2, [], { tracks: [track] }));
    await draws(page, 2);
    assert.ok((await colourAt(page, ahead))[0] > bare[0] + 100, "the arrow is where they will be in half a second");
    // Less red, and dashed: some of the ring is red, and nothing of it green.
    const ring = await page.evaluate(() => {
      const canvas = /** @type {HTMLCanvasElement} */ (document.getElementById("map"));
      const [x, y] = /** @type {any} */ (window).doorcam.mapPoint(0.3, 1.4);
      const ratio = canvas.width / canvas.clientWidth;
      const ctx = new OffscreenCanvas(24 * ratio, 24 * ratio).getContext("2d");
      ctx?.drawImage(canvas, -(x - 12) * ratio, -(y - 12) * ratio);
      const data = ctx?.getImageData(0, 0, 24 * ratio, 24 * ratio).data ?? new Uint8ClampedArray();
      return data.some((_, k) => k % 4 === 0 && data[k] > 230 && data[k + 1] < 40 && data[k + 2] < 40);
    });
    assert.ok(ring, "the ring has the colour of the missing light");
    const [x, y] = await page.evaluate(() => /** @type {any} */ (window).doorcam.mapPoint(0.32, 1.42));
    await page.locator("#map").hover({ position: { x, y } });
    await page.locator("#tooltip").waitFor();
    const text = await page.locator("#tooltip").innerText();
    assert.match(text, /Person 7\b.*0\.30, 1\.40 m, confirmed for 4 s/);
    assert.match(text, /Speed\s+1\.00 m\/s\s+away/);
    // √5.991 times the deviations.
    assert.match(text, /95 % ellipse\s+± 0\.49\s+± 0\.24 m/);
    // They walk on, and the numbers stay theirs only as long as they are under the pointer.
    mock.send(update(3, [], { tracks: [{ ...track, x_m: -0.8 }] }));
    await draws(page, 3);
    await page.waitForFunction(() => !document.getElementById("tooltip-title")?.textContent?.startsWith("Person"));
  });

  test("tells a facet's numbers to a finger", async (t) => {
    const { mock, page } = await visit(t, { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true, deviceScaleFactor: 2 });
    const index = nearest(mock.geometry, 0.6, 1.2);
    mock.send(update(1, [lit(index, [0.02, 0, 0])]));
    await draws(page, 1);
    const [x, y] = await page.evaluate(([x, y]) => /** @type {any} */ (window).doorcam.mapPoint(x, y), middle(mock.geometry, index));
    await page.locator("#map").tap({ position: { x, y } });
    await page.locator("#tooltip", { hasText: `Facet ${index}` }).waitFor();
    await page.locator("h1").tap();
    await page.locator("#tooltip").waitFor({ state: "hidden" });
  });

  test("is sharp on a dense screen and draws a thick wall to scale", async (t) => {
    const { mock, page } = await visit(t, { deviceScaleFactor: 2 }, (mock) => {
      mock.geometry.doorway = { width_m: 0.85, wall_thickness_m: 0.12, height_m: 2.03 };
    });
    mock.send(update(1, []));
    await draws(page, 1);
    const ratio = await page.evaluate(() => {
      const canvas = /** @type {HTMLCanvasElement} */ (document.getElementById("map"));
      return canvas.width / canvas.clientWidth;
    });
    assert.equal(ratio, 2);
    const wall = await colourAt(page, [0.6, -0.11]);
    assert.deepEqual(await colourAt(page, [0.6, -0.01]), wall);
    assert.notDeepEqual(await colourAt(page, [0.2, -0.06]), wall, "the opening is open");
    assert.notDeepEqual(await colourAt(page, [0.9, -0.16]), wall, "the wall ends at its thickness");
  });
});

describe("connection", () => {
  test("says whose data it is and how it goes", async (t) => {
    const { mock, page } = await visit(t);
    mock.send(update(41, []));
    await reaches(page, "live");
    mock.send(update(42, []));
    mock.send(update(46, []));
    await draws(page, 46);
    await page.waitForFunction(() => document.getElementById("missed")?.textContent === "3");
    const body = await page.locator("body").innerText();
    for (const words of ["Simulated: two people", "replay:recordings/two-people,loop", "Watching", "unexpected end of file", "3.2 ms", "doorcam 0.1.0"]) {
      assert.ok(body.includes(words), `the page says "${words}"`);
    }
    assert.match(await page.locator("#rate").innerText(), /^\d+\.\d$/);
    assert.equal(await page.locator("#gain").innerText(), "\u22123.0 %, +1.2 %");
  });

  test("comes back by itself after a restart, with the new door", async (t) => {
    const { mock, page } = await visit(t);
    mock.send(update(500, []));
    await reaches(page, "live");
    await mock.stop();
    await reaches(page, "reconnecting");
    assert.match(await page.locator("#connection-label").innerText(), /^Reconnecting/);
    assert.match(await page.locator("#map-notice").innerText(), /Not connected · last update \d+ s ago/);
    const other = geometry({ width: 0.85, thickness: 0.12 });
    mock.geometry = other;
    mock.status.source.notes = "Another recording";
    mock.latest = null;
    await mock.start();
    await reaches(page, "waiting");
    const index = nearest(other, 0.5, 1.5);
    mock.send(update(1, [lit(index, rgb(RED))]));
    await reaches(page, "live");
    await page.waitForFunction(() => document.documentElement.dataset.sequence === "1");
    assert.deepEqual(await colourAt(page, middle(other, index)), [255, 0, 0]);
    assert.equal(await page.locator("#missed").innerText(), "0", "a restarted count is no miss");
    await page.getByText("Another recording").waitFor();
  });

  test("never passes an old picture off as live", async (t) => {
    const { mock, page, complaints } = await visit(t);
    mock.send(update(1, []));
    await reaches(page, "live");
    assert.equal(await page.locator("#map-notice").isVisible(), false);
    await reaches(page, "stale");
    assert.match(await page.locator("#map-notice").innerText(), /^Stale · last update \d s ago$/);
    await page.waitForFunction(() => Number(getComputedStyle(/** @type {Element} */ (document.getElementById("map"))).opacity) < 0.5);
    mock.send(update(2, []));
    await reaches(page, "live");
    mock.status.source.state = "ended";
    await page.locator("#map-notice", { hasText: /^Recording ended · last update \d+ s ago$/ }).waitFor();
    assert.deepEqual(complaints, []);
  });

  test("shows the last picture of a recording that ended before, as such", async (t) => {
    const { page, complaints } = await visit(t, {}, (mock) => {
      mock.latest = twoPeople(mock.geometry, 90);
      mock.latestAt = Date.now() - 300_000;
      mock.status.source.state = "ended";
    });
    await page.locator("#map-notice", { hasText: "Recording ended · last update 5 min ago" }).waitFor();
    assert.equal(await page.locator("html").getAttribute("data-sequence"), "90");
    assert.deepEqual(complaints, []);
  });

  test("waits visibly for the first picture", async (t) => {
    const { mock, page, complaints } = await visit(t, {}, (mock) => {
      mock.status.state = "learning";
    });
    await reaches(page, "waiting");
    await page.locator("#map-notice", { hasText: "Learning the background" }).waitFor();
    mock.status.source = { ...mock.status.source, state: "failed", error: "no such device" };
    await page.locator("#map-notice", { hasText: "Source failed: no such device" }).waitFor();
    assert.deepEqual(complaints, []);
  });

  test("waits longer after each failure, never too long, and not in step with others", async (t) => {
    const { page } = await visit(t);
    const delays = await page.evaluate(async () => {
      const { backoffMs } = await import(/** @type {any} */ ("/live.js"));
      const at = (/** @type {number} */ random) => Array.from({ length: 12 }, (_, attempt) => backoffMs(attempt, () => random));
      return { least: at(0), most: at(1) };
    });
    assert.deepEqual(delays.most.slice(0, 6), [500, 1000, 2000, 4000, 8000, 15000]);
    assert.equal(delays.most[11], 15000);
    assert.deepEqual(delays.least, delays.most.map((/** @type {number} */ ms) => ms / 2));
  });

  test("hides the difference picture when the daemon has none", async (t) => {
    const { mock, page } = await visit(t, {}, (mock) => {
      mock.hasPictures = false;
    });
    mock.send(update(1, []));
    await reaches(page, "live");
    await page.waitForTimeout(800);
    assert.equal(await page.locator("#difference").isVisible(), false);
    assert.equal(mock.requests.filter((path) => path.endsWith("difference.png")).length, 1, "asked once, not hammered");
  });

  test("asks for the difference picture at most once a second", async (t) => {
    const { mock, page } = await visit(t);
    const from = Date.now();
    for (let sequence = 1; sequence <= 30; sequence += 1) {
      mock.send(update(sequence, []));
      await page.waitForTimeout(80);
    }
    await page.locator("#difference-image").waitFor();
    const asked = mock.requests.filter((path) => path.endsWith("difference.png")).length;
    const seconds = (Date.now() - from) / 1000;
    assert.ok(asked >= 2 && asked <= seconds + 1, `asked ${asked} times in ${seconds} s`);
  });
});
