// Health at a glance: the charts of the last minutes and the latency, against the numbers that the daemon tells.

import assert from "node:assert/strict";
import { describe, test } from "node:test";
import { reaches, until } from "./browser.js";
import { update } from "./scene.js";
import { visit } from "./visit.js";

/** @import { Page } from "playwright-core" */

/**
 * What a chart says, to who does not see it.
 * @param {Page} page
 * @param {string} title
 */
const says = async (page, title) => (await page.locator(`#charts svg[aria-label^="${title}:"]`).getAttribute("aria-label")) ?? "";

/**
 * @param {Page} page
 * @param {string} title
 * @param {number} line
 */
const drawn = (page, title, line = 0) => page.locator(`#charts svg[aria-label^="${title}:"] .chart-line-${line}`).getAttribute("d");

describe("health", () => {
  test("charts rates, missing frames, solve time, gap and gain as the daemon tells them", async (t) => {
    const { mock, page, complaints } = await visit(t);
    let sequence = 0;
    const stream = setInterval(() => mock.send(update((sequence += 1), [], {
      solution: { lambda: 0.05, objective: 0.5, data: 0.1, penalty: 0.4, bound: 0.49, iterations: 3, warm: true },
      timing_ms: { decode: 1, rectify: 1, background: 1, project: 1, solve: 4.25, track: 0, total: 9 },
    })), 100);
    t.after(() => clearInterval(stream));
    mock.status.rate_hz = { captured: 29.5, solved: 14.5 };
    await until(async () => (await says(page, "Frames")).startsWith("Frames: 29.5 in, 14.5 out"), "the rates");
    await until(async () => (await says(page, "Solve time")).startsWith("Solve time: 4.3 ms"), "the solve time");
    assert.match(await says(page, "Certificate gap"), /^Certificate gap: 2\.0 %/);
    assert.match(await says(page, "Light gain"), /^Light gain: −3\.0 % left, \+1\.2 % right/);
    assert.match(await says(page, "Frames missing"), /^Frames missing: 0 a second; 0 to 0 in/);
    // Three frames too few, of whatever kind.
    mock.status.frames = { ...mock.status.frames, dropped: mock.status.frames.dropped + 2, lost: 1 };
    await until(async () => / 0 to 3 in the last 5 minutes$/.test(await says(page, "Frames missing")), "three frames are missing");
    assert.match(await page.locator("#health-words").innerText(), /^Streaming, background from 200 frames, 5 min old$/);
    assert.deepEqual(complaints, []);
  });

  test("leaves a gap where nothing was known", async (t) => {
    const { mock, page } = await visit(t);
    mock.send(update(1, []));
    await reaches(page, "live");
    await until(async () => /^M/.test((await drawn(page, "Frames")) ?? ""), "a first second");
    await mock.stop();
    await reaches(page, "reconnecting");
    await until(async () => (await says(page, "Frames")).startsWith("Frames: – in, – out"), "a second without a daemon");
    mock.status.frames.dropped = 0;
    await mock.start();
    await until(async () => ((await drawn(page, "Frames")) ?? "").split("M").length === 3, "two stretches with a gap between");
    assert.match(await says(page, "Frames missing"), / 0 to 0 in /, "a daemon that counts anew has lost nothing");
  });

  test("measures the latency by the daemon's clock", async (t) => {
    const { mock, page } = await visit(t, {}, (mock) => {
      mock.clockAheadMs = 3_600_000;
    });
    const captured = (/** @type {number} */ agoMs) => new Date(Date.now() + mock.clockAheadMs - agoMs).toISOString();
    let sequence = 0;
    const stream = setInterval(() => mock.send(update((sequence += 1), [], { time: captured(5000) })), 100);
    t.after(() => clearInterval(stream));
    await reaches(page, "live");
    const latency = async () => Number((await page.locator("#latency").innerText()).replace("–", "NaN"));
    await until(async () => (await latency()) >= 5000, "the latency is known");
    assert.ok((await latency()) < 8000, `five seconds and what drawing takes: ${await latency()}`);
    await until(async () => /: \d\.\d s; \d\.\d s to \d\.\d s in/.test(await says(page, "Latency")), "the latency is charted");
    // An old picture has none.
    clearInterval(stream);
    await reaches(page, "stale");
    await until(async () => (await page.locator("#latency").innerText()) === "–", "no latency of an old picture");
  });
});
