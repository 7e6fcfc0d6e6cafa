// What happened in the last hours: occupancy that can be scrubbed, events, and files of them.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { describe, test } from "node:test";
import { violations } from "./axe.js";
import { DESKTOP, PHONE, picture, reaches } from "./browser.js";
import { update } from "./scene.js";
import { visit } from "./visit.js";

/** @import { TestContext } from "node:test" */
/** @import { BrowserContextOptions, Page } from "playwright-core" */
/** @import { Mock } from "./mock.js" */
/** @import { OccupancySpan, RoomEvent } from "../../web/types.js" */

const MINUTE = 60_000;

const ago = (/** @type {number} */ now, /** @type {number} */ minutes) => new Date(now - minutes * MINUTE).toISOString();

/**
 * @param {number} now
 * @returns {RoomEvent[]} two people, one of them in bed for a while
 */
function evening(now) {
  const event = (/** @type {number} */ sequence, /** @type {RoomEvent["kind"]} */ kind, /** @type {number} */ minutesAgo, /** @type {number} */ track, /** @type {string | null} */ zone = null) =>
    ({
      sequence, kind, time: ago(now, minutesAgo), track, x_m: -0.5, y_m: 1.25, zone,
      through: null, reason: kind === "exit" ? /** @type {const} */ ("unseen") : null, speed_m_s: null,
    });
  return [
    event(0, "enter", 50, 3),
    event(1, "enter", 40, 4),
    event(2, "zone_enter", 38, 4, "bed, left"),
    event(3, "exit", 30, 3),
    event(4, "zone_exit", 12, 4, "bed, left"),
    event(5, "exit", 10, 4),
    event(6, "enter", 2, 5),
  ];
}

/**
 * The same as occupancy: watched for 55 minutes, and until some time later.
 * @param {number} now
 * @returns {OccupancySpan[]}
 */
function occupied(now) {
  const counts = (/** @type {number} */ first, /** @type {string | null} */ zone, /** @type {[number, number][]} */ changes) =>
    changes.slice(0, -1).map(([minutesAgo, people], k) => ({ id: first + k, zone, people, from: ago(now, minutesAgo), to: ago(now, changes[k + 1][0]) }));
  return [
    ...counts(0, null, [[55, 0], [50, 1], [40, 2], [30, 1], [10, 0], [2, 1], [-5, 0]]),
    ...counts(10, "bed, left", [[55, 0], [38, 1], [12, 0], [-5, 0]]),
  ];
}

/**
 * @param {TestContext} t
 * @param {BrowserContextOptions} [options]
 * @param {(mock: Mock) => void} [prepare]
 */
async function looking(t, options, prepare) {
  const now = Date.now();
  const visited = await visit(t, options, (mock) => {
    mock.events = evening(now);
    mock.spans = occupied(now);
    mock.geometry.zones = [{ name: "bed, left", polygon_m: [[-1, 1], [0, 1], [0, 2]] }];
    prepare?.(mock);
  }, "#history");
  visited.mock.send(update(1, []));
  await visited.page.locator("#history-rows tr").first().waitFor();
  return { ...visited, now };
}

/**
 * Drags the time to so many minutes ago; an hour is shown.
 * @param {Page} page
 * @param {number} minutes
 */
async function scrub(page, minutes) {
  const box = await page.locator("#timeline").boundingBox();
  assert.ok(box);
  await page.mouse.click(box.x + box.width * (1 - minutes / 60), box.y + 30);
  return page.locator("#history-who").innerText();
}

describe("history", () => {
  test("says who was where at any time that is scrubbed to", async (t) => {
    const { page, complaints } = await looking(t);
    assert.match(await page.locator("#history-when").innerText(), /^Now, /);
    assert.match(await page.locator("#history-who").innerText(), /Room: 1 person\s+bed, left: 0 people/);
    assert.match(await scrub(page, 35), /Room: 2 people\s+bed, left: 1 person/);
    assert.match(await scrub(page, 20), /Room: 1 person\s+bed, left: 1 person/);
    assert.match(await scrub(page, 5), /Room: 0 people\s+bed, left: 0 people/);
    assert.match(await scrub(page, 58), /Room: not watched\s+bed, left: not watched/, "before the daemon began");
    assert.match(await scrub(page, 20), /Room: 1/);
    // The events up to then, the newest first.
    assert.deepEqual((await page.locator("#history-rows tr td:nth-child(3)").allInnerTexts()).slice(0, 2), ["leaves", "enters bed, left"]);
    assert.equal(await page.locator("#history-count").innerText(), "7");
    assert.deepEqual(complaints, []);
  });

  test("draws as many people as there were", async (t) => {
    const { page } = await looking(t);
    const heights = await page.evaluate(() => {
      const canvas = /** @type {HTMLCanvasElement} */ (document.getElementById("timeline"));
      const ctx = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d");
      if (!ctx) throw new Error("no canvas");
      ctx.drawImage(canvas, 0, 0);
      const ratio = canvas.width / canvas.clientWidth;
      const accent = getComputedStyle(canvas).getPropertyValue("--accent").trim();
      const wanted = [1, 3, 5].map((at) => parseInt(accent.slice(at, at + 2), 16));
      // Pixels of the room's colour in the room's lane, so many minutes ago.
      return [45, 35, 20, 5].map((minutes) => {
        const column = ctx.getImageData(Math.round(canvas.width * (1 - minutes / 60)), Math.round(16 * ratio), 1, Math.round(40 * ratio)).data;
        let count = 0;
        for (let k = 0; k < column.length; k += 4) if (wanted.every((value, c) => column[k + c] === value)) count += 1;
        return count / ratio;
      });
    });
    assert.deepEqual(heights, [20, 40, 20, 0]);
  });

  test("is scrubbed by keys, follows the time at its end, and takes in what happens", async (t) => {
    const { mock, page, now } = await looking(t);
    const slider = page.getByRole("slider", { name: "Time that is looked at" });
    await slider.focus();
    await page.keyboard.press("Home");
    assert.match((await slider.getAttribute("aria-valuetext")) ?? "", /; Room: not watched; /);
    await page.keyboard.press("End");
    await page.locator("#history-when", { hasText: /^Now, / }).waitFor();
    mock.spans[5] = { ...mock.spans[5], people: 2 };
    mock.events.push({ ...mock.events[6], sequence: 7, track: 6, time: new Date(now + 1).toISOString() });
    await page.locator("#history-who", { hasText: "Room: 2 people" }).waitFor();
    await page.locator("#history-rows tr", { hasText: "Person 6" }).waitFor();
  });

  test("exports what is shown as CSV and as JSON", async (t) => {
    const { mock, page, complaints } = await looking(t);
    const file = async (/** @type {string} */ name) => {
      const [download] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name }).click()]);
      assert.match(download.suggestedFilename(), /^doorcam-events-\d{4}-\d\d-\d\dT\d{6}-\d{4}-\d\d-\d\dT\d{6}\.(csv|json)$/);
      return readFile(await download.path(), "utf8");
    };
    const rows = (await file("Export CSV")).split("\r\n");
    assert.equal(rows[0], "sequence,kind,time,track,x_m,y_m,zone,through,reason,speed_m_s");
    assert.equal(rows[1], `0,enter,${mock.events[0].time},3,-0.5,1.25,,,,`);
    assert.equal(rows[3], `2,zone_enter,${mock.events[2].time},4,-0.5,1.25,"bed, left",,,`);
    assert.equal(rows.length, 9);
    assert.deepEqual(JSON.parse(await file("Export JSON")), mock.events);
    // Of the last quarter of an hour, only what happened in it.
    await page.getByLabel("15 min").check({ force: true });
    await page.locator("#history-count", { hasText: /^3$/ }).waitFor();
    assert.deepEqual(JSON.parse(await file("Export JSON")).map((/** @type {RoomEvent} */ event) => event.sequence), [4, 5, 6]);
    assert.deepEqual(complaints, []);
  });

  test("asks for the time that is shown", async (t) => {
    const { mock, page, complaints } = await looking(t, {}, (mock) => {
      const span = (/** @type {number} */ id, /** @type {number} */ from, /** @type {number} */ to, /** @type {number} */ people, /** @type {string | null} */ zone = null) =>
        ({ id, zone, people, from: new Date(Date.now() - from * MINUTE).toISOString(), to: new Date(Date.now() - to * MINUTE).toISOString() });
      mock.spans = [span(1, 55, 45, 0), span(2, 45, 25, 3), span(3, 90, 70, 1), span(4, 45, 30, 2, "bed, left")];
    });
    assert.match(await scrub(page, 40), /Room: 3 people\s+bed, left: 2 people/);
    assert.match(await scrub(page, 20), /Room: not watched/, "what no span covers");
    await page.getByRole("button", { name: "Earlier" }).click();
    await page.locator("#history-who", { hasText: "Room: 3 people" }).waitFor();
    await page.getByRole("button", { name: "Earlier" }).click();
    await page.getByRole("button", { name: "Later" }).click();
    await page.getByRole("button", { name: "Later" }).click();
    await page.locator("#history-when", { hasText: /^Now, / }).waitFor();
    assert.ok(mock.requests.some((path) => path.endsWith("/occupancy")));
    assert.deepEqual(complaints, []);
  });

  test("says who is there now, though the newest span ends a moment ago", async (t) => {
    const { page } = await looking(t, {}, (mock) => {
      mock.spans = [{ id: 1, zone: null, people: 2, from: ago(Date.now(), 5), to: ago(Date.now(), 0.01) }];
    });
    await page.locator("#history-who", { hasText: "Room: 2 people" }).waitFor();
  });

  test("says where it is kept, and when it is not where it should be", async (t) => {
    const { mock, page } = await looking(t);
    const kept = page.locator("#history-kept");
    assert.equal(await kept.innerText(), "Kept in /var/lib/doorcam/history.sqlite, 1.2 MB.");
    mock.status.history = { ...mock.status.history, state: "memory", reason: "/var/lib/doorcam/history.sqlite: database or disk is full", lost: 3 };
    await page.locator("#history-kept.trouble", { hasText: "In memory, until doorcam ends: /var/lib/doorcam/history.sqlite: database or disk is full. 3 entries could not be kept." }).waitFor();
    mock.status.history = { state: "memory", reason: "for recordings and simulations, the history is kept only in a file", file: null, bytes: 0, lost: 0 };
    await page.locator("#history-kept:not(.trouble)", { hasText: "In memory" }).waitFor();
  });

  /** @type {[string, BrowserContextOptions][]} */
  const looks = [
    ["history-light", { viewport: DESKTOP }],
    ["history-dark", { viewport: DESKTOP, colorScheme: "dark" }],
    ["history-phone", { viewport: PHONE, deviceScaleFactor: 2, hasTouch: true }],
  ];
  for (const [name, options] of looks) {
    test(`has no accessibility violation (${name}), and its picture is taken`, async (t) => {
      const { page } = await looking(t, options);
      await reaches(page, "stale");
      await scrub(page, 20);
      await picture(page, name);
      assert.deepEqual(await violations(page), []);
      assert.equal(await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth), 0);
    });
  }
});
