// Names of exits, stairs, storeys and places over the picture.

const CORNER = [-200, -56, 0, 0];  // Left, top, right and bottom of the scale bar and the arrow to the north, from the lower right corner [pixels].
const DIRECTIONS = 16;
const CELL = 6;  // Side of the parts of the picture that are taken or free [pixels].

class Labels {
  constructor(node, record, layout) {
    this.node = node;
    this.record = record;
    this.layout = layout;
    this.cells = new Cells();
    const { building, grain } = record;
    const metres = (values) => values.map((value) => value * grain);
    this.items = (layout.storeys.length > 1 ? layout.storeys : []).map(({ name, z }, index) => {
      const level = building.levels.findIndex((one) => one.storey === index && one.kind === "floor");
      const parts = building.levels.filter((one) => one.storey === index);  // Beside the stairs, too.
      return { kind: "storey", name, level, corners: this.cornersOf(building.levels[level]), outer: parts.flatMap((one) => this.cornersOf(one)).map(([x, y]) => [x, y, z]) };
    });
    this.items.push(...[this.who, this.event] = [{ kind: "who", name: "" }, { kind: "event", name: "" }]);
    this.cars = record.cars.map(() => ({ kind: "car", name: "" }));
    this.items.push(...this.cars);
    building.exits.forEach(({ name, level, segments }, index) => {
      const s = 6 * Math.floor(segments.length / 12), [x1, y1, z1, x2, y2, z2] = metres(segments.slice(s, s + 6));
      this.items.push({ kind: "exit", index, name, level, at: [(x1 + x2) / 2, (y1 + y2) / 2, (z1 + z2) / 2], lift: EXIT_HEIGHT + 0.1 });
    });
    for (const { name, levels } of building.stairs) {
      const level = levels[Math.floor(levels.length / 2)], { triangles } = building.levels[level];
      const at = [0, 1, 2].map((i) => triangles.reduce((sum, v) => sum + building.vertices[3 * v + i] * grain, 0) / triangles.length);
      this.items.push({ kind: "stair", name: /stair/i.test(name) ? name : `stair ${name}`, level, at, lift: 0.3 });
    }
    for (const { name, kind, level, at } of building.places) this.items.push({ kind: kind === "fire" ? "fire" : "place", name, level, at: metres(at), lift: 0.3 });
    for (const item of this.items) {
      item.span = document.createElement("span");
      item.span.className = item.kind;
      item.span.textContent = item.name;
      this.node.append(item.span);
    }
  }

  // Outermost points of a floor in some directions.
  cornersOf({ triangles }) {
    const { building: { vertices }, grain } = this.record, found = new Set();
    for (let k = 0; k < DIRECTIONS; k++) {
      const [c, s] = [Math.cos(2 * Math.PI * k / DIRECTIONS), Math.sin(2 * Math.PI * k / DIRECTIONS)], reach = (v) => c * vertices[3 * v] + s * vertices[3 * v + 1];
      found.add(triangles.reduce((most, v) => reach(v) > reach(most) ? v : most, triangles[0]));
    }
    return [...found].map((v) => [0, 1, 2].map((i) => vertices[3 * v + i] * grain));
  }

  // Room that the names of storeys need beside the building.
  margin() { return Math.max(0, ...this.items.map(({ kind, span }) => kind === "storey" ? span.offsetWidth + 3 * GAP : 0)); }

  rename(item, text) {
    if (item.text === text) return;
    item.span.textContent = item.text = text;
    item.size = null;
    item.boxes?.clear();
  }

  // Puts every label beside what it names, where it covers nobody and no other label, and where no floor lies before what
  // it names, with a line to that if it is not near; it is hidden where there is no such place. Of whoever is selected and
  // of the event at this time, there are name and place in the picture. Styles are written only where they change.
  update(camera, state, selected, event, cars, people, density, width, height) {
    const { cells } = this;
    const aim = [...camera.matrix, this.layout.spread, this.layout.storey, width, height], isMoved = aim.some((value, k) => value !== this.aim?.[k]);
    if (isMoved && (width !== cells.width || height !== cells.height)) for (const item of this.items) item.size = null;
    for (const item of this.items) if (isMoved) item.boxes = new Map();  // By the side: null where a floor lies before it.
    this.aim = aim;
    cells.clear(width, height, heightOfTools());
    if (isMoved && this.layout.storey < 0 && !this.layout.isPlan) this.nameStoreys(camera);
    cells.markPeople(camera, people);
    if (camera.isFlat || this.record.northward) cells.mark(...CORNER.map((value, i) => value + (i % 2 ? height : width)));
    Object.assign(this.who, { to: selected });
    Object.assign(this.event, { to: event });
    this.cars.forEach((item, k) => { item.to = cars[k]; });
    this.shown = [];
    for (const item of this.items) {
      const box = this.boxOf(item, camera, state, density), line = box && item.kind !== "storey" ? leaderOf(box) : [0, 0, 0, 0];
      if (box) {
        cells.mark(...box);
        this.shown.push({ span: item.span, box, line });
      }
      const style = box ? styleOf(box, line) : "visibility: hidden";
      if (item.style !== style) item.span.style.cssText = item.style = style;
    }
  }

  // Left, top, right and bottom of a label; null where it has no place.
  boxOf(item, camera, state, density) {
    const { layout, cells } = this, { to } = item;
    if (to === undefined ? !layout.visible[item.level] || item.kind === "storey" && layout.storey >= 0 : !to) return null;
    if (item.at && !layout.holds(...item.at)) return null;
    if (to) this.rename(item, to.name);
    if (item.kind === "exit") {
      const note = this.record.noteOn(item.index, state);
      item.span.className = state.shut.includes(this.record.building.portals.length + item.index) ? "closed" : "exit";
      this.rename(item, note ? `${item.name} (${note})` : item.name);
    }
    const boxes = to ? new Map() : item.boxes, places = SIDES[to ? "pointer" : item.kind === "storey" && !layout.isPlan ? "column" : item.kind] ?? SIDES.any;
    const fits = (side, isOver) => {
      const key = isOver ? places.indexOf(side) : side;
      if (!boxes.has(key)) boxes.set(key, this.boxAt(item, to?.at ?? this.anchor(item, camera), side, camera, density, isOver));
      return boxes.get(key) && cells.isFree(...boxes.get(key));
    };
    const ordered = places.includes(item.side) ? [item.side, ...places] : places;  // The last one first, so that it does not jump.
    item.side = ordered.find((side) => fits(side, false));
    if (!item.side && item.kind === "exit") {  // Every exit has its name, if need be before the floors above it.
      item.side = ordered.find((side) => fits(side, true));
      return item.side ? boxes.get(places.indexOf(item.side)) : null;
    }
    return item.side ? boxes.get(item.side) : null;
  }

  // Puts the names of storeys in a column beside the building, at their heights: of every storey or, where there is no room
  // for all, of every second, third and so on.
  nameStoreys(camera) {
    const { width, height } = this.cells, items = this.items.filter(({ kind }) => kind === "storey");
    const at = items.map((item) => camera.project(this.anchor(item, camera))).map(([x, y]) => [(x + 1) / 2 * width, (1 - y) / 2 * height]);
    const right = Math.min(...at.map(([x]) => x)) - 2 * GAP, sizes = items.map(({ span }) => [span.offsetWidth, span.offsetHeight]);
    let step = 1;
    while (at.some(([, y], k) => k + step < at.length && k % step === 0 && Math.abs(at[k + step][1] - y) < sizes[k][1] + CELL)) step++;
    items.forEach((item, k) => {
      const [[x, y], [w, h]] = [at[k], sizes[k]];
      item.boxes.set(SIDES.column[0], k % step ? null : [right - w, y - h / 2, right, y + h / 2, x, y]);
    });
  }

  // The box at a side of a point; null where the point is not before the eye or a floor lies before the box.
  boxAt(item, at, [right, down], camera, density, isOver) {
    const { width, height } = this.cells, [x, y, depth] = camera.project(at), [w, h] = item.size ??= [item.span.offsetWidth, item.span.offsetHeight];
    if (depth >= 1) return null;
    const left = (x + 1) / 2 * width + right * (w / 2 + GAP) - w / 2, top = (1 - y) / 2 * height + down * (h + GAP) - h / 2;
    const shines = (px, py) => {
      const [from, along] = camera.ray(2 * px / width - 1, 1 - 2 * py / height), way = (at[2] - from[2]) / along[2];
      return way > 0 && floorsBefore(this.layout, density, from, from.map((value, i) => value + way * along[i]), 1) > 0;
    };
    const isHidden = !isOver && !camera.isFlat && !item.to && [left, left + w].some((px) => shines(px, top) || shines(px, top + h));
    return isHidden ? null : [left, top, left + w, top + h, (x + 1) / 2 * width, (1 - y) / 2 * height];
  }

  // The point that a label names: of a storey, its corner on the left; in a section, the middle of its left end.
  anchor(item, camera) {
    const { layout } = this;
    if (item.kind === "storey") {
      const corners = (camera.isFlat ? item.corners : item.outer).map((corner) => layout.place(item.level, ...corner));
      const xs = corners.map(([x]) => x), ys = corners.map(([, y]) => y);
      if (camera.isFlat) return [Math.min(...xs), layout.isSection ? (Math.min(...ys) + Math.max(...ys)) / 2 : Math.max(...ys), 0];
      return corners.reduce((left, one) => camera.project(one)[0] < camera.project(left)[0] ? one : left);
    }
    const [x, y, z] = layout.place(item.level, ...item.at);
    return [x, y, z + (camera.isFlat ? 0 : item.lift)];
  }
}

// Where labels may be beside what they name, in their widths and heights, and the space between.
const GAP = 5;
const near = Array.from({ length: 31 }, (_, k) => (k - 15) * 1.05).filter((down) => Math.abs(down) > 1);
const around = (reach) => [[0, -reach], [0, reach], [-reach, 0], [reach, 0], [-reach, -reach], [reach, -reach], [-reach, reach], [reach, reach]];
const far = (rights) => near.flatMap((down) => rights.map((right) => [right, down])).sort(([a, b], [c, d]) => Math.hypot(6 * a, b) - Math.hypot(6 * c, d));
const SIDES = {
  any: [[0, 0], ...around(1)],
  pointer: far([0, 0.5, -0.5, 1, -1, 1.5, -1.5]),
  exit: [...around(1), ...around(2), ...around(3), ...around(4), ...far([0, 1, -1, 2, -2, 3, -3, 4.5, -4.5, 6, -6, 8, -8])],
  storey: [...[1, 1.25, 1.5, 1.75, 2, 2.5, 3, 4].map((right) => [right, -0.75]), [1, 1], [-1, 1], [-1, -1], [-1, 0]],  // Above it.
  column: [[-1, 0]],
};

const NEAR = 12;  // A label so near to what it names has no line to it [pixels].

// The line from a box to the point that it names: where it begins and ends; of no length if they are near.
function leaderOf([left, top, right, bottom, x, y]) {
  const [fx, fy] = [Math.max(left, Math.min(right, x)), Math.max(top, Math.min(bottom, y))];
  return Math.hypot(x - fx, y - fy) > NEAR ? [fx, fy, x, y] : [x, y, x, y];
}

function styleOf([left, top], [x1, y1, x2, y2]) {
  const line = { x: `${(x1 - left).toFixed(1)}px`, y: `${(y1 - top).toFixed(1)}px`, far: `${Math.hypot(x2 - x1, y2 - y1).toFixed(1)}px`, turn: `${Math.atan2(y2 - y1, x2 - x1).toFixed(3)}rad` };
  return `visibility: visible; transform: translate(${left.toFixed(1)}px, ${top.toFixed(1)}px);${Object.entries(line).map(([name, value]) => ` --${name}: ${value}`).join(";")}`;
}

// Which parts of the picture are taken.
class Cells {
  clear(width, height, top) {
    const columns = Math.ceil(width / CELL), rows = Math.ceil(height / CELL);
    if (this.marks?.length !== columns * rows) this.marks = new Uint8Array(columns * rows);
    Object.assign(this, { width, height, top, columns, rows });
    this.marks.fill(0);
  }

  // Calls `visit` with the cells of a box until it returns true, and returns whether it did.
  some(left, top, right, bottom, visit) {
    const cell = (value, count) => Math.max(0, Math.min(count - 1, Math.floor(value / CELL)));
    const from = cell(left, this.columns), to = cell(right, this.columns), last = cell(bottom, this.rows);
    for (let row = cell(top, this.rows); row <= last; row++) {
      for (let k = row * this.columns + from; k <= row * this.columns + to; k++) if (visit(k)) return true;
    }
    return false;
  }

  mark(left, top, right, bottom) {
    if (right >= 0 && bottom >= 0 && left <= this.width && top <= this.height) this.some(left, top, right, bottom, (k) => { this.marks[k] = 1; });
  }

  // Everybody from the feet to the head, as `Camera.project` but without arrays, which are many for many people.
  markPeople({ matrix: m, size }, { bodies, words, count, tallest }) {
    const { width, height } = this, wider = 1.2 * height / size;
    for (let k = 0; k < count; k++) {
      const x = bodies[4 * k], y = bodies[4 * k + 1], z = bodies[4 * k + 2], reach = wider * (bodies[4 * k + 3] % HEAD_STEP);
      const tall = (words[k] >>> 24) / 255 * tallest;
      const a = m[0] * x + m[4] * y + m[8] * z + m[12], b = m[1] * x + m[5] * y + m[9] * z + m[13], w = m[3] * x + m[7] * y + m[11] * z + m[15];
      const upper = w + m[11] * tall, x1 = (a / w + 1) / 2 * width, x2 = ((a + m[8] * tall) / upper + 1) / 2 * width;
      const y1 = (1 - b / w) / 2 * height, y2 = (1 - (b + m[9] * tall) / upper) / 2 * height;
      this.mark(Math.min(x1, x2) - reach, Math.min(y1, y2) - reach, Math.max(x1, x2) + reach, Math.max(y1, y2) + reach);
    }
  }

  isFree(left, top, right, bottom) {
    return left >= 0 && top >= this.top && right <= this.width && bottom <= this.height && !this.some(left, top, right, bottom, (k) => this.marks[k]);
  }
}

// A bar of a round length, for plans, and an arrow to the north where that is known.
function updateScale(camera, height, northward, isSection) {
  const arrow = document.getElementById("north");
  arrow.hidden = !northward || isSection;
  if (!arrow.hidden) {
    const [x, y] = [camera.right, camera.up].map((axis) => axis[0] * northward[0] + axis[1] * northward[1]);
    arrow.firstElementChild.style.transform = `rotate(${Math.atan2(x, y)}rad)`;
  }
  document.getElementById("scale").hidden = !camera.isFlat;
  if (!camera.isFlat) return;
  const metre = height / camera.size, power = 10 ** Math.floor(Math.log10(120 / metre));
  const length = [5, 2, 1].map((k) => k * power).find((value) => value * metre <= 130) ?? power;
  document.getElementById("scale-bar").style.width = `${length * metre}px`;
  document.getElementById("scale-text").textContent = `${length} m`;
}
