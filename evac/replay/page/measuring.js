// Measures where the user draws: people through a line, and people in an area, over the whole run.

const SPAN = 5;  // Between two rows of a table of flows [s], as in flows.csv.

// The level and the point in plan [m] that a ray meets first; null if it meets no floor.
function meetFloor(layout, density, [from, along]) {
  let least = Infinity, found = null;
  layout.building.levels.forEach((level, index) => {
    if (!layout.visible[index]) return;
    const [c, a, b] = level.plane, [[xx, xy, x0], [yx, yy, y0]] = layout.frames[index], { base, spread } = layout;
    const back = (x, y) => {
      const whole = xx * yy - xy * yx;
      return [(yy * (x - x0) - xy * (y - y0)) / whole, (xx * (y - y0) - yx * (x - x0)) / whole];
    };
    const way = layout.isFlat ? 0 : (base + spread * (c + a * from[0] + b * from[1] - base) - from[2]) / (along[2] - spread * (a * along[0] + b * along[1]));
    const [x, y] = back(from[0] + way * along[0], from[1] + way * along[1]);
    if (way < 0 || way >= least || !density.isFloor(index, x, y)) return;
    [least, found] = [way, { level: index, x, y }];
  });
  return found;
}

class Measured {
  // `kind` is line or area; `from` and `to` are ends or opposite corners on one level.
  constructor(kind, from, to, record, density) {
    Object.assign(this, { kind, level: from.level, ends: [from.x, from.y, to.x, to.y], record });
    const [x1, y1, x2, y2] = this.ends;
    this.name = `${kind} on ${record.building.levels[this.level].name}`;
    if (kind === "line") this.findPassages(Math.hypot(x2 - x1, y2 - y1));
    else this.countPeople(density);
  }

  // Times of passages to the left and to the right, on straight ways between recorded states and to the exit.
  findPassages(width) {
    const { motion: { first, person, level, x, y, times }, frames, outAt } = this.record, [x1, y1, x2, y2] = this.ends;
    const side = (px, py) => (x2 - x1) * (py - y1) - (y2 - y1) * (px - x1);
    const left = [], right = [];
    for (let k = 0; k + 1 < frames; k++) {
      let next = first[k + 1];
      for (let row = first[k]; row < first[k + 1]; row++) {
        while (next < first[k + 2] && person[next] < person[row]) next++;
        const stays = next < first[k + 2] && person[next] === person[row], p = person[row];
        if (level[row] !== this.level && !(stays && level[next] === this.level)) continue;
        const [ex, ey] = stays ? [x[next], y[next]] : [outAt[2 * p], outAt[2 * p + 1]];
        const before = side(x[row], y[row]), after = side(ex, ey);
        if (before > 0 === after > 0) continue;
        const share = before / (before - after), px = x[row] + share * (ex - x[row]), py = y[row] + share * (ey - y[row]);
        const along = ((px - x1) * (x2 - x1) + (py - y1) * (y2 - y1)) / width ** 2;
        if (along >= 0 && along <= 1) (after > 0 ? left : right).push(times[k] + share * (times[k + 1] - times[k]));
      }
    }
    const ascending = (all) => all.sort((a, b) => a - b);
    Object.assign(this, { width, sides: [["to the left", ascending(left)], ["to the right", ascending(right)]] });
  }

  // People in the rectangle at each recorded time, and the floor in it.
  countPeople(density) {
    const { motion: { first, level, x, y }, frames } = this.record, [x1, y1, x2, y2] = this.ends;
    const [left, right, low, high] = [Math.min(x1, x2), Math.max(x1, x2), Math.min(y1, y2), Math.max(y1, y2)];
    this.people = Array.from({ length: frames }, (_, k) => {
      let count = 0;
      for (let row = first[k]; row < first[k + 1]; row++) {
        if (level[row] === this.level && x[row] >= left && x[row] <= right && y[row] >= low && y[row] <= high) count++;
      }
      return count;
    });
    const { cell } = density;
    let cells = 0;
    for (let px = left + cell / 2; px < right; px += cell) for (let py = low + cell / 2; py < high; py += cell) cells += density.isFloor(this.level, px, py);
    this.area = cells * cell ** 2;
  }

  // What the chart shows.
  curves() {
    if (this.kind === "line") return this.sides.map(([name, times]) => ({ name, value: (time) => countUpTo(times, time) }));
    return [{ name: "people", value: (time) => this.people[this.record.frameAt(time)] }];
  }

  // Names and values at a time.
  facts(time) {
    if (this.kind === "line") {
      const flow = (times) => flowAt(times, time, this.record.begin);
      return [["Length", `${this.width.toFixed(2)} m`], ...this.sides.flatMap(([name, times]) => [
        [`Passed ${name}`, `${countUpTo(times, time)} of ${times.length}`],
        [`Flow ${name}`, `${flow(times).toFixed(2)} 1/s, ${(flow(times) / this.width).toFixed(2)} 1/(m s)`]])];
    }
    const count = this.people[this.record.frameAt(time)], most = this.people.reduce((a, b) => Math.max(a, b), 0);
    const per = (people) => `${(people / this.area).toFixed(2)} 1/m²`;
    return [["Floor", `${this.area.toFixed(2)} m²`], ["People now", `${count}, ${per(count)}`],
            ["Most people", `${most}, ${per(most)}, at ${seconds(this.record.motion.times[this.people.indexOf(most)])}`]];
  }

  // The table to save: passages as in flows.csv, or people and density at each recorded time.
  table() {
    const { times } = this.record.motion, { end } = this.record, place = this.name.replaceAll('"', '""');
    if (this.kind === "area") {
      return ["time,kind,name,people,density", ...this.people.map((count, k) => `${times[k]},area,"${place}",${count},${count / this.area}`)].join("\n");
    }
    const rows = ["time,kind,name,direction,count,flow,specific_flow"], until = [];
    for (let time = SPAN; time < end; time += SPAN) until.push(time);
    for (const [name, passed] of this.sides) [...until, end].forEach((time, k, all) => {
      const [count, before] = [time, all[k - 1] ?? 0].map((one) => countUpTo(passed, one)), flow = (count - before) / (time - (all[k - 1] ?? 0));
      rows.push(`${time},line,"${place}",${name},${count},${flow},${flow / this.width}`);
    });
    return rows.join("\n");
  }
}

// What has been drawn, on the floor.
function measureMesh(layout, { kind, level, ends: [x1, y1, x2, y2] }, colour) {
  const values = [], [c, a, b] = layout.building.levels[level].plane;
  const quad = (corners, share) => pushQuad(values, corners.map(([x, y]) => layout.place(level, x, y, c + a * x + b * y + 0.05)), [...colour, share]);
  const half = Math.max(0.04, Math.max(...layout.extent) / 500), length = Math.hypot(x2 - x1, y2 - y1) || 1;
  const [ox, oy] = [-(y2 - y1) / length * half, (x2 - x1) / length * half];
  if (kind === "line") quad([[x1 + ox, y1 + oy], [x2 + ox, y2 + oy], [x2 - ox, y2 - oy], [x1 - ox, y1 - oy]], 0.9);
  else quad([[x1, y1], [x2, y1], [x2, y2], [x1, y2]], 0.4);
  return values;
}
