// People: the colour of each, and the bytes that are handed to WebGL; who is where the pointer is.

// The measures of people, and the columns of the motion that have them.
const COLUMNS = { speed: "speed", "contact force": "force", "waited so far": "waited", dose: "dose" };

const HEAD_STEP = 10;  // The fourth number of a body is its radius, and this for each step of the marks on head and belt.

class People {
  constructor(record, density, smoke) {
    this.record = record;
    Object.assign(this, { density, smoke });
    this.width = 1024;  // of the textures that have everybody
    const room = this.width * Math.ceil(record.people / this.width);
    this.bodies = new Float32Array(4 * room);
    this.tints = new Uint8Array(4 * room);
    this.words = new Uint32Array(this.tints.buffer);
    this.shown = new Uint32Array(record.people);  // rows of `now`
    this.count = 0;
    this.parts = [];  // Of each storey, the first one shown and how many.
    this.marked = -1;  // which of those shown is selected
    this.tallest = record.tallest;  // The fourth byte of a tint is the height, as a share of this.
    const { colours: { groups, marks, nothing } } = record, markOf = (part) => marks.indexOf(part) + 1;
    this.groups = groups.map(([body]) => packed(parts(body)));
    this.marks = groups.map(([, head, belt]) => HEAD_STEP * (markOf(head) + (marks.length + 1) * markOf(belt)));
    this.nothing = packed(parts(nothing));
    this.faded = packed([176, 184, 193]);
  }

  // The scale of a quantity; the longest time that anybody waited, or the densest smoke, ends its own.
  scaleOf(quantity, service) {
    const { people_scales: scales, services, longest_wait } = this.record;
    const scale = served(scales[quantity], service, services);
    if (quantity !== AIR[0]) return { ...scale, top: scale.top ?? roundUp(longest_wait) };
    const isDark = document.documentElement.dataset.theme === "dark";  // There, the densest smoke is the lightest.
    return { ...scale, top: roundUp(this.smoke.greatest), stops: isDark ? [...scale.stops].reverse() : scale.stops };
  }

  // Value of a quantity of the i-th person of `now`.
  valueOf(quantity, now, i) {
    if (quantity === "density") return this.density.sums[this.density.node(now.level[i], now.x[i], now.y[i])];
    if (AIR.includes(quantity)) return this.smoke.at(quantity, now.frame, now.level[i], now.x[i], now.y[i]);
    return this.record.motion[COLUMNS[quantity]][now.row[i]];
  }

  update(now, layout, quantity, service, highlighted, selected) {
    const { record, bodies, words } = this;
    const isGroup = quantity === "group";
    const scale = isGroup ? null : this.scaleOf(quantity, service), colours = scale && ramp(scale);
    const { levels } = layout.building, sizes = new Uint32Array(layout.storeys.length);
    const isShown = (i) => layout.visible[now.level[i]] && layout.holds(now.x[i], now.y[i], now.z[i]);
    for (let i = 0; i < now.count; i++) if (isShown(i)) sizes[levels[now.level[i]].storey]++;
    let total = 0;
    this.parts = Array.from(sizes, (size) => [(total += size) - size, size]);
    const next = this.parts.map(([from]) => from);
    this.marked = -1;
    for (let i = 0; i < now.count; i++) {
      const level = now.level[i];
      if (!isShown(i)) continue;
      const p = now.person[i], k = next[levels[level].storey]++;
      const [[xx, xy, x0], [yx, yy, y0]] = layout.frames[level];
      bodies[4 * k] = xx * now.x[i] + xy * now.y[i] + x0;
      bodies[4 * k + 1] = yx * now.x[i] + yy * now.y[i] + y0 + layout.rise(level, now.z[i]);
      bodies[4 * k + 2] = layout.height(now.z[i]);
      const group = record.group[p] < 0 ? this.groups.length - 1 : record.group[p];
      bodies[4 * k + 3] = record.radius[p] / 1000 + (isGroup ? this.marks[group] : 0);
      const fades = highlighted !== null && group !== highlighted;
      let colour = this.groups[group];
      if (!isGroup) {
        const value = this.valueOf(quantity, now, i);
        colour = value < scale.least ? this.nothing : colours[Math.floor(255 * shareOf(scale, scale.top, value))];
      }
      if (fades) colour = this.faded;
      if (p === selected) this.marked = k;
      words[k] = colour & 0xffffff | Math.round(255 * record.height[p] / 1000 / this.tallest) << 24;
      this.shown[k] = i;
    }
    this.count = total;
  }

  // The person whose figure the ray meets first, -1 for none.
  pick([from, along]) {
    let least = Infinity, found = -1;
    for (let k = 0; k < this.count; k++) {
      const [x, y, z, r] = this.bodies.subarray(4 * k, 4 * k + 4);
      const tall = this.record.height[this.record.now.person[this.shown[k]]] / 1000;
      const way = meetCapsule(from, along, [x, y, z], 1.25 * (r % HEAD_STEP), tall);
      if (way < least) [least, found] = [way, this.shown[k]];
    }
    return found < 0 ? -1 : this.record.now.person[found];
  }
}

// The end of a scale: a round number; 1 for 0.
function roundUp(most) {
  if (!(most > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(most));
  return Number(([1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10].find((k) => k * power >= most * 0.999) * power).toPrecision(2));
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
