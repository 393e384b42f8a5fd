// The section: storeys as bars above each other, and beside them the stairs, unfolded.

const BAR_SHARE = 0.72;  // Of the distance between storeys, the height of a bar.
const LEAST_PITCH = 3.2;  // Between storeys [m in the picture].
const SHAFT_GAP = 2;  // [m]

// Gives each level x and y in the picture from those in plan, for a picture of an aspect.
function unfold(layout, aspect) {
  const { building: { levels }, extent, box, storeys } = layout, isAcross = extent[0] >= extent[1];
  const [wide, deep] = isAcross ? extent : [extent[1], extent[0]], shafts = findShafts(layout);
  const whole = wide + shafts.reduce((sum, shaft) => sum + SHAFT_GAP + shaft.width, 0);
  const pitch = Math.max(LEAST_PITCH, Math.min(deep / BAR_SHARE, whole / aspect / storeys.length)), flat = BAR_SHARE * pitch / deep;
  layout.pitch = pitch;
  levels.forEach((level, index) => {
    const low = level.storey * pitch;
    layout.frames[index] = isAcross ? [[1, 0, -box[0]], [0, flat, low - flat * box[1]]] : [[0, 1, -box[1]], [-flat, 0, low + flat * box[2]]];
  });
  let left = wide;
  for (const { stairs, width } of shafts) {
    left += SHAFT_GAP;
    for (const stair of stairs) unfoldStair(layout, stair, [left, left + width], pitch);
    left += width;
  }
}

// Stairs above each other are one shaft, as wide as the longest of them is long.
function findShafts(layout) {
  const { building: { stairs, levels } } = layout, shafts = new Map();
  for (const { shaft, levels: own } of stairs) {
    const parts = own.filter((index) => levels[index].kind !== "floor").sort((a, b) => levels[a].z[0] + levels[a].z[1] - levels[b].z[0] - levels[b].z[1]);
    if (!parts.length) continue;
    const pieces = parts.map((index, k) => pieceOf(layout, parts, k)), width = pieces.reduce((sum, { span: [low, high] }) => sum + high - low, 0);
    if (!shafts.has(shaft)) shafts.set(shaft, { stairs: [], width: 0 });
    shafts.get(shaft).stairs.push(pieces);
    shafts.get(shaft).width = Math.max(shafts.get(shaft).width, width);
  }
  return [...shafts.values()];
}

// The direction in which a part of a stair is walked up, its length along it, and the middle across it.
function pieceOf({ building: { portals, levels, vertices }, grain }, parts, k) {
  const index = parts[k], { plane: [, a, b], triangles } = levels[index];
  const middle = (other) => {
    const portal = portals.find(({ levels: pair }) => pair.includes(index) && pair.includes(other));
    return portal && [0, 1].map((i) => (portal.segments[i] + portal.segments[portal.segments.length - 3 + i]) / 2 * grain);
  };
  const from = middle(parts[k - 1]), to = middle(parts[k + 1]);
  const [dx, dy] = Math.hypot(a, b) > 0.01 ? [a, b] : from && to ? [to[0] - from[0], to[1] - from[1]] : [1, 0], length = Math.hypot(dx, dy) || 1;
  const along = [dx / length, dy / length], across = [-along[1], along[0]];
  const reach = (axis) => {
    const values = triangles.map((v) => (vertices[3 * v] * axis[0] + vertices[3 * v + 1] * axis[1]) * grain);
    return [Math.min(...values), Math.max(...values)];
  };
  const [low, high] = reach(across);
  return { index, along, across, span: reach(along), middle: (low + high) / 2 };
}

// Puts the parts of a stair one after the other, up to the right and, in every other storey, up to the left.
function unfoldStair(layout, pieces, [left, right], pitch) {
  const { building: { levels }, storeys } = layout, { storey } = levels[pieces[0].index], low = storeys[storey].z;
  const rise = pitch / ((storeys[storey + 1]?.z ?? levels[pieces.at(-1).index].z[1]) - low || 1), bottom = storey * pitch + pitch * BAR_SHARE / 2;
  const stretch = (right - left) / pieces.reduce((sum, { span }) => sum + span[1] - span[0], 0), sign = storey % 2 ? -stretch : stretch;
  let at = storey % 2 ? right : left;
  for (const { index, along, across, span, middle } of pieces) {
    const [c, a, b] = levels[index].plane;
    layout.frames[index] = [
      [sign * along[0], sign * along[1], at - sign * span[0]],
      [rise * a + across[0], rise * b + across[1], bottom + rise * (c - low) - middle],
    ];
    at += sign * (span[1] - span[0]);
  }
}
