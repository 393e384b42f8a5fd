// People: the colour of each, and the bytes that are handed to WebGL; who is where the pointer is.

// What people can be coloured by, with the range of the scale. `null` is found from the data.
const QUANTITIES = {
  group: { label: "Group" },
  speed: { label: "Speed", unit: "m/s", greatest: 2 },
  density: { label: "Density", unit: "1/m²", greatest: 5 },
  "contact force": { label: "Contact force", unit: "N", greatest: null },
  "waiting time": { label: "Waiting time", unit: "s", greatest: null },
};

class People {
  constructor(record, density) {
    this.record = record;
    this.density = density;
    this.width = 1024;  // of the textures that have everybody
    const room = this.width * Math.ceil(record.people / this.width);
    this.bodies = new Float32Array(4 * room);
    this.tints = new Uint8Array(4 * room);
    this.words = new Uint32Array(this.tints.buffer);
    this.shown = new Uint32Array(record.people);  // rows of `now`
    this.count = 0;
    this.marked = -1;  // which of those shown is selected
    this.tallest = record.tallest;  // The fourth byte of a tint is the height, as a share of this.
    const { colours } = record;
    this.groups = [...colours.groups, colours.none].map((hex) => packed(parts(hex)));
    this.faded = [...colours.groups, colours.none].map(() => packed([176, 184, 193]));
    this.ramps = Object.fromEntries(Object.entries(colours.maps).map(([name, stops]) => [name, ramp(stops)]));
    this.greatest = {};
  }

  // The upper end of a quantity's scale: a round number that 99 % of the greatest values stay below.
  greatestOf(quantity) {
    if (QUANTITIES[quantity].greatest) return QUANTITIES[quantity].greatest;
    if (this.greatest[quantity]) return this.greatest[quantity];
    const { record } = this, peaks = new Float32Array(record.people);
    const values = quantity === "waiting time" ? record.waiting() : null;
    record.motion.person.forEach((p, row) => {
      const value = values ? values[row] : record.motion.force[row];
      if (value > peaks[p]) peaks[p] = value;
    });
    const sorted = peaks.filter((value) => value > 0).sort();
    let most = sorted.length ? sorted[Math.floor(0.99 * (sorted.length - 1))] : 1;
    if (!values) most = sorted.length ? record.forceOfCode(most) : 100;
    this.greatest[quantity] = roundUp(most);
    return this.greatest[quantity];
  }

  // Value of a quantity of the i-th person of `now`.
  valueOf(quantity, now, i) {
    const { record } = this;
    if (quantity === "speed") return record.speeds(now.frame)[now.row[i] - record.motion.first[now.frame]];
    if (quantity === "density") return this.density.sums[this.density.node(now.level[i], now.x[i], now.y[i])];
    if (quantity === "contact force") return record.forceOf(now.row[i]);
    return record.waiting()[now.row[i]];
  }

  update(now, layout, quantity, highlighted, selected) {
    const { record, bodies, words } = this;
    const isGroup = quantity === "group";
    const scale = isGroup ? null : this.ramps[quantity];
    const factor = isGroup ? 1 : 255 / this.greatestOf(quantity);
    let k = 0;
    this.marked = -1;
    for (let i = 0; i < now.count; i++) {
      const level = now.level[i];
      if (!layout.visible[level]) continue;
      const p = now.person[i], shift = layout.shift[level];
      bodies[4 * k] = now.x[i] + shift[0];
      bodies[4 * k + 1] = now.y[i] + shift[1];
      bodies[4 * k + 2] = layout.height(now.z[i]);
      bodies[4 * k + 3] = record.radius[p] / 1000;
      const group = record.group[p] < 0 ? this.groups.length - 1 : record.group[p];
      const fades = highlighted !== null && group !== highlighted;
      let colour = isGroup ? this.groups[group] : scale[Math.max(0, Math.min(255, Math.round(factor * this.valueOf(quantity, now, i))))];
      if (fades) colour = this.faded[group];
      if (p === selected) this.marked = k;
      words[k] = colour & 0xffffff | Math.round(255 * record.height[p] / 1000 / this.tallest) << 24;
      this.shown[k++] = i;
    }
    this.count = k;
  }

  // The person whose figure the ray meets first, -1 for none.
  pick([from, along]) {
    let least = Infinity, found = -1;
    for (let k = 0; k < this.count; k++) {
      const [x, y, z, r] = this.bodies.subarray(4 * k, 4 * k + 4);
      const tall = this.record.height[this.record.now.person[this.shown[k]]] / 1000;
      const way = meetCapsule(from, along, [x, y, z], 1.25 * r, tall);
      if (way < least) [least, found] = [way, this.shown[k]];
    }
    return found < 0 ? -1 : this.record.now.person[found];
  }
}

// The end of a scale: a round number.
function roundUp(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return Number(([1, 1.5, 2, 3, 4, 5, 6, 8, 10].find((k) => k * power >= most * 0.999) * power).toPrecision(2));
}

// How far along a ray an upright capsule is, infinite where it is missed.
function meetCapsule(from, along, foot, radius, tall) {
  const off = foot.map((value, i) => value - from[i]);
  const flat = along[0] ** 2 + along[1] ** 2;
  let way = flat > 1e-9 ? (off[0] * along[0] + off[1] * along[1]) / flat : dot(off, along);
  const z = Math.max(0, Math.min(tall, way * along[2] - off[2]));
  way = dot([off[0], off[1], off[2] + z], along);
  const miss = Math.hypot(off[0] - way * along[0], off[1] - way * along[1], off[2] + z - way * along[2]);
  return miss <= radius && way > 0 ? way : Infinity;
}
