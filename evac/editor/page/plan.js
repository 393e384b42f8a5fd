// The plan of a storey on a canvas: what is in the table, and what was judged of it.

const MARGIN = 80, TOOLS_WIDE = 130;  // Around everything, and for the tools at the left [pixels].
const BODY = 0.22;  // Radius of people [m].
const SLOW = 60, REST = 200;  // Time to paint from which a view is moved as a picture, and after which it rests [ms].
const FONT = '12px system-ui, "DejaVu Sans", sans-serif';
const STEP_LINE = 0.28;  // Between the lines of steps [m].

function coloursOf(...names) {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

class PlanView {
  constructor(canvas, store) {
    Object.assign(this, { canvas, store, pen: canvas.getContext("2d"), x: 0, y: 0, zoom: 20, judged: null, people: {}, findings: [], selected: null, also: [], storey: "", frames: 0, paintTime: 0 });
  }

  get table() { return this.store.now; }
  get size() { return [this.canvas.clientWidth, this.canvas.clientHeight]; }
  place(left, top) { const [w, h] = this.size; return [this.x + (left - w / 2) / this.zoom, this.y - (top - h / 2) / this.zoom]; }
  spot([x, y]) { const [w, h] = this.size; return [w / 2 + (x - this.x) * this.zoom, h / 2 - (y - this.y) * this.zoom]; }

  pan([dx, dy]) { this.move(this.x + dx, this.y + dy, this.zoom); }

  zoomAt(factor, [x, y]) {
    const zoom = Math.max(0.5, Math.min(2000, this.zoom * factor)), share = 1 - this.zoom / zoom;
    this.move(this.x + share * (x - this.x), this.y + share * (y - this.y), zoom);
  }

  // Moves the view: a plan that takes long to paint is moved as a picture, and painted when the view rests.
  move(x, y, zoom) {
    const { canvas: { width: w, height: h }, pen } = this, share = zoom / this.zoom, scale = zoom * devicePixelRatio;
    const left = w / 2 * (1 - share) + (this.x - x) * scale, top = h / 2 * (1 - share) - (this.y - y) * scale;
    Object.assign(this, { x, y, zoom });
    if (this.paintTime < SLOW) return this.draw();
    this.frames += 1;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.globalCompositeOperation = "copy";
    pen.drawImage(this.canvas, left, top, w * share, h * share);
    pen.globalCompositeOperation = "source-over";
    clearTimeout(this.rest);
    this.rest = setTimeout(() => this.draw(), REST);
  }

  fit() {
    const corners = this.table.storeys.flatMap(({ name }) => [name, ...this.table.originals(name)].flatMap((one) => this.table.on(one).flatMap((ref) => this.table.rings(ref).flat())));
    const all = [...corners, ...(this.judged?.levels ?? []).flatMap(({ polygons }) => polygons.flat(2))], [w, h] = this.size;
    const [x, y] = [0, 1].map((i) => range(all.length ? all : [[0, 0], [20, 12]], (corner) => corner[i]));
    Object.assign(this, { y: centre(y), zoom: Math.max(0.5, Math.min(200, Math.min((w - 2 * MARGIN - TOOLS_WIDE) / (x[1] - x[0] || 1), (h - 2 * MARGIN) / (y[1] - y[0] || 1)))) });
    this.x = centre(x) - TOOLS_WIDE / 2 / this.zoom;
    this.draw();
  }

  // Shows everything if something that was drawn reaches out of the view.
  frame(rows) {
    const [w, h] = this.size;
    if (rows.flatMap(ringsOf).flat().map((corner) => this.spot(corner)).some(([left, top]) => left < 0 || top < 0 || left > w || top > h)) this.fit();
  }

  isSelected(ref) { return [this.selected, ...this.also].some((one) => one && ref.section === one.section && ref.index === one.index && ref.part === one.part); }

  // Moves the view so that a point is seen.
  reveal(point) {
    const [w, h] = this.size, [left, top] = this.spot(point);
    if (left < 20 || top < 20 || left > w - 20 || top > h - 20) [this.x, this.y] = point;
    this.draw();
  }

  goTo(point) {
    [this.x, this.y] = point;
    this.zoom = Math.max(this.zoom, 30);
    this.draw();
  }

  // The outlines of rooms and ground: those of the table, and of what it takes from other storeys and files.
  groundHere() {
    const refs = [this.storey, ...this.table.originals(this.storey)].flatMap((name) => this.table.on(name)), floors = this.levels().filter(({ kind }) => kind === "floor");
    return [...["rooms", "storeys"].flatMap((section) => refs.filter((ref) => ref.section === section).flatMap((ref) => this.table.rings(ref))), ...floors.flatMap(({ polygons }) => polygons.map(([ring]) => ring))];
  }

  // The walls on which doors and exits may be: those of the table, and of what it takes from other storeys and files.
  wallsHere() {
    const levels = this.levels().filter(({ kind }) => kind === "floor");
    return [...[this.storey, ...this.table.originals(this.storey)].flatMap((one) => this.table.walls(one)), ...levels.flatMap(({ polygons }) => polygons.flat().flatMap((ring) => sidesOf2(ring.slice(0, -1))))];
  }

  // The judged levels of the storey: its floors, and the stairs that begin on it.
  levels() {
    return (this.judged?.levels ?? []).filter(({ storey }) => storey === this.storey);
  }

  // The ends of a door, an exit or the foot of a stair; of one that is tied to rooms of other storeys as it was judged.
  lineOf(ref, row) {
    if (ON_WALLS.includes(ref.section) && isTie(row.segment)) {
      const wall = this.table.wallOf(row.segment, row.storey), drawn = wall && partOf(wall, row.segment);
      if (drawn) return drawn;
      const ends = this.judged?.segments[ref.section]?.find((one) => one.name === row.name && one.storey === row.storey)?.ends[0];
      return ends ? [ends.slice(0, 2), ends.slice(2)] : null;
    }
    if (row.foot) {
      const [dx, dy] = row.direction ?? [1, 0], far = Math.hypot(dx, dy) || 1, half = (row.width ?? 1) / 2;
      return [plus(row.foot, [-dy / far * half, dx / far * half]), plus(row.foot, [dy / far * half, -dx / far * half])];
    }
    return (doorsOf(row)[0] ?? ringsOf(row)[0])?.slice(0, 2) ?? null;
  }

  // All lines of such a thing: exits and lifts may have several.
  linesOf(ref, row) {
    if (isTie(row.segment) || row.foot) return [this.lineOf(ref, row)].filter(Boolean);
    return ref.section === "lifts" ? doorsOf(row) : ringsOf(row);
  }

  // What is at a point: lines before outlines, of these the smallest; with the corner or the side that is near.
  hit(point) {
    const reach = REACH / this.zoom, refs = this.table.on(this.storey);
    let best = null, least = reach;
    for (const ref of refs) {
      const lines = [...ON_WALLS, ...STAIRS, "lifts"].includes(ref.section) ? this.linesOf(ref, this.table.row(ref)) : [], away = Math.min(...lines.map((line) => nearest(point, line).away));
      if (away < least) [best, least] = [ref.section === "lifts" ? { ref, side: { door: true } } : { ref }, away];
    }
    if (best) return best;
    const stair = this.levels().find(({ stair, polygons }) => stair && polygons.some(([ring]) => isInside(point, ring)))?.stair;
    const shaft = refs.find((ref) => STAIRS.includes(ref.section) && stair && stair.startsWith(this.table.row(ref).name));
    if (shaft) return { ref: shaft };
    const outlines = refs.filter(({ section }) => OUTLINED.includes(section)).flatMap((ref) => this.table.outlines(ref).map((ring) => ({ ref, ring, size: Math.abs(areaOf(ring)) })));
    const isChosen = ({ ref }) => this.isSelected(ref);
    outlines.sort((a, b) => isChosen(b) - isChosen(a) || a.size - b.size);
    for (const { ref, ring } of outlines) {
      const corner = ring.find((one) => length(minus(one, point)) < reach);
      if (corner) return { ref, side: { corner } };
    }
    for (const { ref, ring } of outlines) {
      const side = sidesOf2(ring).find((one) => nearest(point, one).away < reach);
      if (side) return { ref, side: { side } };
    }
    const within = outlines.find(({ ring }) => isInside(point, ring));
    return within ? { ref: within.ref } : null;
  }

  draw() {
    if (this.isWaiting) return;
    this.isWaiting = true;
    requestAnimationFrame(() => {
      this.isWaiting = false;
      this.frames += 1;
      const start = performance.now();
      if (this.canvas.clientWidth) this.paint();
      requestAnimationFrame(() => { this.paintTime = performance.now() - start; });
    });
  }

  path(rings) {
    const { pen } = this;
    pen.beginPath();
    for (const ring of rings) {
      ring.forEach(([x, y], k) => k ? pen.lineTo(x, y) : pen.moveTo(x, y));
      pen.closePath();
    }
  }

  line([a, b], colour, width) {
    const { pen } = this;
    pen.beginPath();
    pen.moveTo(...a);
    pen.lineTo(...b);
    Object.assign(pen, { strokeStyle: colour, lineWidth: width });
    pen.stroke();
  }

  paint() {
    const { canvas, pen, zoom } = this, [w, h] = this.size, dpr = devicePixelRatio;
    if (canvas.width !== Math.round(w * dpr) || canvas.height !== Math.round(h * dpr)) Object.assign(canvas, { width: Math.round(w * dpr), height: Math.round(h * dpr) });
    const look = this.look = coloursOf("ground", "panel", "floor", "flight", "landing", "wall", "wall-top", "desk", "text", "soft", "accent", "exit", "error", "notice", "line", "mark");
    pen.setTransform(dpr, 0, 0, dpr, 0, 0);
    pen.fillStyle = look.ground;
    pen.fillRect(0, 0, w, h);
    pen.setTransform(dpr * zoom, 0, 0, -dpr * zoom, dpr * (w / 2 - this.x * zoom), dpr * (h / 2 + this.y * zoom));
    this.paintGrid(w, h);
    if (this.pictures.isShown) this.pictures.paint(pen);
    this.paintFloors();
    this.paintRows();
    this.paintPeople();
    this.paintTool();
    pen.setTransform(dpr, 0, 0, dpr, 0, 0);
    this.paintNames();
    this.paintFindings();
  }

  paintGrid(w, h) {
    const step = [1, 5, 10, 50, 100].find((one) => one * this.zoom > 14) ?? 1000, [x1, y2] = this.place(0, 0), [x2, y1] = this.place(w, h), { pen, look } = this;
    pen.beginPath();
    for (let x = Math.ceil(x1 / step) * step; x < x2; x += step) { pen.moveTo(x, y1); pen.lineTo(x, y2); }
    for (let y = Math.ceil(y1 / step) * step; y < y2; y += step) { pen.moveTo(x1, y); pen.lineTo(x2, y); }
    Object.assign(pen, { strokeStyle: look.line, lineWidth: 0.6 / this.zoom });
    pen.stroke();
  }

  // Floors as they were judged, hatched where they cannot be left; those of the table until they are judged.
  paintFloors() {
    const { pen, look, zoom } = this, isFresh = this.judgedRevision === this.store.revision, levels = this.levels();
    const names = [this.storey, ...this.table.originals(this.storey)];
    const ground = isFresh ? levels.filter(({ kind }) => kind === "floor").map(({ polygons }) => polygons.flat())
      : names.flatMap((name) => this.table.on(name).filter(({ section }) => section === "rooms" || section === "storeys").map((ref) => this.table.rings(ref)));
    for (const rings of ground) {
      this.path(rings);
      pen.fillStyle = look.floor;
      pen.globalAlpha = this.pictures.isShown ? 0.3 : 1;
      pen.fill("evenodd");
      pen.globalAlpha = 1;
      if (!isFresh) continue;  // The outlines of rows are drawn below.
      Object.assign(pen, { strokeStyle: look["wall-top"], lineWidth: Math.max(0.06, 2 / zoom) });
      pen.stroke();
    }
    for (const level of levels) {
      const rings = level.polygons.flat();
      if (level.kind !== "floor") {
        this.path(rings);
        pen.fillStyle = look[level.kind] ?? look.landing;  // Of cars.
        pen.fill("evenodd");
        Object.assign(pen, { strokeStyle: look["wall-top"], lineWidth: 1.2 / zoom });
        pen.stroke();
        if (level.kind === "flight") this.paintSteps(level);
      }
      if (!level.reached && this.judged.hasExits) this.hatch(rings);
    }
  }

  paintSteps({ polygons, uphill: [ux, uy] }) {
    const { pen, look, zoom } = this, corners = polygons.flat(2), [low, high] = range(corners, ([x, y]) => x * ux + y * uy), [left, right] = range(corners, ([x, y]) => y * ux - x * uy);
    const at = (along, aside) => [along * ux - aside * uy, along * uy + aside * ux];
    pen.save();
    pen.clip("evenodd");
    for (let along = low + STEP_LINE; along < high; along += STEP_LINE) this.line([at(along, left), at(along, right)], look.soft, 0.7 / zoom);
    pen.restore();
    const aside = (left + right) / 2, tip = at(high - 0.15, aside);
    this.line([at(low + 0.1, aside), tip], look.text, 1.6 / zoom);
    for (const off of [-0.2, 0.2]) this.line([at(high - 0.45, aside + off), tip], look.text, 1.6 / zoom);
  }

  hatch(rings) {
    const { pen, look, zoom } = this, corners = rings.flat(), [x1, x2] = range(corners, ([x]) => x), [y1, y2] = range(corners, ([, y]) => y), step = 9 / zoom;
    this.path(rings);
    pen.save();
    pen.clip("evenodd");
    for (let x = x1 - (y2 - y1); x < x2; x += step) this.line([[x, y1], [x + y2 - y1, y2]], look.error, 1.3 / zoom);
    pen.restore();
  }

  paintRows() {
    const { pen, look, zoom, table, selected } = this;
    const isSelected = (ref) => this.isSelected(ref);
    const rows = [...this.table.originals(this.storey).flatMap((name) => table.on(name).filter(({ section }) => ["areas", "obstacles"].includes(section))), ...table.on(this.storey)];
    for (const ref of rows.filter(({ section }) => OUTLINED.includes(section))) {
      const outlines = table.outlines(ref);
      this.path(outlines);
      if (ref.section === "lifts") this.paintCar(outlines[0] ?? []);
      if (ref.section === "obstacles") { pen.fillStyle = look.desk; pen.fill("evenodd"); }
      if (isSelected(ref)) { pen.save(); pen.globalAlpha = 0.13; pen.fillStyle = look.accent; pen.fill("evenodd"); pen.restore(); }
      pen.setLineDash(ref.section === "areas" ? [6 / zoom, 4 / zoom] : []);
      Object.assign(pen, { strokeStyle: isSelected(ref) ? look.accent : ref.section === "areas" ? look.soft : look["wall-top"], lineWidth: (isSelected(ref) ? 3 : 1) / zoom });
      pen.stroke();
      pen.setLineDash([]);
      if (isSelected(ref)) for (const corner of table.rings(ref).flat()) this.dot(corner, look.accent);
    }
    for (const { ends, section } of this.others()) this.line(ends, section === "exits" ? look.exit : look.soft, Math.max(0.1, 3 / zoom));
    for (const ref of table.on(this.storey).filter(({ section }) => [...ON_WALLS, ...STAIRS, "lifts"].includes(section))) {
      const row = table.row(ref), colour = { exits: look.exit, doors: look.accent, lifts: look.accent }[ref.section] ?? look.soft;
      for (const line of this.linesOf(ref, row)) {
        this.line(line, isSelected(ref) && (ref.section !== "lifts" || selected.door) ? look.mark : colour, Math.max(0.14, (isSelected(ref) && ref.section !== "lifts" ? 8 : 5) / zoom));
        if (ref.section === "doors") this.line(line, look.floor, Math.max(0.05, 1.5 / zoom));
      }
    }
    if (selected?.side) this.line(selected.side, look.mark, 5 / zoom);
    if (selected?.corner) this.dot(selected.corner, look.mark);
  }

  // The car of a lift has a cross, as in plans of architects.
  paintCar(ring) {
    const { pen, look, zoom } = this;
    pen.fillStyle = look.landing;
    pen.fill("evenodd");
    for (const [k, corner] of ring.entries()) if (k + 2 < Math.min(4, ring.length)) this.line([corner, ring[k + 2]], look.soft, 1 / zoom);
    this.path([ring]);
  }

  // People of a run that goes on, on the storey and the stairs that begin on it.
  paintPeople() {
    const { pen, look, people, storey } = this, all = people[storey] ?? [];
    pen.beginPath();
    for (let k = 0; k < all.length; k += 3) {
      pen.moveTo(all[k] + BODY, all[k + 1]);
      pen.arc(all[k], all[k + 1], BODY, 0, 7);
    }
    Object.assign(pen, { fillStyle: look.accent, strokeStyle: look.panel, lineWidth: 1 / this.zoom });
    pen.fill();
    pen.stroke();
  }

  // Doors and exits that no row of the storey has, as they were judged: of storeys that it is like, and of other files.
  others() {
    return ["doors", "exits"].flatMap((section) => {
      const own = new Set(this.table.rows(section).filter((row) => row.storey === this.storey).map((row) => row.name)), all = this.judged?.segments[section] ?? [];
      return all.filter((one) => one.storey === this.storey && !own.has(one.name)).flatMap(({ name, ends }) => ends.map((line) => ({ section, name, ends: [line.slice(0, 2), line.slice(2)] })));
    });
  }

  dot([x, y], colour) {
    const half = 3.5 / this.zoom;
    this.pen.fillStyle = colour;
    this.pen.fillRect(x - half, y - half, 2 * half, 2 * half);
  }

  // What is being drawn, the lines to which it snaps, and the cross of the keyboard.
  paintTool() {
    const { pen, look, zoom, tools: { tool, points, at, lines, measured, isByKeys } } = this, far = 1e4;
    for (const [i, value] of lines) this.line(i ? [[-far, value], [far, value]] : [[value, -far], [value, far]], look.mark, 1 / zoom);
    const { box } = this.tools, shown = measured ?? (box ? [...rectangle(...box), points[0]] : points.length ? [...points, at] : []);
    for (let k = 1; k < shown.length; k++) this.line([shown[k - 1], shown[k]], look.mark, 2 / zoom);
    for (const point of shown) this.dot(point, look.mark);
    if (this.tools.isStair && points.length && keyOf(points[0]) !== keyOf(at)) this.paintGhost();
    if (this.tools.isOnWalls && (this.tools.isOver || isByKeys)) for (const ends of this.ghosts()) this.line(ends, look.mark, Math.max(0.12, 5 / zoom));
    if (isByKeys) for (const i of [0, 1]) this.line([-1, 1].map((sign) => at.map((value, k) => value + (k === i ? sign * 12 / zoom : 0))), look.mark, 2 / zoom);
  }

  // The doors or exits that a click or the end of a drag would make.
  ghosts() { const { at, drag } = this.tools; return drag?.kind === "draw" ? this.tools.linesAt(drag.start, at) : this.tools.linesAt(at); }

  // The stair that is being drawn, of the kind and as long as it would be.
  paintGhost() {
    const { tools, look, zoom, pen } = this, { outline, isFit, row } = tools.stairOf([tools.points[0], tools.at]);
    this.line(this.lineOf({ section: "shafts" }, row), look.mark, 5 / zoom);
    this.path([outline]);
    Object.assign(pen, { strokeStyle: isFit ? look.mark : look.error, lineWidth: 1.5 / zoom });
    pen.stroke();
  }

  text(words, point, colour, [dx, dy] = [0, 0], weight = 400) {
    const { pen } = this, [left, top] = this.spot(point);
    Object.assign(pen, { font: `${weight} ${FONT}`, textAlign: "center", textBaseline: "middle", lineWidth: 3, strokeStyle: this.look.floor, fillStyle: colour });
    pen.strokeText(words, left + dx, top + dy);
    pen.fillText(words, left + dx, top + dy);
  }

  // The name of something; of an escalator with the way in which it moves.
  nameOf({ name = "" }) { const moving = this.table.movingOf(name); return moving ? `${name} ${{ up: "\u2191", down: "\u2193" }[moving.towards ?? "up"] ?? ""}` : name; }

  // What stands beside a door, an exit or the foot of a stair: of exits outside.
  nameLine(section, name, line, lines = [line]) {
    const [dx, dy] = minus(line[1], line[0]), far = Math.hypot(dx, dy) || 1, width = mm(wide(lines)).toFixed(2), at = middle(line), words = { doors: width, exits: `${name} ${width}` }[section] ?? name;
    const floors = this.levels().flatMap(({ polygons }) => polygons.map(([ring]) => ring)), isIn = ([x, y]) => floors.some((ring) => isInside([at[0] + 0.3 * x, at[1] + 0.3 * y], ring));
    let aside = [-dy / far, dx / far];
    if (section === "exits" && isIn(aside) && !isIn(aside.map((value) => -value))) aside = aside.map((value) => -value);
    this.pen.font = FONT;
    this.text(words, at, { exits: this.look.exit, doors: this.look.accent }[section] ?? this.look.text, [aside[0] * (this.pen.measureText(words).width / 2 + 12), -14 * aside[1]], section === "doors" ? 400 : 600);
  }

  paintNames() {
    const { table, look, zoom } = this, named = [this.storey, ...table.originals(this.storey)];
    for (const ref of named.flatMap((name) => table.on(name))) {
      const row = table.row(ref), isOwn = row.storey === this.storey || row.lower === this.storey, line = [...ON_WALLS, ...STAIRS].includes(ref.section) && isOwn && this.lineOf(ref, row);
      if (line && zoom > 8) this.nameLine(ref.section, this.nameOf(row), line, this.linesOf(ref, row));
      const [ring] = table.rings(ref);
      if ([...POLYGONS, "lifts"].includes(ref.section) && ring && Math.sqrt(Math.abs(areaOf(ring))) * zoom > 45) {
        const [x, y] = [0, 1].map((i) => range(ring, (corner) => corner[i])), isArea = ref.section === "areas";  // Whose names are at their upper edge.
        this.text(row.name ?? "", [centre(x), isArea ? y[1] : centre(y)], ref.section === "rooms" ? look.text : look.soft, [0, isArea ? 12 : ref.section === "rooms" ? -8 : 0], ref.section === "rooms" ? 600 : 400);
        if (ref.section === "rooms") this.text([row.use, row.people === undefined ? "" : `${row.people} people`].filter(Boolean).join(", "), [centre(x), centre(y)], look.soft, [0, 8]);
      }
    }
    if (zoom > 8) for (const { section, name, ends } of this.others()) this.nameLine(section, name, ends);
    const { tools: { tool, points, at, typed, isOnWalls, drag } } = this, mark = (words, place, top = -12) => this.text(words, place, look.mark, [0, top], 700), { box } = this.tools, last = points.at(-1);
    if (box) mark(`${box[0].map((value, i) => Math.abs(box[1][i] - value).toFixed(2)).join(" × ")} m`, middle(box), 0);
    else if (typed) mark(`${typed} m`, middle([last, at]));
    else if (this.tools.isStair && last && keyOf(last) !== keyOf(at)) { const { kind, outline, isFit } = this.tools.stairOf([last, at]); mark(isFit ? kind : "does not fit here", [0, 1].map((i) => centre(range(outline, (corner) => corner[i]))), 0); }
    else if (last) mark(`${length(minus(at, last)).toFixed(2)} m`, middle([last, at]));
    if (isOnWalls && drag?.kind === "draw") for (const ends of this.ghosts()) mark(`${length(minus(...ends)).toFixed(2)} m`, middle(ends));
    if (this.tools.measured) this.text(`${length(minus(...this.tools.measured)).toFixed(3)} m`, middle(this.tools.measured), look.mark, [0, -12], 700);
  }

  paintFindings() {
    const { pen, look } = this;
    for (const { number, kind, storey, at } of this.findings) {
      if (!at || storey !== this.storey || !number) continue;
      const [left, top] = this.spot(at);
      pen.beginPath();
      pen.arc(left, top - 14, 10, 0, 7);
      pen.moveTo(left - 5, top - 6);
      pen.lineTo(left, top);
      pen.lineTo(left + 5, top - 6);
      pen.fillStyle = kind === "error" ? look.error : kind === "warning" ? look.notice : look.soft;
      pen.fill();
      Object.assign(pen, { fillStyle: look.panel, font: '700 11px system-ui, "DejaVu Sans", sans-serif', textAlign: "center", textBaseline: "middle" });
      pen.fillText(number, left, top - 13.5);
    }
  }
}
