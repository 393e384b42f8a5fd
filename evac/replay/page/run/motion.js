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
  const { first, person, level, x, y, z, heading } = motion, levelOf = whole().fill(-1), seen = bytes(), begun = bytes(), turned = bytes();
  const places = [[x, Math.cos], [y, Math.sin]].map(([target, share]) => {
    const toward = Int32Array.from({ length: 256 }, (_, turn) => Math.round(1000 * share(turn * Math.PI / 128)));
    return { target, toward, last: whole(), velocity: new Float64Array(people) };
  });
  const codes = [["speeds", motion.speed, (code) => pace * code], ["waited", motion.waited, (code) => moment * code],
                 ["forces", motion.force, forceOf], ["doses", motion.dose, (code) => part * code]]
    .map(([name, target, of]) => ({ bytes: streams[name], target, of, last: whole() })).filter((one) => one.bytes.length);
  let event = 0, step = 0, lift = 0, wider = 0, turn = 0;
  const number = (byte) => byte === 255 ? wide[wider++] : byte & 1 ? -(byte + 1) / 2 : byte / 2;

  for (let k = 0; k < times.length; k++) {
    const changed = events[event++];
    for (let i = 0; i < changed; i++) levelOf[events[event + i]] = events[event + changed + i];
    event += 2 * changed;
    const other = events[event++];
    for (let i = 0; i < other; i++) begun[events[event + i]] ^= 1;
    event += other;

    const from = first[k];
    let end = from;
    for (let p = 0; p < people; p++) {
      if (levelOf[p] < 0) continue;
      person[end] = p;
      motion.started[end] = begun[p];
      level[end++] = levelOf[p];
    }
    first[k + 1] = end;
    for (const { bytes, target, of, last } of codes) {
      for (let row = from; row < end; row++) target[row] = of(last[person[row]] += number(bytes[row]));
    }
    const speeds = codes[0].last;
    for (let row = from; row < end; row++) {
      if (speeds[person[row]]) turned[person[row]] += headings[turn++];
      heading[row] = turned[person[row]];
    }
    const share = k ? (times[k] - times[k - 1]) * (pace / grain / 2000) : 0;
    for (const { target, toward, last, velocity } of places) {
      for (let row = from; row < end; row++) {
        const p = person[row], before = velocity[p];
        velocity[p] = speeds[p] * toward[turned[p]];
        if (seen[p]) last[p] += Math.floor(share * (before + velocity[p]) + 0.5);
        last[p] += number(steps[step++]);
        target[row] = grain * (last[p] + 0.5);
      }
    }
    for (let row = from; row < end; row++) {
      const { plane, uneven } = levels[level[row]];
      seen[person[row]] = 1;
      z[row] = plane[0] + plane[1] * x[row] + plane[2] * y[row];
      if (uneven) z[row] += grain * number(heights[lift++]);
    }
  }
  return motion;
}

// Contact force of a code, with two significant digits [N].
const forceOf = (code) => code ? (10 + (code - 1) % 90) * 10 ** Math.floor((code - 1) / 90) : 0;
