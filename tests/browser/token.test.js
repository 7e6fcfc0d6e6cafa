// The page where a token is needed, on the real daemon.

import assert from "node:assert/strict";
import { writeFile, mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, describe, test } from "node:test";
import { violations } from "./axe.js";
import { launch, open, picture, reaches } from "./browser.js";
import { serve } from "./daemon.js";
import { visit } from "./visit.js";

/** @import { ChildProcess } from "node:child_process" */
/** @import { Browser } from "playwright-core" */

const program = process.env.DOORCAM_BIN;
const recording = process.env.DOORCAM_RECORDING;
const skip = program && recording ? undefined : "set DOORCAM_BIN and DOORCAM_RECORDING to test the real program";

const CONTROL = "control-0123456789abcdef";
const READ = "read-0123456789abcdef0123";

describe("a doorcam with tokens", () => {
  /** @type {Browser} */
  let browser;
  /** @type {ChildProcess} */
  let child;
  /** @type {string} */
  let url;
  /** @type {string} */
  let directory;

  before(async () => {
    if (skip) return;
    directory = await mkdtemp(join(tmpdir(), "doorcam-"));
    const [control, read] = ["control", "read"].map((name) => join(directory, name));
    await writeFile(control, CONTROL, { mode: 0o600 });
    await writeFile(read, READ, { mode: 0o600 });
    const tokens = ["--token-file", control, "--read-token-file", read];
    ({ child, url } = await serve(String(program), String(recording), ...tokens));
    browser = await launch();
  });
  after(async () => {
    await browser?.close();
    child?.kill();
    if (directory) await rm(directory, { recursive: true });
  });

  test("asks for one, shows the map to the read token and asks again to change something", { skip }, async (t) => {
    const { page, close } = await open(browser, url);
    t.after(close);
    page.setDefaultTimeout(60000);
    const dialog = page.locator("#token-dialog");
    await dialog.waitFor();
    await picture(page, "token");
    assert.deepEqual(await violations(page), []);
    const field = page.getByLabel("Token", { exact: true });
    await field.fill("wrong-0123456789abcdef01");
    await page.keyboard.press("Enter");
    await page.locator("#token-problem", { hasText: "not one of" }).waitFor();
    await field.fill(READ);
    await page.keyboard.press("Enter");
    await dialog.waitFor({ state: "hidden" });
    await reaches(page, "live");
    // The browser keeps who it is; scripts cannot read it.
    assert.equal(await page.evaluate(() => document.cookie), "");
    await page.reload();
    await reaches(page, "live");

    await page.locator("#reset-background").click();
    await dialog.waitFor();
    assert.match(await page.locator("#token-why").innerText(), /control token/);
    await field.fill(CONTROL);
    await page.keyboard.press("Enter");
    await dialog.waitFor({ state: "hidden" });
    await page.locator("#reset-background").click();
    await page.locator("#reset-outcome", { hasText: "being learned anew" }).waitFor();

    await page.locator("#session", { hasText: "Log out" }).click();
    await page.locator("#session", { hasText: "Log in" }).waitFor();
    await page.waitForFunction(() => document.documentElement.dataset.connection === "reconnecting");
    assert.equal(await page.evaluate(async () => (await fetch("/api/v1/status")).status), 401);
  });
});

test("a page that doorcam takes for another site's says why", async (t) => {
  const refusal = "pages at http://door.lan:8081 may not do this";
  const { page } = await visit(t, {}, (mock) => {
    mock.session = { ...mock.session, refusal };
  });
  await page.locator("#foreign", { hasText: `This address is not allowed: ${refusal}.` }).waitFor();
});

test("a doorcam that everybody may change says so on the page", async (t) => {
  const { page, mock } = await visit(t, {}, (mock) => {
    mock.session = { ...mock.session, exposed: true };
  });
  await page.locator("#exposed").waitFor();
  mock.session = { ...mock.session, exposed: false };
  await page.reload();
  await page.locator("#session").waitFor({ state: "hidden" });
  await page.locator("#exposed").waitFor({ state: "hidden" });
});
