// `npm run mock`: the page with two people walking about, for work on it without a daemon.

import { Mock } from "./mock.js";
import { twoPeople } from "./scene.js";

const mock = new Mock();
mock.port = Number(process.env.PORT ?? 8081);
await mock.start();
console.log(`the page on ${mock.url}`);
let sequence = 0;
setInterval(() => mock.send(twoPeople(mock.geometry, (sequence += 1))), 100);
