// Triangles of the storeys of the building, as the layout places them.

// Two triangles, whose corners have some numbers in common.
function pushQuad(values, corners, shared = []) {
  for (const k of [0, 1, 2, 0, 2, 3]) values.push(...corners[k], ...shared);
}

function floorMesh(layout, storey, density) {
  const { building, grain } = layout, { vertices } = building, values = [];
  building.levels.forEach((level, index) => {
    if (!layout.shows(index, storey)) return;
    const kind = KINDS.indexOf(level.kind);
    for (const v of level.triangles) {
      const [x, y, z] = [0, 1, 2].map((i) => vertices[3 * v + i] * grain);
      values.push(...layout.place(index, x, y, z), ...density.texel(index, x, y), Math.max(0, kind), z);
    }
  });
  return values;
}

// Walls stand outside their line, so that the floor inside keeps its width.
function solidMesh(layout, storey) {
  const { building, grain } = layout, values = [];
  const thick = Math.max(0.07, Math.max(...layout.extent) / 420);
  const quad = (a, b, c, d, normal, kind) => pushQuad(values, [a, b, c, d], [...normal, kind]);
  building.levels.forEach((level, index) => {
    if (!layout.shows(index, storey)) return;
    const { walls, furniture } = level;
    for (const [a, b, normal] of sidesOf(furniture.sides, grain)) {
      const low = [layout.place(index, ...a), layout.place(index, ...b)], raise = ([x, y, z]) => [x, y, z + DESK_HEIGHT];
      quad(low[0], low[1], raise(low[1]), raise(low[0]), normal, 2);
    }
    for (const [[x1, y1, z1], [x2, y2, z2], normal] of sidesOf(walls, grain)) {
      const [ox, oy] = [-thick * normal[0], -thick * normal[1]];
      const low = [layout.place(index, x1, y1, z1), layout.place(index, x2, y2, z2)];
      const far = [layout.place(index, x1 + ox, y1 + oy, z1), layout.place(index, x2 + ox, y2 + oy, z2)];
      const raise = ([x, y, z]) => [x, y, z + WALL_HEIGHT];
      quad(low[0], low[1], raise(low[1]), raise(low[0]), normal, 0);
      quad(far[1], far[0], raise(far[0]), raise(far[1]), normal.map((part) => -part), 0);
      quad(raise(low[0]), raise(low[1]), raise(far[1]), raise(far[0]), [0, 0, 1], 1);
      quad(low[0], raise(low[0]), raise(far[0]), far[0], [-normal[1], normal[0], 0], 0);
      quad(low[1], raise(low[1]), raise(far[1]), far[1], [normal[1], -normal[0], 0], 0);
    }
    for (let t = 0; t < furniture.top.length; t += 2) {
      const [x, y, z] = layout.place(index, furniture.top[t] * grain, furniture.top[t + 1] * grain, level.z[0]);
      values.push(x, y, z + DESK_HEIGHT, 0, 0, 1, 2);
    }
  });
  return values;
}

// The ends of each segment, and the direction to its left, which is inside.
function* sidesOf(segments, grain) {
  for (let s = 0; s < segments.length; s += 6) {
    const [x1, y1, z1, x2, y2, z2] = segments.slice(s, s + 6).map((value) => value * grain);
    const length = Math.hypot(x2 - x1, y2 - y1);
    if (length) yield [[x1, y1, z1], [x2, y2, z2], [-(y2 - y1) / length, (x2 - x1) / length, 0]];
  }
}

// Exits and closed doors: a curtain of light that fades upwards, and a strip on the floor. Places and marks: a carpet.
function glowMesh(layout, storey, { shut, marks }, colours) {
  const { building, grain } = layout, values = [];
  const wide = Math.max(0.25, Math.max(...layout.extent) / 220);
  const curtain = (level, segments, colour) => {
    for (let s = 0; s < segments.length; s += 6) {
      const [x1, y1, z1, x2, y2, z2] = segments.slice(s, s + 6).map((value) => value * grain);
      const length = Math.hypot(x2 - x1, y2 - y1) || 1;
      const a = layout.place(level, x1, y1, z1), b = layout.place(level, x2, y2, z2);
      const [ox, oy] = [(y2 - y1) / length * wide, -(x2 - x1) / length * wide];
      const lift = ([x, y, z], by) => [x, y, z + by], push = ([x, y, z]) => [x + ox, y + oy, z + 0.03];
      const shaded = (share, corners) => corners.map((corner) => [...corner, ...colour, share]);
      pushQuad(values, [...shaded(0.75, [a, b]), ...shaded(0.05, [lift(b, EXIT_HEIGHT), lift(a, EXIT_HEIGHT)])]);
      pushQuad(values, [...shaded(0.95, [lift(a, 0.03), lift(b, 0.03)]), ...shaded(0.35, [push(b), push(a)])]);
    }
  };
  building.exits.forEach((exit, index) => {
    if (!layout.shows(exit.level, storey)) return;
    curtain(exit.level, exit.segments, shut.includes(building.portals.length + index) ? colours.closed : colours.exit);
  });
  building.portals.forEach((portal, index) => {
    if (!shut.includes(index)) return;
    for (const level of portal.levels) if (layout.shows(level, storey)) curtain(level, portal.segments, colours.closed);
  });
  building.doors.forEach((door, index) => {
    const isShut = shut.includes(building.portals.length + building.exits.length + index);
    if (isShut && layout.shows(door.level, storey)) curtain(door.level, door.segments, colours.closed);
  });
  const carpet = ({ level, triangles }, colour, share, lift) => {
    if (!layout.shows(level, storey)) return;
    for (let t = 0; t < triangles.length; t += 3) {
      const [x, y, z] = layout.place(level, ...triangles.slice(t, t + 3).map((value) => value * grain));
      values.push(x, y, z + lift, ...colour, share);
    }
  };
  for (const place of building.places) carpet(place, colours.places[place.kind], ["sign", "fire"].includes(place.kind) ? 0.9 : 0.3, 0.02);
  for (const mark of marks) carpet(mark, colours.closed, { slow: 0.18, barred: 0.4, one_way: 0.9, control: 0.6 }[mark.kind], 0.03);
  return values;
}

const PATH_STEP = 0.2;  // Least length of a piece [m].

// The paths of all people of a kind: lines in the colours of their groups.
function pathsMesh(layout, record, isOfThem, colours) {
  const { motion } = record, { levels } = layout.building, values = [], last = new Int32Array(record.people).fill(-1);
  const end = (row) => [...layout.place(motion.level[row], motion.x[row], motion.y[row], motion.z[row] + 0.04), ...colours[record.group[motion.person[row]]] ?? colours.at(-1), 0.5];
  for (let row = 0; row < motion.person.length; row++) {
    const p = motion.person[row], before = last[p], level = motion.level[row];
    if (!isOfThem(p)) continue;
    if (before >= 0) {
      const from = motion.level[before];
      if (from === level && Math.hypot(motion.x[row] - motion.x[before], motion.y[row] - motion.y[before]) < PATH_STEP) continue;
      const jumps = layout.isFlat && (levels[from].storey !== levels[level].storey || layout.isSection && from !== level);
      if (layout.visible[from] && layout.visible[level] && !jumps) values.push(...end(before), ...end(row));
    }
    last[p] = row;
  }
  return values;
}

// The way of one person: a flat ribbon on the floor.
function trackMesh(layout, record, p, colour) {
  const { motion } = record, values = [], half = Math.max(0.05, Math.max(...layout.extent) / 600);
  let last = null;
  for (let k = 0; k < record.frames; k++) {
    const row = record.rowOf(k, p);
    if (row < 0) continue;
    const level = motion.level[row];
    const [x, y, z] = layout.place(level, motion.x[row], motion.y[row], motion.z[row]);
    const point = { x, y, z: z + 0.04, level, storey: layout.building.levels[level].storey, isVisible: layout.visible[level] };
    if (!last) { last = point; continue; }
    const length = Math.hypot(point.x - last.x, point.y - last.y);
    if (length < 0.02) continue;
    const jumps = layout.isFlat && (point.storey !== last.storey || layout.isSection && level !== last.level);
    if (point.isVisible && last.isVisible && !jumps) {
      const [ox, oy] = [-(point.y - last.y) / length * half, (point.x - last.x) / length * half];
      pushQuad(values, [[last, 1], [point, 1], [point, -1], [last, -1]].map(([at, side]) => [at.x + side * ox, at.y + side * oy, at.z]), [...colour, 0.85]);
    }
    last = point;
  }
  return values;
}
