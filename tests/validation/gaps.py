"""Random plans with gaps that some people fit through and others do not, and who has a way of own width."""

import numpy as np
import shapely
from shapely import affinity

#: People of each plan, and widths of gaps and of exits after the first [m].
PEOPLE, GAPS = 8, (0.2, 1.2)
#: A body whose width differs less than this from that of a gap may fit or not [m].
CLOSE = 3e-3


def gap_case(seed, model="nsm2"):
    """Return a case as a dictionary: a hall divided by walls with one to three gaps each, furniture beside walls."""
    random = np.random.default_rng(seed)
    width, depth = random.uniform(7.0, 12.0), random.uniform(5.0, 8.0)
    ground = shapely.box(0.0, 0.0, width, depth)
    for x in np.sort(random.uniform(2.0, width - 2.0, random.integers(1, 3))):
        ground = ground.difference(_partition(random, x, depth))
    for _ in range(random.integers(0, 4)):
        size = random.uniform(0.3, 1.2, 2)
        x, gap = random.uniform(0.5, width - 1.5), random.uniform(*GAPS)
        ground = ground.difference(shapely.box(x, gap, x + size[0], gap + size[1]))
    exits = []
    for index, side in enumerate(random.permutation(2)[: random.integers(1, 3)]):
        wide = random.uniform(0.8, 1.4) if index == 0 else random.uniform(*GAPS)
        low = random.uniform(0.1, depth - wide - 0.1)
        x = side * width
        if shapely.box(x - 0.05, low, x + 0.05, low + wide).intersection(ground).area < 0.049 * wide:
            continue
        exits.append(((x, low), (x, low + wide)))
    parts = [part for part in shapely.get_parts(ground) if part.area > 1.0]
    if not exits or len(parts) != 1 or any(shapely.LineString(way).distance(parts[0]) > 1e-9 for way in exits):
        return gap_case(seed + 1_000_003, model)
    angle = random.uniform(0.0, 90.0) if random.random() < 0.4 else 0.0
    low, high = random.uniform(0.12, 0.22), random.uniform(0.23, 0.33)
    return {
        "building": {
            "plan": {
                "storeys": [{"name": "f", "polygons": [_placed(parts[0], angle).wkt]}],
                "exits": [
                    {
                        "name": f"exit {index}",
                        "storey": "f",
                        "segment": shapely.get_coordinates(_placed(shapely.LineString(way), angle)).tolist(),
                    }
                    for index, way in enumerate(exits)
                ],
            }
        },
        "people": [{"name": "people", "number": PEOPLE, "level": "f", "radius": {"uniform": [low, high]}}],
        "contact": {"model": model},
        "simulation": {"seed": seed, "duration": 240.0, "no_progress": 30.0},
        "output": {"picture": False, "replay": False},
    }


def _partition(random, x, depth):
    """Return a wall across a hall, which may be slanted, without its gaps."""
    thickness = random.uniform(0.05, 0.3)
    wall = shapely.box(x, -1.0, x + thickness, depth + 1.0)
    for _ in range(random.integers(1, 4)):
        gap = random.uniform(*GAPS)
        low = random.choice([0.0, depth - gap, random.uniform(0.0, depth - gap)])
        wall = wall.difference(shapely.box(x - 1.0, low - 1e-9, x + 1.0, low + gap))
    return affinity.rotate(wall, random.choice([0.0, random.uniform(-15.0, 15.0)]), origin=(x, 0.5 * depth))


def _placed(geometry, angle):
    turned = affinity.rotate(geometry, angle, origin=(0.0, 0.0))
    return shapely.transform(turned, lambda points: np.round(points, 6))


def has_way(building, position, radius):
    """Return whether each body has a way to an exit that is as wide as it: 1 yes, 0 no, -1 if it is close."""
    (level,) = building.levels
    walls = shapely.multilinestrings(building.walls.reshape(-1, 2, 2))
    strips = []
    for way in building.exits:
        line = shapely.linestrings(way.segments.reshape(2, 2))
        strips += [line.buffer(side, single_sided=True, cap_style="flat") for side in (-1.0, 1.0)]
    strips = shapely.union_all(strips).difference(level.polygon)
    ground = shapely.union_all([level.polygon.buffer(1e-7), strips.buffer(1e-6)])
    goal = strips.difference(level.polygon.buffer(0.8))
    found = []
    for place, r in zip(shapely.points(position), radius, strict=True):
        ways = []
        for margin in (-0.5 * CLOSE, 0.5 * CLOSE):
            free = shapely.get_parts(ground.difference(walls.buffer(r + margin, quad_segs=32)))
            free = free[shapely.area(free) > 0.0]
            own = free[shapely.distance(free, place) < 2.0 * CLOSE]
            ways.append(bool(shapely.intersects(own, goal).any()))
        found.append(int(ways[0]) if ways[0] == ways[1] else -1)
    return np.array(found)
