// The first view: of several, the one in which most of the people of the run are seen well.

const TIMES = 8, PEOPLE_EACH = 16;  // Looked at.
const TURNS = [0.35, -0.35, 0.8, -0.8, 1.2, -1.2];  // From the plan, so that the same sides lie at the left and at the right [rad].
const TILTS = [0.45, 0.7, 1];  // [rad]
const CLEARANCES = [0.3, 0.6, 1];  // Shares of a storey that the one above leaves free.
const SEEN = [1, 0.6, 0.1];  // How well people are seen behind no, one and two floors.
const SIZE_COUNTS = 0.35;  // Exponent: how much it counts that people are large in the picture.

// Level, place and height of people at times over the whole run.
function witnesses(record) {
  const found = [];
  for (let t = 0; t < TIMES; t++) {
    const now = record.at(record.begin + (record.end - record.begin) * t / TIMES), by = Math.ceil(now.count / PEOPLE_EACH);
    for (let i = 0; i < now.count; i += by) found.push([now.level[i], now.x[i], now.y[i], now.z[i], record.height[now.person[i]] / 1000]);
  }
  return found;
}

// Number of floors and flights between the eye and a point in the picture, counted up to a number.
function floorsBefore(layout, density, eye, [x, y, z], most) {
  const [dx, dy, dz] = [eye[0] - x, eye[1] - y, eye[2] - z], { base, spread, visible, building: { levels } } = layout;
  let count = 0;
  for (let index = 0; index < levels.length && count < most; index++) {
    const [c, a, b] = levels[index].plane, above = base + (c + a * x + b * y - base) * spread - z;
    if (above <= 0.1 || !visible[index]) continue;
    const way = above / (dz - spread * (a * dx + b * dy));
    if (way > 0 && way < 1 && density.isFloor(index, x + way * dx, y + way * dy)) count++;
  }
  return count;
}

// Sets the camera and the spread of the layout to the best view, and returns how well people are seen in it.
function chooseView(camera, layout, density, record) {
  const crowd = witnesses(record);
  let best = { score: -1 };
  for (const tilt of layout.storeys.length > 1 ? TILTS : [0.95]) for (const turn of TURNS) {
    Object.assign(camera, { tilt, azimuth: turn, isFlat: false });
    for (const spread of new Set(CLEARANCES.map((share) => layout.spreadFor(camera, share)))) {
      layout.arrange("3d", -1, spread, camera.aspect);
      camera.fit(layout.corners(), 1);
      const weight = camera.size ** -SIZE_COUNTS;
      if (weight <= best.score) continue;  // Even if everybody were seen.
      const seen = crowd.reduce((sum, [level, x, y, z, tall]) => {
        const [px, py, pz] = layout.place(level, x, y, z);
        return sum + (SEEN[floorsBefore(layout, density, camera.position, [px, py, pz + 0.9 * tall], SEEN.length)] ?? 0);
      }, 0) / (crowd.length || 1);
      const score = seen * weight;
      if (score > best.score * (1 + 1e-9)) best = { score, seen, tilt, azimuth: camera.azimuth, spread };
    }
  }
  Object.assign(camera, { tilt: best.tilt, azimuth: best.azimuth });
  return best;
}
