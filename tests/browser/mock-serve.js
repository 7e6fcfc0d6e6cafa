// `npm run mock`: the page with two people walking about, for work on it without a daemon.
// `npm run mock camera`: a webcam just plugged in, that nobody has calibrated; the people come with the calibration.

import { Mock } from "./mock.js";
import { cameraStatus, twoPeople } from "./scene.js";

const mock = new Mock();
if (process.argv.includes("camera")) {
  mock.status = { ...cameraStatus(), calibrated: false, calibration_revision: 0 };
  mock.geometry.calibration = 0;
}
mock.port = Number(process.env.PORT ?? 8081);
await mock.start();
console.log(`the page on ${mock.url}`);
let sequence = 0;
setInterval(() => {
  const { calibrated, calibration_revision: calibration } = mock.status;
  if (calibrated) mock.send({ ...twoPeople(mock.geometry, (sequence += 1)), calibration });
}, 100);
