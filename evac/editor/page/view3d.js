// The building in 3D, drawn by the stage of the replay from what was judged last.

const ROW = 1024, TALLEST = 2.5, TALL = 1.7;  // People in a row of a texture, and heights of figures [m].

class View3D {
  constructor(canvas) {
    Object.assign(this, { canvas, camera: new Camera(), building: null, people: {} });
    const look = () => this.draw();
    listenToPointers(canvas, this.camera, { draw: () => false, click() {}, look });
    canvas.addEventListener("keydown", ({ key }) => {
      const [turn, tilt] = { ArrowLeft: [0.12, 0], ArrowRight: [-0.12, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[key] ?? [0, 0];
      if (key === "+" || key === "-") this.camera.zoom(key === "+" ? 0.8 : 1.25);
      this.camera.orbit(turn, tilt);
      look();
    });
  }

  show(judged) {
    Object.assign(this, judged, { isBuilt: false });
    this.draw();
  }

  fit() {
    this.camera.azimuth = 0.35;
    this.camera.tilt = 0.7;
    if (this.layout) this.camera.fit(this.layout.corners(), 1.1);
    this.draw();
  }

  build() {
    const { building } = this, storeys = findStoreys(building.levels), isFirst = !this.layout;
    const bits = Uint8Array.from(atob(this.floors), (sign) => sign.charCodeAt(0)), style = coloursOf("exit", "error");
    this.stage ??= new Stage(this.canvas, ROW);
    this.layout = new Layout(building, 0.01, storeys);
    this.layout.arrange("3d", -1, this.layout.spreadFor({ tilt: 0.7, azimuth: 0.35 }, 0.5), this.camera.aspect);
    this.stage.build(this.layout, new Density(building, bits, 4), { shut: [], entrances: [], marks: [] }, { exit: unit(style.exit), closed: unit(style.error), places: {} });
    this.stage.mesh("cars", this.shafts(unit(coloursOf("soft").soft)), [3, 4]);
    for (const name of ["paths", "track", "measured"]) this.stage.mesh(name, [], [3, 4]);
    this.stage.setScale(new Uint32Array(256));
    this.isBuilt = true;
    if (isFirst) this.fit();
  }

  // Each lift from its lowest to its highest stop, whose rooms are above each other.
  shafts(colour) {
    const { layout, building: { levels } } = this, lifts = new Map();
    levels.forEach(({ kind, z }, level) => {
      const key = layout.boxes[level].join(), lift = lifts.get(key) ?? { level, z: z[0], top: z[0], isOpen: true };
      if (kind === "car") lifts.set(key, { ...lift, z: Math.min(lift.z, z[0]), top: Math.max(lift.top, z[0]) });
    });
    return carsMesh(layout, [...lifts.values()].map((lift) => ({ ...lift, tall: layout.height(lift.top) - layout.height(lift.z) + TALLEST })), colour);
  }

  // People of a run as the stage draws them: storey by storey, as the levels are.
  figures() {
    const all = Object.values(this.people).flat(), count = all.length / 3, room = ROW * Math.max(1, Math.ceil(count / ROW)), [ox, oy] = this.origin;
    const bodies = new Float32Array(4 * room), tints = new Uint8Array(4 * room), colour = unit(coloursOf("accent").accent).map((share) => 255 * share);
    const { storeys } = this.layout, storeyOf = (z) => Math.max(0, storeys.findLastIndex((storey) => storey.z <= z + SAME_STOREY));
    const order = Array.from({ length: count }, (_, k) => k).sort((a, b) => storeyOf(all[3 * a + 2]) - storeyOf(all[3 * b + 2])), sizes = storeys.map(() => 0);
    order.forEach((k, row) => {
      const [x, y, z] = all.slice(3 * k, 3 * k + 3);
      bodies.set([x - ox, y - oy, this.layout.height(z), BODY], 4 * row);
      tints.set([...colour, 255 * TALL / TALLEST], 4 * row);
      sizes[storeyOf(z)] += 1;
    });
    let total = 0;
    const parts = sizes.map((size) => [(total += size) - size, size]);
    return { bodies, tints, width: ROW, count, parts, tallest: TALLEST, marked: -1 };
  }

  draw() {
    const { canvas } = this;
    if (!this.building || !canvas.clientWidth || this.isWaiting) return;
    this.isWaiting = true;
    requestAnimationFrame(() => {
      this.isWaiting = false;
      Object.assign(canvas, { width: canvas.clientWidth * devicePixelRatio, height: canvas.clientHeight * devicePixelRatio });
      this.camera.aspect = canvas.width / Math.max(1, canvas.height);
      if (!this.isBuilt) this.build();
      const of = (...names) => names.flatMap((name) => unit(coloursOf(name)[name]));
      const look = { ...this.layout.boxInPicture(), background: of("ground"), floors: of("floor", "flight", "landing"), solids: of("wall", "wall-top", "desk"), marks: new Array(30).fill(-1), mark: of("mark"), rim: of("text"), layer: 0, shadows: false, widen: 1 };
      this.camera.update();
      this.stage.draw(this.camera, this.figures(), look);
    });
  }
}
