// What lies under the map: tiles and vector layers that the station has; nothing is fetched from anywhere else.
//
// Tiles are in Web Mercator, the map is in metres east and north of the mission's datum. Around it both are alike but for their scale: each tile is
// placed by its corners, which fits to decimetres over a kilometre.

import { withToken } from "./link.js";
import { element } from "./texts.js";

const EQUATOR_M = 6378137;  // semi-major axis of WGS84
const ECCENTRICITY2 = 6.69437999014e-3;
const TILE = 256;  // pixels
const MOST_TILES = 80;  // at a time
const INK = "#5b4a2f";

const rad = (degrees) => (degrees * Math.PI) / 180;
const at = ([x, y]) => [y, x];

export class Background {
  constructor(map, mission, layers) {
    Object.assign(this, { map, mission, layers });
    map.createPane("tiles").style.zIndex = 200;
    map.createPane("own").style.zIndex = 240;
    this.shown = new Map();
    if (mission.tiles) {
      const [latitude] = mission.datum_deg;
      const bend = 1 - ECCENTRICITY2 * Math.sin(rad(latitude)) ** 2;
      this.east = (rad(1) * EQUATOR_M * Math.cos(rad(latitude))) / Math.sqrt(bend);  // metres per degree
      this.north = (rad(1) * EQUATOR_M * (1 - ECCENTRICITY2)) / bend ** 1.5;
      map.on("moveend", () => this.#drawTiles());
    }
    if (mission.layer) this.#drawLayer();
  }

  #drawTiles() {
    const [low, high] = this.mission.tiles;
    const [latitude, longitude] = this.mission.datum_deg;
    const view = this.map.getBounds();
    const north = latitude + view.getNorth() / this.north;
    const south = latitude + view.getSouth() / this.north;
    const west = longitude + view.getWest() / this.east;
    const east = longitude + view.getEast() / this.east;
    const around = 360 * this.east * 2 ** this.map.getZoom();  // pixels around the Earth
    let z = Math.min(high, Math.max(low, Math.round(Math.log2(around / TILE))));
    let range = tilesOf(z, north, south, west, east);
    while (range.length > MOST_TILES && z > low) range = tilesOf(--z, north, south, west, east);
    const wanted = new Set(range.slice(0, MOST_TILES).map(([x, y]) => `${z}/${x}/${y}`));
    for (const [name, image] of this.shown) {
      if (!wanted.has(name)) {
        image.remove();
        this.shown.delete(name);
      }
    }
    for (const name of wanted) if (!this.shown.has(name)) this.shown.set(name, this.#tile(name));
  }

  #tile(name) {
    const [z, x, y] = name.split("/").map(Number);
    const place = (column, row) => {
      const [latitude, longitude] = this.mission.datum_deg;
      return [(latitudeOf(row, z) - latitude) * this.north, (longitudeOf(column, z) - longitude) * this.east];
    };
    return L.imageOverlay(withToken(`tiles/${name}`), [place(x, y + 1), place(x + 1, y)], { pane: "tiles", alt: "" }).addTo(this.layers.tiles);
  }

  async #drawLayer() {
    const shapes = await (await fetch(withToken("layer.json"))).json();
    const renderer = L.canvas({ pane: "own" });
    for (const [kind, name, places] of shapes) {
      const style = { color: INK, weight: 2, fillOpacity: 0.08, renderer };
      const points = places.map(at);
      const shape = kind === "point" ? L.circleMarker(points[0], { ...style, radius: 5, fillOpacity: 1 }) : kind === "area" ? L.polygon(points, style) : L.polyline(points, style);
      if (name) shape.bindTooltip(element("span", name));
      shape.addTo(this.layers.own);
    }
  }
}

const longitudeOf = (column, z) => (360 * column) / 2 ** z - 180;
const latitudeOf = (row, z) => (180 / Math.PI) * Math.atan(Math.sinh(Math.PI * (1 - (2 * row) / 2 ** z)));
const columnOf = (longitude, z) => Math.floor(((longitude + 180) / 360) * 2 ** z);
const rowOf = (latitude, z) => Math.floor(((1 - Math.asinh(Math.tan(rad(latitude))) / Math.PI) / 2) * 2 ** z);

function tilesOf(z, north, south, west, east) {
  const found = [];
  for (let x = columnOf(west, z); x <= columnOf(east, z); x += 1) {
    for (let y = rowOf(north, z); y <= rowOf(south, z); y += 1) found.push([x, y]);
    if (found.length > 4 * MOST_TILES) return found;
  }
  return found;
}
