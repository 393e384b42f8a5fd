// Smoke at head height, as codes of extinction coefficients in the cells of a field (evac/replay/motion.py).

const AIR = ["smoke at heads", "visibility"];  // What it gives, of people and on floors.
const aboutAir = (quantity, { contrast }) => quantity === AIR[1] ? `${contrast} / K, K being the smoke at the mean height of heads` : "At the mean height of heads";

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
    this.cellOf = new Int32Array(density.bytes.length).fill(-1);  // Of each place of the layers.
    building.levels.forEach((_, level) => {
      const { x, y, nx, ny, left, low } = density.grids[level];
      for (let j = 0; j < ny; j++) for (let i = 0; i < nx; i++) {
        this.cellOf[(y + j) * density.width + x + i] = this.cell(level, left + (i + 0.5) * density.cell, low + (j + 0.5) * density.cell);
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

  // What the layer of a quantity shows: 0 where the floor is seen through thin air, or further than the scale goes.
  layer(quantity, frame, { top }) {
    const shown = Uint8Array.from(this.extinction, (value) => {
      const share = this.of(quantity, value) / top;
      return quantity === "visibility" && share >= 1 ? 0 : Math.max(value > 0 ? 1 : 0, Math.min(255, 255 * share));
    });
    const codes = this.states[frame];
    for (let k = 0; k < this.bytes.length; k++) this.bytes[k] = this.cellOf[k] < 0 ? 0 : shown[codes[this.cellOf[k]]];
    return this.bytes;
  }
}
