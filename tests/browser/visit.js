import { after, before } from "node:test";
import { launch, open } from "./browser.js";
import { Mock } from "./mock.js";

/** @import { TestContext } from "node:test" */
/** @import { Browser, BrowserContextOptions } from "playwright-core" */

/** @type {Browser} */
let browser;
before(async () => {
  browser = await launch();
});
after(() => browser.close());

/**
 * A mock of its own and a page that looks at it, both gone when the test ends.
 * @param {TestContext} t
 * @param {BrowserContextOptions} [options]
 * @param {(mock: Mock) => void} [prepare]
 * @param {string} [view]  of the page's address
 */
export async function visit(t, options, prepare, view = "") {
  const mock = new Mock();
  prepare?.(mock);
  await mock.start();
  t.after(() => mock.stop());
  const { page, complaints, close } = await open(browser, mock.url + view, options);
  t.after(close);
  return { mock, page, complaints };
}
