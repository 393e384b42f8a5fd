// Names of exits, stairs, storeys and places over the picture.

const CELL = 6;  // Side of the parts of the picture that are taken or free [pixels].

class Labels {
  constructor(node, record, layout) {
    this.node = node;
    this.record = record;
    this.layout = layout;
    const { building, grain } = record;
    this.items = building.exits.map((exit, index) => {
      const s = 6 * Math.floor(exit.segments.length / 12);
      const [x1, y1, z1, x2, y2, z2] = exit.segments.slice(s, s + 6).map((value) => value * grain);
      return { kind: "exit", index, name: exit.name, level: exit.level, at: [(x1 + x2) / 2, (y1 + y2) / 2, (z1 + z2) / 2], lift: EXIT_HEIGHT + 0.1 };
    });
    layout.storeys.forEach((storey, index) => {
      if (layout.storeys.length < 2) return;
      const level = building.levels.findIndex((one) => one.storey === index && one.kind === "floor");
      this.items.push({ kind: "storey", index, name: storey.name, level, at: [layout.box[0], layout.box[1], storey.z], lift: 0 });
    });
    building.stairs.forEach((stair, index) => {
      const level = stair.levels[Math.floor(stair.levels.length / 2)];
      const sum = [0, 0, 0], { triangles } = building.levels[level];
      for (const v of triangles) for (const i of [0, 1, 2]) sum[i] += building.vertices[3 * v + i] * grain / triangles.length;
      this.items.push({ kind: "stair", index, name: /stair/i.test(stair.name) ? stair.name : `stair ${stair.name}`, level, at: sum, lift: 0.3 });
    });
    building.places.forEach((place, index) => {
      this.items.push({ kind: "place", index, name: place.name, level: place.level, at: place.at.map((value) => value * grain), lift: 0.3 });
    });
    for (const item of this.items) this.add(item);
    this.who = this.add({ kind: "who", name: "" });
  }

  add(item) {
    item.span = document.createElement("span");
    item.span.className = item.kind;
    item.span.textContent = item.name;
    this.node.append(item.span);
    return item;
  }

  rename(item, text) {
    if (item.text === text) return;
    item.span.textContent = item.text = text;
    item.size = null;
  }

  // Puts every label beside what it names, where it covers nobody and no other label, and where no floor lies before what
  // it names; it is hidden where there is no such place.
  update(camera, closed, selected, people, density) {
    const { clientWidth: width, clientHeight: height } = this.node, taken = new Cells(width, height, heightOfTools());
    if (!taken.marks.length) return;
    taken.markPeople(camera, people);
    this.who.span.style.visibility = "hidden";
    if (selected) this.rename(this.who, selected.name);
    for (const item of selected ? [this.who, ...this.items] : this.items) {
      item.span.style.visibility = "hidden";
      if (item.level >= 0 && !this.layout.visible[item.level] || item.kind === "storey" && this.layout.storey >= 0) continue;
      if (item.kind === "exit") {
        const isClosed = closed.includes(this.record.building.portals.length + item.index);
        item.span.className = isClosed ? "closed" : "exit";
        this.rename(item, isClosed ? `${item.name} (closed)` : item.name);
      }
      const at = item === this.who ? selected.at : this.anchor(item, camera), [x, y, depth] = camera.project(at);
      const [w, h] = item.size ??= [item.span.offsetWidth, item.span.offsetHeight];
      const boxAt = ([right, down]) => {
        const left = (x + 1) / 2 * width + right * (w / 2 + GAP) - w / 2, top = (1 - y) / 2 * height + down * (h + GAP) - h / 2;
        return [left, top, left + w, top + h];
      };
      const shines = ([left, top, right, bottom]) => !camera.isFlat && item !== this.who && [[left, top], [right, top], [left, bottom], [right, bottom]].some(([px, py]) => {
        const [from, along] = camera.ray(2 * px / width - 1, 1 - 2 * py / height), way = (at[2] - from[2]) / along[2];
        return way > 0 && floorsBefore(this.layout, density, from, from.map((value, i) => value + way * along[i]), 1) > 0;
      });
      const places = SIDES[item.kind] ?? SIDES.any, tries = item.side ? [item.side, ...places] : places;  // So that it does not jump.
      item.side = depth < 1 ? tries.find((side) => taken.isFree(boxAt(side)) && !shines(boxAt(side))) : null;
      if (!item.side) continue;
      const box = boxAt(item.side);
      taken.mark(box);
      item.span.style.visibility = "visible";
      item.span.style.transform = `translate(${box[0].toFixed(1)}px, ${box[1].toFixed(1)}px)`;
    }
  }

  // The point that a label names: of a storey, its corner on the left.
  anchor(item, camera) {
    const { layout } = this;
    if (item.kind === "storey") {
      const [x1, y1, x2, y2] = layout.boxes[item.level], z = item.at[2];
      const corners = [[x1, y1], [x2, y1], [x1, y2], [x2, y2]].map(([x, y]) => layout.place(item.level, x, y, z));
      return corners.reduce((left, one) => camera.project(one)[0] < camera.project(left)[0] ? one : left);
    }
    const [x, y, z] = layout.place(item.level, ...item.at);
    return [x, y, z + (camera.isFlat ? 0 : item.lift)];
  }
}

// Where labels may be beside what they name, in their widths and heights, and the space between.
const GAP = 5;
const around = (reach) => [[0, -reach], [0, reach], [-reach, 0], [reach, 0], [-reach, -reach], [reach, -reach], [-reach, reach], [reach, reach]];
const SIDES = {
  any: [[0, 0], ...around(1)],
  who: [[0, -0.5], [0, -1], [1, -1], [-1, -1], [1, 0], [-1, 0], [0, -2], [0, -3], [1, 1], [-1, 1], [0, 2]],
  exit: [...around(1), ...around(2), ...around(3), ...around(4)],
  storey: [[-1, 0], [-1, -1], [-1, 1], [-2, 0], [-1, -2], [-1, 2], [-3, 0]],
};

// Which parts of the picture are taken.
class Cells {
  constructor(width, height, top) {
    Object.assign(this, { width, height, top, columns: Math.ceil(width / CELL), rows: Math.ceil(height / CELL) });
    this.marks = new Uint8Array(this.columns * this.rows);
  }

  // The cells that a box touches, as first and last columns and rows.
  touched([left, top, right, bottom]) {
    return [left, right].map((x) => Math.max(0, Math.min(this.columns - 1, Math.floor(x / CELL))))
      .concat([top, bottom].map((y) => Math.max(0, Math.min(this.rows - 1, Math.floor(y / CELL)))));
  }

  mark(box) {
    const [from, to, low, high] = this.touched(box);
    for (let row = low; row <= high; row++) this.marks.fill(1, row * this.columns + from, row * this.columns + to + 1);
  }

  markPeople(camera, { bodies, words, count, tallest }) {
    for (let k = 0; k < count; k++) {
      const [x, y, z, radius] = bodies.subarray(4 * k, 4 * k + 4), tall = (words[k] >>> 24) / 255 * tallest;
      const ends = [z, z + tall].map((height) => camera.project([x, y, height])), reach = 1.2 * (radius % HEAD_STEP) / camera.size * this.height;
      const xs = ends.map(([px]) => (px + 1) / 2 * this.width), ys = ends.map(([, py]) => (1 - py) / 2 * this.height);
      const box = [Math.min(...xs) - reach, Math.min(...ys) - reach, Math.max(...xs) + reach, Math.max(...ys) + reach];
      if (box[2] > 0 && box[3] > 0 && box[0] < this.width && box[1] < this.height) this.mark(box);
    }
  }

  isFree(box) {
    if (box[0] < 0 || box[1] < this.top || box[2] > this.width || box[3] > this.height) return false;
    const [from, to, low, high] = this.touched(box);
    for (let row = low; row <= high; row++) {
      for (let column = from; column <= to; column++) if (this.marks[row * this.columns + column]) return false;
    }
    return true;
  }
}

// A bar of a round length, for plans.
function updateScale(camera, height) {
  document.getElementById("scale").hidden = !camera.isFlat;
  if (!camera.isFlat) return;
  const metre = height / camera.size, power = 10 ** Math.floor(Math.log10(120 / metre));
  const length = [5, 2, 1].map((k) => k * power).find((value) => value * metre <= 130) ?? power;
  document.getElementById("scale-bar").style.width = `${length * metre}px`;
  document.getElementById("scale-text").textContent = `${length} m`;
}
