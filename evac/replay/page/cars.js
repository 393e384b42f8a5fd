// The cars of lifts: where each is at a time, what it looks like, and what its label says.

// Level, height above it [m], whether the doors are open, and people inside of each car; between two frames on the straight line.
function carsAt(record, now, time) {
  const { building: { levels }, motion: { times }, grain } = record, k = now.frame, next = Math.min(k + 1, record.frames - 1);
  const share = next > k ? Math.min(1, (time - times[k]) / (times[next] - times[k])) : 0;
  return record.cars.map(({ name, capacity, tall, states }) => {
    const [from, rise, isOpen] = states[k], [to, later] = states[next], level = share > 0.5 ? to : from;
    const [low, high] = [levels[from].z[0] + grain * rise, levels[to].z[0] + grain * later];
    let people = 0;
    for (let i = 0; i < now.count; i++) if (now.level[i] === from || now.level[i] === to) people++;
    return { name, capacity, tall, level, z: low + share * (high - low), isOpen: Boolean(isOpen), people };
  });
}

// A ground and sides through which the riders are seen.
function carsMesh(layout, cars, colour) {
  const { building: { levels, vertices }, grain } = layout, values = [];
  for (const { level, z, tall, isOpen } of cars) {
    if (!layout.visible[level]) continue;
    const at = (x, y, up) => { const [px, py, pz] = layout.place(level, x, y, z); return [px, py, pz + up]; };
    for (const v of levels[level].triangles) values.push(...at(vertices[3 * v] * grain, vertices[3 * v + 1] * grain, 0.03), ...colour, isOpen ? 0.35 : 0.7);
    for (const [[x1, y1], [x2, y2]] of sidesOf(levels[level].walls, grain)) {
      pushQuad(values, [[...at(x1, y1, 0), ...colour, 0.5], [...at(x2, y2, 0), ...colour, 0.5], [...at(x2, y2, tall), ...colour, 0.2], [...at(x1, y1, tall), ...colour, 0.2]]);
    }
  }
  return values;
}

// Names and places in the picture of the cars in which somebody is, or whose doors are open; null of the others.
function carPlaces(layout, cars, isFlat) {
  return cars.map(({ name, capacity, tall, level, z, isOpen, people }) => {
    if (!layout.visible[level] || !people && !isOpen) return null;
    const { triangles } = layout.building.levels[level], { vertices } = layout.building;
    const [x, y] = [0, 1].map((i) => triangles.reduce((sum, v) => sum + vertices[3 * v + i] * layout.grain, 0) / triangles.length);
    const [px, py, pz] = layout.place(level, x, y, z);
    return { name: `${name}: ${people} of ${capacity}${isOpen ? ", open" : ""}`, at: [px, py, pz + (isFlat ? 0 : tall)] };
  });
}
