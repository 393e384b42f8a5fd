// The plan as an immutable table, as it is in the file: what its rows are, their shapes, and changes of them.

const POLYGONS = ["rooms", "areas", "obstacles"];
const ON_WALLS = ["doors", "exits", "openings"];
const STAIRS = ["shafts", "stairs"];
const PIECES = ["flights", "landings"];  // Of stairs that are drawn piece by piece.
const OUTLINED = [...POLYGONS, ...PIECES, "lifts", "storeys"];
const DRAWN = [...ON_WALLS, ...STAIRS, ...PIECES, "lifts", ...POLYGONS];
const SHAPES = ["polygon", "polygons", "segment", "lower_edge", "upper_edge", "door"];
const CASE = ["people", "event", "phase", "compartment", "behaviours"];  // Of the case, which is beside the plan as `case`.
const NAMED = { storeys: "level", areas: "area" };  // Keys of groups with names of the plan.
const USUAL_HEIGHT = 3;  // From a storey to the next one [m].
const WALL = 0.35;  // Two faces of rooms that are no farther apart are those of one wall [m].

const mm = (value) => Math.round(value * 1000) / 1000;
const isTie = (shape) => Boolean(shape?.rooms);
const isRing = (shape) => Array.isArray(shape) && shape.length > 1 && shape.every((one) => Array.isArray(one) && one.length > 1 && one.every((value) => typeof value === "number"));
const plus = ([x, y, ...rest], [dx, dy]) => [mm(x + dx), mm(y + dy), ...rest];
const minus = ([x1, y1], [x2, y2]) => [x1 - x2, y1 - y2];
const length = ([x, y]) => Math.hypot(x, y);
const letters = (n) => (n > 26 ? letters(Math.floor((n - 1) / 26)) : "") + String.fromCharCode(65 + (n - 1) % 26);
const middle = ([[x1, y1], [x2, y2]]) => [(x1 + x2) / 2, (y1 + y2) / 2];
const wide = (lines) => lines.reduce((sum, [a, b]) => sum + length(minus(b, a)), 0);
const keyOf = ([x, y]) => `${mm(x)},${mm(y)}`;
const sidesOf2 = (ring) => ring.map((corner, k) => [corner, ring[(k + 1) % ring.length]]);

// A shape in which `change` was applied to each ring or line, in the form in which it is given: lists, WKT or GeoJSON.
function mapRings(shape, change) {
  const opened = (ring) => {
    const isClosed = ring.length > 3 && keyOf(ring[0]) === keyOf(ring[ring.length - 1]), open = isClosed ? ring.slice(0, -1) : ring, next = change(open);
    return next === open ? ring : isClosed ? [...next, next[0]] : next;
  };
  if (typeof shape === "string") {
    return shape.replace(/\(([^()]+)\)/g, (whole, text) => {
      const ring = text.split(",").map((corner) => corner.trim().split(/\s+/).map(Number)), next = opened(ring);
      return next === ring ? whole : `(${next.map((corner) => corner.join(" ")).join(", ")})`;
    });
  }
  if (isRing(shape)) return opened(shape);
  if (Array.isArray(shape)) {
    const next = shape.map((one) => mapRings(one, change));
    return next.every((one, k) => one === shape[k]) ? shape : next;
  }
  if (!shape?.coordinates) return shape;
  const coordinates = mapRings(shape.coordinates, change);
  return coordinates === shape.coordinates ? shape : { ...shape, coordinates };
}

const known = new WeakMap();  // The rings of rows, which never change.

function ringsOf(row) {
  if (known.has(row)) return known.get(row);
  const rings = [];
  for (const key of SHAPES) if (row[key] && !isTie(row[key])) mapRings(row[key], (ring) => { rings.push(ring); return ring; });
  known.set(row, rings);
  return rings;
}

// A row in which each corner was moved by `move`, which returns the same corner where it stays.
function moved(row, move, isRing = () => true) {
  let number = -1;
  const next = { ...row };
  for (const key of SHAPES) {
    if (row[key] && !isTie(row[key])) next[key] = mapRings(row[key], (ring) => {
      number += 1;
      const corners = isRing(number) ? ring.map(move) : ring;
      return corners.every((corner, k) => corner === ring[k]) ? ring : corners;
    });
  }
  if (row.foot) next.foot = move(row.foot);
  return Object.keys(next).every((key) => next[key] === row[key]) ? row : next;
}

// The doors of a lift, which are lines on its outline.
const doorsOf = (row) => row.door ? ringsOf({ door: row.door }) : [];

const areaOf = (ring) => sidesOf2(ring).reduce((sum, [[x1, y1], [x2, y2]]) => sum + x1 * y2 - x2 * y1, 0) / 2;

function isInside([x, y], ring) {
  let isIn = false;
  for (const [[x1, y1], [x2, y2]] of sidesOf2(ring)) if (y1 > y !== y2 > y && x < (x2 - x1) * (y - y1) / (y2 - y1) + x1) isIn = !isIn;
  return isIn;
}

// Whether corners are within a ring or on it, and none of its own is among them.
const holds = (ring, corners) => corners.every((corner) => isInside(corner, ring) || isOn(corner, ring)) && !ring.some((corner) => isInside(corner, corners) && !isOn(corner, corners));
const isOn = (point, ring) => sidesOf2(ring).some((side) => nearest(point, side).away < 0.01);

// The place on a line that is nearest to a point: how far it is along the line and away.
function nearest(point, [a, b]) {
  const way = minus(b, a), whole = length(way) || 1, step = way.map((value) => value / whole), off = minus(point, a);
  const along = Math.max(0, Math.min(whole, off[0] * step[0] + off[1] * step[1])), at = a.map((value, i) => value + along * step[i]);
  return { at, along, step, whole, away: length(minus(point, at)) };
}

// Whether two lines are the faces of one wall, or a line lies on a wall.
function isBeside([a, b], other) {
  const { step, whole } = nearest(a, other), way = minus(b, a);
  if (whole < 1e-6 || Math.abs(way[0] * step[1] - way[1] * step[0]) > 0.02 * length(way)) return false;
  const along = [a, b].map((end) => minus(end, other[0])).map(([x, y]) => x * step[0] + y * step[1]);
  const [x, y] = minus(a, other[0]), away = Math.abs(x * step[1] - y * step[0]);
  return away <= WALL && Math.min(whole, Math.max(...along)) - Math.max(0, Math.min(...along)) > 0.05;
}

// The outline of a room, whose other rings are holes in it; none of a room of several parts.
function outlineOf(row) {
  const [outer, ...others] = ringsOf(row ?? {});
  return outer && others.every(([corner]) => isInside(corner, outer)) ? outer : null;
}

// The part of a wall that a tie names.
function partOf([a, b], { at, width }) {
  const { step, whole } = nearest(a, [a, b]), half = (width ?? whole) / 2, centre = at ?? whole / 2;
  return [centre - half, centre + half].map((along) => a.map((value, i) => mm(value + along * step[i])));
}

const stated = (content) => Object.fromEntries(Object.entries(content).filter(([, value]) => value !== undefined));

class Table {
  constructor(content) { Object.assign(this, { content, found: new Map() }); }

  // What `find` returns, which is looked for once: a table never changes.
  once(what, find) {
    if (!this.found.has(what)) this.found.set(what, find());
    return this.found.get(what);
  }

  rows(section) { return (CASE.includes(section) ? this.content.case : this.content)?.[section] ?? []; }
  row({ section, index }) { return this.rows(section)[index]; }
  get storeys() { return this.rows("storeys").toSorted((a, b) => (a.z ?? 0) - (b.z ?? 0)); }
  storey(name) { return this.rows("storeys").find((one) => one.name === name); }
  above(name) { const all = this.storeys; return all[all.findIndex((one) => one.name === name) + 1]; }

  // The storeys that a storey is like, the nearest first.
  originals(name) {
    const found = [];
    for (let like = this.storey(name)?.like; like && !found.includes(like) && like !== name; like = this.storey(like)?.like) found.push(like);
    return found;
  }

  // What is drawn on a storey: its own rows, and its ground.
  on(name) { return this.once(`on ${name}`, () => this.findOn(name)); }

  findOn(name) {
    const index = this.rows("storeys").findIndex((one) => one.name === name);
    const ground = index < 0 ? [] : ringsOf(this.rows("storeys")[index]).map((_, part) => ({ section: "storeys", index, part }));
    return [...DRAWN.flatMap((section) => this.rows(section).map((row, at) => ({ section, index: at, row }))
      .filter(({ row }) => this.isOn(row, section, name)).map(({ row, ...ref }) => ref)), ...ground];
  }

  // Whether something is drawn on a storey: pieces of stairs on the highest one that is not above them.
  isOn(row, section, name) {
    if (!PIECES.includes(section)) return (row.storeys ?? [row.storey, row.lower]).includes(name);
    const z = row.lower_z ?? row.z ?? Math.min(...ringsOf(row).flat().map((corner) => corner[2] ?? 0));
    return (this.storeys.findLast((one) => (one.z ?? 0) < z + 0.05) ?? this.storeys[0])?.name === name;
  }

  // The closed outlines of something: its rings, of a lift without its doors, and of a flight between two edges what is
  // between them.
  outlines(ref) {
    const rings = this.rings(ref), [[a, b], [c, d] = []] = [rings[0] ?? [], rings[1]];
    if (ref.section === "lifts") return rings.slice(0, rings.length - doorsOf(this.row(ref)).length);
    if (ref.section !== "flights" || rings.length !== 2) return rings;
    const [x, y] = minus(b, a), [dx, dy] = minus(d, c);
    return [x * dx + y * dy > 0 ? [a, b, d, c] : [a, b, c, d]];
  }

  // Flights and landings that begin, end or are at a line, which is within it or contains it: their stairs and heights.
  joinedAt(line) {
    const has = (ring) => ring && (line.every((end) => isOn(end, ring)) || ring.filter((end) => isOn(end, line)).length > 1);
    const found = [...this.rows("flights").flatMap(({ stair, lower_edge, lower_z, upper_edge, upper_z }) => [[lower_edge, lower_z], [upper_edge, upper_z]].map(([ring, z]) => ({ stair, ring, z }))), ...this.rows("landings").flatMap((row) => ringsOf(row).map((ring) => ({ stair: row.stair, ring, z: row.z })))];
    return found.find(({ ring, z }) => Number.isFinite(z) && has(ring));
  }

  rings(ref) { const rings = ringsOf(this.row(ref) ?? {}); return ref.part === undefined ? rings : rings.slice(ref.part, ref.part + 1); }

  // The faces of all walls of a storey: sides of rooms and of its ground.
  walls(name) {
    return this.once(`walls ${name}`, () => this.on(name).filter(({ section }) => section === "rooms" || section === "storeys").flatMap((ref) => this.rings(ref).flatMap(sidesOf2)));
  }

  // The wall that a tie names: from a corner of a room to the next, or the longest one between two rooms, from its end
  // with the least x, then y. None if a room is not an outline of this storey.
  wallOf({ rooms, side }, storey) {
    const outlines = rooms.map((name) => outlineOf(this.rows("rooms").find((row) => row.name === name && row.storey === storey)));
    if (!outlines.every(Boolean)) return null;
    const [own, other] = outlines.map(sidesOf2);
    if (!other) return own[side] ?? null;
    let best = null, most = 0;
    for (const a of own) for (const b of other.filter((one) => isBeside(a, one))) {
      const { step, whole } = nearest(b[0], b), along = a.map((end) => minus(end, b[0])).map(([x, y]) => x * step[0] + y * step[1]);
      const [from, to] = [Math.max(0, Math.min(...along)), Math.min(whole, Math.max(...along))];
      const between = (way) => { const at = b[0].map((value, i) => value + way * step[i]), off = minus(a[0], at), aside = off[0] * step[1] - off[1] * step[0]; return [at[0] + aside * step[1] / 2, at[1] - aside * step[0] / 2]; };
      if (to - from > most) [most, best] = [to - from, [between(from), between(to)]];
    }
    return best?.sort(([x1, y1], [x2, y2]) => x1 - x2 || y1 - y2) ?? null;
  }

  // A tie to the walls of rooms for a line that was drawn on them; the line itself where there are no such walls.
  tied(section, ends, storey) {
    const rooms = this.rows("rooms").filter((row) => row.storey === storey && outlineOf(row) && sidesOf2(outlineOf(row)).some((side) => isBeside(ends, side)));
    if (rooms.length !== (section === "doors" ? 2 : 1)) return ends;
    const tie = { rooms: rooms.map(({ name }) => name), ...(section === "doors" ? {} : { side: sidesOf2(outlineOf(rooms[0])).findIndex((side) => isBeside(ends, side)) }) };
    const wall = this.wallOf(tie, storey), { step, whole } = nearest(wall[0], wall), [x, y] = minus(middle(ends), wall[0]), at = mm(x * step[0] + y * step[1]), width = mm(length(minus(ends[1], ends[0])));
    return at - width / 2 < 0 || at + width / 2 > whole ? ends : { ...tie, at, width };
  }

  // With other rows of sections; one without rows is not in the file.
  with(changes) {
    const all = Object.entries(changes).map(([section, rows]) => [section, Array.isArray(rows) && !rows.length ? undefined : rows]), of = (isOfCase) => Object.fromEntries(all.filter(([section]) => CASE.includes(section) === isOfCase));
    const content = stated({ ...this.content, ...of(false) });
    if (content.case) content.case = stated({ ...content.case, ...of(true) });
    return new Table(content);
  }

  set({ section, index }, row) {
    const rows = this.rows(section);
    return this.with({ [section]: Array.isArray(rows) ? rows.with(index, row) : { ...rows, [index]: row } });
  }

  add(section, row) { return this.with({ [section]: [...this.rows(section), row] }); }

  // A value of a row, or without it none.
  put(ref, key, value) {
    const { [key]: _, ...rest } = this.row(ref);
    if (value === undefined) return this.set(ref, rest);
    return this.set(ref, { ...this.row(ref), [key]: value });
  }

  mapRows(change, sections = Object.keys(this.content)) {
    const changes = {};
    for (const section of sections) if (Array.isArray(this.rows(section)) && this.rows(section).length) changes[section] = this.rows(section).map((row) => change(row, section));
    return this.with(changes);
  }

  // How the ground of a stair moves, which is then an escalator: in the case, by the name of the stair.
  movingOf(name) { return this.content.case?.building?.moving?.[name]; }

  move(name, moving) {
    if (this.movingOf(name) === moving) return this;
    const { case: given } = this.content, { [name]: _, ...others } = given.building.moving ?? {}, all = moving ? { ...others, [name]: moving } : others;
    return new Table({ ...this.content, case: { ...given, building: stated({ ...given.building, moving: Object.keys(all).length ? all : undefined }) } });
  }

  // A name that no other row has: with a number, or of a shaft, whose stairs are numbered, with a letter.
  unique(section, name) {
    const stairs = [...STAIRS, ...PIECES], taken = new Set((stairs.includes(section) ? stairs : [section]).flatMap((one) => this.rows(one).map((row) => row.name ?? row.stair)));
    if (!taken.has(name)) return name;
    const isShaft = stairs.includes(section) && section !== "stairs", stem = name.replace(isShaft ? / [A-Z]+$/ : / \d+$/, "");
    for (let n = 2; ; n++) if (!taken.has(`${stem} ${isShaft ? letters(n) : n}`)) return `${stem} ${isShaft ? letters(n) : n}`;
  }

  // A new name, also where the old one is referred to.
  rename(ref, name) {
    const old = this.row(ref), swap = (value) => value === old.name ? name : value;
    const tied = (shape) => isTie(shape) ? { ...shape, rooms: shape.rooms.map(swap) } : shape;
    const key = NAMED[ref.section], next = this.put(ref, "name", name).mapRows((row) => row[key] === old.name ? { ...row, [key]: name } : row, key ? ["people"] : []);
    if (ref.section === "storeys") {
      const renamed = (row, keys) => Object.assign({ ...row }, ...keys.filter((key) => row[key] === old.name).map((key) => ({ [key]: name })));
      return next.mapRows((row) => renamed(row, ["storey", "lower", "upper", "like"])).mapRows((row) => stated({ ...row, storeys: row.storeys.map(swap), operation: row.operation && renamed(row.operation, ["discharge", "start"]) }), ["lifts"]);
    }
    if (STAIRS.includes(ref.section)) return next.move(old.name, undefined).move(name, this.movingOf(old.name));
    if (ref.section !== "rooms") return next;
    return next.mapRows((row) => row.storey !== old.storey ? row : Object.assign({ ...row }, ...["segment", "polygon"].filter((key) => isTie(row[key])).map((key) => ({ [key]: tied(row[key]) }))), ["doors", "exits", "areas"]);
  }

  remove(ref) {
    const row = this.row(ref);
    if (!Array.isArray(this.rows(ref.section))) {
      const { [ref.index]: _, ...others } = this.rows(ref.section);
      return this.with({ [ref.section]: others });
    }
    if (ref.part !== undefined) return Array.isArray(row.polygons) && !isRing(row.polygons) ? this.put(ref, "polygons", row.polygons.filter((_, k) => k !== ref.part)) : this.put(ref, "polygons");
    const next = this.with({ [ref.section]: this.rows(ref.section).filter((_, k) => k !== ref.index) });
    if (ref.section === "rooms") {
      const isOn = (one) => one.storey === row.storey && [one.segment, one.polygon].some((shape) => isTie(shape) && shape.rooms.includes(row.name));
      return next.with(Object.fromEntries([...ON_WALLS, "areas"].filter((section) => next.rows(section).some(isOn)).map((section) => [section, next.rows(section).filter((one) => !isOn(one))])));
    }
    if (STAIRS.includes(ref.section)) return next.move(row.name, undefined);
    if (ref.section !== "storeys") return next;
    const all = this.storeys.map((one) => one.name), at = all.indexOf(row.name), changes = {};
    for (const section of [...POLYGONS, ...ON_WALLS, "stairs"]) if (next.content[section]) changes[section] = next.rows(section).filter((one) => ![one.storey, one.lower, one.upper].includes(row.name));
    if (next.content.shafts) {
      changes.shafts = next.rows("shafts").map((one) => ({ ...one, lower: one.lower === row.name ? all[at + 1] : one.lower, upper: one.upper === row.name ? all[at - 1] : one.upper }))
        .filter((one) => one.lower && one.upper && all.indexOf(one.lower) < all.indexOf(one.upper));
    }
    if (next.content.lifts) {
      const left = ({ discharge, start, ...own }) => stated({ ...own, discharge: discharge === row.name ? undefined : discharge, start: start === row.name ? undefined : start });
      changes.lifts = next.rows("lifts").map((one) => stated({ ...one, storeys: one.storeys.filter((name) => name !== row.name), operation: one.operation && left(one.operation) })).filter(({ storeys }) => storeys.length > 1);
    }
    return next.with(changes);
  }

  // A copy of a row a metre aside.
  duplicate(ref) {
    const row = this.row(ref), copy = { ...moved(row, (corner) => plus(corner, [1, 1])) };
    if (isTie(row.segment) && row.segment.at !== undefined) copy.segment = { ...row.segment, at: mm(row.segment.at + 1) };
    if (row.name === undefined) return this.add(ref.section, copy);
    copy.name = this.unique(ref.section, row.name);
    return this.add(ref.section, copy).move(copy.name, STAIRS.includes(ref.section) ? this.movingOf(row.name) : undefined);
  }

  // A storey above all others, after the topmost one in the order of the file, which shafts follow up or down.
  addStorey(row) {
    const rows = this.rows("storeys"), at = rows.indexOf(this.storeys.at(-1)), isDown = at < rows.indexOf(this.storeys[0]);
    return this.with({ storeys: rows.toSpliced(isDown ? at : at + 1, 0, row) });
  }

  // The height from a storey to the next one; of the topmost, that from the one below.
  heightOf(name) {
    const all = this.storeys.map(({ z = 0 }) => z), upper = Math.min(this.storeys.findIndex((one) => one.name === name) + 1, all.length - 1);
    return upper > 0 ? mm(all[upper] - all[upper - 1]) : USUAL_HEIGHT;
  }

  // Storeys like one, above the topmost one; shafts, stairs and lifts that lead to this one go on.
  copyUp(name, count) {
    const top = this.storeys.at(-1), from = (top.z ?? 0) + this.heightOf(top.name), height = this.heightOf(name), copies = [];
    let next = this;
    for (let k = 0; k < count; k++) {
      copies.push(next.unique("storeys", name === "ground" ? `storey ${this.storeys.length + k}` : name));
      next = next.addStorey({ name: copies[k], z: mm(from + k * height), like: name });
    }
    next = next.mapRows((row) => row.upper === top.name ? { ...row, upper: copies.at(-1) } : row, ["shafts"]).mapRows((row) => row.storeys.includes(top.name) ? { ...row, storeys: [...row.storeys, ...copies] } : row, ["lifts"]);
    for (const row of this.rows("stairs").filter(({ upper }) => upper === top.name)) {
      [top.name, ...copies].slice(0, -1).forEach((lower, k) => { const name = next.unique("stairs", row.name); next = next.add("stairs", { ...row, name, lower, upper: copies[k] }).move(name, this.movingOf(row.name)); });
    }
    return next;
  }

  // All corners of a storey that are at one place are moved.
  moveCorners(name, keys, by) {
    const move = (corner) => keys.has(keyOf(corner)) ? plus(corner, by) : corner;
    return this.mapRows((row, section) => (section === "storeys" ? row.name === name : this.isOn(row, section, name)) ? moved(row, move) : row, ["storeys", ...PIECES, ...POLYGONS]);
  }

  // A wall is moved with both of its faces, and with the doors and exits on it.
  moveWall(name, side, by) {
    const walls = this.walls(name), faces = [side];
    const taken = new Set(faces);
    for (const face of faces) for (const wall of walls) if (!taken.has(wall) && isBeside(wall, face)) faces.push(wall) && taken.add(wall);
    const next = this.moveCorners(name, new Set(faces.flat().map(keyOf)), by);
    return next.mapRows((row) => row.storey !== name ? row : moved(row, (corner) => plus(corner, by), (number) => faces.some((face) => isBeside(ringsOf(row)[number], face))), ON_WALLS);
  }

  // A corner or a side of a lift is moved, and its doors so that they stay on its outline.
  moveCar(ref, ends, by) {
    const row = this.row(ref), keys = new Set(ends.map(keyOf)), move = (corner) => plus(corner, by), { door, ...car } = row;
    const next = { ...row, ...moved(car, (corner) => keys.has(keyOf(corner)) ? move(corner) : corner) }, rings = ringsOf({ ...next, door: null });
    const placed = (line) => rings.some((ring) => line.every((end) => isOn(end, ring))) ? line : onWall(middle(line), rings.flatMap(sidesOf2), length(minus(...line))) ?? line;
    return this.set(ref, { ...next, door: mapRings(door, (line) => placed(ends.length > 1 && isBeside(line, ends) ? line.map(move) : line)) });
  }

  // The door of a lift with one, at another place of its outline.
  moveDoor(ref, by) {
    const [line] = doorsOf(this.row(ref)), ends = onWall(plus(middle(line), by), this.outlines(ref).flatMap(sidesOf2), length(minus(...line)));
    return ends ? this.put(ref, "door", ends) : this;
  }

  moveRow(ref, by) {
    const row = this.row(ref);
    if (isTie(row.segment)) return this;
    return this.set(ref, moved(row, (corner) => plus(corner, by), (number) => ref.part === undefined || number === ref.part));
  }
}

// The table of now, those before and after it; revisions count up, and changes with the same name in a row are one.
class Store {
  constructor(content, changed) { Object.assign(this, { now: new Table(content), past: [], future: [], revision: 0, saved: content, last: null, changed }); }

  commit(table, name = null) {
    if (table === this.now) return;
    if (!name || name !== this.last) this.past.push(this.now);
    Object.assign(this, { future: [], last: name });
    this.show(table);
  }

  show(table) {
    this.now = table;
    this.revision += 1;
    this.changed();
  }

  step(from, to) {
    if (!from.length) return;
    to.push(this.now);
    this.last = null;
    this.show(from.pop());
  }

  undo() { this.step(this.past, this.future); }
  redo() { this.step(this.future, this.past); }
  get isChanged() { return JSON.stringify(this.now.content) !== JSON.stringify(this.saved); }
}
