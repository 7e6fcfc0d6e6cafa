import { mkdir } from "node:fs/promises";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";

/** @import { Browser, BrowserContextOptions, Page } from "playwright-core" */

const ARTEFACTS = fileURLToPath(new URL("artefacts/", import.meta.url));

export const DESKTOP = { width: 1280, height: 860 };
export const PHONE = { width: 390, height: 844 };

export function launch() {
  return chromium.launch({
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    args: [
      "--headless",
      "--no-sandbox",
      "--disable-gpu",
      "--disable-quic",
      "--no-first-run",
      "--disable-background-networking",
      "--disable-component-update",
      "--disable-sync",
    ],
  });
}

/**
 * A page of its own context, with everything the console complained of.
 * @param {Browser} browser
 * @param {string} url
 * @param {BrowserContextOptions} [options]
 */
export async function open(browser, url, options = {}) {
  const context = await browser.newContext({ viewport: DESKTOP, colorScheme: "light", ...options });
  const page = await context.newPage();
  page.setDefaultTimeout(10000);
  /** @type {string[]} */
  const complaints = [];
  page.on("console", (message) => {
    if (message.type() === "error" || message.type() === "warning") complaints.push(message.text());
  });
  page.on("pageerror", (error) => complaints.push(String(error)));
  await page.goto(url);
  return { page, complaints, close: () => context.close() };
}

/**
 * @param {Page} page
 * @param {string} state
 */
export async function reaches(page, state) {
  await page.waitForFunction((wanted) => document.documentElement.dataset.connection === wanted, state);
}

/**
 * @param {Page} page
 * @param {number} sequence
 */
export async function draws(page, sequence) {
  await page.waitForFunction((wanted) => Number(document.documentElement.dataset.sequence) >= wanted, sequence);
}

/**
 * What the page was last told has been drawn.
 * @param {Page} page
 */
export async function settled(page) {
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
}

/**
 * The canvas's brightest colour within `radius` CSS pixels of a floor point, and the update it
 * belongs to.
 * @param {Page} page
 * @param {readonly [number, number]} point  metres, door frame
 * @param {number} [radius]
 * @returns {Promise<{ colour: [number, number, number], sequence: number }>}
 */
export async function look(page, [x, y], radius = 0) {
  return page.evaluate(([x, y, radius]) => {
    const canvas = /** @type {HTMLCanvasElement} */ (document.getElementById("map"));
    const { doorcam } = /** @type {{ doorcam: { mapPoint(x: number, y: number): [number, number] } }} */ (/** @type {unknown} */ (window));
    const ratio = canvas.width / canvas.clientWidth;
    const [px, py] = doorcam.mapPoint(x, y).map((css) => Math.floor((css - radius) * ratio));
    const size = 1 + Math.floor(2 * radius * ratio);
    // From a copy: reading the page's own canvas would slow it and have the browser complain.
    const probe = new OffscreenCanvas(size, size).getContext("2d");
    probe?.drawImage(canvas, -px, -py);
    const data = probe?.getImageData(0, 0, size, size).data ?? new Uint8ClampedArray();
    /** @type {[number, number, number]} */
    let colour = [0, 0, 0];
    for (let i = 0; i < data.length; i += 4) {
      const [r, g, b] = data.subarray(i, i + 3);
      if (r + g + b > colour[0] + colour[1] + colour[2]) colour = [r, g, b];
    }
    return { colour, sequence: Number(document.documentElement.dataset.sequence) };
  }, [x, y, radius]);
}

/**
 * The canvas's colour at a floor point.
 * @param {Page} page
 * @param {readonly [number, number]} point
 */
export const colourAt = async (page, point) => (await look(page, point)).colour;

/**
 * Every pixel of the canvas, as something to compare.
 * @param {Page} page
 */
export function pixels(page) {
  return page.evaluate(() => /** @type {HTMLCanvasElement} */ (document.getElementById("map")).toDataURL());
}

/**
 * Until something outside the page is so.
 * @param {() => unknown} is  may be a promise
 * @param {string} what
 */
export async function until(is, what) {
  const end = Date.now() + 10000;
  while (!(await is())) {
    if (Date.now() > end) throw new Error(`not in time: ${what}`);
    await new Promise((done) => setTimeout(done, 20));
  }
}

/**
 * @param {Page} page
 * @param {string} name
 */
export async function picture(page, name) {
  await mkdir(ARTEFACTS, { recursive: true });
  await page.screenshot({ path: `${ARTEFACTS}${name}.png`, fullPage: true });
}
