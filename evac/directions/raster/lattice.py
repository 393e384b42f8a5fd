"""The common lattice of grid nodes of a building, and its links that are crossed by segments.

Operations on masks of nodes agree with `scipy.ndimage`, whose import takes longer than computing the directions of
small buildings. In strips of nodes behind exits marching starts, so that paths pass the posts of exits at a distance.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import BoolArray, FloatArray, IndexArray
from evac.building.geometry import connected_components, side_of

#: Rounding tolerance of positions on the lattice, in cells.
SLACK = 1e-6


@dataclass(frozen=True)
class Lattice:
    """Nodes at anchor + spacing * (i, j) in plan; every level's grid is a window of it.

    The anchor is the corner of the building, so that walls and corners with round coordinates are on
    nodes. Such nodes are walkable, so that paths pass such corners exactly.
    """

    anchor: tuple[float, float]  # position (x, y) of node (0, 0) [m]
    spacing: float  # distance of neighbouring nodes [m]

    def window(self, bounds: Iterable[float], margin: int) -> "Window":
        """Return the window of the box (x_min, y_min, x_max, y_max) with `margin` nodes around it."""
        low, high = (np.reshape([*bounds], (2, 2)) - self.anchor) / self.spacing
        first, last = np.floor(low).astype(int) - margin, np.ceil(high).astype(int) + margin
        shape = last - first + 1
        return Window(self, (int(first[0]), int(first[1])), (int(shape[0]), int(shape[1])))


@dataclass(frozen=True)
class Window:
    """A rectangular part of a lattice, given by its first node and its numbers of nodes."""

    lattice: Lattice
    first: tuple[int, int]
    shape: tuple[int, int]

    @property
    def origin(self) -> FloatArray:
        """Plan position (2,) of the first node [m]."""
        return np.array(self.lattice.anchor) + self.lattice.spacing * np.array(self.first)

    def coordinates(self, box: tuple[slice, slice] = (slice(None), slice(None))) -> tuple[FloatArray, FloatArray]:
        """Return x and y of the nodes in a box, or of all, each of its shape [m]; both are views and read-only."""
        along = [
            start + self.lattice.spacing * np.arange(number)[part]
            for start, number, part in zip(self.origin, self.shape, box, strict=True)
        ]
        x, y = np.broadcast_arrays(along[0][:, None], along[1][None, :])
        return x, y

    def places(self, nodes: IndexArray) -> FloatArray:
        """Return the plan positions (n, 2) of nodes, given by their indices (n, 2) [m]."""
        return np.asarray(self.origin + self.lattice.spacing * nodes)

    def part(self, box: tuple[slice, slice]) -> "Window":
        """Return the nodes in a box as a window."""
        first = self.first[0] + box[0].start, self.first[1] + box[1].start
        return Window(self.lattice, first, (box[0].stop - box[0].start, box[1].stop - box[1].start))

    def box(self, low: FloatArray, high: FloatArray) -> tuple[slice, slice]:
        """Return the slices of the nodes in a box, given by its lower and upper corners (2,) [m]."""
        first = np.maximum(np.ceil((low - self.origin) / self.lattice.spacing), 0.0).astype(int)
        last = np.floor((high - self.origin) / self.lattice.spacing).astype(int)
        ends = np.minimum(np.maximum(first, last + 1), self.shape)
        first = np.minimum(first, ends)
        return slice(first[0], ends[0]), slice(first[1], ends[1])

    def box_around(self, segments: FloatArray, reach: float) -> tuple[slice, slice]:
        """Return the slices of a box that holds all nodes no farther than `reach` from segments (s, 4) [m]."""
        ends = segments.reshape(-1, 2)
        slack = reach + SLACK * self.lattice.spacing
        return self.box(ends.min(axis=0) - slack, ends.max(axis=0) + slack)

    def around(self, lines: NDArray[Any], reach: float) -> "BoolArray":
        """Mark the nodes in boxes around lines (l,), which contain all nodes within `reach` [m] of a line."""
        near = np.zeros(self.shape, dtype=np.bool_)
        slack = reach + SLACK * self.lattice.spacing
        for bounds in shapely.bounds(lines):
            near[self.box(bounds[:2] - slack, bounds[2:] + slack)] = True
        return near

    def overlap(self, other: "Window") -> tuple[tuple[slice, slice], tuple[slice, slice]]:
        """Return the slices of the common nodes, in this window and in the other one."""
        here, there = [], []
        for axis in (0, 1):
            low = max(self.first[axis], other.first[axis])
            high = max(low, min(self.first[axis] + self.shape[axis], other.first[axis] + other.shape[axis]))
            here.append(slice(low - self.first[axis], high - self.first[axis]))
            there.append(slice(low - other.first[axis], high - other.first[axis]))
        return (here[0], here[1]), (there[0], there[1])

    def crossed_links(self, segments: FloatArray, axis: int, *, touching: bool) -> "Links":
        """Return the links along an axis (0: x, 1: y) that segments (s, 4) [m] cross.

        `touching`: a segment through the end of a link counts as crossing it.
        """
        cells = (np.asarray(segments, dtype=np.float64).reshape(-1, 2, 2) - self.origin) / self.lattice.spacing
        node, fraction = _crossings(self.shape, cells, axis, touching)
        # Of several segments that cross a link the last one counts.
        number, last = np.unique(np.ravel_multi_index(node, self.shape)[::-1], return_index=True)
        i, j = np.unravel_index(number, self.shape)
        return Links((i, j), (i + 1, j) if axis == 0 else (i, j + 1), fraction[::-1][last])


@dataclass(frozen=True)
class Links:
    """Links between neighbouring nodes that segments cross, each once."""

    # near, far: (c,) int64, (c,) int64: first and second indices of the nodes at their ends
    near: tuple[IndexArray, IndexArray]
    far: tuple[IndexArray, IndexArray]
    fraction: FloatArray  # (c,) float64: share of each link, from its near end, at the crossing

    def some(self, which: BoolArray) -> "Links":
        """Return some of the links."""
        near, far = ((i[which], j[which]) for i, j in (self.near, self.far))
        return Links(near, far, self.fraction[which])


def _crossings(
    shape: tuple[int, int], segments: FloatArray, axis: int, touching: bool
) -> tuple[tuple[IndexArray, IndexArray], FloatArray]:
    """Return the links along `axis` that segments (s, 2, 2), in cells, cross, in their order: near ends, fractions."""
    across = 1 - axis
    segments = segments[np.abs(segments[:, 1, across] - segments[:, 0, across]) >= SLACK]
    low = np.maximum(np.ceil(segments[:, :, across].min(axis=1) - SLACK), 0)
    high = np.minimum(np.floor(segments[:, :, across].max(axis=1) + SLACK), shape[across] - 1)
    owner, rows = numbers_between(low, high)
    start, end = segments[owner, 0], segments[owner, 1]
    share = np.clip((rows - start[:, across]) / (end[:, across] - start[:, across]), 0.0, 1.0)
    along = start[:, axis] + share * (end[:, axis] - start[:, axis])
    link = np.floor(along + SLACK).astype(np.int64)
    fraction = np.clip(along - link, 0.0, 1.0)
    at_node = fraction < 2.0 * SLACK
    if touching:
        # A segment through a node crosses the links on both sides of it.
        order = np.argsort(np.concatenate((owner, owner[at_node])), kind="stable")
        link, rows, fraction = (
            np.concatenate((link, link[at_node] - 1))[order],
            np.concatenate((rows, rows[at_node]))[order],
            np.concatenate((fraction, np.ones(int(at_node.sum()))))[order],
        )
    else:
        link, rows, fraction = link[~at_node], rows[~at_node], fraction[~at_node]
    kept = (link >= 0) & (link < shape[axis] - 1)
    return (link[kept], rows[kept]) if axis == 0 else (rows[kept], link[kept]), fraction[kept]


def numbers_between(first: FloatArray, last: FloatArray) -> tuple[IndexArray, IndexArray]:
    """Return the concatenated ranges from `first` (r,) to `last` (r,), preceded by the range index of each number."""
    count = np.maximum(last - first + 1.0, 0.0).astype(np.int64)
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) + (first.astype(np.int64) - np.cumsum(count) + count)[owner]


def walkable_nodes(window: Window, polygon: BaseGeometry, walls: FloatArray) -> tuple[BoolArray, IndexArray]:
    """Return the mask (nx, ny) of the nodes that are used for marching on a level, and those that represent the others.

    Marching couples neighbouring nodes, so it would pass a wall thinner than a cell unless every link through the wall
    loses one end. The end nearer to the wall is excluded, which is at most half a cell from it, so that no door is
    closed. A wall exactly one cell thick, with both faces on nodes, loses the nodes of one face. No link passes between
    two walls that touch in a point.

    The latter are flat indices (3, m) of an excluded node of the level, of the visible node beside it that represents
    it, and of the next node in line, or again of the representing node if that one is excluded. Walls are (w, 4) [m].
    """
    slack = SLACK * window.lattice.spacing
    grown = shapely.buffer(polygon, slack, join_style="mitre")
    shapely.prepare(grown)
    inside: BoolArray = np.asarray(shapely.intersects_xy(grown, *window.coordinates()), dtype=np.bool_)
    slits, pinches = _slits(polygon, walls, slack), _pinches(polygon, slack)
    left_out = np.zeros_like(inside)
    for axis in (0, 1):
        outline, within, pinched = (
            links.some(inside[links.near] & inside[links.far])
            for links in (
                window.crossed_links(_outline(polygon), axis, touching=True),
                window.crossed_links(slits, axis, touching=False),
                window.crossed_links(_crosses_at(pinches, slack), axis, touching=True),
            )
        )
        ends = [window.places(np.stack(nodes, axis=-1)) for nodes in (outline.near, outline.far)]
        leaves = ~shapely.covers(grown, shapely.linestrings(np.stack(ends, axis=1)))
        for links in (outline.some(leaves), within, pinched):
            at_near = links.fraction <= 0.5
            left_out[links.some(at_near).near] = True
            left_out[links.some(~at_near).far] = True
    # Also the nodes on a slit and at its ends on the outline, where its surroundings were removed from it.
    reach = 10.0 * slack
    for slit in slits:
        box = window.box_around(slit, reach)
        near = shapely.dwithin(shapely.LineString(slit.reshape(2, 2)), shapely.points(*window.coordinates(box)), reach)
        left_out[box] |= near
    nodes = inside & ~left_out
    ground = shapely.difference(grown, shapely.buffer(shapely.multipoints(pinches), reach))
    return nodes, _stand_ins(window, inside & left_out, nodes, ground, slits)


def _outline(polygon: BaseGeometry) -> FloatArray:
    """Return the sides (s, 4) of a polygon or multipolygon."""
    rings = [shapely.get_coordinates(ring) for ring in shapely.get_rings(shapely.get_parts(polygon))]
    return np.concatenate([np.concatenate([ring[:-1], ring[1:]], axis=1) for ring in rings])


def _pinches(polygon: BaseGeometry, slack: float) -> FloatArray:
    """Return the points (p, 2) in which the outline touches itself, where nobody can pass."""
    sides = _outline(polygon)
    corners = np.unique(sides[:, :2], axis=0)
    lines = shapely.STRtree(shapely.linestrings(sides.reshape(-1, 2, 2)))
    corner, _ = lines.query(shapely.points(corners), predicate="dwithin", distance=slack)
    # A simple corner of an outline has two sides.
    return corners[np.bincount(corner, minlength=len(corners)) > 2]


def _crosses_at(points: FloatArray, size: float) -> FloatArray:
    """Return two small diagonal segments (2 p, 4) at each point, which cross the grid lines in both directions."""
    across, along = np.array([size, 0.0]), np.array([0.0, size])
    arms = [np.concatenate([points - arm, points + arm], axis=1) for arm in (across, along)]
    return np.concatenate(arms)


def _stand_ins(
    window: Window, left_out: BoolArray, nodes: BoolArray, ground: BaseGeometry, slits: FloatArray
) -> IndexArray:
    """Return flat indices (3, m) of excluded nodes, the nearest visible node of each, and the next node in line."""
    shapely.prepare(ground)
    barrier = shapely.multilinestrings(shapely.linestrings(slits.reshape(-1, 2, 2)))
    shapely.prepare(barrier)
    pairs = []
    waiting = np.argwhere(left_out)
    for step in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        beside = waiting + step
        has_node = nodes[tuple(beside.T)]
        one, two = waiting[has_node], beside[has_node]
        sight = shapely.linestrings(np.stack([window.places(one), window.places(two)], axis=1))
        clear = shapely.covers(ground, sight) & ~shapely.crosses(barrier, sight)
        one, two = one[clear], two[clear]
        three = two + step
        # Along a diagonal, there may be a wall between two nodes.
        in_line = nodes[tuple(three.T)] & (0 in step)
        three = np.where(in_line[:, None], three, two)
        pairs.append([np.ravel_multi_index(tuple(index.T), nodes.shape) for index in (one, two, three)])
        settled = np.zeros(len(waiting), dtype=bool)
        settled[np.flatnonzero(has_node)[clear]] = True
        waiting = waiting[~settled]
    return np.concatenate([np.array(part, dtype=np.int64).reshape(3, -1) for part in pairs], axis=1)


def _slits(polygon: BaseGeometry, walls: FloatArray, slack: float) -> FloatArray:
    """Return the parts (s, 4) of walls that are not on the outline, with the level on both sides."""
    # They are longer than what is left outside the surroundings of the outline, so that a link through their end
    # crosses them whatever the rounding.
    sides, outline = shapely.linestrings(walls.reshape(-1, 2, 2)), shapely.buffer(polygon.boundary, slack)
    shapely.prepare(outline)
    rest = shapely.difference(sides[~shapely.covers(outline, sides)], outline)
    lines = [shapely.get_coordinates(part)[[0, -1]] for part in shapely.get_parts(rest) if part.length > slack]
    ends = np.array(lines, dtype=np.float64).reshape(-1, 2, 2)
    along = ends[:, 1] - ends[:, 0]
    along *= 4.0 * slack / np.linalg.norm(along, axis=1, keepdims=True)
    return np.concatenate([ends[:, 0] - along, ends[:, 1] + along], axis=1)


def wall_distance(window: Window, nodes: IndexArray, walls: FloatArray, reach: float) -> FloatArray:
    """Return the distance (n,) of nodes with indices (n, 2) from the nearest wall, at most `reach` [m]."""
    distance = np.full(len(nodes), reach)
    points = shapely.points(window.places(nodes))
    lines = shapely.linestrings(walls.reshape(-1, 2, 2))
    # There are far fewer walls than nodes, so nodes are searched around walls.
    wall, near = shapely.STRtree(points).query(lines, predicate="dwithin", distance=reach)
    np.minimum.at(distance, near, shapely.distance(points[near], lines[wall]))
    return distance


def parts_of(nodes: BoolArray) -> IndexArray:
    """Return the component (n,) of each marked node, with 4-connectivity."""
    run = np.cumsum(_first_of_runs(nodes), dtype=np.int32).reshape(nodes.shape) - 1
    meet = _first_of_runs(nodes[:-1] & nodes[1:])
    pairs = np.stack([run[:-1][meet], run[1:][meet]], axis=1, dtype=np.int64)
    part: IndexArray = connected_components(int(run.max(initial=-1)) + 1, pairs)[run[nodes]]
    return part


def _first_of_runs(nodes: BoolArray) -> BoolArray:
    """Mark the marked nodes (nx, ny) behind which, along the second axis, there is none."""
    first = nodes.copy()
    first[:, 1:] &= ~nodes[:, :-1]
    return first


def grown(nodes: BoolArray, steps: int) -> BoolArray:
    """Mark the nodes at most `steps` nodes from a marked one along each axis (dilation by a square)."""
    width = 2 * steps + 1
    for axis in (0, 1):
        padded = np.pad(nodes, [(steps + 1, steps) if axis == other else (0, 0) for other in (0, 1)])
        before = np.cumsum(padded, axis, dtype=np.int32)
        first, last = (slice(None, -width), slice(width, None))
        nodes = before[last] > before[first] if axis == 0 else before[:, last] > before[:, first]
    return nodes


def nearest_marked(nodes: BoolArray, wanted: BoolArray) -> tuple[IndexArray, IndexArray]:
    """Return both indices (w,) of the node of a mask (nx, ny) that is nearest to each wanted node (nx, ny), in their
    order.

    Ties are resolved by the smallest second index, then by the smallest first index. At least one node is marked.
    """
    row, far = np.arange(len(nodes))[:, None], sum(nodes.shape)
    before = np.maximum.accumulate(np.where(nodes, row, -far), axis=0)
    after = np.minimum.accumulate(np.where(nodes, row, 2 * far)[::-1], axis=0)[::-1]
    nearest = np.where(row - before <= after - row, before, after)  # along the column of each node
    i, j = np.nonzero(wanted)
    squared, of_column, left, step = np.full(len(i), 4 * far**2), j.copy(), np.arange(len(i)), 0
    while len(left):  # columns beside that of a node, as long as they may have a nearer one
        for column in (j[left] - step, j[left] + step):
            inside = (column >= 0) & (column < nodes.shape[1])
            one, column = left[inside], column[inside]
            offer = step**2 + (nearest[i[one], column] - i[one]) ** 2
            is_nearer = (offer < squared[one]) | ((offer == squared[one]) & (column < of_column[one]))
            squared[one[is_nearer]], of_column[one[is_nearer]] = offer[is_nearer], column[is_nearer]
        step += 1
        left = left[step**2 <= squared[left]]
    return nearest[i, of_column], of_column


#: Minimum number of rows of a strip that can contain the contour at which marching starts.
LEAST_ROWS = 3
#: Tolerance, as a share, for other parts of an exit that are nearer to a point behind it than its foot point.
STRAIGHT = 0.05


def free_rows(segments: FloatArray, ground: BaseGeometry, spacing: float, most: int) -> int:
    """Return the number of rows of nodes that fit behind all of an exit, at most `most`; 0 if it is less than
    `LEAST_ROWS`.

    The space behind an exit may be limited by ground of the same level, a strip of another exit, or another part of the
    same exit, such as a balcony behind a door, or the opposite side of a hatch whose four sides are one exit. Its
    segments (s, 4) have the level on their left; rows are `spacing` apart [m].
    """
    place, outward = points_along(segments, 0.5 * spacing)
    depth = spacing * np.arange(1, most + 1)
    points = place[:, None, :] + depth[:, None] * outward[:, None, :]
    is_free = shapely.distance(chain(segments), shapely.points(points)) > (1.0 - STRAIGHT) * depth
    # One more row is required, since nodes adjacent to other ground are excluded.
    beyond = shapely.linestrings(
        np.stack([place + SLACK * spacing * outward, place + (most + 1) * spacing * outward], axis=1)
    )
    first = shapely.distance(shapely.points(place), shapely.intersection(beyond, ground))
    is_free &= ~(first[:, None] <= depth + spacing)  # NaN where there is no other ground
    rows = int(np.logical_and.accumulate(is_free.all(axis=0)).sum())
    return rows if rows >= LEAST_ROWS else 0


def behind(window: Window, segments: FloatArray, rows: int) -> Iterator[tuple[tuple[slice, slice], BoolArray]]:
    """Yield, for each segment of an exit, a box and the mask of its nodes in a strip of a number of rows behind it."""
    depth = rows * window.lattice.spacing
    for segment in segments:
        box = window.box_around(segment, depth)
        x, y = window.coordinates(box)
        x1, y1, x2, y2 = segment
        length = math.hypot(x2 - x1, y2 - y1)
        ahead = side_of(segment, x, y) / length
        along = ((x2 - x1) * (x - x1) + (y2 - y1) * (y - y1)) / length
        yield box, (ahead < 0.0) & (ahead >= -depth) & (along >= 0.0) & (along <= length)


def outward_directions(segments: FloatArray, points: FloatArray) -> FloatArray:
    """Return the outward unit normals (n, 2) of the segments of an exit that are nearest to points (n, 2)."""
    lines = shapely.linestrings(segments.reshape(-1, 2, 2))
    nearest = shapely.distance(lines[:, None], shapely.points(points)[None, :]).argmin(axis=0)
    outward: FloatArray = _outward(segments)[nearest]
    return outward


def _outward(segments: FloatArray) -> FloatArray:
    """Return the unit normals (s, 2) of segments to their right, away from the level."""
    normal = np.column_stack([segments[:, 3] - segments[:, 1], segments[:, 0] - segments[:, 2]])
    unit: FloatArray = normal / np.linalg.norm(normal, axis=1)[:, None]
    return unit


def points_along(segments: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 2) inside segments, at most `spacing` apart, and the outward normals (n, 2) there."""
    places: list[FloatArray] = []
    numbers: list[int] = []
    for x1, y1, x2, y2 in segments:
        number = max(1, math.ceil(math.hypot(x2 - x1, y2 - y1) / spacing))
        share: NDArray[np.float64] = (np.arange(number) + 0.5)[:, None] / number
        places.append(np.array([x1, y1]) + share * np.array([x2 - x1, y2 - y1]))
        numbers.append(number)
    return np.concatenate(places), np.repeat(_outward(segments), numbers, axis=0)


def chain(segments: FloatArray) -> BaseGeometry:
    """Return the segments of a portal or exit as one geometry."""
    return shapely.multilinestrings(shapely.linestrings(segments.reshape(-1, 2, 2)))
