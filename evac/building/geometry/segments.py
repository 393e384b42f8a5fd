"""Segments in plan (s, 4), x1, y1, x2, y2 [m], and the sides of polygons."""

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import BoolArray, FloatArray, IndexArray
from evac.base.defaults import LEAST_LENGTH

#: Segments lie along each other if their directions differ by less than this (25 degrees).
ALONG = 0.9
#: Rounding errors of distances in plan [m].
ROUNDING = 1e-5
#: Share of a segment at each end in which points are at the end.
END = 1e-6
#: Places along a piece of an outline at which the floor beyond a wall is looked for.
SAMPLES = 8


def segment_lengths(segments: FloatArray) -> FloatArray:
    """Return the lengths (s,) of segments (s, 4) [m]."""
    length: FloatArray = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    return length


def side_of(segment: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return twice the signed area of a segment (4,) and each point [m2], positive for points on its left."""
    x1, y1, x2, y2 = segment
    return np.asarray((x2 - x1) * (y - y1) - (y2 - y1) * (x - x1))


def sides(polygon: BaseGeometry) -> FloatArray:
    """Return the sides (s, 4) of a polygon or multipolygon, with its interior on their left [m]."""
    rings = []
    for part in shapely.get_parts(polygon):
        oriented = shapely.orient_polygons(part)
        rings += [shapely.get_coordinates(ring) for ring in (oriented.exterior, *oriented.interiors)]
    if not rings:
        return np.empty((0, 4))
    return np.concatenate([np.concatenate([ring[:-1], ring[1:]], axis=1) for ring in rings])


def lines_of(line: BaseGeometry) -> list[BaseGeometry]:
    """Return the sides of a line, as lines of two points."""
    corners = shapely.get_coordinates(line)
    return [*shapely.linestrings(np.stack([corners[:-1], corners[1:]], axis=1))]


def points_on(
    points: FloatArray, tree: shapely.STRtree, ends: FloatArray, distance: float
) -> tuple[IndexArray, IndexArray]:
    """Return rows of segments (s, 2, 3) with rows of points (v, 3) between their ends, at most `distance` off them [m].

    The tree has the points in plan. Both are sorted by the segments, and along each of them.
    """
    rows, found = tree.query(shapely.linestrings(ends[:, :, :2]), predicate="dwithin", distance=distance + ROUNDING)
    along, reach = ends[rows, 1] - ends[rows, 0], points[found] - ends[rows, 0]
    square = (along * along).sum(axis=1)
    share = np.divide((along * reach).sum(axis=1), square, out=np.zeros(len(rows)), where=square > 0.0)
    off = np.linalg.norm(reach - share[:, None] * along, axis=1)
    on = np.flatnonzero((share > END) & (share < 1.0 - END) & (off <= distance))
    on = on[np.lexsort((share[on], rows[on]))]
    return rows[on], found[on]


def pieces_along(segments: FloatArray, ends: FloatArray, reach: float) -> tuple[FloatArray, IndexArray]:
    """Return the pieces (p, 4) of segments (s, 4) along a line (2, 2), at most `reach` from it [m], and their rows.

    Pieces shorter than 1 mm are left out, and those that end less than 1 mm before an end of their segment end there.
    """
    length = segment_lengths(segments)
    start, step = segments[:, :2], (segments[:, 2:] - segments[:, :2]) / length[:, None]
    direction = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    share = np.stack([((point - start) * step).sum(axis=1) for point in ends], axis=1)
    low, high = np.maximum(share.min(axis=1), 0.0), np.minimum(share.max(axis=1), length)
    low, high = np.where(low < LEAST_LENGTH, 0.0, low), np.where(length - high < LEAST_LENGTH, length, high)
    pieces = np.concatenate([start + low[:, None] * step, start + high[:, None] * step], axis=1)
    off = shapely.distance(shapely.points(pieces.reshape(-1, 2, 2)), shapely.LineString(ends)).max(axis=1, initial=0.0)
    rows = np.flatnonzero((high - low > LEAST_LENGTH) & (np.abs(step @ direction) > ALONG) & (off <= reach))
    return pieces[rows], rows


def gaps_along(pieces: FloatArray, ends: FloatArray) -> FloatArray:
    """Return the lengths (p + 1,) that pieces (p, 4) leave free of a line (2, 2) before, between and after them [m]."""
    length = float(np.hypot(*(ends[1] - ends[0])))
    spans = np.sort(((pieces.reshape(-1, 2, 2) - ends[0]) @ (ends[1] - ends[0]) / length).clip(0.0, length), axis=1)
    spans = spans[np.argsort(spans[:, 0])]
    reached = np.maximum.accumulate(np.append(0.0, spans[:, 1]))
    gaps: FloatArray = np.maximum(np.append(spans[:, 0], length) - reached, 0.0)
    return gaps


def between_floors(polygon: BaseGeometry, pieces: FloatArray, reach: float) -> BoolArray:
    """Return which pieces (p, 4) of an outline have floor beyond the wall behind most of their length.

    Parameters
    ----------
    polygon : shapely polygon or multipolygon
        The floor.
    pieces : (p, 4) float64 [m]
        With the floor on their left.
    reach : float [m]
        Greatest thickness of the wall.
    """
    start, step = pieces[:, None, :2], (pieces[:, 2:] - pieces[:, :2])[:, None]
    outward = np.stack([step[..., 1], -step[..., 0]], axis=-1) / segment_lengths(pieces)[:, None, None]
    places = start + np.linspace(0.0, 1.0, 2 * SAMPLES + 1)[1::2, None] * step
    rays = shapely.linestrings(np.stack([places + LEAST_LENGTH * outward, places + reach * outward], axis=-2))
    shapely.prepare(polygon)
    is_between: BoolArray = shapely.intersects(polygon, rays).mean(axis=1) > 0.5
    return is_between
