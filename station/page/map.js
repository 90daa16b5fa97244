// The map: mission frame in metres (x east, y north), drawn by Leaflet on a plane.

import { Background } from "./background.js";
import { Sketch } from "./sketch.js";
import { element, say, significant } from "./texts.js";

const DOSE_LEVELS = [0.1, 1, 10, 100, 1000];  // uSv/h
const DOSE_COLOURS = ["#fff7bc", "#fec44f", "#fe9929", "#d95f0e", "#8c2d04", "#3d1400"];
const DOSE_ALPHA = "82";  // on the map and in its legend

const at = ([x, y]) => [y, x];

// Colours of a raster's values as pixels.
const BELIEF_PAINT = paint((value) => [0, 114, 178, Math.min(200, 1.2 * value)]);
const DOSE_FILLS = DOSE_COLOURS.map((text) => [1, 3, 5].map((start) => parseInt(text.slice(start, start + 2), 16)));
const DOSE_PAINT = paint((value) => {
  const level = DOSE_LEVELS.filter((least) => 1e-3 * 10 ** (value / 32) >= least).length;
  return [...DOSE_FILLS[level], level === 0 ? 0 : parseInt(DOSE_ALPHA, 16)];
});

function paint(colourOf) {
  const bytes = Uint8ClampedArray.from(Array.from({ length: 256 }, (_, value) => colourOf(value)).flat());
  return new Uint32Array(bytes.buffer);
}

export class SwarmMap {
  constructor(mission) {
    this.mission = mission;
    this.map = L.map("map", { crs: L.CRS.Simple, minZoom: -4, maxZoom: 7, zoomSnap: 0.25, preferCanvas: true, attributionControl: false, fadeAnimation: false });
    this.map.createPane("rasters").style.zIndex = 250;
    Object.assign(this.map.createPane("labels").style, { zIndex: 440, pointerEvents: "none" });  // below the drones
    L.control.scale({ imperial: false }).addTo(this.map);
    this.fence = L.polygon(mission.fence.map(at), { color: "#444", weight: 2, dashArray: "2 6", fill: false }).addTo(this.map);
    this.area = L.polygon(mission.area.map(at), { color: "#111", weight: 2, fill: false }).addTo(this.map);
    this.layers = Object.fromEntries(["tiles", "own", "dose", "belief"].map((name) => [name, L.layerGroup().addTo(this.map)]));
    this.sketch = new Sketch(this.map, mission.drones);
    for (const name of ["cones", "trails", "plans"]) this.layers[name] = this.sketch.part(name);
    this.cordon = L.layerGroup().addTo(this.map);
    this.rasters = {};
    this.source = null;
    this.line = null;  // the cordon's
    this.#control();
    this.background = new Background(this.map, mission, this.layers);
    this.fit(this.area);
    this.watch = new ResizeObserver(() => this.#resized());  // what is beside the map grows and shrinks
    this.watch.observe(this.map.getContainer());
  }

  // Show the whole of something, beside the list of layers.
  fit(shape) {
    const beside = document.querySelector(".control").open ? 270 : 0;
    this.map.fitBounds(shape.getBounds().pad(0.1), { paddingBottomRight: [beside, 0], animate: false });
    this.fitted = { shape, centre: this.map.getCenter(), zoom: this.map.getZoom() };
  }

  // What was to be seen as a whole stays so, unless the operator has moved the map.
  #resized() {
    const { shape, centre, zoom } = this.fitted;
    const isMoved = this.map.getZoom() !== zoom || this.map.distance(this.map.getCenter(), centre) > 1;
    this.map.invalidateSize({ animate: false });
    if (!isMoved) this.fit(shape);
  }

  // Draw a frame.
  show(frame) {
    this.source = frame.source?.place ?? null;
    this.#tellCordon();
    this.sketch.show(frame);
  }

  remove() {
    this.watch.disconnect();
    this.map.remove();
    this.sketch.remove();
  }

  #control() {
    const control = L.control({ position: "topright" });
    control.onAdd = () => {
      const box = Object.assign(element("details", "", "control"), { open: window.innerWidth >= 1400 });
      box.append(element("summary", say("layers")));
      const under = [...(this.mission.tiles ? ["tiles"] : []), ...(this.mission.layer ? ["own"] : [])];
      for (const name of ["belief", "dose", "cones", "trails", "plans", ...under]) {
        const label = element("label");
        const tick = element("input");
        Object.assign(tick, { type: "checkbox", checked: true, id: `layer-${name}` });
        tick.addEventListener("change", () => (tick.checked ? this.layers[name].addTo(this.map) : this.layers[name].remove()));
        label.append(tick, element("span", say(`layer ${name}`)));
        box.append(label);
      }
      const label = element("label", `${say("cordon label")} `);
      this.level = Object.assign(element("input"), { type: "number", min: 0.001, step: "any", value: 10, id: "cordon" });
      this.level.addEventListener("change", () => this.#drawDose());
      label.append(this.level);
      this.cordonTold = element("p", "", "dim");
      box.append(label, this.cordonTold, this.#legend(), marks());
      if (this.mission.tiles?.[2]) box.append(element("p", this.mission.tiles[2], "dim"));
      L.DomEvent.disableClickPropagation(box);
      L.DomEvent.disableScrollPropagation(box);
      return box;
    };
    control.addTo(this.map);
  }

  #legend() {
    const box = element("div", "", "legend");
    DOSE_COLOURS.forEach((fill, place) => {
      const swatch = element("i");
      if (place > 0) swatch.style.backgroundImage = `linear-gradient(${fill}${DOSE_ALPHA}, ${fill}${DOSE_ALPHA})`;
      const text = place === 0 ? `< ${DOSE_LEVELS[0]}` : `≥ ${DOSE_LEVELS[place - 1]}`;
      box.append(swatch, element("span", `${text}${place === DOSE_COLOURS.length - 1 ? " " + say("dose legend") : ""}`));
    });
    return box;
  }

  // Take away layers that are not known at the time that is shown.
  without(kinds) {
    for (const kind of kinds) {
      this.layers[kind].clearLayers();
      delete this.rasters[kind];
      if (kind === "dose") {
        this.cordon.clearLayers();
        this.line = null;
        this.#tellCordon();
      }
    }
  }

  showRaster(raster) {
    this.rasters[raster.kind] = raster;
    raster.cells = Uint8Array.from(atob(raster.values), (letter) => letter.charCodeAt(0));
    if (raster.kind === "dose") this.#drawDose();
    else this.#draw(raster, BELIEF_PAINT);
  }

  #drawDose() {
    const raster = this.rasters.dose;
    if (!raster) return;
    this.#draw(raster, DOSE_PAINT);
    this.#drawCordon(raster);
  }

  #draw(raster, paint) {
    const { columns, rows, cells } = raster;
    const canvas = Object.assign(document.createElement("canvas"), { width: columns, height: rows });
    const context = canvas.getContext("2d");
    const image = context.createImageData(columns, rows);
    const pixels = new Uint32Array(image.data.buffer);
    for (let row = 0; row < rows; row += 1) {
      const above = (rows - 1 - row) * columns;
      for (let column = 0; column < columns; column += 1) pixels[above + column] = paint[cells[row * columns + column]];
    }
    context.putImageData(image, 0, 0);
    const [x, y] = raster.origin;
    const bounds = [at([x, y]), at([x + raster.cell_m * columns, y + raster.cell_m * rows])];
    this.layers[raster.kind].clearLayers();
    // Leaflet draws any element in the place of an SVG; an image would have to be packed and unpacked first.
    L.svgOverlay(canvas, bounds, { pane: "rasters" }).addTo(this.layers[raster.kind]);
  }

  #drawCordon(raster) {
    this.cordon.clearLayers();
    this.line = null;
    const level = Number(this.level.value);
    if (!(level > 0)) return;
    const threshold = 32 * Math.log10(level / 1e-3);
    const lines = contour(raster.cells, raster.columns, raster.rows, threshold).map((pair) =>
      pair.map(([column, row]) => at([raster.origin[0] + raster.cell_m * (column + 0.5), raster.origin[1] + raster.cell_m * (row + 0.5)])));
    this.line = { most: raster.scale, leaves: leaves(raster, threshold), points: lines.flat() };
    this.#tellCordon();
    if (!lines.length) return;
    L.polyline(lines, { color: "#a33b00", weight: 4 }).addTo(this.cordon);
    const top = lines.flat().reduce((one, other) => (other[0] > one[0] ? other : one));
    const name = element("span", say("cordon", { level: Number(level.toPrecision(3)) }));
    L.tooltip({ permanent: true, direction: "top", className: "cordon", pane: "labels" }).setLatLng(top).setContent(name).addTo(this.cordon);
  }

  // Where the cordon is: on a screen without a mouse there is nothing to hover over.
  #tellCordon() {
    const words = this.line ? this.#cordonWords(this.line) : "";
    if (this.cordonTold.textContent !== words) this.cordonTold.textContent = words;
  }

  #cordonWords({ most, leaves, points }) {
    if (leaves) return say("cordon beyond");
    if (!points.length) return say("cordon nowhere", { most: significant(most) });
    if (!this.source) return say("cordon search");
    const [x, y] = this.source;
    return say("cordon around", { far: Math.max(...points.map(([north, east]) => Math.hypot(east - x, north - y))).toFixed(0) });
  }
}

// What the marks on the map are.
function marks() {
  const list = element("ul", "", "marks");
  for (const name of ["source", "region", "drone", "plan", "area", "fence"]) {
    const item = element("li");
    item.append(element("i", "", name), element("span", say(`mark ${name}`)));
    list.append(item);
  }
  return list;
}

// Whether values above a level reach the edge of a raster.
function leaves({ cells, columns, rows }, level) {
  const isEdge = (place) => place < columns || place >= columns * (rows - 1) || place % columns === 0 || place % columns === columns - 1;
  return cells.some((value, place) => value >= level && isEdge(place));
}

// Segments of the line at a level (marching squares; each crossing by linear interpolation).
function contour(values, columns, rows, level) {
  const found = [];
  const value = (column, row) => values[row * columns + column];
  for (let row = 0; row + 1 < rows; row += 1) {
    for (let column = 0; column + 1 < columns; column += 1) {
      const corners = [[column, row], [column + 1, row], [column + 1, row + 1], [column, row + 1]];
      const crossings = [];
      corners.forEach(([x0, y0], place) => {
        const [x1, y1] = corners[(place + 1) % 4];
        const [from, to] = [value(x0, y0), value(x1, y1)];
        if ((from < level) !== (to < level)) {
          const share = (level - from) / (to - from);
          crossings.push([x0 + share * (x1 - x0), y0 + share * (y1 - y0)]);
        }
      });
      for (let place = 0; place + 1 < crossings.length; place += 2) found.push([crossings[place], crossings[place + 1]]);
    }
  }
  return found;
}
