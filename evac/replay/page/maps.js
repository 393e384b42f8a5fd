// Maps of the whole run on the floors: the quantities of `evac map`, computed in slices when the first one is chosen.

const SLICE = 25;  // The page stays usable while maps are computed: a slice takes about so long [ms].
const FEWEST = 1e-3;  // Below this mean density a mean speed is not given [1/m²].

// Quantities of maps, with the colours that each is drawn in; those of densities let the floor show through.
const MAPS = {
  "mean density": { unit: "1/m²", colours: "density", isVeiled: true },
  "maximum density": { unit: "1/m²", colours: "density", isVeiled: true },
  "mean speed": { unit: "m/s", colours: "speed" },
  "specific flow": { unit: "1/(m s)", colours: "density", isVeiled: true },
  "waiting": { unit: "s/m²", colours: "waiting time", isVeiled: true },
  "time to clear": { unit: "s", colours: "waiting time" },
  "contact pressure": { unit: "N/m", colours: "contact force" },
  "usage": { unit: "people", colours: "density" },
};

class Maps {
  constructor(record, density) {
    Object.assign(this, { record, density, share: 0, values: null });
  }

  // Computes all maps and calls `tell` with the share that is done, at the end with 1.
  async find(tell) {
    if (this.begun) return;
    this.begun = true;
    const size = this.density.sums.length;
    const values = Object.fromEntries(Object.keys(MAPS).map((name) => [name, new Float32Array(size)]));
    let since = performance.now();
    for (const share of this.steps(values)) {
      if (performance.now() - since < SLICE) continue;
      tell(this.share = share);
      await new Promise((done) => setTimeout(done, 0));
      since = performance.now();
    }
    this.values = values;
    this.ends = Object.fromEntries(Object.entries(values).map(([name, all]) => [name, this.upperEnd(all)]));
    tell(this.share = 1);
  }

  // Greatest densities by frames, all else person by person.
  * steps(values) {
    const { density, record } = this, { motion } = record;
    const sums = new Float32Array(density.sums.length), greatest = values["maximum density"];
    for (let k = 0; k < record.frames; k++) {
      const [a, b] = motion.first.subarray(k, k + 2);
      const part = (name) => motion[name].subarray(a, b);
      density.sum({ count: b - a, level: part("level"), x: part("x"), y: part("y") }, sums);
      for (let c = 0; c < sums.length; c++) if (sums[c] > greatest[c]) greatest[c] = sums[c];
      yield 0.5 * k / record.frames;
    }
    const { order, start, frame } = this.byPerson();
    const linear = ["mean density", "mean speed", "waiting"].map((name) => values[name]);
    const flows = [0, 1].map(() => new Float32Array(sums.length)), stamp = new Int32Array(sums.length).fill(-1);
    for (let p = 0; p < record.people; p++) {
      const rows = order.subarray(start[p], start[p + 1]);
      this.addPerson(rows, frame, linear, flows);
      this.addBody(p, rows, frame, values, stamp);
      yield 0.5 + 0.5 * p / record.people;
    }
    this.finish(values, linear, flows);
  }

  // Rows of each person in the order of time, and the frame of each row.
  byPerson() {
    const { motion, people, frames } = this.record;
    const start = new Uint32Array(people + 1), order = new Uint32Array(motion.person.length);
    for (const p of motion.person) start[p + 1]++;
    for (let p = 0; p < people; p++) start[p + 1] += start[p];
    const next = start.slice(), frame = new Uint32Array(order.length);
    for (let k = 0; k < frames; k++) {
      for (let row = motion.first[k]; row < motion.first[k + 1]; row++) {
        order[next[motion.person[row]]++] = row;
        frame[row] = k;
      }
    }
    return { order, start, frame };
  }

  // Part of each recorded state in means over time (trapezoidal rule).
  shareOf(k) {
    const { times } = this.record.motion, last = times.length - 1;
    if (!last) return 1;
    return 0.5 * (times[Math.min(last, k + 1)] - times[Math.max(0, k - 1)]) / (times[last] - times[0]);
  }

  // Density, speed and waiting of one person, at the nearest node: they are smoothed together, at the end.
  addPerson(rows, frame, [densities, speeds, waiting], flows) {
    const { density, record } = this, { x, y, z, level, times } = record.motion;
    for (let i = 0; i < rows.length; i++) {
      const row = rows[i], from = rows[Math.max(0, i - 1)], to = rows[Math.min(rows.length - 1, i + 1)];
      const span = times[frame[to]] - times[frame[from]];
      const [vx, vy, vz] = span ? [(x[to] - x[from]) / span, (y[to] - y[from]) / span, (z[to] - z[from]) / span] : [0, 0, 0];
      const speed = Math.hypot(vx, vy, vz), node = density.node(level[row], x[row], y[row]);
      const weight = this.shareOf(frame[row]) / density.cover[node];
      densities[node] += weight;
      speeds[node] += weight * speed;
      flows[0][node] += weight * vx;
      flows[1][node] += weight * vy;
      if (speed < SLOW) waiting[node] += weight;
    }
  }

  // What one body covers, on straight ways between recorded states.
  addBody(p, rows, frame, values, stamp) {
    const { density, record } = this, { x, y, level, times } = record.motion, radius = record.radius[p] / 1000;
    const clear = values["time to clear"], pressure = values["contact pressure"], usage = values.usage;
    rows.forEach((row, i) => {
      const isOn = i + 1 < rows.length && level[rows[i + 1]] === level[row], next = isOn ? rows[i + 1] : row;
      const parts = Math.max(1, Math.ceil(Math.hypot(x[next] - x[row], y[next] - y[row]) / density.cell));
      const force = record.forceOf(row) / (2 * Math.PI * radius);
      for (let part = 0; part < parts; part++) {
        const u = part / parts, time = times[frame[row]] + u * (times[frame[next]] - times[frame[row]]);
        density.covered(level[row], x[row] + u * (x[next] - x[row]), y[row] + u * (y[next] - y[row]), radius, (node) => {
          if (stamp[node] !== p) usage[node]++;
          stamp[node] = p;
          clear[node] = Math.max(clear[node], time, 1e-6);  // 0 is "nobody was ever here".
          if (!part) pressure[node] = Math.max(pressure[node], force);
        });
      }
    });
  }

  finish(values, [densities, speeds, waiting], flows) {
    const { density, record } = this, length = record.end - record.begin;
    for (const grid of [densities, speeds, waiting, ...flows]) density.smooth(grid);
    for (let c = 0; c < densities.length; c++) {
      speeds[c] = densities[c] > FEWEST ? speeds[c] / densities[c] : 0;
      waiting[c] *= length;
      values["specific flow"][c] = Math.hypot(flows[0][c], flows[1][c]);
    }
  }

  // A round number that 99 % of what is not zero on the floors stays below.
  upperEnd(values) {
    const sorted = values.filter((value, c) => value > 0 && this.density.inside[c]).sort();
    return sorted.length ? roundUp(sorted[Math.floor(0.99 * (sorted.length - 1))]) : 1;
  }

  // Values from 1 to 255 up to the end of the scale; 0 is no value.
  bytes(name) {
    const scale = 255 / this.ends[name];
    return Uint8Array.from(this.values[name], (value) => value > 0 ? Math.max(1, Math.min(255, scale * value)) : 0);
  }
}
