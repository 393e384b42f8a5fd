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
    this.now = this.room(this.people);
  }

  room(count) {
    const floats = () => new Float32Array(count);
    return { count: 0, person: new Uint32Array(count), row: new Uint32Array(count), level: new Uint16Array(count),
             x: floats(), y: floats(), z: floats() };
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
    const { motion, now } = this;
    const { first, person, level, x, y, z, times } = motion;
    const k = this.frameAt(time);
    const isLast = k + 1 >= this.frames;
    const span = isLast ? 1 : times[k + 1] - times[k];
    const share = isLast ? 0 : Math.min(1, (time - times[k]) / span);
    let other = isLast ? 0 : first[k + 1], count = 0;
    const end = isLast ? 0 : first[k + 2];
    for (let row = first[k]; row < first[k + 1]; row++) {
      const p = person[row];
      while (other < end && person[other] < p) other++;
      let next = row, u = 0;
      now.level[count] = level[row];
      if (other < end && person[other] === p) {
        next = other;
        u = share;
        if (share > 0.5) now.level[count] = level[next];
      } else if (!isLast && time >= this.outTime[p]) continue;
      now.person[count] = p;
      now.row[count] = row;
      if (next === row && !isLast && this.outTime[p] < Infinity) {
        u = Math.min(1, (time - times[k]) / Math.max(1e-6, this.outTime[p] - times[k]));
        now.x[count] = x[row] + u * (this.outAt[2 * p] - x[row]);
        now.y[count] = y[row] + u * (this.outAt[2 * p + 1] - y[row]);
        now.z[count++] = z[row];
        continue;
      }
      now.x[count] = x[row] + u * (x[next] - x[row]);
      now.y[count] = y[row] + u * (y[next] - y[row]);
      now.z[count++] = z[row] + u * (z[next] - z[row]);
    }
    for (const [came, row, frame] of this.comes) {
      if (frame !== k + 1 || came > time) continue;
      now.person[count] = person[row];
      now.row[count] = row;
      now.level[count] = level[row];
      now.x[count] = x[row];
      now.y[count] = y[row];
      now.z[count++] = z[row];
    }
    now.count = count;
    now.frame = k;
    return now;
  }

  // What is shut and marked in the building at a time.
  stateAt(time) { return this.states.findLast(({ since }) => since <= time + 1e-9); }

  // What a state makes of an exit: nothing, if people can leave by it.
  noteOn(exit, { shut, entrances }) {
    const link = this.building.portals.length + exit;
    return entrances.includes(link) ? "entrance only" : shut.includes(link) ? "closed" : "";
  }
}
