// The building in 3D, drawn by the stage of the replay from what was judged last.

const NOBODY = { bodies: new Float32Array(4096), tints: new Uint8Array(4096), width: 1024, count: 0, tallest: 2.5, marked: -1 };

class View3D {
  constructor(canvas) {
    Object.assign(this, { canvas, camera: new Camera(), building: null });
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
    this.stage ??= new Stage(this.canvas, 0);
    this.layout = new Layout(building, 0.01, storeys);
    this.layout.arrange("3d", -1, this.layout.spreadFor({ tilt: 0.7, azimuth: 0.35 }, 0.5), this.camera.aspect);
    this.stage.build(this.layout, new Density(building, bits, 4), { shut: [], entrances: [], marks: [] }, { exit: unit(style.exit), closed: unit(style.error), places: {} });
    for (const name of ["paths", "track", "measured"]) this.stage.mesh(name, [], [3, 4]);
    this.stage.setScale(new Uint32Array(256));
    this.isBuilt = true;
    if (isFirst) this.fit();
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
      this.stage.draw(this.camera, { ...NOBODY, parts: this.layout.storeys.map(() => [0, 0]) }, look);
    });
  }
}
