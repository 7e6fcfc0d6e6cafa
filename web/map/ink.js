// The map is dark in both colour schemes: it shows light, and light reads best on black.

export const INK = {
  ground: "#0a0e13",
  room: "#0f151c",
  visibleSide: "#0c1015",
  gridMetre: "rgb(160 185 210 / 0.16)",
  gridHalf: "rgb(160 185 210 / 0.07)",
  outline: "rgb(160 185 210 / 0.38)",
  facet: "rgb(150 175 200 / 0.34)",
  facetBackground: "rgb(150 175 200 / 0.24)",
  litOutline: "rgb(255 255 255 / 0.42)",
  wall: "#66727f",
  text: "#94a3b2",
  textFaint: "#7c8a98",
  edge: "#f2c14e",
  edgeFaint: "#7d6a37",
  patchFill: "rgb(242 193 78 / 0.14)",
  track: "#f4f7fa",
  trail: "rgb(244 247 250 / 0.4)",
  zone: "#7fc8a9",
  zoneChosen: "rgb(127 200 169 / 0.16)",
  fog: "#8fa8c4",
  blind: "rgb(143 168 196 / 0.16)",
  fogHatch: "rgb(10 14 19 / 0.75)",
  highlight: "#ffffff",
};

export const FONT = '11px system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';
export const FONT_BOLD = `600 ${FONT}`;
