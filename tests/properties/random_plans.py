"""Polygons as real files have them: jittered, with doubled, missing and swapped corners, T-junctions and spikes."""

import numpy as np
import shapely

#: Where a plan may lie [m]: at the origin, or at coordinates of a map.
ORIGINS = ((0.0, 0.0), (458_123.4567, 5_428_765.4321))


def rooms(rng):
    """Some rectangles, which may overlap and touch."""
    low = rng.uniform(0.0, 20.0, (rng.integers(1, 12), 2))
    size = rng.uniform(1.0, 8.0, low.shape)
    corners = np.round(np.hstack([low, low + size]), rng.integers(0, 4))
    return [shapely.box(*one) for one in corners]


def comb(rng):
    """A corridor with rooms on one side, behind walls with gaps, as one outline."""
    width, wall, door = rng.uniform(2.0, 6.0), rng.uniform(0.02, 0.4), rng.uniform(0.6, 1.5)
    count = rng.integers(1, 8)
    parts = [shapely.box(0, 0, count * (width + wall), 2.0)]
    for k in range(count):
        x = k * (width + wall)
        parts += [shapely.box(x, 2.0 + wall, x + width, 6.0), shapely.box(x + 0.3, 2.0, x + 0.3 + door, 2.0 + wall)]
    return list(shapely.get_parts(shapely.union_all(parts)))


def spoiled(polygon, rng):
    """One polygon with two things wrong with its outline."""
    corners = shapely.get_coordinates(polygon.exterior)[:-1]
    for flaw in rng.choice(["jitter", "double", "middle", "flip", "spike", "missing", "swap", "none"], 2):
        k = rng.integers(len(corners))
        if flaw == "jitter":
            corners = corners + rng.normal(0.0, 10.0 ** rng.integers(-9, 0), corners.shape)
        elif flaw == "double":
            corners = np.insert(corners, k, corners[k] + rng.choice([0.0, 1e-9, 1e-5]), axis=0)
        elif flaw == "middle":
            corners = np.insert(corners, k, (corners[k] + corners[k - 1]) / 2, axis=0)
        elif flaw == "flip":
            corners = corners[::-1]
        elif flaw == "spike":
            corners = np.insert(corners, k, [corners[k], corners[k] + rng.normal(0.0, 3.0, 2)], axis=0)
        elif flaw == "missing" and len(corners) > 4:
            corners = np.delete(corners, k, axis=0)
        elif flaw == "swap":
            corners = corners.copy()
            corners[[k, 0]] = corners[[0, k]]
    return shapely.Polygon(corners)


def plan_shapes(rng):
    """Return the polygons of one storey."""
    drawn = [rooms, comb][rng.integers(2)](rng)
    origin = np.array(ORIGINS[rng.integers(len(ORIGINS))])
    spoiled_ones = shapely.GeometryCollection([spoiled(one, rng) for one in drawn])
    return list(shapely.transform(spoiled_ones, lambda corners: corners + origin).geoms)
