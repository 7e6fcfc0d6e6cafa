// People who walk through the doorway: counts, how many are inside, and patches that something covers.

import assert from "node:assert/strict";
import { describe, test } from "node:test";
import { violations } from "./axe.js";
import { DESKTOP, PHONE, reaches } from "./browser.js";
import { crossing, crossings, update } from "./scene.js";
import { visit } from "./visit.js";

/** @import { BrowserContextOptions } from "playwright-core" */
/** @import { PatchView } from "../../web/types.js" */

/** @type {PatchView} */
const CLEAR = { state: "clear", used: 1 };

describe("through the door", () => {
  test("today's crossings, how many are inside, and who was the last", async (t) => {
    const { mock, page, complaints } = await visit(t, {}, (mock) => {
      mock.status.crossings = crossings({ last: crossing("cross_in", 130) });
    });
    mock.send(update(1, []));
    await reaches(page, "live");
    await page.locator("#crossings-words", { hasText: "Somebody came in 2 min ago." }).waitFor();
    const told = async () => Promise.all(["#crossed-in", "#crossed-out", "#crossed-back", "#inside"].map((id) => page.locator(id).innerText()));
    assert.deepEqual(await told(), ["3", "1", "4", "2"]);
    // The live socket tells it at once, the status a moment later.
    const more = crossings({ out: 2, inside: 1, last: crossing("cross_out", 0) });
    mock.status.crossings = more;
    mock.send(update(2, [], { crossings: more }));
    await page.locator("#crossings-words", { hasText: /^Somebody went out (just now|\d+ s ago)\.$/ }).waitFor();
    assert.deepEqual(await told(), ["3", "2", "4", "1"]);
    assert.deepEqual(complaints, []);
  });

  test("how many are inside is set right by keyboard", async (t) => {
    const { mock, page } = await visit(t);
    mock.send(update(1, []));
    await reaches(page, "live");
    await page.locator("#crossings-words", { hasText: "Nobody has walked through yet." }).waitFor();
    await page.getByLabel("People inside now").focus();
    await page.keyboard.type("5");
    await page.keyboard.press("Enter");
    await page.locator("#inside-outcome", { hasText: "Counted on from 5." }).waitFor();
    await page.locator("#inside", { hasText: /^5$/ }).waitFor();
    assert.deepEqual(mock.insides, [5]);
    // What is no number of people is not sent.
    for (const wrong of ["-1", "1001", "1.5"]) {
      await page.getByLabel("People inside now").fill(wrong);
      await page.getByRole("button", { name: "Set right" }).click();
    }
    mock.refusal = "crossings.json: cannot be written: no space left on device";
    await page.getByLabel("People inside now").fill("6");
    await page.getByRole("button", { name: "Set right" }).click();
    await page.locator("#inside-outcome.failed", { hasText: "It was not set: crossings.json: cannot be written" }).waitFor();
    assert.deepEqual(mock.insides, [5]);
  });

  test("who may only read is not asked how many are inside", async (t) => {
    const { mock, page } = await visit(t, {}, (mock) => {
      mock.session = { ...mock.session, scope: "read", token_needed: true };
    });
    mock.send(update(1, []));
    await reaches(page, "live");
    await page.locator("#inside", { hasText: /^2$/ }).waitFor();
    assert.equal(await page.locator("#inside-form").isVisible(), false);
  });

  test("where nobody is counted, the page says why and claims nothing", async (t) => {
    const { mock, page } = await visit(t, {}, (mock) => {
      mock.status.crossings = crossings({ available: false, reason: "the picture shows the floor patches only" });
    });
    mock.send(update(1, []));
    await reaches(page, "live");
    await page.locator("#crossings-words", { hasText: "Nobody is counted: the picture shows the floor patches only." }).waitFor();
    assert.equal(await page.locator("#inside-label").innerText(), "Inside, when last seen");
  });
});

describe("the view of the floor", () => {
  test("is told where something covers it, and only there", async (t) => {
    const { mock, page } = await visit(t);
    mock.send(update(1, [], { view: { left: CLEAR, right: CLEAR } }));
    await reaches(page, "live");
    const words = page.locator("#view-words");
    assert.equal(await words.isVisible(), false);
    mock.send(update(2, [], { view: { left: { state: "partial", used: 0.634 }, right: { state: "blocked", used: 0.02 } } }));
    await page.locator("#view-words", { hasText: "Left view partly covered (63 % used), right view blocked." }).waitFor();
    mock.send(update(3, [], { view: { left: CLEAR, right: { state: "blocked", used: 0 } } }));
    await page.locator("#view-words", { hasText: /^Right view blocked\.$/ }).waitFor();
    mock.send(update(4, [], { view: { left: CLEAR, right: CLEAR } }));
    await words.waitFor({ state: "hidden" });
  });

  test("is no picture of the room while both patches are covered, or the camera has moved", async (t) => {
    const { mock, page } = await visit(t, {}, (mock) => {
      mock.status.state = "obstructed";
    });
    let sequence = 0;
    const stream = setInterval(() => mock.send(update((sequence += 1), [], { state: mock.status.state })), 100);
    t.after(() => clearInterval(stream));
    await page.locator("#watch-state", { hasText: "The floor is covered" }).waitFor();
    await page.locator("#tracks-none", { hasText: "Not watching: something covers the floor before the door." }).waitFor();
    mock.status.state = "misaligned";
    await page.locator("#watch-state", { hasText: "The camera has moved" }).waitFor();
    await page.locator("#tracks-none", { hasText: "Not watching: the camera has moved." }).waitFor();
  });
});

describe("everyone", () => {
  /** @type {[string, BrowserContextOptions][]} */
  const looks = [
    ["light", { viewport: DESKTOP, colorScheme: "light" }],
    ["dark", { viewport: DESKTOP, colorScheme: "dark" }],
    ["phone", { viewport: PHONE, colorScheme: "dark", hasTouch: true }],
  ];
  for (const [name, options] of looks) {
    for (const available of [true, false]) {
      test(`reads who walked through (${name}${available ? "" : ", not counted"})`, async (t) => {
        const { mock, page } = await visit(t, options, (mock) => {
          mock.status.crossings = crossings({ available, reason: available ? null : "not watching: no new frames", last: crossing("cross_back", 40) });
        });
        mock.send(update(1, [], { view: { left: { state: "partial", used: 0.5 }, right: CLEAR } }));
        await reaches(page, "live");
        await page.locator("#crossings-words", { hasText: "Somebody turned around on the threshold" }).waitFor();
        // The charts get their words with the first second.
        await page.locator("#charts svg[aria-label]").first().waitFor();
        assert.deepEqual(await violations(page), []);
      });
    }
  }
});
