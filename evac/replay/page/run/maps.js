// Maps of the whole run on the floors: the quantities of `evac map`, computed in slices when the first one is chosen.

const SLICE = 25;  // The page stays usable while maps are computed: a slice takes about so long [ms].
const FEWEST = 1e-3;  // Below this mean density of people who have started a mean speed is not given [1/m²].

class Maps {
  constructor(record, density) {
    Object.assign(this, { record, density, share: 0, values: null });
  }

  // Computes all maps and calls `tell` with the share that is done, at the end with 1.
  async find(tell) {
    if (this.begun) return;
    this.begun = true;
    const size = this.density.sums.length;
    const values = Object.fromEntries(Object.keys(this.record.map_scales).map((name) => [name, new Float32Array(size)]));
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
    const { order, start, frame } = this.byPerson(), parts = this.partsOf(order, frame);
    const linear = ["mean density", "mean speed", "waiting"].map((name) => values[name]);
    linear.push(new Float32Array(sums.length));  // of those who have started
    const flows = [0, 1].map(() => new Float32Array(sums.length)), stamp = new Int32Array(sums.length).fill(-1);
    for (let p = 0; p < record.people; p++) {
      const rows = order.subarray(start[p], start[p + 1]);
      this.addPerson(rows, frame, linear, flows);
      this.addBody(p, rows, frame, parts, values, stamp);
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

  // In how many parts ways to the next frame are divided, for each frame and level: the longest one has parts of a cell.
  partsOf(order, frame) {
    const { motion: { person, level, x, y }, frames, building } = this.record, parts = new Uint16Array(frames * building.levels.length).fill(1);
    for (let i = 0; i + 1 < order.length; i++) {
      const row = order[i], next = order[i + 1];
      if (person[row] !== person[next] || frame[next] !== frame[row] + 1 || level[row] !== level[next]) continue;
      const at = frame[row] * building.levels.length + level[row];
      parts[at] = Math.max(parts[at], Math.ceil(Math.hypot(x[next] - x[row], y[next] - y[row]) / this.density.cell));
    }
    return parts;
  }

  // Density, speed and waiting of one person, in its cell: they are smoothed together, at the end.
  addPerson(rows, frame, [densities, speeds, waiting, begun], flows) {
    const { density, record } = this, { x, y, level, speed, heading, waited, started } = record.motion, { levels } = record.building;
    rows.forEach((row, i) => {
      const node = density.node(level[row], x[row], y[row]), one = 1 / density.cover[node], weight = this.shareOf(frame[row]) * one;
      const angle = heading[row] * Math.PI / 128, toward = [Math.cos(angle), Math.sin(angle)];
      const [, a, b] = levels[level[row]].plane, inPlan = speed[row] / Math.hypot(1, a * toward[0] + b * toward[1]);
      densities[node] += weight;
      if (started[row]) begun[node] += weight;
      if (started[row]) speeds[node] += weight * speed[row];
      flows.forEach((flow, axis) => { flow[node] += weight * inPlan * toward[axis]; });
      if (i) waiting[node] += one * (waited[row] - waited[rows[i - 1]]);
    });
  }

  // What one body covers, on straight ways between recorded states.
  addBody(p, rows, frame, partsOf, values, stamp) {
    const { density, record } = this, { x, y, level, times, force } = record.motion, radius = record.radius[p] / 1000;
    const clear = values["time to clear"], pressure = values["maximum contact pressure"], usage = values.usage;
    rows.forEach((row, i) => {
      const next = i + 1 < rows.length && frame[rows[i + 1]] === frame[row] + 1 && level[rows[i + 1]] === level[row] ? rows[i + 1] : row;
      const parts = next === row ? 1 : partsOf[frame[row] * record.building.levels.length + level[row]];
      const isLast = frame[row] === record.frames - 1, load = force[row] / (2 * Math.PI * radius);
      for (let part = 0; part < parts; part++) {
        const u = part / parts, time = isLast ? Infinity : times[frame[row]] + u * (times[frame[next]] - times[frame[row]]);
        density.covered(level[row], x[row] + u * (x[next] - x[row]), y[row] + u * (y[next] - y[row]), radius, (node) => {
          if (stamp[node] !== p) usage[node]++;
          stamp[node] = p;
          clear[node] = Math.max(clear[node], time, 1e-6);  // 0 is "nobody was ever here".
          if (!part) pressure[node] = Math.max(pressure[node], load);
        });
      }
    });
  }

  finish(values, [densities, speeds, waiting, begun], flows) {
    for (const grid of [densities, speeds, waiting, begun, ...flows]) this.density.smooth(grid);
    for (let c = 0; c < densities.length; c++) {
      speeds[c] = begun[c] > FEWEST ? speeds[c] / begun[c] : 0;
      values["specific flow"][c] = Math.hypot(flows[0][c], flows[1][c]);
    }
  }

  // A round number that 99 % of the finite values above zero on the floors stay below.
  upperEnd(values) {
    const sorted = values.filter((value, c) => value > 0 && value < Infinity && this.density.inside[c]).sort();
    return roundUp(sorted[Math.floor(0.99 * (sorted.length - 1))]);
  }

  // Values from 1 to 255 up to the end of the scale; 0 is no value.
  bytes(name, scale, top) {
    return Uint8Array.from(this.values[name], (value) => value > 0 ? Math.max(1, 255 * shareOf(scale, top, value)) : 0);
  }
}
