// Who moves in the hidden room, live: node people.mjs [URL [UPDATES]]
//
// Needs nothing but Node.js 22 (or 20 with --experimental-websocket). In a page it is the same, but for `process`.

const [url = "http://127.0.0.1:8080", updates = "Infinity"] = process.argv.slice(2);

const answer = await fetch(`${url}/api/v1/status`);
if (!answer.ok) throw new Error((await answer.json()).detail);
const status = await answer.json();
console.log(`doorcam ${status.version} watches ${status.source.spec}: ${status.state}`);

let count = 0;
const live = new WebSocket(`${url.replace("http", "ws")}/api/v1/live`);
live.addEventListener("message", ({ data }) => {
  const { sequence, state, tracks, missed } = JSON.parse(data);
  console.log(`update ${sequence}: ${state}, ${tracks.length} followed${missed ? ` (missed ${missed})` : ""}`);
  for (const { id, state, x_m, y_m } of tracks) {
    console.log(`  ${id}: ${state} at x ${x_m.toFixed(2)} m, y ${y_m.toFixed(2)} m`);
  }
  count += 1;
  if (count >= Number(updates)) live.close();
});
live.addEventListener("error", () => {
  console.error(`no live socket at ${url}`);
  process.exitCode = 1;
});
