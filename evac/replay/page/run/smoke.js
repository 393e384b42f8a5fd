// Smoke at head height, as codes of extinction coefficients in the cells of a field (evac/replay/motion.py).

const AIR = ["smoke at heads", "visibility"];  // What it gives, of people and on floors.
const aboutAir = (quantity, { contrast, limit }) => (quantity === AIR[1] ? `${contrast} / K, K being the smoke at the mean height of heads` : "At the mean height of heads") + (limit ? `; red line: visibility of ${limit} m, the limit of the case` : "");

class Smoke {
  constructor(bytes, { smoke, building }, frames, density) {
    Object.assign(this, { ...smoke, density, first: [0] });
    for (const [, , nx, ny] of smoke.grids) this.first.push(this.first.at(-1) + nx * ny);
    let now = new Uint8Array(this.first.at(-1)), at = 0;
    this.states = Array.from({ length: frames }, () => {  // Frames of the same smoke share one array.
      if (bytes[at++]) {
        const change = bytes.subarray(at, at += now.length);
        now = now.map((code, cell) => code + change[cell]);
      }
      return now;
    });
    this.extinction = Float32Array.from({ length: 256 }, (_, code) => -Math.log(1 - Math.min(code, 254) / 255) / this.depth);
    this.greatest = this.extinction[this.states.reduce((most, codes) => codes.reduce((a, b) => Math.max(a, b), most), 0)];
    this.bytes = new Uint8Array(density.bytes.length);
    this.places = [];  // Of the layers: the place, the four cells around it, and how far it is from the first one, as a share of a cell.
    building.levels.forEach((_, level) => {
      const { x, y, nx, ny, left, low } = density.grids[level], [, , columns, rows] = this.grids[level];
      for (let j = -1; j <= ny; j++) for (let i = -1; i <= nx; i++) {
        const [px, py] = [left + (i + 0.5) * density.cell, low + (j + 0.5) * density.cell], half = this.size / 2;
        const first = this.cell(level, px - half, py - half), column = (first - this.first[level]) % columns, row = Math.floor((first - this.first[level]) / columns);
        const right = column + 1 < columns ? 1 : 0, up = row + 1 < rows ? columns : 0, within = (value) => Math.max(0, Math.min(1, value));
        const [x0, y0] = [this.grids[level][0] + (column + 0.5) * this.size, this.grids[level][1] + (row + 0.5) * this.size];
        this.places.push([(y + j) * density.width + x + i, first, right, up, within((px - x0) / this.size), within((py - y0) / this.size)]);
      }
    });
  }

  cell(level, x, y) {
    const [left, low, nx, ny] = this.grids[level], within = (value, count) => Math.max(0, Math.min(count - 1, Math.floor(value / this.size)));
    return this.first[level] + within(y - low, ny) * nx + within(x - left, nx);
  }

  // A quantity of an extinction coefficient.
  of(quantity, extinction) {
    return quantity === "visibility" ? this.contrast / Math.max(extinction, 1e-6) : extinction;
  }

  // A quantity at a place of a level.
  at(quantity, frame, level, x, y) {
    return this.of(quantity, this.extinction[this.states[frame][this.cell(level, x, y)]]);
  }

  // Where on the scale of a layer the visibility is as short as the limit of the case; nothing without one.
  limitOf(quantity, people) {
    return this.limit && AIR.includes(quantity) ? Math.min(1, this.of(quantity, this.contrast / this.limit) / people.scaleOf(quantity, "").top) : null;
  }

  // What the layer of a quantity shows: 0 where the floor is seen through thin air, the end of the scale where further than that.
  layer(quantity, frame, { top }) {
    const shown = (value) => {
      return Math.max(value > 0 ? 1 : 0, Math.min(255, 255 * this.of(quantity, value) / top));
    };
    const codes = this.states[frame], at = (cell) => this.extinction[codes[cell]];
    for (const [place, cell, right, up, u, v] of this.places) {
      const below = (1 - u) * at(cell) + u * at(cell + right), above = (1 - u) * at(cell + up) + u * at(cell + up + right);
      this.bytes[place] = shown((1 - v) * below + v * above);
    }
    return this.bytes;
  }
}
