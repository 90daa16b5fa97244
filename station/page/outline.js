// Area, fence and launch places on the map, while they are edited: corners are dragged, and added by the marks between them.

import { colour, element } from "./texts.js";

const HANDLE = 44;  // pixels: what a finger hits
const at = ([x, y]) => [y, x];

export const round = (metres) => Math.round(100 * metres) / 100;  // to the centimetre

function handle(kind, text = "") {
  return L.divIcon({ className: `handle ${kind}`, html: element("span", text), iconSize: [HANDLE, HANDLE] });
}

export class Outline {
  // area: corners [x, y]; launches: by drone [x, y, heading]: both are changed in place, and told: changed(whether it is done).
  constructor(map, area, launches, fence, changed) {
    Object.assign(this, { map, area, launches, changed });
    this.group = L.layerGroup().addTo(map);
    this.fence = L.polygon(fence.map(at), { color: "#7a3b8f", weight: 2, dashArray: "2 6", fill: false }).addTo(this.group);
    this.shape = L.polygon([], { color: "#7a3b8f", weight: 4, fill: false }).addTo(this.group);
    this.handles = L.layerGroup().addTo(this.group);
    this.draw();
  }

  draw() {
    this.shape.setLatLngs(this.area.map(at));
    this.handles.clearLayers();
    this.area.forEach((corner, place) => {
      const next = this.area[(place + 1) % this.area.length];
      this.#between(corner, next, place + 1);
    });
    this.area.forEach((corner) => this.#draggable(corner, handle("corner")));
    Object.entries(this.launches).forEach(([name, place], index) => {
      const mark = this.#draggable(place, handle("launch", name));
      mark.getElement().firstChild.style.borderColor = colour(index);
    });
  }

  #draggable(place, icon) {
    const mark = L.marker(at(place), { icon, draggable: true, keyboard: false, zIndexOffset: 1000 }).addTo(this.handles);
    mark.on("drag", () => {
      [place[1], place[0]] = [round(mark.getLatLng().lat), round(mark.getLatLng().lng)];
      this.shape.setLatLngs(this.area.map(at));
      this.changed(false);
    });
    mark.on("dragend", () => {
      this.draw();
      this.changed(true);
    });
    return mark;
  }

  #between([x0, y0], [x1, y1], place) {
    const middle = [round((x0 + x1) / 2), round((y0 + y1) / 2)];
    const mark = L.marker(at(middle), { icon: handle("between", "+"), keyboard: false }).addTo(this.handles);
    mark.on("click", () => {
      this.area.splice(place, 0, middle);
      this.draw();
      this.changed(true);
    });
  }

  fenceAt(corners) {
    this.fence.setLatLngs(corners.map(at));
  }

  mark(flawed) {
    this.shape.setStyle({ dashArray: flawed ? "8 8" : null });
  }

  remove() {
    this.group.remove();
  }
}
