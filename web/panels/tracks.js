import { byId, resizeList, setText } from "../dom.js";
import { duration, fixed, position } from "../format.js";

/** @import { Occupancy, Track } from "../types.js" */

/**
 * That nobody is seen means something only while somebody would be.
 * @param {string | null} why  doorcam is not watching; null: it is
 */
export function showNobody(why) {
  setText(byId("tracks-none"), why === null ? "Nobody is seen right now." : `Not watching: ${why}.`);
}

/**
 * @param {Track[]} tracks
 * @param {Occupancy[]} zones
 */
export function showTracks(tracks, zones) {
  const summary = byId("zones");
  summary.hidden = zones.length === 0;
  setText(summary, `In zones: ${zones.map(({ name, people }) => `${name} ${people}`).join(", ")}`);
  byId("tracks-none").hidden = tracks.length > 0;
  const list = byId("tracks");
  resizeList(list, tracks.length, item);
  tracks.forEach((track, row) => {
    const [id, place, detail] = list.children[row].children;
    const speed = Math.hypot(track.vx_m_s, track.vy_m_s);
    setText(id, String(track.id));
    setText(place, position(track.x_m, track.y_m));
    setText(detail, `${fixed(speed, 1)} m/s, ${track.state} for ${duration(track.age_s)}`);
  });
}

function item() {
  const element = document.createElement("li");
  element.append(document.createElement("b"), document.createElement("div"), document.createElement("span"));
  return element;
}
