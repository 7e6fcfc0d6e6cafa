// Recordings begun and ended on the page.

import assert from "node:assert/strict";
import { describe, test } from "node:test";
import { reaches } from "./browser.js";
import { update } from "./scene.js";
import { visit } from "./visit.js";

describe("recording", () => {
  test("begins and ends as asked, and says how it goes", async (t) => {
    const { mock, page, complaints } = await visit(t);
    mock.send(update(1, []));
    await reaches(page, "live");
    await page.locator("#recording-seconds").fill("90");
    await page.getByLabel("Room empty at first").fill("5");
    await page.locator("#recording-name").fill("evening");
    await page.getByRole("button", { name: "Record", exact: true }).click();
    await page.locator("#recording-outcome", { hasText: "Recording." }).waitFor();
    assert.deepEqual(mock.recorded, [{ name: "evening", seconds: 90, empty_seconds: 5 }]);
    const { recording } = mock.status;
    assert.ok(recording);
    mock.status.recording = { ...recording, frames: 120, seconds: 12.1, bytes: 34_500_000, lost: 2 };
    await page.locator("#recording-words", { hasText: "120 frames in 12 s, 34.5 MB, 2 missing so far, into /var/lib/doorcam/recordings/evening" }).waitFor();
    assert.equal(await page.locator("#recording-now").innerText(), "Recording 12 s");
    assert.equal(await page.locator("#recording-seconds").isDisabled(), true);
    await page.getByRole("button", { name: "Stop recording" }).click();
    await page.locator("#recording-words", { hasText: /^The last one: 120 frames .* \(stopped\)$/ }).waitFor();
    assert.equal(await page.locator("#recording-now").isVisible(), false);
    assert.deepEqual(complaints, []);
  });

  test("says why nothing is recorded, and what ended one", async (t) => {
    const { mock, page } = await visit(t, {}, (mock) => {
      mock.refusal = "evening: there is a recording already; remove it or name another directory";
    });
    mock.send(update(1, []));
    await reaches(page, "live");
    await page.getByRole("button", { name: "Record", exact: true }).click();
    await page.locator("#recording-outcome.failed", { hasText: "Nothing is recorded: evening: there is a recording already" }).waitFor();
    mock.status.recording = {
      directory: "evening", state: "failed", frames: 3, seconds: 1, bytes: 10, skipped: 0, lost: 0, overflowed: 0,
      ended: null, error: "frames/00000003.png: no space left on the device",
    };
    await page.getByRole("alert").filter({ hasText: "no space left on the device" }).waitFor();
    // A length that is none is not sent.
    mock.refusal = null;
    await page.locator("#recording-seconds").fill("0");
    await page.getByRole("button", { name: "Record", exact: true }).click();
    assert.deepEqual(mock.recorded, []);
  });
});
