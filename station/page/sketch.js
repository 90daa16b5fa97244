// What moves on the map: trails, plans, cones, drones and the source, on one canvas above Leaflet's own. Leaflet keeps an object for
// each line and projects, clips and simplifies it anew whenever it changes: thirty drones are too many for that ten times a second.

import { Labels } from "./labels.js";
import { colour } from "./texts.js";

const CONES_MS = 6000;
const MOST_CONES = 150;
const TRAIL_MS = 60000;
const TRAIL_STEP_MS = 1000;
const BODY = [[0, 1.9], [2.5, 1.2], [Math.PI, 0.5], [-2.5, 1.2]];  // corners: angle from the heading, distance (m)
const MARGIN = 0.15;  // of the map's size, drawn beyond each of its edges: while the map is dragged the canvas moves with it
const FONT = '700 15px system-ui, "DejaVu Sans", sans-serif';

export class Sketch {
  constructor(map, drones) {
    this.map = map;
    this.colours = new Map(drones.map((name, index) => [name, colour(index)]));
    this.trails = new Map(drones.map((name) => [name, []]));  // [time, x, y]
    this.cones = [];  // [time, colour, path]
    this.frame = null;
    this.hidden = new Set();
    this.widths = new Map();  // of names
    this.labels = new Labels();
    const pane = map.createPane("sketch");
    pane.style.zIndex = 450;
    pane.style.pointerEvents = "none";
    this.canvas = Object.assign(document.createElement("canvas"), { className: "leaflet-zoom-hide" });
    this.canvas.style.position = "absolute";
    pane.append(this.canvas);
    map.on("moveend zoomend viewreset resize", () => this.#wish());
  }

  // A part, ``trails``, ``plans`` or ``cones``, that is shown and hidden like a layer of Leaflet's.
  part(name) {
    return {
      addTo: () => this.hidden.delete(name) && this.#wish(),
      remove: () => this.hidden.add(name) && this.#wish(),
    };
  }

  // Begin anew at another time, with the drones' trails up to then.
  beginAt(trails, time) {
    this.cones = [];
    [...this.trails.keys()].forEach((name, index) => {
      const last = trails[index].length - 1;
      this.trails.set(name, trails[index].map(([x, y], place) => [time - (last - place) * TRAIL_STEP_MS, x, y]));
    });
  }

  addCones(cones) {
    for (const cone of cones) {
      const path = new Path2D();
      for (const curve of cone.curves) curve.forEach(([x, y], place) => (place ? path.lineTo(x, y) : path.moveTo(x, y)));
      this.cones.push([cone.at_ms, this.colours.get(cone.drone) ?? "#111", path]);
    }
    this.cones.splice(0, this.cones.length - MOST_CONES);
  }

  show(frame) {
    this.frame = frame;
    for (const { id, place } of frame.drones) {
      const trail = this.trails.get(id);
      if (place && frame.at_ms - (trail.at(-1)?.[0] ?? -Infinity) >= TRAIL_STEP_MS) trail.push([frame.at_ms, place[0], place[1]]);
      while (trail.length && trail[0][0] < frame.at_ms - TRAIL_MS) trail.shift();
    }
    while (this.cones.length && this.cones[0][0] < frame.at_ms - CONES_MS) this.cones.shift();
    this.draw();
  }

  // The map is gone: nothing more is drawn on it.
  remove() {
    if (this.asked) cancelAnimationFrame(this.asked);
    this.asked = null;
  }

  #wish() {
    this.asked ??= requestAnimationFrame(() => this.draw());
  }

  draw() {
    if (this.asked) cancelAnimationFrame(this.asked);
    this.asked = null;
    const ratio = window.devicePixelRatio || 1;
    const margin = this.map.getSize().multiplyBy(MARGIN).round();
    const size = this.map.getSize().add(margin.multiplyBy(2));
    const [width, height] = [Math.round(size.x * ratio), Math.round(size.y * ratio)];
    if (this.canvas.width !== width || this.canvas.height !== height) {
      Object.assign(this.canvas, { width, height });
      Object.assign(this.canvas.style, { width: `${size.x}px`, height: `${size.y}px` });
    }
    L.DomUtil.setPosition(this.canvas, this.map.containerPointToLayerPoint(margin.multiplyBy(-1)));
    const pen = this.canvas.getContext("2d");
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, width, height);
    if (!this.frame) return;
    const [scale, origin] = [this.map.options.crs.scale(this.map.getZoom()), this.map.latLngToContainerPoint([0, 0]).add(margin)];
    pen.setTransform(ratio * scale, 0, 0, -ratio * scale, ratio * origin.x, ratio * origin.y);  // from here on in metres
    this.#drawMetres(pen, 1 / scale);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.#drawNames(pen, ([x, y]) => [origin.x + scale * x, origin.y - scale * y], scale, margin);
  }

  #drawMetres(pen, pixel) {
    pen.lineJoin = "round";
    pen.globalAlpha = 0.6;
    if (!this.hidden.has("cones")) {
      pen.lineWidth = pixel;
      for (const [, ink, path] of this.cones) {
        pen.strokeStyle = ink;
        pen.stroke(path);
      }
    }
    pen.lineWidth = 3 * pixel;
    if (!this.hidden.has("trails")) this.frame.drones.forEach((drone) => this.#line(pen, drone, [...this.trails.get(drone.id).map(([, x, y]) => [x, y]), drone.place]));
    pen.globalAlpha = 1;
    pen.lineWidth = 2 * pixel;
    pen.setLineDash([4 * pixel, 6 * pixel]);
    if (!this.hidden.has("plans")) this.frame.drones.forEach((drone) => drone.stale || this.#line(pen, drone, drone.plan));
    pen.setLineDash([]);
    for (const source of [this.frame.source, ...this.frame.others]) {
      pen.lineWidth = 2 * pixel;
      if (source) drawSource(pen, pixel, source);
    }
    for (const drone of this.frame.drones) if (drone.place) this.#body(pen, pixel, drone);
  }

  #line(pen, drone, places) {
    pen.strokeStyle = this.colours.get(drone.id);
    pen.beginPath();
    for (const place of places) if (place) pen.lineTo(place[0], place[1]);
    pen.stroke();
  }

  #body(pen, pixel, { id, place: [x, y], yaw, stale }) {
    pen.beginPath();
    for (const [turn, far] of BODY) pen.lineTo(x + far * Math.cos(yaw + turn), y + far * Math.sin(yaw + turn));
    pen.closePath();
    pen.fillStyle = this.colours.get(id);
    pen.globalAlpha = stale ? 0.25 : 1;
    pen.fill();
    pen.globalAlpha = 1;
    pen.lineWidth = 2 * pixel;
    pen.strokeStyle = "#111";
    pen.setLineDash(stale ? [3 * pixel, 4 * pixel] : []);
    pen.stroke();
    pen.setLineDash([]);
  }

  #drawNames(pen, pixelOf, scale, margin) {
    pen.font = FONT;
    pen.textBaseline = "middle";
    pen.lineWidth = 1;
    pen.strokeStyle = "#111";
    const { source, others, drones } = this.frame;
    const sources = others.length ? [source, ...others].map(({ number, place }) => ({ id: `${number}`, place })) : [];
    const named = [...sources, ...drones].filter(({ place }) => place).map(({ id, place, stale }) => [stale ? `${id} ?` : id, ...pixelOf(place), stale]);
    const view = this.map.getSize();
    const names = named.map(([text, x, y]) => [text, x - margin.x, y - margin.y, this.#width(pen, text) + 8]);
    const boxes = this.labels.place(names, Math.max(8, BODY[0][1] * scale), [view.x, view.y]);
    for (const [place, [text, , , stale]] of named.entries()) {
      const [left, top, right, bottom] = boxes[place];
      const [x, y] = [left + margin.x, top + margin.y];
      pen.fillStyle = stale ? "#ffd9c2" : "rgba(255, 255, 255, 0.85)";
      pen.fillRect(x, y, right - left, bottom - top);
      pen.strokeRect(x, y, right - left, bottom - top);
      pen.fillStyle = "#111";
      pen.fillText(text, x + 4, y + (bottom - top) / 2);
    }
  }

  #width(pen, text) {
    if (!this.widths.has(text)) this.widths.set(text, pen.measureText(text).width);
    return this.widths.get(text);
  }
}

function drawSource(pen, pixel, { place: [x, y], region: [long, short, turn], velocity_mps: [east, north] }) {
  pen.strokeStyle = "#111";
  pen.beginPath();
  pen.ellipse(x, y, long, short, turn, 0, 2 * Math.PI);
  pen.stroke();
  pen.lineWidth = 3 * pixel;
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(x + 5 * east, y + 5 * north);
  pen.stroke();
  pen.fillStyle = "#f0e442";
  pen.beginPath();
  pen.arc(x, y, 7 * pixel, 0, 2 * Math.PI);
  pen.fill();
  pen.stroke();
}
