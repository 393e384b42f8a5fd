// Where levels are shown: storeys above each other or side by side, and which of them.

const MOST_SPREAD = 10;
const SAME_STOREY = 0.5;  // Floors that differ by less in height make one storey [m].

// Gives every level a storey; stairs belong to the storey below.
function findStoreys(levels) {
  const floors = levels.filter((level) => level.kind === "floor");
  const storeys = [];
  for (const floor of (floors.length ? floors : levels).toSorted((a, b) => a.z[0] - b.z[0])) {
    const top = storeys[storeys.length - 1];
    if (top && floor.z[0] - top.z < SAME_STOREY) top.names.push(floor.name);
    else storeys.push({ z: floor.z[0], names: [floor.name] });
  }
  storeys.forEach((storey) => {
    storey.name = storey.names.length > 2 ? `level ${storey.z.toFixed(2)} m` : storey.names.join(", ");
  });
  for (const level of levels) {
    level.storey = 0;
    storeys.forEach((storey, index) => { if (storey.z <= level.z[0] + SAME_STOREY) level.storey = index; });
  }
  return storeys;
}

// Least x, least y, greatest x, greatest y of triangles [m].
function planBox(triangles, vertices, grain) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  for (const v of triangles) {
    const x = vertices[3 * v] * grain, y = vertices[3 * v + 1] * grain;
    box[0] = Math.min(box[0], x);
    box[1] = Math.min(box[1], y);
    box[2] = Math.max(box[2], x);
    box[3] = Math.max(box[3], y);
  }
  return box;
}

class Layout {
  constructor(building, grain, storeys) {
    this.building = building;
    this.grain = grain;
    this.storeys = storeys;
    this.base = storeys[0].z;
    this.boxes = building.levels.map((level) => planBox(level.triangles, building.vertices, grain));
    this.box = [0, 1, 2, 3].map((i) => Math[i < 2 ? "min" : "max"](...this.boxes.map((box) => box[i])));
    this.extent = [this.box[2] - this.box[0], this.box[3] - this.box[1]];
    this.frames = building.levels.map(() => [[1, 0, 0], [0, 1, 0]]);  // Of each level: x and y in the picture from those in plan.
    this.visible = building.levels.map(() => true);
    this.spread = 1;
    this.heights = [this.base, Math.max(...building.levels.map((level) => level.z[1])) + 2.2];  // Of the floors, and above heads.
    this.clip([0, 0, 0, 1, 1, 1]);
  }

  // Shows only what is in a box: its least x, y and z and its greatest, as shares of those of the building. In 3D only.
  clip(shares) {
    const [low, high] = [[...this.box.slice(0, 2), this.heights[0]], [...this.box.slice(2), this.heights[1]]];
    this.shares = shares;
    this.isClipped = shares.some((share, k) => share !== (k < 3 ? 0 : 1));
    this.limits = shares.map((share, k) => share === (k < 3 ? 0 : 1) ? (k < 3 ? -Infinity : Infinity) : low[k % 3] + share * (high[k % 3] - low[k % 3]));
  }

  // Whether a place in plan, at its true height, is in the box.
  holds(x, y, z) {
    const [x1, y1, z1, x2, y2, z2] = this.limits;
    return this.isFlat || !this.isClipped || (x >= x1 && x <= x2 && y >= y1 && y <= y2 && z >= z1 && z <= z2);
  }

  // The least and the greatest corner of the box in the picture.
  boxInPicture() {
    const far = [-1e9, -1e9, -1e9, 1e9, 1e9, 1e9], all = this.isFlat ? far : this.limits.map((limit, k) => Number.isFinite(limit) ? (k % 3 === 2 ? this.height(limit) : limit) : far[k]);
    return { low: all.slice(0, 3), high: all.slice(3) };
  }

  // Factor of heights with which, in a view, a storey leaves a share of the one below free.
  spreadFor({ tilt, azimuth }, share) {
    if (this.storeys.length < 2) return 1;
    const gaps = this.storeys.slice(1).map((storey, k) => storey.z - this.storeys[k].z);
    const depth = Math.abs(Math.sin(azimuth)) * this.extent[0] + Math.abs(Math.cos(azimuth)) * this.extent[1];
    return Math.max(1, Math.min(MOST_SPREAD, share * depth * Math.tan(tilt) / Math.min(...gaps)));
  }

  // `view` is 3d, plan or section; `storey` is -1 for all of them.
  arrange(view, storey, spread, aspect) {
    this.isFlat = view !== "3d";
    this.isPlan = view === "plan";
    this.storey = storey;
    this.spread = this.isFlat || storey >= 0 ? 1 : spread;
    const many = this.storeys.length, gap = 0.08 * Math.max(...this.extent) + 1;
    const [width, depth] = [this.extent[0] + gap, this.extent[1] + 1.5 * gap];  // With room for names.
    let columns = 1, best = Infinity;
    for (let n = 1; n <= many; n++) {
      const size = Math.max(n * width / aspect, Math.ceil(many / n) * depth);
      if (size < best) [columns, best] = [n, size];
    }
    this.building.levels.forEach((level, index) => {
      const aside = this.isFlat && storey < 0 ? level.storey : 0;
      this.frames[index] = [[1, 0, (aside % columns) * width], [0, 1, -Math.floor(aside / columns) * depth]];
      this.visible[index] = storey < 0 || level.storey === storey || (!this.isFlat && this.leadsDown(level, storey));
    });
    this.isSection = view === "section";
    if (this.isSection) unfold(this, aspect);
  }

  // Whether a level is drawn with a storey.
  shows(level, storey) { return this.visible[level] && this.building.levels[level].storey === storey; }

  leadsDown(level, storey) {
    return level.kind !== "floor" && level.storey === storey - 1;
  }

  height(z) { return this.isSection ? 0 : this.base + (z - this.base) * this.spread; }

  place(level, x, y, z) {
    const [[xx, xy, x0], [yx, yy, y0]] = this.frames[level];
    return [xx * x + xy * y + x0, yx * x + yy * y + y0 + this.rise(level, z), this.height(z)];
  }

  // How far above its stop the section shows a car that rides, or somebody in it, at a height.
  rise(level, z) {
    const { kind, z: [low] } = this.building.levels[level];
    return this.isSection && kind === "car" ? this.pitch * (this.storeyAt(z) - this.storeyAt(low)) : 0;
  }

  // The storey at a height, with its share between two of them.
  storeyAt(z) {
    const k = Math.max(0, this.storeys.slice(0, -1).findLastIndex((storey) => storey.z <= z)), [low, high] = this.storeys.slice(k);
    return k + (z - low.z) / (high.z - low.z);
  }

  // Corners of everything visible, to fit the view to.
  corners() {
    const found = [];
    this.building.levels.forEach((level, index) => {
      if (!this.visible[index]) return;
      const [x1, y1, x2, y2] = this.boxes[index];
      for (const x of [x1, x2]) for (const y of [y1, y2]) for (const z of [level.z[0], level.z[1] + 1.2]) {
        found.push(this.place(index, x, y, z));
      }
    });
    return found;
  }
}
