"""Plane geometry: connected components, overlays, polygons and segments."""

from collections.abc import Callable, Sequence
from functools import wraps
from hashlib import blake2b
from typing import ParamSpec, TypeVar

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import BoolArray, FloatArray, IndexArray
from evac.base.defaults import LEAST_LENGTH

Given = ParamSpec("Given")
Made = TypeVar("Made")


def connected_components(count: int, pairs: IndexArray) -> IndexArray:
    """Return the component (count,) of each node of a graph with edges (p, 2), in the order of first nodes."""
    # Every node points to a node of its component that is not greater, and finally to the smallest one.
    least = np.arange(count)
    while True:
        low = least[pairs].min(axis=1)
        if (least[pairs] == low[:, None]).all():
            return np.unique(least, return_inverse=True)[1]
        for end in (0, 1):
            np.minimum.at(least, least[pairs[:, end]], low)
        while ((further := least[least]) != least).any():
            least = further


MOST_KEPT = 64_000_000  #: Greatest size of the arguments of a function whose results are kept [bytes].


def remembered(function: Callable[Given, Made]) -> Callable[Given, Made]:
    """Keep the results of a function of shapes, arrays and numbers, so that storeys that are equal are made once."""
    kept, total = dict[bytes, tuple[int, Made]](), 0

    @wraps(function)
    def call(*given: Given.args, **named: Given.kwargs) -> Made:
        nonlocal total
        content = b"".join(map(_content, (*given, *named.values())))
        key = blake2b(content, digest_size=16).digest()
        if (found := kept.get(key)) is None:
            kept[key] = found = len(content), function(*given, **named)
            total += len(content)
            while total > MOST_KEPT:
                total -= kept.pop(next(iter(kept)))[0]
        return found[1]

    return call


def _content(value: object) -> bytes:
    """Return what a shape, shapes, an array of numbers, or a number consists of."""
    if isinstance(value, BaseGeometry):
        return bytes(shapely.to_wkb(value))
    if isinstance(value, Sequence) or (isinstance(value, np.ndarray) and value.dtype == object):
        return b"".join(shapely.to_wkb(np.array(value, dtype=object)).tolist())
    return repr(value.shape).encode() + value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode()


#: Grid to which coordinates of plans are rounded, on which overlays are exact [m].
GRID = 1e-6
LEAST_AREA = 1e-6  #: Minimum area of polygons, and of changes by repairs that are reported [m2].


def flat_parts(geometry: BaseGeometry) -> BaseGeometry:
    """Return the polygons of a geometry; points, lines and slivers left by overlay operations are dropped."""
    parts = shapely.get_parts(geometry)
    least = np.maximum(LEAST_AREA, GRID * shapely.length(parts))  # parts as narrow as the grid are of its rounding
    kept = parts[(shapely.get_type_id(parts) == shapely.GeometryType.POLYGON) & (shapely.area(parts) > least)]
    return kept[0] if len(kept) == 1 else shapely.multipolygons(kept)


@remembered
def united(polygons: Sequence[BaseGeometry]) -> BaseGeometry:
    """Return the union of polygons on the grid of plans; those that meet are united apart from the others."""
    given = np.array(polygons, dtype=object)
    group = connected_components(len(given), shapely.STRtree(given).query(given, "intersects").T)
    given, size = given[np.argsort(group, kind="stable")], np.bincount(group)
    first, wholes = np.cumsum(size) - size, np.empty(len(size), dtype=object)
    pairs = first[size == 2]  # a union of two is faster
    wholes[size == 2] = shapely.union(given[pairs], given[pairs + 1], grid_size=GRID)
    for row in np.flatnonzero(size != 2):
        wholes[row] = shapely.union_all(given[first[row] : first[row] + size[row]], grid_size=GRID)
    return flat_parts(shapely.geometrycollections(shapely.get_parts(wholes)))


def enclosed(lines: Sequence[BaseGeometry]) -> BaseGeometry:
    """Return what lines enclose that end at each other."""
    return shapely.union_all(shapely.get_parts(shapely.polygonize([shapely.union_all([*lines])])))


def rounded(points: ArrayLike) -> FloatArray:
    """Return coordinates on the grid of plans."""
    exact: FloatArray = np.asarray(points, np.float64)
    return exact.round(6) + 0.0


def cut(geometry: BaseGeometry, away: BaseGeometry) -> BaseGeometry:
    """Return the difference of two polygons, on the grid of plans."""
    return flat_parts(shapely.difference(geometry, away, grid_size=GRID))


def common(geometry: BaseGeometry, other: BaseGeometry) -> BaseGeometry:
    """Return the intersection of two polygons, on the grid of plans."""
    return flat_parts(shapely.intersection(geometry, other, grid_size=GRID))


def place_of(shape: BaseGeometry | FloatArray) -> tuple[float, float]:
    """Return a point (x, y) on a geometry, or the mean of the ends of segments, for a message or a finding."""
    if isinstance(shape, BaseGeometry):
        shape = shapely.get_coordinates(shape.representative_point())
    x, y = shape.reshape(-1, 2).mean(axis=0).tolist()
    return x, y


def below(plan: BaseGeometry, height: Callable[[float, float], float], z: float) -> BaseGeometry:
    """Return the part of a polygon where a plane is lower than `z` [m]."""
    x, y = plan.centroid.coords[0]
    here = height(x, y)
    uphill = np.array([height(x + 1.0, y) - here, height(x, y + 1.0) - here])
    way = uphill / np.hypot(*uphill)
    border = np.array([x, y]) + (z - here) / np.hypot(*uphill) * way
    reach = 2.0 * float(np.hypot(*np.ptp(np.reshape(plan.bounds, (2, 2)), axis=0))) + abs(z - here) / np.hypot(*uphill)
    across = reach * np.array([way[1], -way[0]])
    half = [border - across, border + across, border + across - 2 * reach * way, border - across - 2 * reach * way]
    return plan.intersection(shapely.Polygon(half))


SNAP = 1e-8  #: Grid on which polygons are united that do not share their sides [m].


def triangulate(points: FloatArray, polygons: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Return triangles (t, 3) of polygons (n, k) in any plane, fans of convex ones, and the row (t,) of each."""
    n, k = polygons.shape
    if k == 3:
        return polygons, np.arange(n)
    polygons = _start_at_least(points, polygons)
    corners = points[polygons] - points[polygons[:, :1]]
    normal = np.abs(np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1))  # Newell's method
    across = np.where(normal[:, 2] >= normal[:, :2].max(axis=1), 2, normal[:, :2].argmax(axis=1))
    plan = np.take_along_axis(points[polygons], np.array([[1, 2], [0, 2], [0, 1]])[across][:, None], axis=2)
    step = np.roll(plan, -1, axis=1) - plan
    following = np.roll(step, -1, axis=1)
    turn = step[..., 0] * following[..., 1] - step[..., 1] * following[..., 0]
    rounding = 1e-9 * np.square(step).sum(axis=2).max(axis=1, keepdims=True)
    is_convex = (turn >= -rounding).all(axis=1) | (turn <= rounding).all(axis=1)

    fans = np.stack([polygons[:, [0, i, i + 1]] for i in range(1, k - 1)], axis=1)[is_convex]
    triangles = [fans.reshape(-1, 3)]
    owner = [np.repeat(np.flatnonzero(is_convex), k - 2)]
    for row in np.flatnonzero(~is_convex):
        pieces = _delaunay(points, plan[row], polygons[row], bool(across[row] != 2))
        triangles.append(pieces)
        owner.append(np.full(len(pieces), row))
    return np.concatenate(triangles), np.concatenate(owner)


def least_height(corners: FloatArray) -> FloatArray:
    """Return the smallest heights (t,) of triangles (t, 3, 3), zero where corners coincide [m]."""
    sides = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    twice_area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    height: FloatArray = np.divide(twice_area, longest, out=np.zeros(len(corners)), where=longest > 0)
    return height


def plan_area(corners: FloatArray) -> FloatArray:
    """Return the unsigned areas in plan (t,) of triangles (t, 3, 3) [m2]."""
    one, other = corners[:, 1, :2] - corners[:, 0, :2], corners[:, 2, :2] - corners[:, 0, :2]
    area: FloatArray = 0.5 * np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
    return area


@remembered
def union(polygons: Sequence[BaseGeometry] | NDArray[np.object_]) -> BaseGeometry:
    """Return the union of polygons, on a grid unless they share their sides: GEOS may omit one without it."""
    if shapely.coverage_is_valid(polygons):
        return shapely.coverage_union_all(polygons)
    return shapely.union_all(polygons, grid_size=SNAP)


def _start_at_least(points: FloatArray, polygons: IndexArray) -> IndexArray:
    """Rotate and flip the corners so that the smallest one comes first and its smaller neighbour second."""
    k = polygons.shape[1]
    rank = np.empty(len(points), dtype=np.int64)
    rank[np.lexsort(points.T[::-1])] = np.arange(len(points))
    first = rank[polygons].argmin(axis=1)
    turned = np.take_along_axis(polygons, (first[:, None] + np.arange(k)) % k, axis=1)
    flip = rank[turned[:, 1]] > rank[turned[:, -1]]
    turned[flip, 1:] = turned[flip, :0:-1]
    return turned


def _delaunay(points: FloatArray, plan: FloatArray, polygon: IndexArray, is_upright: bool) -> IndexArray:
    """Triangulate a non-convex polygon, by its corners (k, 2) in its plane; an upright one may cross itself."""
    outline = shapely.Polygon(plan)
    if not outline.is_valid:
        if is_upright:
            return np.array([polygon[[0, i, i + 1]] for i in range(1, len(polygon) - 1)])
        x, y, z = points[polygon[0]]
        raise ValueError(f"the outline of the polygon at ({x:z.2f}, {y:z.2f}, {z:z.2f}) crosses itself in plan")
    corner_at = {(x, y): corner for (x, y), corner in zip(plan.tolist(), polygon.tolist(), strict=True)}
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(outline))
    return np.array([[corner_at[xy] for xy in piece.exterior.coords[:3]] for piece in pieces], dtype=np.int64)


#: Segments lie along each other if their directions differ by less than this (25 degrees).
ALONG = 0.9
#: Rounding errors of distances in plan [m].
ROUNDING = 1e-5
#: Share of a segment at each end in which points are at the end.
END = 1e-6
SAMPLES = 8  #: Places along a piece of an outline at which the floor beyond a wall is looked for.


def segment_lengths(segments: FloatArray) -> FloatArray:
    """Return the lengths (s,) of segments (s, 4) [m]."""
    length: FloatArray = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    return length


def side_of(segment: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return twice the signed area of a segment (4,) and each point [m2], positive for points on its left."""
    x1, y1, x2, y2 = segment
    return np.asarray((x2 - x1) * (y - y1) - (y2 - y1) * (x - x1))


@remembered
def sides(polygon: BaseGeometry) -> FloatArray:
    """Return the sides (s, 4) of a polygon or multipolygon, with its interior on their left [m]."""
    rings = shapely.get_rings(shapely.orient_polygons(shapely.get_parts(polygon)))
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    own: FloatArray = np.concatenate([corners[:-1], corners[1:]], axis=1)[ring[:-1] == ring[1:]]
    return own


def lines_of(line: BaseGeometry) -> list[BaseGeometry]:
    """Return the sides of a line, as lines of two points."""
    corners = shapely.get_coordinates(line)
    return [*shapely.linestrings(np.stack([corners[:-1], corners[1:]], axis=1))]


def points_on(
    points: FloatArray, tree: shapely.STRtree, ends: FloatArray, distance: float
) -> tuple[IndexArray, IndexArray]:
    """Return rows of segments (s, 2, d) and of the points (v, d) between their ends, sorted along each of them."""
    rows, found = tree.query(shapely.linestrings(ends[:, :, :2]), predicate="dwithin", distance=distance + ROUNDING)
    along, reach = ends[rows, 1] - ends[rows, 0], points[found] - ends[rows, 0]
    square = (along * along).sum(axis=1)
    share = np.divide((along * reach).sum(axis=1), square, out=np.zeros(len(rows)), where=square > 0.0)
    off = np.linalg.norm(reach - share[:, None] * along, axis=1)
    on = np.flatnonzero((share > END) & (share < 1.0 - END) & (off <= distance))
    on = on[np.lexsort((share[on], rows[on]))]
    return rows[on], found[on]


def divided(
    corners: FloatArray, tree: shapely.STRtree, ends: FloatArray, distance: float
) -> tuple[IndexArray, FloatArray]:
    """Return the rows of sides (s, 2, d) that corners (c, d) divide, and the starts of their parts, in order."""
    row, corner = points_on(corners, tree, ends, distance)
    side = np.concatenate([np.arange(len(ends)), row])
    order = np.argsort(side, kind="stable")
    return side[order], np.concatenate([ends[:, 0], corners[corner]])[order]


def pieces_along(segments: FloatArray, ends: FloatArray, reach: float) -> tuple[FloatArray, IndexArray]:
    """Return the pieces (p, 4) of segments (s, 4) along a line (2, 2), at most `reach` from it [m], and their rows.

    Each segment may have a line (s, 2, 2) of its own. Pieces shorter than 1 mm are left out, and those that end less
    than 1 mm before an end of their segment end there.
    """
    length, ends = segment_lengths(segments), ends.reshape(-1, 2, 2)
    start, step = segments[:, :2], (segments[:, 2:] - segments[:, :2]) / length[:, None]
    span = np.hypot(*(ends[:, 1] - ends[:, 0]).T)[:, None]
    direction = (ends[:, 1] - ends[:, 0]) / span
    share = ((ends - start[:, None]) * step[:, None]).sum(axis=-1)
    low, high = np.maximum(share.min(axis=1), 0.0), np.minimum(share.max(axis=1), length)
    low, high = np.where(low < LEAST_LENGTH, 0.0, low), np.where(length - high < LEAST_LENGTH, length, high)
    pieces = np.concatenate([start + low[:, None] * step, start + high[:, None] * step], axis=1)
    offset = pieces.reshape(-1, 2, 2) - ends[:, :1]
    share = (offset * direction[:, None]).sum(axis=-1).clip(0.0, span)
    away = np.linalg.norm(offset - share[..., None] * direction[:, None], axis=-1).max(axis=1)
    is_along = (high - low > LEAST_LENGTH) & (np.abs((step * direction).sum(axis=-1)) > ALONG)
    rows = np.flatnonzero(is_along & (away <= reach))
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
    """Return which pieces (p, 4) of an outline have floor beyond a wall of at most `reach` [m] behind most of them."""
    start, step = pieces[:, None, :2], (pieces[:, 2:] - pieces[:, :2])[:, None]
    outward = np.stack([step[..., 1], -step[..., 0]], axis=-1) / segment_lengths(pieces)[:, None, None]
    places = start + np.linspace(0.0, 1.0, 2 * SAMPLES + 1)[1::2, None] * step
    rays = shapely.linestrings(np.stack([places + LEAST_LENGTH * outward, places + reach * outward], axis=-2))
    shapely.prepare(polygon)
    is_between: BoolArray = shapely.intersects(polygon, rays).mean(axis=1) > 0.5
    return is_between
