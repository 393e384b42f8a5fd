// The view: a target on the floor, a direction, and the height of what is seen.

const FIELD = 0.42;  // Vertical angle of view [rad]: long, so that sizes compare.
const FILLED = 0.94;  // Of the picture, by the building.

class Camera {
  constructor() {
    Object.assign(this, { target: [0, 0, 0], azimuth: 0, tilt: 0.8, size: 20, isFlat: false, aspect: 1, reach: 100 });
    this.matrix = new Float32Array(16);
  }

  update() {
    const tilt = this.isFlat ? Math.PI / 2 : this.tilt, turn = this.azimuth;
    const [c, s, ct, st] = [Math.cos(turn), Math.sin(turn), Math.cos(tilt), Math.sin(tilt)];
    this.right = [c, s, 0];
    this.up = [-s * st, c * st, ct];
    this.toward = [s * ct, -c * ct, st];
    const away = this.isFlat ? 2 * this.reach : this.size / (2 * Math.tan(FIELD / 2));
    this.position = this.target.map((value, i) => value + away * this.toward[i]);
    const near = Math.max(0.02 * away, away - 4 * this.reach), far = away + 6 * this.reach;
    const [tall, wide] = [this.size / 2, this.size / 2 * this.aspect];
    const rows = [this.right, this.up, this.toward].map((axis) => [...axis, -dot(axis, this.position)]);
    const m = this.matrix;
    for (let k = 0; k < 4; k++) {
      const [x, y, z] = rows.map((row) => row[k]);
      const last = k === 3 ? 1 : 0;
      m[4 * k] = x * (this.isFlat ? 1 / wide : away / wide);
      m[4 * k + 1] = y * (this.isFlat ? 1 / tall : away / tall);
      m[4 * k + 2] = this.isFlat ? (-2 * z - last * (far + near)) / (far - near)
                                 : (-(far + near) * z - last * 2 * far * near) / (far - near);
      m[4 * k + 3] = this.isFlat ? last : -z;
    }
  }

  place() { return `${this.target} ${this.size} ${this.azimuth} ${this.tilt}`; }

  // Place on the screen, from -1 to 1, and depth.
  project([x, y, z]) {
    const m = this.matrix, w = m[3] * x + m[7] * y + m[11] * z + m[15];
    return [(m[0] * x + m[4] * y + m[8] * z + m[12]) / w, (m[1] * x + m[5] * y + m[9] * z + m[13]) / w, (m[2] * x + m[6] * y + m[10] * z + m[14]) / w];
  }

  // The ray through a place on the screen: where it starts, and its direction.
  ray(x, y) {
    const [u, v] = [x * this.size / 2 * this.aspect, y * this.size / 2];
    const through = this.target.map((value, i) => value + u * this.right[i] + v * this.up[i]);
    if (this.isFlat) return [through.map((value, i) => value + 2 * this.reach * this.toward[i]), this.toward.map((value) => -value)];
    const along = through.map((value, i) => value - this.position[i]), length = Math.hypot(...along);
    return [this.position, along.map((value) => value / length)];
  }

  // Shows all of the points, with a margin for names.
  fit(points, margin) {
    this.update();
    const middle = [0, 1, 2].map((i) => centre(range(points, (point) => point[i])));
    this.reach = Math.max(1, range(points, ([x, y, z]) => Math.hypot(x - middle[0], y - middle[1], z - middle[2]))[1]);
    const spans = [this.right, this.up].map((axis) => range(points, (point) => dot(axis, point)));
    const shifts = [this.right, this.up].map((axis, k) => centre(spans[k]) - dot(axis, middle));
    this.target = middle.map((value, i) => value + shifts[0] * this.right[i] + shifts[1] * this.up[i]);
    const [wide, tall] = spans.map(([low, high]) => high - low);
    this.size = margin * Math.max(tall, wide / this.aspect, 2);
    this.update();
    if (this.isFlat) return;
    const most = Math.max(...this.bounds(points).flat().map(Math.abs));
    if (Number.isFinite(most) && most > 0.96) this.size *= most / 0.96;
    this.update();
  }

  // Least and greatest place of points on the screen, across and up.
  bounds(points) {
    const at = points.map((point) => this.project(point));
    return [0, 1].map((i) => range(at, (place) => place[i]));
  }

  // Shows all of the points, and leaves shares of the picture free at the left, at the top and at the bottom.
  makeRoom(points, left, top, bottom) {
    for (let turn = 0; turn < 4; turn++) {
      this.zoom(Math.max(...this.bounds(points).map(([low, high], i) => (high - low) / (2 * (FILLED - (i ? top + bottom : left))))));
      this.update();
      const [across, up] = this.bounds(points).map(centre);
      this.pan(left - across, bottom - top - up);
      this.update();
    }
  }

  pan(dx, dy) {
    const k = this.size / 2;
    const ahead = this.isFlat ? this.up : [-Math.sin(this.azimuth), Math.cos(this.azimuth), 0];
    const lean = this.isFlat ? 1 : 1 / Math.max(0.35, Math.sin(this.tilt));
    this.target = this.target.map((value, i) => value - k * (this.aspect * dx * this.right[i] + lean * dy * ahead[i]));
  }

  orbit(dx, dy) {
    this.azimuth -= dx;
    this.tilt = Math.max(0.08, Math.min(1.55, this.tilt + dy));
  }

  // Zooms in at factors below 1, and keeps the place (x, y) of the screen.
  zoom(factor, x = 0, y = 0) {
    const size = Math.max(0.8, Math.min(8 * this.reach, this.size * factor));
    const k = (this.size - size) / 2;
    this.target = this.target.map((value, i) => value + k * (this.aspect * x * this.right[i] + y * this.up[i]));
    this.size = size;
  }
}

const centre = ([low, high]) => (low + high) / 2;

function range(points, of) {
  let low = Infinity, high = -Infinity;
  for (const point of points) {
    const value = of(point);
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return [low, high];
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
