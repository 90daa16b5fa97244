// Area, fence and launch places on the map, while they are edited: corners are dragged, and added by the marks between them. The
// mission knows the fence by its distance from the area: that is what dragging the fence's mark changes.

import { colour, element, say } from "./texts.js";

const HANDLE = 44;  // pixels: what a finger hits
const at = ([x, y]) => [y, x];

export const round = (metres) => Math.round(100 * metres) / 100;  // to the centimetre

function handle(kind, text = "") {
  return L.divIcon({ className: `handle ${kind}`, html: element("span", text), iconSize: [HANDLE, HANDLE] });
}

export class Outline {
  // area: corners [x, y]; launches: by drone [x, y, heading]: both are changed in place, and told: changed(whether it is done).
  // The fence's distance is told only: fenced(metres).
  constructor(map, area, launches, fence, changed, fenced) {
    Object.assign(this, { map, area, launches, changed, fenced });
    this.group = L.layerGroup().addTo(map);
    this.fence = L.polygon(fence.map(at), { color: "#7a3b8f", weight: 2, dashArray: "2 6", fill: false }).addTo(this.group);
    this.shape = L.polygon([], { color: "#7a3b8f", weight: 4, fill: false }).addTo(this.group);
    this.handles = L.layerGroup().addTo(this.group);
    this.fenceHandle = L.marker([0, 0], { icon: handle("fence", say("fence handle")), draggable: true, keyboard: false, zIndexOffset: 900 });
    this.fenceHandle.on("dragend", () => {
      const { lng, lat } = this.fenceHandle.getLatLng();
      this.fenced(Math.round(10 * distance([lng, lat], this.area)) / 10);
    });
    this.fenceHandle.addTo(this.group);
    this.fenceAt(fence);
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
    const lowest = Math.min(...corners.map(([, y]) => y));
    const along = corners.filter(([, y]) => y === lowest).map(([x]) => x);
    this.fenceHandle.setLatLng([lowest, (Math.min(...along) + Math.max(...along)) / 2]);
  }

  mark(flawed) {
    this.shape.setStyle({ dashArray: flawed ? "8 8" : null });
  }

  remove() {
    this.group.remove();
  }
}

// Metres from a place to an area; 0 inside.
function distance([x, y], area) {
  let [nearest, inside] = [Infinity, false];
  area.forEach(([x0, y0], place) => {
    const [x1, y1] = area[(place + 1) % area.length];
    const along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / ((x1 - x0) ** 2 + (y1 - y0) ** 2 || 1);
    const share = Math.min(1, Math.max(0, along));
    nearest = Math.min(nearest, Math.hypot(x0 + share * (x1 - x0) - x, y0 + share * (y1 - y0) - y));
    if (y0 > y !== y1 > y && x < x0 + ((y - y0) / (y1 - y0)) * (x1 - x0)) inside = !inside;
  });
  return inside ? 0 : nearest;
}
