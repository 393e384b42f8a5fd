// The run: everybody at any time, and times of leaving.

class Record {
  constructor(about, motion) {
    Object.assign(this, about);
    this.motion = motion;
    this.people = about.group.length;
    this.frames = motion.times.length;
    this.begin = motion.times[0];
    this.end = motion.times[this.frames - 1];
    this.findExits();
    const floats = () => new Float32Array(this.people), whole = () => new Uint32Array(this.people);
    this.now = { count: 0, person: whole(), row: whole(), level: new Uint16Array(this.people), x: floats(), y: floats(), z: floats() };
  }

  // Finds when, by which exit and at which point people leave. The moves of killed runs are those between recorded times,
  // and have no exits.
  findExits() {
    const { motion, moves } = this, firstSeen = new Map();
    this.lastRow = new Int32Array(this.people).fill(-1);
    for (let k = 0; k < this.frames; k++) {
      for (let row = motion.first[k]; row < motion.first[k + 1]; row++) {
        if (this.lastRow[motion.person[row]] < 0) firstSeen.set(motion.person[row], [row, k]);
        this.lastRow[motion.person[row]] = row;
      }
    }
    this.comes = [];  // Who comes during the run: when, and where each of them is recorded first.
    this.hasTimes = moves.target.some((target) => target < -1);
    moves.time.forEach((since, i) => { moves.time[i] = since + (moves.time[i - 1] ?? 0); });
    this.outTime = new Float64Array(this.people).fill(Infinity);
    this.outBy = new Int32Array(this.people).fill(-1);
    this.outAt = new Float32Array(2 * this.people);
    moves.person.forEach((p, i) => {
      const time = moves.time[i] / 100, target = moves.target[i];
      if (target < 0) {
        this.outTime[p] = time;
        this.outBy[p] = target < -1 ? -2 - target : -1;
        if (this.lastRow[p] >= 0) this.leadOut(p);
      } else if (moves.start[p] < 0 && firstSeen.has(p)) {
        this.comes.push([time, ...firstSeen.get(p)]);
        firstSeen.delete(p);
      }
    });
  }

  // Takes the nearest point of the exit used, or of the nearest exit on the level if it is not known.
  leadOut(p) {
    const row = this.lastRow[p], { x, y, level } = this.motion;
    let least = Infinity;
    const known = this.outBy[p];
    this.building.exits.forEach((exit, index) => {
      if (known >= 0 ? index !== known : exit.level !== level[row]) return;
      for (let s = 0; s < exit.segments.length; s += 6) {
        const [x1, y1, , x2, y2] = exit.segments.slice(s, s + 6).map((value) => value * this.grain);
        const along = (x2 - x1) ** 2 + (y2 - y1) ** 2;
        const share = Math.max(0, Math.min(1, ((x[row] - x1) * (x2 - x1) + (y[row] - y1) * (y2 - y1)) / along));
        const px = x1 + share * (x2 - x1), py = y1 + share * (y2 - y1);
        const off = Math.hypot(px - x[row], py - y[row]);
        if (off >= least) continue;
        least = off;
        this.outBy[p] = index;
        this.outAt.set([px, py], 2 * p);
      }
    });
    if (least === Infinity) this.outAt.set([x[row], y[row]], 2 * p);
  }

  // The last frame at or before a time.
  frameAt(time) { return Math.max(0, countUpTo(this.motion.times, time) - 1); }

  rowOf(k, p) {
    const { first, person } = this.motion;
    let low = first[k], high = first[k + 1] - 1;
    while (low <= high) {
      const middle = (low + high) >> 1;
      if (person[middle] === p) return middle;
      if (person[middle] < p) low = middle + 1; else high = middle - 1;
    }
    return -1;
  }

  // Everybody inside at a time, between two frames on the straight line; whoever leaves goes to the exit.
  at(time) {
    const { motion: { first, person, level, x, y, z, times }, now, outTime, outAt } = this;
    const k = this.frameAt(time), isLast = k + 1 >= this.frames, end = isLast ? 0 : first[k + 2];
    const shareTo = (then) => Math.min(1, (time - times[k]) / Math.max(1e-6, then - times[k])), share = isLast ? 0 : shareTo(times[k + 1]);
    let other = isLast ? 0 : first[k + 1];
    Object.assign(now, { count: 0, frame: k });
    const add = (row, at, px, py, pz, u) => {
      const i = now.count++;
      [now.person[i], now.row[i], now.level[i]] = [person[row], row, level[at]];
      [now.x[i], now.y[i], now.z[i]] = [x[row] + u * (px - x[row]), y[row] + u * (py - y[row]), z[row] + u * (pz - z[row])];
    };
    for (let row = first[k]; row < first[k + 1]; row++) {
      const p = person[row];
      while (other < end && person[other] < p) other++;
      if (other < end && person[other] === p) add(row, share > 0.5 ? other : row, x[other], y[other], z[other], share);
      else if (isLast || outTime[p] === Infinity) add(row, row, x[row], y[row], z[row], 0);
      else if (time < outTime[p]) add(row, row, outAt[2 * p], outAt[2 * p + 1], z[row], shareTo(outTime[p]));
    }
    for (const [came, row, frame] of this.comes) if (frame === k + 1 && came <= time) add(row, row, x[row], y[row], z[row], 0);
    return now;
  }

  // What is shut and marked in the building at a time.
  stateAt(time) { return this.states.findLast(({ since }) => since <= time + 1e-9); }

  // What a state makes of an exit: nothing, if everybody can leave by it.
  noteOn(exit, { notes }) { return notes[this.building.portals.length + exit] ?? ""; }
}
