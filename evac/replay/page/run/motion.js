// Where everybody was: takes apart what evac/replay/motion.py has packed.

async function inflateMotion() {
  const names = ["times", "events", "steps", "heights", "speeds", "waited", "forces", "doses", "headings", "smoke", "wide"];
  const kinds = { times: Float64Array, events: Int32Array, wide: Int32Array };
  const streams = await Promise.all(names.map(async (name) => [name, new (kinds[name] ?? Uint8Array)(await inflate(name))]));
  return Object.fromEntries(streams);
}

// The first row of each frame, and the number of all rows at the end.
function firstRows(streams) {
  const first = new Uint32Array(streams.times.length + 1);
  const events = streams.events;
  let at = 0, inside = 0;
  for (let k = 0; k + 1 < first.length; k++) {
    const entered = events[at];
    const gone = events[at += 1 + 2 * entered];
    at += 1 + gone;
    at += 1 + 2 * events[at];
    at += 1 + events[at];
    inside += entered - gone;
    first[k + 1] = first[k] + inside;
  }
  return first;
}

// Rows of everybody inside, frame after frame: person, level, position [m], speed [m/s], direction in plan, time waited so
// far [s], contact force [N], dose if there is one, and whether the response time is over.
function unpackMotion(streams, { building: { levels }, group, grain, pace, moment, part }) {
  const people = group.length;
  const first = firstRows(streams);
  const rows = first[first.length - 1];
  const motion = {
    times: streams.times, first, started: new Uint8Array(rows), heading: new Uint8Array(rows),
    person: new Uint32Array(rows), level: new Uint16Array(rows),
    x: new Float32Array(rows), y: new Float32Array(rows), z: new Float32Array(rows),
    speed: new Float32Array(rows), waited: new Float32Array(rows), force: new Float32Array(rows),
    dose: new Float32Array(streams.doses.length),
  };
  const { events, steps, heights, headings, wide } = streams;
  const levelOf = new Int32Array(people).fill(-1);
  const seen = new Uint8Array(people);
  const begun = new Uint8Array(people), turned = new Uint8Array(people);
  const codes = ["speeds", "waited", "forces", "doses"].map((name) => [streams[name], new Int32Array(people)]);
  const last = [new Int32Array(people), new Int32Array(people)];
  const before = [new Int32Array(people), new Int32Array(people)];
  let event = 0, step = 0, lift = 0, wider = 0, turn = 0;
  const number = (byte) => byte === 255 ? wide[wider++] : byte & 1 ? -(byte + 1) / 2 : byte / 2;

  for (let k = 0; k + 1 < first.length; k++) {
    const entered = events[event++];
    for (let i = 0; i < entered; i++) levelOf[events[event + i]] = events[event + entered + i];
    event += 2 * entered;
    const gone = events[event++];
    for (let i = 0; i < gone; i++) levelOf[events[event + i]] = -1;
    event += gone;
    const moved = events[event++];
    for (let i = 0; i < moved; i++) levelOf[events[event + i]] = events[event + moved + i];
    event += 2 * moved;
    const other = events[event++];
    for (let i = 0; i < other; i++) begun[events[event + i]] ^= 1;
    event += other;

    let row = first[k];
    for (let p = 0; p < people; p++) {
      if (levelOf[p] < 0) continue;
      motion.person[row] = p;
      motion.started[row] = begun[p];
      motion.level[row++] = levelOf[p];
    }
    for (const axis of [0, 1]) {
      const target = axis ? motion.y : motion.x;
      for (row = first[k]; row < first[k + 1]; row++) {
        const p = motion.person[row];
        const expected = seen[p] > 1 ? 2 * last[axis][p] - before[axis][p] : seen[p] ? last[axis][p] : 0;
        before[axis][p] = last[axis][p];
        last[axis][p] = expected + number(steps[step++]);
        target[row] = grain * (last[axis][p] + 0.5);
      }
    }
    for (row = first[k]; row < first[k + 1]; row++) {
      const level = levels[motion.level[row]];
      const [c, a, b] = level.plane;
      if (seen[motion.person[row]] < 2) seen[motion.person[row]]++;
      motion.z[row] = c + a * motion.x[row] + b * motion.y[row];
      if (level.uneven) motion.z[row] += grain * number(heights[lift++]);
    }
    const [speeds, waited, forces, doses] = codes.map(([bytes, last]) => {
      for (row = first[k]; row < first[k + 1]; row++) last[motion.person[row]] += number(bytes[row] ?? 0);
      return last;
    });
    for (row = first[k]; row < first[k + 1]; row++) {
      const p = motion.person[row];
      motion.speed[row] = pace * speeds[p];
      motion.waited[row] = moment * waited[p];
      motion.force[row] = forceOf(forces[p]);
      motion.dose[row] = part * doses[p];  // Nothing is kept where there are no doses.
      if (speeds[p]) turned[p] += headings[turn++];
      motion.heading[row] = turned[p];
    }
  }
  return motion;
}

// Contact force of a code, with two significant digits [N].
const forceOf = (code) => code ? (10 + (code - 1) % 90) * 10 ** Math.floor((code - 1) / 90) : 0;
