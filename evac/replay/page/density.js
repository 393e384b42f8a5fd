// Grids on all levels. Density: people per square metre, with a Gaussian kernel, corrected where it reaches beyond the level.

const BANDWIDTH = 0.7 / Math.SQRT2;  // Standard deviation of the kernel [m], as in evac/analysis/maps.py.
const MOST_CELLS = 300000;
const ATLAS_WIDTH = 1024;

class Density {
  constructor({ building, grain, boxes }, greatest) {
    this.greatest = greatest;
    this.boxes = boxes;
    const area = this.boxes.reduce((sum, box) => sum + (box[2] - box[0] + 1) * (box[3] - box[1] + 1), 0);
    this.cell = Math.max(0.25, Math.sqrt(area / MOST_CELLS), ...this.boxes.map((box) => (box[2] - box[0]) / (ATLAS_WIDTH - 4)));
    this.reach = Math.max(1, Math.ceil(3 * BANDWIDTH / this.cell));
    this.pack();
    this.weights = Array.from({ length: 2 * this.reach + 1 }, (_, k) => Math.exp(-0.5 * ((k - this.reach) * this.cell / BANDWIDTH) ** 2));
    this.inside = new Uint8Array(this.width * this.height);  // Nodes on floors.
    this.cover = this.coverage(building, grain);
    this.bytes = new Uint8Array(this.width * this.height);
    this.sums = new Float32Array(this.width * this.height);
  }

  // Rectangles of all levels in one texture, row by row.
  pack() {
    let x = 1, y = 1, tall = 0;
    this.grids = this.boxes.map((box) => {
      const nx = Math.ceil((box[2] - box[0]) / this.cell) + 1, ny = Math.ceil((box[3] - box[1]) / this.cell) + 1;
      if (x + nx + 1 > ATLAS_WIDTH) { x = 1; y += tall + 1; tall = 0; }
      const grid = { x, y, nx, ny, box };
      x += nx + 1;
      tall = Math.max(tall, ny);
      return grid;
    });
    this.width = ATLAS_WIDTH;
    this.height = y + tall + 1;
  }

  // Position in the texture of a point on a level, from 0 to 1; nodes are in the middle of texels.
  texel(level, x, y) {
    const { x: left, y: low, box } = this.grids[level];
    return [(left + (x - box[0]) / this.cell + 0.5) / this.width, (low + (y - box[1]) / this.cell + 0.5) / this.height];
  }

  // Share of the kernel around each node that lies on the level.
  coverage(building, grain) {
    const cover = new Float32Array(this.width * this.height);
    building.levels.forEach((level, index) => {
      const { x, y, nx, ny, box } = this.grids[index];
      const inside = new Float32Array(nx * ny);
      for (let t = 0; t < level.triangles.length; t += 3) {
        const corner = [0, 1, 2].map((i) => {
          const v = level.triangles[t + i];
          return [(building.vertices[3 * v] * grain - box[0]) / this.cell, (building.vertices[3 * v + 1] * grain - box[1]) / this.cell];
        });
        fillTriangle(corner, inside, nx, ny);
      }
      const both = this.blurred(inside, nx, ny);
      for (let j = 0; j < ny; j++) for (let i = 0; i < nx; i++) {
        this.inside[(y + j) * this.width + x + i] = inside[j * nx + i];
        cover[(y + j) * this.width + x + i] = Math.max(0.15, both[j * nx + i]);
      }
    });
    return cover;
  }

  blurred(values, nx, ny) {
    const total = this.weights.reduce((a, b) => a + b);
    return blur(blur(values, nx, ny, 1, nx, this.weights, total), ny, nx, nx, 1, this.weights, total);
  }

  // Smooths numbers at the nodes of all levels to numbers per square metre.
  smooth(values) {
    for (const { x, y, nx, ny } of this.grids) {
      const rows = Array.from({ length: ny }, (_, j) => values.subarray((y + j) * this.width + x, (y + j) * this.width + x + nx));
      const part = new Float32Array(nx * ny);
      rows.forEach((row, j) => part.set(row, j * nx));
      const both = this.blurred(part, nx, ny).map((value) => value / this.cell ** 2);
      rows.forEach((row, j) => row.set(both.subarray(j * nx, (j + 1) * nx)));
    }
  }

  // Calls `visit` with the node nearest to a point, and with those on the floor within a radius of it.
  covered(level, x, y, radius, visit) {
    const { x: left, y: low, nx, ny, box } = this.grids[level], own = this.node(level, x, y);
    const gx = (x - box[0]) / this.cell, gy = (y - box[1]) / this.cell, reach = radius / this.cell;
    for (let j = Math.max(0, Math.ceil(gy - reach)); j <= Math.min(ny - 1, gy + reach); j++) {
      for (let i = Math.max(0, Math.ceil(gx - reach)); i <= Math.min(nx - 1, gx + reach); i++) {
        const node = (low + j) * this.width + left + i;
        if (node !== own && this.inside[node] && (i - gx) ** 2 + (j - gy) ** 2 <= reach ** 2) visit(node);
      }
    }
    visit(own);
  }

  // Finds the density of people; `bytes` are from 0 to 255 for 0 to the greatest density of the scale.
  update(now) {
    this.sum(now, this.sums);
    const scale = 255 / this.greatest;
    for (let k = 0; k < this.sums.length; k++) this.bytes[k] = Math.min(255, scale * this.sums[k]);
  }

  // Adds everybody up, [1/m²].
  sum(now, sums) {
    const { cell, reach, width } = this;
    sums.fill(0);
    const peak = 1 / (2 * Math.PI * BANDWIDTH ** 2);
    const across = new Float32Array(2 * reach + 1);
    for (let i = 0; i < now.count; i++) {
      const grid = this.grids[now.level[i]];
      const gx = (now.x[i] - grid.box[0]) / cell, gy = (now.y[i] - grid.box[1]) / cell;
      const cx = Math.round(gx), cy = Math.round(gy);
      for (let k = -reach; k <= reach; k++) across[k + reach] = Math.exp(-0.5 * ((cx + k - gx) * cell / BANDWIDTH) ** 2);
      for (let j = Math.max(0, cy - reach); j <= Math.min(grid.ny - 1, cy + reach); j++) {
        const down = peak * Math.exp(-0.5 * ((j - gy) * cell / BANDWIDTH) ** 2);
        const row = (grid.y + j) * width + grid.x;
        for (let k = Math.max(0, cx - reach); k <= Math.min(grid.nx - 1, cx + reach); k++) {
          sums[row + k] += down * across[k - cx + reach];
        }
      }
    }
    for (let k = 0; k < sums.length; k++) if (sums[k] > 0) sums[k] /= this.cover[k];
  }

  // The node nearest to a point of a level.
  node(level, x, y) {
    const grid = this.grids[level];
    const i = Math.max(0, Math.min(grid.nx - 1, Math.round((x - grid.box[0]) / this.cell)));
    const j = Math.max(0, Math.min(grid.ny - 1, Math.round((y - grid.box[1]) / this.cell)));
    return (grid.y + j) * this.width + grid.x + i;
  }
}

function fillTriangle(corner, inside, nx, ny) {
  const [[ax, ay], [bx, by], [cx, cy]] = corner;
  const area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
  for (let j = Math.max(0, Math.floor(Math.min(ay, by, cy))); j <= Math.min(ny - 1, Math.ceil(Math.max(ay, by, cy))); j++) {
    for (let i = Math.max(0, Math.floor(Math.min(ax, bx, cx))); i <= Math.min(nx - 1, Math.ceil(Math.max(ax, bx, cx))); i++) {
      const a = ((bx - i) * (cy - j) - (by - j) * (cx - i)) / area;
      const b = ((cx - i) * (ay - j) - (cy - j) * (ax - i)) / area;
      if (a >= -1e-6 && b >= -1e-6 && a + b <= 1 + 1e-6) inside[j * nx + i] = 1;
    }
  }
}

// Convolves lines of `length` values, `step` apart, of which there are `lines`, `stride` apart.
function blur(values, length, lines, step, stride, weights, total) {
  const result = new Float32Array(values.length), reach = (weights.length - 1) / 2;
  for (let line = 0; line < lines; line++) for (let i = 0; i < length; i++) {
    let sum = 0;
    for (let k = Math.max(-reach, -i); k <= Math.min(reach, length - 1 - i); k++) {
      sum += weights[k + reach] * values[line * stride + (i + k) * step];
    }
    result[line * stride + i * step] = sum / total;
  }
  return result;
}
