// What the pointer and the keyboard do in plan: select, move, and draw with one tool after the other.

const WIDTHS = { door: 0.9, exit: 1.2, wall: 0.1, lift: 1 };  // Of what is drawn [m].
const STAIR = { width: 1.2, rise: 0.17, going: 0.28 };  // [m]
const ESCALATOR = { width: 1, rise: 0.2, going: 0.346 };  // Of steps of 1 m at 30 degrees [m].
const MOVING = { speed: 0.5, towards: "up" };  // Of most escalators [m/s].
const GAP = 0.1;  // Between the flights of a U-shaped stair [m].
const BESIDE = 0.6, BEHIND = 2;  // A U-shaped stair takes floor that is narrower, beside and behind it [m].
const GROUND = 0.2;  // Of a car for each person it holds [m²].
const BEFORE = 0.7;  // Floor begins at most so far from the door of a lift [m].
const DRAGGED = 4;  // [pixels]
const TOOLS = {
  select: { key: "v", points: 0, hint: "Click to select, with Shift several; drag walls, corners and what is selected; drag the ground to move the view" },
  room: { key: "r", points: Infinity, section: "rooms", hint: "Drag a rectangle, or click corner after corner and the first one again; digits are a length, 6x4 a rectangle" },
  wall: { key: "w", points: 2, section: "obstacles", hint: "Click on both ends; digits are a length" },
  door: { key: "d", points: 1, section: "doors", hint: "Click on a wall between two rooms, or drag along it" },
  exit: { key: "e", points: 1, section: "exits", hint: "Click on an outer wall, or drag along it" },
  stair: { key: "s", points: 2, section: "shafts", hint: "Click on the middle of the lowest step, then on where it leads; it turns where a straight one does not fit" },
  escalator: { key: "k", points: 2, section: "shafts", hint: "Click on the middle of the lower end, then on where it leads; it goes straight up to the storey above, and which way it moves is at the right" },
  lift: { key: "u", points: Infinity, section: "lifts", hint: "Drag a rectangle for its car, beside the floor or on it; it stops on this storey and all above. Its door can be dragged to another side" },
  flight: { key: "l", points: 4, section: "flights", hint: "For other stairs: click on both ends of the lower edge of a flight, then of the upper one; heights are those of what they join" },
  landing: { key: "g", points: Infinity, section: "landings", hint: "Drag a rectangle, or click corner after corner; its height is that of the flight that ends there" },
  area: { key: "a", points: Infinity, section: "areas", hint: "Drag a rectangle, or click corner after corner; people start in areas" },
  obstacle: { key: "o", points: Infinity, section: "obstacles", hint: "Drag a rectangle, or click corner after corner; it is cut out of the floor" },
  measure: { key: "m", points: 2, hint: "Click on both ends" },
  picture: { key: "p", points: 2, hint: "Drag the picture where it belongs; click on two points of it, then type the length between them" },
};
const singular = (section) => ({ rooms: "room", storeys: "ground", shafts: "stair", stairs: "stair", lifts: "lift", flights: "flight", landings: "landing", areas: "area", obstacles: "obstacle", doors: "door", exits: "exit", openings: "opening", people: "group", event: "event", phase: "phase", compartment: "compartment", behaviours: "behaviour", case: "table" })[section];
// A name that begins with the kind says the kind already: "Door 2", not "Door door 2".
const heading = (what, name) => `${name} `.startsWith(`${what} `) ? capital(name) : `${capital(what)} ${name}`;
const rectangle = ([x1, y1], [x2, y2]) => [[Math.min(x1, x2), Math.min(y1, y2)], [Math.max(x1, x2), Math.min(y1, y2)], [Math.max(x1, x2), Math.max(y1, y2)], [Math.min(x1, x2), Math.max(y1, y2)]];

class Tools {
  constructor(store, view, act) {
    Object.assign(this, { store, view, act, tool: "select", points: [], typed: "", at: [0, 0], lines: [], drag: null, measured: null, isByKeys: false, isOver: false });
    const { canvas } = view, place = ({ offsetX, offsetY }) => view.place(offsetX, offsetY);
    canvas.addEventListener("pointerdown", (event) => {
      canvas.focus();  // What was typed elsewhere is taken before something else is selected.
      canvas.setPointerCapture(event.pointerId);
      this.isByKeys = false;
      this.press(place(event), event);
    });
    canvas.addEventListener("pointermove", (event) => this.move(place(event), event));
    canvas.addEventListener("pointerup", (event) => this.release(place(event), event));
    canvas.addEventListener("pointercancel", () => this.cancel());
    for (const [name, isOver] of [["pointerenter", true], ["pointerleave", false]]) canvas.addEventListener(name, () => { this.isOver = isOver; view.draw(); });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      view.zoomAt(Math.exp(-0.0015 * Math.max(-300, Math.min(300, event.deltaY * (event.deltaMode ? 20 : 1)))), place(event));
    }, { passive: false });
  }

  get table() { return this.store.now; }
  get storey() { return this.view.storey; }
  get isOnWalls() { return ON_WALLS.includes(TOOLS[this.tool].section); }

  // The opposite corners of a rectangle that is dragged or typed.
  get box() {
    const [from] = this.points;
    if (this.points.length !== 1 || TOOLS[this.tool].points !== Infinity) return null;
    const [a, b] = this.typed.split("x").map(Number), way = minus(this.at, from);
    if (a > 0 && b > 0) return [from, plus(from, [way[0] < 0 ? -a : a, way[1] < 0 ? -b : b])];
    return this.drag?.kind === "draw" ? [from, this.at] : null;
  }

  get isStair() { return TOOLS[this.tool].section === "shafts"; }

  // Why nothing can be drawn with the tool now; empty if it can.
  fault() { return ["stair", "escalator", "lift"].includes(this.tool) && !this.table.above(this.storey) ? `${this.tool === "escalator" ? "An" : "A"} ${this.tool} leads to the storey above, and there is none.` : ""; }

  choose(tool) {
    this.cancel();
    if (tool === "picture" && !this.pictures.own) {
      by("picture-file").focus();
      return this.act.say("Choose a picture of the plan at the left, or drop one here");
    }
    this.tool = tool;
    this.act.toolChanged();
    this.view.canvas.focus();
  }

  cancel() {
    const base = this.drag?.base;
    Object.assign(this, { points: [], typed: "", drag: null, lines: [], measured: null });
    if (base) this.store.show(base);
    this.view.draw();
  }

  snap(point, isFree) {
    if (isFree || this.tool === "picture") return point.map(mm);
    const refs = this.table.on(this.storey).filter(({ section }) => !ON_WALLS.includes(section)), still = this.drag?.base ?? this.table;
    const corners = [...this.points, ...refs.flatMap((ref) => still.rings(ref).flat())];
    const { at, lines } = snapped(point, corners, still.walls(this.storey), this.view.zoom, this.points[this.points.length - 1]);
    this.lines = lines;
    return at;
  }

  press(point, event) {
    if (event.button === 1 || event.button === 2 || event.altKey) this.drag = { kind: "pan", start: point };
    else if (this.tool === "select") this.pick(point, event);
    else if (this.tool === "picture") {
      if (this.pictures.own) this.drag = { kind: "picture", start: point, from: [event.offsetX, event.offsetY], at: this.pictures.own.at };
    }
    else {
      this.measured = null;
      const start = this.snap(point, event.shiftKey);
      this.drag = { kind: "draw", start, from: [event.offsetX, event.offsetY] };
      if (!this.isOnWalls) this.addPoint(start);
    }
    this.view.draw();
  }

  // Selects what is at a point, and begins to drag it; with Shift, takes it to what is selected or out of it.
  pick(point, { offsetX, offsetY, shiftKey }) {
    const hit = this.view.hit(point), was = this.act.selected();
    if (shiftKey && hit && was?.section === hit.ref.section) return this.act.toggle(hit.ref);
    this.act.select(hit && { ...hit.ref, ...hit.side });
    const isSame = hit && was && was.section === hit.ref.section && was.index === hit.ref.index && was.part === hit.ref.part;
    const kind = !hit ? "pan" : hit.side ? "side" : isSame || ON_WALLS.includes(hit.ref.section) || STAIRS.includes(hit.ref.section) ? "row" : "pan";
    this.drag = { kind, hit, start: point, from: [offsetX, offsetY], base: kind === "pan" ? null : this.table };
  }

  move(point, event) {
    const { drag } = this;
    if (!drag && this.tool === "select") { this.at = point; return; }  // Nothing looks different.
    if (!drag) this.at = this.snap(point, event.shiftKey);
    else if (drag.kind === "pan") return this.view.pan(minus(drag.start, point));
    else if (drag.kind === "draw") this.at = this.snap(point, event.shiftKey);
    else if (drag.isMoved || length(minus([event.offsetX, event.offsetY], drag.from)) > DRAGGED) {
      drag.isMoved = true;
      if (drag.kind === "picture") this.pictures.own.at = plus(drag.at, minus(point, drag.start));
      else this.store.show(this.dragged(point, event.shiftKey));
    }
    this.view.draw();
  }

  // The table in which what is dragged is where the pointer is.
  dragged(point, isFree) {
    const { base, hit: { ref, side }, start } = this.drag, row = base.row(ref);
    if (ON_WALLS.includes(ref.section)) return this.lineAt(base, ref, row, point, start);
    const anchor = side?.corner ?? side?.side?.[0] ?? (row.foot || base.rings(ref)[0]?.[0]) ?? start;
    const by = minus(this.snap(plus(anchor, minus(point, start)), isFree), anchor);
    if (!side) return base.moveRow(ref, by);
    this.act.select({ ...ref, ...sideMoved(side, by) });
    return moveSide(base, this.storey, { ...ref, ...side }, side.door ? minus(point, start) : by);
  }

  // A door or an exit goes along its wall, or to another one; a tied one is tied to that.
  lineAt(base, ref, row, point, start) {
    const line = this.view.lineOf(ref, row) ?? [start, start], by = minus(point, start), to = plus(middle(line), by);
    const onOther = () => onWall(to, base.walls(this.storey), length(minus(...line)));
    if (isTie(row.segment)) {
      const own = base.wallOf(row.segment, row.storey), { step, whole } = nearest(to, own ?? line.toSorted(([x1, y1], [x2, y2]) => x1 - x2 || y1 - y2)), half = (row.segment.width ?? whole) / 2;
      const at = onGrid((row.segment.at ?? whole / 2) + by[0] * step[0] + by[1] * step[1]), ends = own && (at < 0 || at > whole) && onOther();
      return base.put(ref, "segment", ends ? base.tied(ref.section, ends, row.storey) : { ...row.segment, at: mm(Math.max(half, Math.min(own ? whole - half : Infinity, at))) });
    }
    const ends = isRing(row.segment) && onOther();
    return ends ? base.put(ref, "segment", ends) : base.moveRow(ref, by);
  }

  release(point, event) {
    const { drag } = this;
    this.drag = null;
    this.lines = [];
    if (drag?.kind === "picture") {
      if (drag.isMoved) this.pictures.put({});
      else this.addPoint(this.snap(point, true));
    } else if (drag?.isMoved) {
      const next = this.table;
      this.store.now = drag.base;
      this.store.commit(next);
    } else if (drag?.kind === "draw" && this.isOnWalls) this.finish([drag.start, this.at]);
    else if (drag?.kind === "draw" && this.points.length === 1 && length(minus([event.offsetX, event.offsetY], drag.from)) > DRAGGED) {
      const end = this.snap(point, event.shiftKey);
      if (TOOLS[this.tool].points === Infinity) this.finish(rectangle(this.points[0], end));
      else this.addPoint(end);
    }
    this.view.draw();
  }

  // The next point of what is drawn; the first one again, or the last one, ends an outline.
  addPoint(point) {
    if (this.fault()) return this.act.say(this.fault());
    const { points } = TOOLS[this.tool], isEnd = this.points.length > 2 && [this.points[0], this.points[this.points.length - 1]].some((one) => keyOf(one) === keyOf(point));
    if (!isEnd) this.points.push(point);
    this.typed = "";
    if (isEnd || this.points.length === points) this.finish(this.points);
  }

  // A length, or two of a rectangle, that was typed: the next point is in the direction of the pointer.
  takeTyped() {
    const { box, typed } = this, a = Number(typed), from = this.points.at(-1), way = minus(this.at, from), far = length(way);
    this.typed = "";
    if (typed.includes("x")) return box && this.finish(rectangle(...box));
    if (a > 0) {
      this.at = plus(from, far ? way.map((value) => value * a / far) : [a, 0]);
      this.addPoint(this.at);
    }
  }

  // Adds what was drawn to the table.
  finish(points) {
    const { storey, tool, table } = this, { section } = TOOLS[tool];
    this.points = [];
    if (tool === "picture") {
      this.measured = points;
      return this.pictures.measure(points);
    }
    if (tool === "measure") {
      this.measured = points;
      this.act.say(`${length(minus(points[1], points[0])).toFixed(3)} m`);
      return;
    }
    let { rows, told } = { rows: [{ storey, polygon: tool === "wall" ? stripOf(points, WIDTHS.wall) : points }], told: "" };
    if (this.isOnWalls) rows = this.waysAlong(this.linesAt(points[0], points[1])).map((lines) => ({ storey, segment: lines.length > 1 ? lines : table.tied(section, lines[0], storey) }));
    else if (section === "shafts") {
      const { row, kind, isFit } = this.stairOf(points);
      [rows, told] = [[row], `: ${kind}${isFit ? "" : ", which does not fit here"}`];
    }
    else if (tool === "lift") rows = [this.liftOf(points)];
    else if (PIECES.includes(section)) rows = [this.pieceOf(points)];
    if (rows[0]?.polygon && Math.abs(areaOf(rows[0].polygon)) < 0.01) return this.act.say("This is too small");
    if (!rows.length) return this.act.say("No wall is here");
    let next = table;
    for (const row of rows) {
      if (row.polygon && areaOf(row.polygon) < 0) row.polygon.reverse();
      next = next.add(section, PIECES.includes(section) ? row : { name: next.unique(section, section === "shafts" ? `${tool} A` : tool), ...row });
    }
    if (tool === "escalator") next = next.move(next.rows(section).at(-1).name, MOVING);
    const names = next.rows(section).slice(-rows.length).map(({ name, stair }) => name ?? `${tool} of ${stair}`);
    this.store.commit(next);
    this.act.select({ section, index: next.rows(section).length - 1 });
    this.view.frame(rows);
    this.act.say(`${capital(names.join(", "))} added${told}`);
  }

  // A flight between two edges, or a landing: of the stair that it joins, at the height of that.
  pieceOf(points) {
    const { table, storey } = this, z = table.storey(storey).z ?? 0, height = table.heightOf(storey), isFlight = this.tool === "flight", lines = isFlight ? [points.slice(0, 2), points.slice(2)] : sidesOf2(points);
    const joined = lines.map((line) => table.joinedAt(line)), [lower, upper] = joined, any = joined.find(Boolean), stair = any?.stair ?? table.unique("flights", "stair A");
    if (!isFlight) return { stair, polygon: points, z: any?.z ?? mm(z + height / 2) };
    return { stair, lower_edge: lines[0], lower_z: lower?.z ?? z, upper_edge: lines[1], upper_z: upper?.z ?? mm(z + height) };
  }

  // A lift from this storey to the highest one, with its door on the side before which most of the floor is.
  liftOf(polygon) {
    const { table, storey } = this, floors = this.view.groundHere();
    const ahead = ([a, b]) => {
      const { step: [x, y], whole } = nearest(a, [a, b]), way = isInside(plus(middle([a, b]), [0.01 * y, -0.01 * x]), polygon) ? -1 : 1, at = (far) => plus(middle([a, b]), [way * far * y, -way * far * x]);
      const floor = floors.find((ring) => isInside(at(BEFORE), ring));
      let far = 0;
      while (floor && isInside(at(BEFORE + far), floor)) far += 0.5;
      return whole > SHORTEST ? far : -1;
    };
    const [side] = sidesOf2(polygon).sort((a, b) => ahead(b) - ahead(a)), all = table.storeys.map(({ name }) => name), capacity = Math.max(1, Math.floor(Math.abs(areaOf(polygon)) / GROUND));
    return { storeys: all.slice(all.indexOf(storey)), polygon, door: onWall(middle(side), [side], WIDTHS.lift), operation: { capacity } };
  }

  // The lines of doors or exits at a point of a wall, or along it from one point to another.
  linesAt(from, to = from) {
    const walls = this.view.wallsHere(), along = length(minus(to, from)) * this.view.zoom > DRAGGED ? spanned(from, to, walls) : [];
    return along.length ? along : [onWall(from, walls, WIDTHS[this.tool])].filter(Boolean);
  }

  // The lines of each door, and of each exit: along rooms whose floors are joined, an exit is one.
  waysAlong(lines) {
    if (this.tool !== "exit") return lines.map((line) => [line]);
    const isBy = (at) => ({ polygons }) => polygons.flat().some((ring) => sidesOf2(ring).some((side) => nearest(at, side).away < WALL)), floors = this.view.levels().filter(({ kind }) => kind === "floor");
    return Object.values(Object.groupBy(lines, (line, k) => floors.findIndex(isBy(middle(line))) + 1 || -k));
  }

  // A stair from a foot in a direction, of the kind that fits into the room: straight, or else with a half landing, put
  // aside as far as needed, which fills a room that is hardly wider; `outline` is what it takes in plan.
  stairOf([foot, to]) {
    const { table, storey } = this, way = minus(to, foot), far = length(way), [dx, dy] = far > 1e-6 ? way.map((value) => value / far) : [1, 0], isEscalator = this.tool === "escalator", { width, rise, going } = isEscalator ? ESCALATOR : STAIR;
    const upper = table.above(storey), run = ((upper.z ?? 0) - (table.storey(storey).z ?? 0)) * going / rise, wall = (table.storey(storey).wall ?? 0) / 2;
    const at = (along, aside) => [foot[0] + along * dx - aside * dy, foot[1] + along * dy + aside * dx], box = (far, left, right) => [at(0, left), at(far, left), at(far, right), at(0, right)];
    const room = this.view.groundHere().find((ring) => isInside(foot, ring));
    const own = { lower: storey, upper: upper.name, width, direction: [mm(dx), mm(dy)], rise, going }, half = width / 2;
    const sides = room ? range(room, ([x, y]) => (y - foot[1]) * dx - (x - foot[0]) * dy) : [-Infinity, Infinity], [, end] = room ? range(room, ([x, y]) => (x - foot[0]) * dx + (y - foot[1]) * dy) : [0, 0];
    const inner = sides[1] - sides[0] - 2 * wall - 2 * width, isFilled = inner >= GAP && inner < GAP + BESIDE, behind = end - wall - run / 2 - width, isDeep = isFilled && behind > 0 && behind < BEHIND;
    const gap = isFilled ? inner : GAP, landing = isDeep ? width + behind : width, both = 2 * width + gap, bent = run / 2 + landing, filling = { ...(isFilled ? { gap: mm(gap) } : {}), ...(isDeep ? { landing: mm(landing) } : {}) };
    const kinds = [["straight", {}, -half, width, run, width], ["U-shaped, turning left", { turn: "left", ...filling }, -half, both, bent, 0], ["U-shaped, turning right", { turn: "right", ...filling }, half - both, both, bent, 0]];
    const found = kinds.slice(0, isEscalator ? 1 : 3).map(([kind, turn, low, size, far, beyond]) => {
      const aside = Math.max(sides[0] + wall - low, Math.min(0, sides[1] - wall - low - size)), left = low + aside;
      return { kind, aside, row: { ...own, foot: at(0, aside).map(mm), ...turn }, outline: box(far, left, left + size), needs: box(far + beyond, left, left + size) };
    });
    const [straight, ...bends] = found, fit = [straight, ...bends.toSorted((a, b) => Math.abs(a.aside) - Math.abs(b.aside))].find(({ needs }) => room && holds(room, needs));
    return { ...(fit ?? found[0]), isFit: Boolean(fit) };
  }

  // Arrows move what is selected, or the cross with which one draws; Enter is a click.
  key(event) {
    const { key } = event, fast = event.shiftKey ? 1 : GRID, selected = this.act.selected();
    const by = { ArrowLeft: [-fast, 0], ArrowRight: [fast, 0], ArrowUp: [0, fast], ArrowDown: [0, -fast] }[key];
    if (this.points.length && /^[\d.x]$/.test(key)) this.typed += key;
    else if (this.typed && key === "Backspace") this.typed = this.typed.slice(0, -1);
    else if (this.typed && key === "Enter") this.takeTyped();
    else if (by && this.tool === "select" && selected) this.nudge(selected, by);
    else if (by) {
      this.isByKeys = true;
      this.at = plus(this.at.map(onGrid), by);
      this.view.reveal(this.at);
      this.act.say(this.at.map((value) => value.toFixed(2)).join(", "));
    } else if (key === "Enter" && this.tool === "select") this.act.select(this.view.hit(this.at)?.ref ?? null);
    else if (key === "Enter") this.addPoint([...this.at]);
    else return false;
    this.view.draw();
    return true;
  }

  nudge(selected, by) {
    if ([...CASE, "case"].includes(selected.section)) return;
    const { corner, side, door, ...ref } = selected, name = `move ${JSON.stringify(ref)}`, row = this.table.row(ref);
    if (corner || side || door) {
      this.store.commit(moveSide(this.table, this.storey, selected, by), name);
      return this.act.select({ ...ref, ...sideMoved({ corner, side, door }, by) });
    }
    const [start] = this.view.lineOf(ref, row) ?? [];
    this.store.commit(isTie(row.segment) ? this.lineAt(this.table, ref, row, plus(start, by), start) : this.table.moveRow(ref, by), name);
  }
}

// A wall goes across itself only.
function across([a, b], by) {
  const { step: [x, y] } = nearest(a, [a, b]), off = by[1] * x - by[0] * y;
  return [-y * off, x * off];
}

const moveSide = (table, storey, { corner, side, door, ...ref }, by) => door ? table.moveDoor(ref, by) : ref.section === "lifts" ? table.moveCar(ref, side ?? [corner], side ? across(side, by) : by) : corner ? table.moveCorners(storey, new Set([keyOf(corner)]), by) : table.moveWall(storey, side, across(side, by));

const sideMoved = ({ corner, side, door }, by) => door ? { door } : corner ? { corner: plus(corner, by) } : { side: side.map((end) => plus(end, across(side, by))) };

// The outline of a line with a thickness.
function stripOf([a, b], thick) {
  const { step: [x, y] } = nearest(a, [a, b]), off = [-y * thick / 2, x * thick / 2];
  return [plus(a, off.map((value) => -value)), plus(b, off.map((value) => -value)), plus(b, off), plus(a, off)];
}
