// Where everybody was: takes apart what evac/replay/motion.py has packed.

async function inflateMotion() {
  const names = ["times", "events", "steps", "heights", "speeds", "waited", "forces", "doses", "headings", "smoke", "wide"];
  const kinds = { times: Float64Array, events: Int32Array, wide: Int32Array };
  const streams = await Promise.all(names.map(async (name) => [name, new (kinds[name] ?? Uint8Array)(await inflate(name))]));
  return Object.fromEntries(streams);
}

// Rows of everybody inside, frame after frame: person, level, position [m], speed [m/s], direction in plan, time waited so
// far [s], contact force [N], dose if there is one, and whether the response time is over. `first` has the first row of
// each frame, and the number of all rows at the end.
function unpackMotion(streams, { building: { levels }, group, grain, pace, moment, part }) {
  const { times, events, steps, heights, headings, wide } = streams, people = group.length, rows = streams.speeds.length;
  const floats = (count) => new Float32Array(count), whole = () => new Int32Array(people), bytes = () => new Uint8Array(people);
  const motion = {
    times, first: new Uint32Array(times.length + 1), started: new Uint8Array(rows), heading: new Uint8Array(rows),
    person: new Uint32Array(rows), level: new Uint16Array(rows), x: floats(rows), y: floats(rows), z: floats(rows),
    speed: floats(rows), waited: floats(rows), force: floats(rows), dose: floats(streams.doses.length),
  };
  const levelOf = whole().fill(-1), seen = bytes(), begun = bytes(), turned = bytes(), { first } = motion;
  const codes = ["speeds", "waited", "forces", "doses"].map((name) => [streams[name], whole()]);
  const last = [whole(), whole()], before = [whole(), whole()];
  let event = 0, step = 0, lift = 0, wider = 0, turn = 0;
  const number = (byte) => byte === 255 ? wide[wider++] : byte & 1 ? -(byte + 1) / 2 : byte / 2;

  for (let k = 0; k < times.length; k++) {
    const changed = events[event++];
    for (let i = 0; i < changed; i++) levelOf[events[event + i]] = events[event + changed + i];
    event += 2 * changed;
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
    first[k + 1] = row;
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
      const level = levels[motion.level[row]], [c, a, b] = level.plane;
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
