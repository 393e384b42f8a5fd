// Grids on all levels, and densities on them: those of evac/analysis/maps.py, which defines them.

const KERNEL_RADIUS = 0.7;  // [m]
const TRUNCATED = 3.5;  // The kernel ends at so many standard deviations.
const LEAST_COVER = 0.05;
const ATLAS_WIDTH = 1024;

class Density {
  constructor({ levels, cell }, bits, greatest) {
    Object.assign(this, { cell, greatest });
    const deviation = KERNEL_RADIUS / Math.SQRT2 / cell;
    this.reach = Math.floor(TRUNCATED * deviation + 0.5);
    const weights = Array.from({ length: 2 * this.reach + 1 }, (_, k) => Math.exp(-0.5 * ((k - this.reach) / deviation) ** 2));
    const total = weights.reduce((a, b) => a + b);
    this.weights = weights.map((weight) => weight / total);
    this.pack(levels);
    this.inside = new Uint8Array(this.width * this.height);  // Cells on floors.
    let bit = 0;
    for (const { x, y, nx, ny } of this.grids) {
      for (let j = 0; j < ny; j++) for (let i = 0; i < nx; i++, bit++) {
        this.inside[(y + j) * this.width + x + i] = bits[bit >> 3] >> (7 - (bit & 7)) & 1;
      }
    }
    this.bytes = new Uint8Array(this.width * this.height);
    this.sums = new Float32Array(this.width * this.height);
  }

  // Share of the kernel around each cell that lies on the floor, found when it is first asked for.
  get cover() {
    const cover = Float32Array.from(this.inside);
    this.blur(cover);
    Object.defineProperty(this, "cover", { value: cover.map((share) => Math.max(LEAST_COVER, share)) });
    return this.cover;
  }

  // Rectangles of all levels in one texture, row by row.
  pack(levels) {
    let x = 1, y = 1, tall = 0;
    this.width = Math.max(ATLAS_WIDTH, ...levels.map(({ grid: [, , nx] }) => nx + 2));
    this.grids = levels.map(({ grid: [left, low, nx, ny] }) => {
      if (x + nx + 1 > this.width) { x = 1; y += tall + 2; tall = 0; }
      const grid = { x, y, nx, ny, left, low };
      x += nx + 2;  // With a rim of each.
      tall = Math.max(tall, ny);
      return grid;
    });
    this.height = y + tall + 1;
  }

  // Position in the texture of a point on a level, from 0 to 1; centres of cells are in the middle of texels.
  texel(level, px, py) {
    const { x, y, left, low } = this.grids[level];
    return [(x + (px - left) / this.cell) / this.width, (y + (py - low) / this.cell) / this.height];
  }

  // Smooths numbers in the cells of all levels with the kernel.
  blur(values) {
    for (const { x, y, nx, ny } of this.grids) {
      const rows = Array.from({ length: ny }, (_, j) => values.subarray((y + j) * this.width + x, (y + j) * this.width + x + nx));
      const part = new Float32Array(nx * ny);
      rows.forEach((row, j) => part.set(row, j * nx));
      const both = blurLines(blurLines(part, nx, ny, 1, nx, this.weights), ny, nx, nx, 1, this.weights);
      rows.forEach((row, j) => row.set(both.subarray(j * nx, (j + 1) * nx)));
    }
  }

  // Smooths numbers in cells to numbers per square metre.
  smooth(values) {
    this.blur(values);
    for (let k = 0; k < values.length; k++) values[k] /= this.cell ** 2;
  }

  // Calls `visit` with the cells on the floor that have a point or whose centre is within a radius of it.
  covered(level, px, py, radius, visit) {
    const { x, y, nx, ny, left: x0, low: y0 } = this.grids[level];
    const gx = (px - x0) / this.cell, gy = (py - y0) / this.cell, reach = radius / this.cell;
    const cells = (at, count) => [Math.max(0, Math.min(Math.floor(at), Math.ceil(at - 0.5 - reach))), Math.min(count - 1, Math.max(Math.floor(at), Math.floor(at - 0.5 + reach)))];
    const [[left, right], [low, high]] = [cells(gx, nx), cells(gy, ny)];
    for (let j = low; j <= high; j++) for (let i = left; i <= right; i++) {
      const cell = (y + j) * this.width + x + i, isOwn = i === Math.floor(gx) && j === Math.floor(gy);
      if (this.inside[cell] && (isOwn || (i + 0.5 - gx) ** 2 + (j + 0.5 - gy) ** 2 <= reach ** 2)) visit(cell);
    }
  }

  // Finds the density of people; `bytes` are from 0 to 255 for 0 to the greatest density of the scale.
  update(now) {
    this.sum(now, this.sums);
    const scale = 255 / this.greatest;
    for (let k = 0; k < this.sums.length; k++) this.bytes[k] = Math.min(255, scale * this.sums[k]);
  }

  // Adds everybody up, [1/m²].
  sum(now, sums) {
    const { reach, width, weights } = this;
    sums.fill(0);
    for (let k = 0; k < now.count; k++) {
      const { x, y, nx, ny } = this.grids[now.level[k]], cell = this.node(now.level[k], now.x[k], now.y[k]);
      const ci = cell % width - x, cj = Math.floor(cell / width) - y, own = 1 / (this.cover[cell] * this.cell ** 2);
      for (let j = Math.max(0, cj - reach); j <= Math.min(ny - 1, cj + reach); j++) {
        const down = own * weights[j - cj + reach], row = (y + j) * width + x;
        for (let i = Math.max(0, ci - reach); i <= Math.min(nx - 1, ci + reach); i++) sums[row + i] += down * weights[i - ci + reach];
      }
    }
  }

  // Whether a point of a level is on its floor.
  isFloor(level, px, py) {
    const { nx, ny, left, low } = this.grids[level], i = (px - left) / this.cell, j = (py - low) / this.cell;
    return i >= 0 && j >= 0 && i < nx && j < ny && this.inside[this.node(level, px, py)] === 1;
  }

  // The cell that has a point of a level.
  node(level, px, py) {
    const { x, y, nx, ny, left, low } = this.grids[level];
    const i = Math.max(0, Math.min(nx - 1, Math.floor((px - left) / this.cell)));
    const j = Math.max(0, Math.min(ny - 1, Math.floor((py - low) / this.cell)));
    return (y + j) * this.width + x + i;
  }
}

// Convolves lines of `length` values, `step` apart, of which there are `lines`, `stride` apart.
function blurLines(values, length, lines, step, stride, weights) {
  const result = new Float32Array(values.length), reach = (weights.length - 1) / 2;
  for (let line = 0; line < lines; line++) for (let i = 0; i < length; i++) {
    let sum = 0;
    for (let k = Math.max(-reach, -i); k <= Math.min(reach, length - 1 - i); k++) {
      sum += weights[k + reach] * values[line * stride + (i + k) * step];
    }
    result[line * stride + i * step] = sum;
  }
  return result;
}
