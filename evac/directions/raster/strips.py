"""Strips of nodes behind exits, where marching starts so that paths pass the posts of exits at a distance."""

import math
from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import BoolArray, FloatArray
from evac.building.geometry import side_of
from evac.directions.raster.lattice import SLACK, Window

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
