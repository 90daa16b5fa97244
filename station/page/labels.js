// Places of names beside their marks on the map, such that no name hides a mark or another name while there is room elsewhere.

const HEIGHT = 22;
const GAP = 12;  // from a mark's middle to its name, in pixels
const SIDES = [[1, 0], [1, -1], [1, 1], [-1, 0], [-1, -1], [-1, 1], [0, -1], [0, 1]];  // right, left, above, below
const KEEP = 30;  // pixels of overlap for which a name does not jump to another side
const OUTSIDE = 4;  // a name that is cut off by the edge is worse than one that overlaps

const overlap = (a, b) => Math.max(0, Math.min(a[2], b[2]) - Math.max(a[0], b[0])) * Math.max(0, Math.min(a[3], b[3]) - Math.max(a[1], b[1]));

export class Labels {
  constructor() {
    this.sides = new Map();  // by name, as last placed
  }

  // Boxes [left, top, right, bottom] for names: [text, x, y, width] each, all in pixels; ``far``: a mark's half width; ``size``: of the map.
  place(names, far, size) {
    const marks = names.map(([, x, y]) => [x - far, y - far, x + far, y + far]);
    const placed = [];
    for (const [place, [text, x, y, width]] of names.entries()) {
      const others = [...marks.filter((_, other) => other !== place), ...placed];
      const boxes = SIDES.map(([right, down]) => boxAt(x, y, width, right, down, Math.max(GAP, far)));
      const costs = boxes.map((box) => others.reduce((sum, other) => sum + overlap(box, other), 0) + OUTSIDE * outside(box, size));
      const best = costs.indexOf(Math.min(...costs));
      const last = this.sides.get(text) ?? best;
      const side = costs[last] <= costs[best] + KEEP ? last : best;
      this.sides.set(text, side);
      placed.push(boxes[side]);
    }
    return placed;
  }
}

function boxAt(x, y, width, right, down, gap) {
  const left = right > 0 ? x + gap : right < 0 ? x - gap - width : x - width / 2;
  const top = y - HEIGHT / 2 + down * (right ? HEIGHT / 2 : gap + HEIGHT / 2);
  return [left, top, left + width, top + HEIGHT];
}

const outside = (box, [width, height]) => (box[2] - box[0]) * (box[3] - box[1]) - overlap(box, [0, 0, width, height]);
