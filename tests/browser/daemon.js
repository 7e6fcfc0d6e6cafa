import { spawn } from "node:child_process";

/** @import { ChildProcess } from "node:child_process" */

const START_TIMEOUT_MS = 30000;

/**
 * The real program on a recording that is replayed again and again.
 * @param {string} program
 * @param {string} recording
 * @param {...string} more
 * @returns {Promise<{ child: ChildProcess, url: string }>}
 */
export function serve(program, recording, ...more) {
  const listen = more.includes("--listen") ? [] : ["--listen", "127.0.0.1:0"];
  const args = ["serve", "--source", `replay:${recording},loop`, ...listen, ...more];
  const child = spawn(program, args, { stdio: ["ignore", "ignore", "pipe"] });
  return new Promise((resolve, reject) => {
    let log = "";
    const fail = (/** @type {string} */ why) => {
      child.kill();
      reject(new Error(`${why}; its log:\n${log}`));
    };
    const timer = setTimeout(() => fail("no address logged in time"), START_TIMEOUT_MS);
    child.on("error", (error) => fail(String(error)));
    const ended = (/** @type {number | null} */ code) => fail(`ended with status ${code}`);
    child.on("exit", ended);
    child.stderr?.on("data", (chunk) => {
      log += chunk;
      const address = /http:\/\/127\.0\.0\.1:\d+/.exec(log);
      if (!address) return;
      clearTimeout(timer);
      // Its own listener alone: a test may wait for the end, too.
      child.off("exit", ended);
      resolve({ child, url: `${address[0]}/` });
    });
  });
}
