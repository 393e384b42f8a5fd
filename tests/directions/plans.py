"""Random floor plans with thin walls at any offset to the grid, and their shortest ways by visibility."""

import math
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.sparse.csgraph import dijkstra
from shapely import affinity

#: Doors and exits are at least so wide, so that a clearance of 0.25 m leaves a way through [m].
LEAST_DOOR = 0.8
#: Points to which a way may lead along an exit, for each metre.
POINTS_PER_METRE = 20


@dataclass(frozen=True)
class Plan:
    """The polygon of one level and its exits, each as two points."""

    polygon: shapely.Polygon
    exits: list[tuple[tuple[float, float], tuple[float, float]]]


def random_plan(seed):
    """Return a box divided by walls 0.05 to 0.3 m thick with a door each, some pillars, and one or two exits.

    A third of the walls have their faces on nodes of a grid of 0.1 m, a third of the plans are turned.
    """
    random = np.random.default_rng(seed)
    width, depth = random.uniform(6.0, 12.0), random.uniform(5.0, 9.0)
    if random.random() < 0.5:
        width, depth = round(width, 1), round(depth, 1)
    box = shapely.box(0.0, 0.0, width, depth)
    walls = _divide(random, (0.0, 0.0, width, depth), 3)
    for pillar in [_pillar(random, width, depth) for _ in range(random.integers(0, 3))]:
        if shapely.distance(pillar, [*walls, box.exterior]).min() >= LEAST_DOOR:
            walls.append(pillar)
    polygon = max(shapely.get_parts(shapely.difference(box, shapely.union_all(walls))), key=lambda part: part.area)
    exits = []
    for side in random.permutation(4)[: random.integers(1, 3)]:
        exits += _exit(random, polygon, (width, depth), side)
    if not exits or _has_necks(polygon):
        return random_plan(seed + 1_000_003)
    # The ends of exits are corners, so that rounding leaves them on the outline.
    polygon = shapely.Polygon(_with_points(polygon.exterior, exits), [ring.coords for ring in polygon.interiors])
    angle = random.uniform(0.0, 90.0) if random.random() < 0.33 else 0.0

    def placed(geometry):
        turned = affinity.rotate(geometry, angle, origin=(0.0, 0.0))
        return shapely.transform(turned, lambda points: np.round(points, 6))

    lines = [placed(shapely.LineString(line)) for line in exits]
    return Plan(placed(polygon), [tuple(map(tuple, shapely.get_coordinates(line).tolist())) for line in lines])


def _has_necks(polygon):
    """Say whether a plan has a gap narrower than the least door: without it rooms fall apart or walls join."""

    def parts_and_holes(gap):
        parts = shapely.get_parts(polygon.buffer(-0.5 * gap))
        return len(parts), shapely.get_num_interior_rings(parts).sum()

    return parts_and_holes(LEAST_DOOR - 0.02) != parts_and_holes(0.02)


def _with_points(ring, lines):
    """Return the corners of a ring and the ends of lines on it, in order."""
    ends = [point for line in lines for point in line]
    corners = {ring.project(shapely.Point(point)): point for point in [*ring.coords[:-1], *ends]}
    return [corners[at] for at in sorted(corners)]


def _divide(random, box, depth):
    """Return walls that divide a box into rooms, each with a door."""
    x1, y1, x2, y2 = box
    if depth == 0 or max(x2 - x1, y2 - y1) < 4.0:
        return []
    thickness = random.uniform(0.05, 0.3)
    across = random.uniform(0.35, 0.65)
    is_upright = x2 - x1 > y2 - y1
    low, high = (x1, x2) if is_upright else (y1, y2)
    start, end = (y1, y2) if is_upright else (x1, x2)
    at = low + across * (high - low)
    if random.random() < 0.33:
        at, thickness = round(at, 1), float(random.choice([0.1, 0.2, 0.3]))
    door = random.uniform(LEAST_DOOR, min(1.5, 0.5 * (end - start)))
    place = random.uniform(start + 0.1, end - door - 0.1)
    parts = []
    for a, b in ((start, place), (place + door, end)):
        one = (at, a, at + thickness, b) if is_upright else (a, at, b, at + thickness)
        parts.append(shapely.box(*one))
    halves = (
        ((x1, y1, at, y2), (at + thickness, y1, x2, y2))
        if is_upright
        else ((x1, y1, x2, at), (x1, at + thickness, x2, y2))
    )
    return parts + [wall for half in halves for wall in _divide(random, half, depth - 1)]


def _pillar(random, width, depth):
    """Return a thin wall that stands free, turned by any angle."""
    centre = random.uniform((1.5, 1.5), (width - 1.5, depth - 1.5))
    size = random.uniform(0.05, 0.3), random.uniform(0.05, 1.5)
    piece = shapely.box(centre[0], centre[1], centre[0] + size[0], centre[1] + size[1])
    return affinity.rotate(piece, random.uniform(0.0, 180.0))


def _exit(random, polygon, size, side):
    """Return an exit on one side of the box, between the walls that end there; none where no place is wide enough."""
    width, depth = size
    corners = [(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)]
    line = shapely.LineString([corners[side], corners[(side + 1) % 4]])
    free = [part for part in shapely.get_parts(polygon.boundary.intersection(line)) if part.length > LEAST_DOOR + 0.2]
    if not free:
        return []
    part = free[random.integers(len(free))]
    ends = shapely.get_coordinates(part)[[0, -1]]
    length = float(np.hypot(*(ends[1] - ends[0])))
    opening = random.uniform(LEAST_DOOR, min(1.6, length - 0.1))
    start = random.uniform(0.05, length - opening - 0.05)
    along = (ends[1] - ends[0]) / length
    return [(tuple(ends[0] + start * along), tuple(ends[0] + (start + opening) * along))]


def reduced(plan, clearance):
    """Return the plan less what is nearer to a wall than a clearance, and the lines of its exits in there."""
    if clearance == 0.0:
        return plan.polygon, [shapely.LineString(line) for line in plan.exits]
    # Behind the exits there is ground, so that only their posts count as walls.
    porches = [
        shapely.LineString(line).buffer(4.0 * clearance, cap_style="flat").difference(plan.polygon)
        for line in plan.exits
    ]
    ground = shapely.union_all([plan.polygon.buffer(1e-9), *(porch.buffer(1e-9) for porch in porches)])
    within = ground.buffer(-clearance, quad_segs=8)
    return within, [shapely.LineString(line).intersection(within) for line in plan.exits]


def shortest(plan, points, clearance):
    """Return the lengths (n,) of the shortest ways from points to an exit that keep a clearance; inf without any.

    Dijkstra's algorithm on the visibility graph of the corners of the reduced plan: independent of grids and marching.
    """
    within, lines = reduced(plan, clearance)
    ground = within.buffer(1e-7)
    shapely.prepare(ground)
    corners = shapely.get_coordinates(within)
    targets = np.concatenate(
        [
            shapely.get_coordinates(
                shapely.line_interpolate_point(
                    line, np.linspace(0.0, 1.0, math.ceil(POINTS_PER_METRE * line.length) + 1), normalized=True
                )
            )
            for line in lines
        ]
    )
    nodes = np.concatenate([corners, targets, points])
    first, second = np.triu_indices(len(nodes), 1)
    wanted = ~((first >= len(corners)) & (second < len(corners) + len(targets)))
    first, second = first[wanted], second[wanted]
    sight = shapely.linestrings(np.stack([nodes[first], nodes[second]], axis=1))
    seen = shapely.covers(ground, sight)
    graph = np.full((len(nodes), len(nodes)), math.inf)
    graph[first[seen], second[seen]] = np.maximum(np.hypot(*(nodes[first] - nodes[second]).T)[seen], 1e-12)
    ends = range(len(corners), len(corners) + len(targets))
    distance = dijkstra(np.where(np.isfinite(graph), graph, 0.0), directed=False, indices=ends, min_only=True)
    return distance[-len(points) :]


def follow(fields, plan, points, length=0.02):
    """Return the lengths (n,) of the ways along the directions from points to an exit, and where one meets a wall.

    Returns
    -------
    ways : (n,) float64
        inf where no exit is reached.
    blocked : list of (x, y)
        Places where a step leads out of the plan, and not through an exit.
    """
    ways = np.full(len(points), math.inf)
    walked = np.zeros(len(points))
    blocked = []
    place, row = np.array(points, dtype=float), np.arange(len(points))
    boundary = plan.polygon.boundary
    exits = shapely.union_all([shapely.LineString(line) for line in plan.exits])
    shapely.prepare(boundary)
    shapely.prepare(exits)
    most = int(4.0 * plan.polygon.length / length)
    for _ in range(most):
        if not len(row):
            break
        direction = fields.directions_at(0, place, 0)
        new = place + length * direction
        steps = shapely.linestrings(np.stack([place, new], axis=1))
        meets = shapely.intersects(boundary, steps)
        out = np.zeros(len(row), dtype=bool)
        met = shapely.intersection(steps[meets], boundary)
        out[meets] = shapely.distance(met, exits) < 1e-6
        stretch = length * np.hypot(*direction.T)
        stretch[meets] = shapely.distance(shapely.points(place[meets]), met)
        walked[row] += stretch
        ways[row[out]] = walked[row[out]]
        hit = meets & ~out
        blocked += [tuple(p) for p in place[hit].tolist()]
        kept = ~meets & (np.hypot(*direction.T) > 0.0)
        place, row = new[kept], row[kept]
    return ways, blocked


def starts(plan, number, clearance, seed):
    """Return random points of a plan that are farther from walls than a clearance."""
    within = plan.polygon.buffer(-clearance)
    low, high = np.array(within.bounds).reshape(2, 2)
    found = np.random.default_rng(seed).uniform(low, high, (20 * number, 2))
    return found[shapely.contains_xy(within, *found.T)][:number]
