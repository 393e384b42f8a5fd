// Where a point goes: to corners, to lines with corners and with the last point, to walls, to angles, to a grid.

const REACH = 9;  // [pixels]
const GRID = 0.1;  // [m]
const ANGLES = 8;  // Directions of lines that are drawn, in a full circle.
const SHORTEST = 0.3;  // Of walls with doors, and of doors that are dragged along them [m].
const NEAR_WALL = 0.6;  // So far from a wall, a door is put on it [m].

const onGrid = (value) => mm(Math.round(value / GRID) * GRID);

// The place, and the lines on which it is: `[0, x]` and `[1, y]`. `from` is the last point of what is drawn.
function snapped(point, corners, walls, zoom, from = null) {
  const reach = REACH / zoom;
  let best = null, least = reach;
  for (const corner of corners) {
    const away = length(minus(corner, point));
    if (away < least) [best, least] = [corner, away];
  }
  if (best) return { at: best.slice(0, 2), lines: [] };
  const at = [...point], lines = [];
  for (const i of [0, 1]) {
    let near = reach;
    for (const corner of from ? [from, ...corners] : corners) {
      const away = Math.abs(corner[i] - point[i]);
      if (away < near) [near, at[i]] = [away, corner[i]];
    }
    if (near < reach) lines.push([i, at[i]]);
  }
  if (lines.length === 2) return { at, lines };
  const wall = walls.map((side) => nearest(lines.length ? at : point, side)).filter(({ away }) => away < reach).sort((a, b) => a.away - b.away)[0];
  if (wall && !lines.length) return { at: wall.at.map(mm), lines };
  if (from && !lines.length) {
    const way = minus(point, from), far = length(way), angle = Math.round(Math.atan2(way[1], way[0]) / (2 * Math.PI) * ANGLES) * 2 * Math.PI / ANGLES;
    const end = plus(from, [far * Math.cos(angle), far * Math.sin(angle)]);
    if (length(minus(end, point)) < reach) return { at: end, lines: [] };
  }
  const held = lines.map(([i]) => i);
  return { at: at.map((value, i) => held.includes(i) ? value : onGrid(value)), lines };
}

// The wall that is nearest to a point, and where on it the point is.
const wallAt = (point, walls) => walls.map((side) => ({ side, ...nearest(point, side) })).filter(({ away, whole }) => away < NEAR_WALL && whole > SHORTEST).sort((a, b) => a.away - b.away)[0];

// A line of a width on the wall that is nearest to a point, within the wall; null if there is none.
function onWall(point, walls, width) {
  const best = wallAt(point, walls);
  if (!best) return null;
  const half = Math.min(width, best.whole - 0.1) / 2, along = Math.max(half + 0.05, Math.min(best.whole - half - 0.05, onGrid(best.along)));
  return [along - half, along + half].map((way) => best.side[0].map((value, i) => mm(value + way * best.step[i])));
}

// The lines on walls from one point to another, along the wall that is nearest to the first: one on the wall of each room.
function spanned(from, to, walls) {
  const first = wallAt(from, walls);
  if (!first) return [];
  const { step: [x, y], side: [start] } = first, along = (point) => { const [dx, dy] = minus(point, start); return dx * x + dy * y; };
  const [low, high] = range([from, to], (point) => onGrid(along(point))), found = [];
  const isOnLine = (point) => { const [dx, dy] = minus(point, start); return Math.abs(dx * y - dy * x) < 0.02; };
  for (const face of walls.filter((side) => side.every(isOnLine)).sort((a, b) => length(minus(...a)) - length(minus(...b)))) {
    const [a, b] = range(face, along), own = [Math.max(low, a + 0.05), Math.min(high, b - 0.05)];
    if (own[1] - own[0] >= SHORTEST && found.every((one) => own[1] < one[0] + 0.1 || own[0] > one[1] - 0.1)) found.push(own);
  }
  return found.sort(([a], [b]) => a - b).map((ends) => ends.map((at) => [mm(start[0] + at * x), mm(start[1] + at * y)]));
}
