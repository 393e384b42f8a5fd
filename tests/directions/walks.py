"""Positions, geodesics and walks on fields, for the tests of directions."""

import math

import numpy as np
import shapely


def positions_on(building, level, number, seed=0):
    """Return random positions on a level."""
    polygon = building.levels[level].polygon
    low, high = np.array(polygon.bounds).reshape(2, 2)
    found = np.random.default_rng(seed).uniform(low, high, (4 * number, 2))
    return found[shapely.contains_xy(polygon, *found.T)][:number]


def geodesics(positions, start, end, corners, blocked):
    """Return shortest distances to the segment from start to end round corners: visibility, independent of grids."""
    line = np.linspace(start, end, 301)

    def distances(point, targets):
        sight = shapely.linestrings(np.stack((np.broadcast_to(point, targets.shape), targets), axis=1))
        return np.where(shapely.intersects(sight, blocked), math.inf, np.linalg.norm(targets - point, axis=1))

    corners = np.array(corners, dtype=float)
    rest = np.array([distances(corner, line).min() for corner in corners])
    between = np.array([distances(corner, corners) for corner in corners])
    for _ in corners:
        rest = np.minimum(rest, (between + rest).min(axis=1))
    return np.array([min(distances(p, line).min(), (distances(p, corners) + rest).min()) for p in positions])


def along(portal, number=60):
    """Return points on a portal."""
    start, end = portal.segments[0].reshape(2, 2)
    return start + (np.arange(number) + 0.5)[:, None] / number * (end - start)


def crossing(links, level, step):
    """Return the first of links on a level that a step crosses."""
    for link in links:
        here = level in getattr(link, "levels", ()) or level == getattr(link, "level", None)
        if here and any(step.intersects(shapely.LineString(s.reshape(2, 2))) for s in link.segments):
            return link
    return None


def walk(fields, building, position, level, length=0.04, steps=4000, route=0):
    """Follow directions from a position; return the name of the exit reached and the way as (level, x, y)."""
    position = np.array(position, dtype=float)
    way = [(level, *position)]
    for _ in range(steps):
        new = position + length * fields.directions_at(level, position, route)[0]
        step = shapely.LineString([position, new])
        exit_ = crossing(building.exits, level, step)
        if exit_:
            return exit_.name, way
        portal = crossing(building.portals, level, step)
        if portal:
            behind = portal.levels[1] if level == portal.levels[0] else portal.levels[0]
            if shapely.intersects_xy(building.levels[behind].polygon, *new):
                level = behind
        position = new
        way.append((level, *position))
    return None, way
