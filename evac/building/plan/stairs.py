"""Stairs of plans: plane flights and flat landings from the edges at their ends."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import LEAST_LENGTH
from evac.building.geometry import LEAST_AREA, below, rounded
from evac.building.surface.surfacemesh import Height

#: Largest angle between the edges at both ends of a flight [degrees].
MOST_SKEW = 45.0
#: Minimum length of a flight in plan [m].
LEAST_RUN = 0.2
LEVEL = 5e-4  #: Largest distance of the corners of an inclined polygon from a plane [m].


@dataclass(frozen=True)
class Piece:
    """A flight or a landing: polygon in plan, height as a function of (x, y), minimum and maximum height [m]."""

    plan: BaseGeometry
    height: Height
    z_min: float
    z_max: float


def flight(lower: FloatArray, z_lower: float, upper: FloatArray, z_upper: float) -> list[Piece]:
    """Return the flight between two edges (2, 2) [m]: one plane, or two triangles if they are not parallel."""
    upper = _like(lower, upper)
    along, beside = lower[1] - lower[0], upper[1] - upper[0]
    skew = np.degrees(np.arccos(np.clip(along @ beside / (np.hypot(*along) * np.hypot(*beside)), -1.0, 1.0)))
    if skew > MOST_SKEW:
        raise ValueError(
            f"the edges at both ends of a flight differ by {skew:.0f} degrees in direction, more than "
            f"{MOST_SKEW:.0f}: put a landing between two flights"
        )
    outline = shapely.Polygon([lower[0], lower[1], upper[1], upper[0]])
    run = abs(float((upper - lower).mean(axis=0) @ [-along[1], along[0]])) / float(np.hypot(*along))
    if run < LEAST_RUN or not outline.is_valid:
        raise ValueError(f"its edges are {run:.2f} m apart in plan; move them at least {LEAST_RUN:g} m apart")
    corners = np.array([*lower, *upper[::-1]])
    heights = np.array([z_lower, z_lower, z_upper, z_upper])
    plane = _plane(corners[:3], heights[:3])
    if abs(plane(*corners[3]) - z_upper) < LEAST_LENGTH / 1000.0:
        return [Piece(outline, plane, min(heights), max(heights))]
    halves = ([0, 1, 2], [0, 2, 3])
    return [
        Piece(shapely.Polygon(corners[rows]), _plane(corners[rows], heights[rows]), min(heights), max(heights))
        for rows in halves
    ]


def slope(outline: BaseGeometry) -> Piece:
    """Return the flight of a polygon whose corners have heights."""
    corners = shapely.get_coordinates(outline, include_z=True)
    ones = np.column_stack([corners[:, :2] - corners[0, :2], np.ones(len(corners))])
    plane = np.linalg.lstsq(ones, corners[:, 2], rcond=None)[0]
    off = np.abs(ones @ plane - corners[:, 2])
    if off.max() > LEVEL:
        x, y, z = corners[off.argmax()].tolist()
        raise ValueError(
            f"its corner ({x:g}, {y:g}, {z:g}) is {off.max():.3f} m off the plane of the others; divide the polygon"
        )
    x0, y0 = corners[0, :2].tolist()

    def height(x: float, y: float) -> float:
        return float(plane[0] * (x - x0) + plane[1] * (y - y0) + plane[2])

    return Piece(shapely.force_2d(outline), height, float(corners[:, 2].min()), float(corners[:, 2].max()))


def straight(
    lower: FloatArray, z_lower: float, upper: FloatArray, z_upper: float, depth: float, landings: int
) -> list[Piece]:
    """Return equal flights in a row, with landings of a given depth between them."""
    upper = _like(lower, upper)
    run = float(np.hypot(*(upper.mean(axis=0) - lower.mean(axis=0))))
    share = depth / run if landings else 0.0
    flight_share = (1.0 - landings * share) / (landings + 1)
    if flight_share * run < LEAST_RUN:
        raise ValueError(
            f"{landings} landings of {depth:g} m leave {flight_share * run:.2f} m per flight on a run of {run:.2f} m; "
            "shorten the landings or lengthen the stair"
        )
    pieces: list[Piece] = []
    for k in range(landings + 1):
        start = k * (flight_share + share)
        ends = [lower + s * (upper - lower) for s in (start, start + flight_share)]
        z = [z_lower + s / (landings + 1) * (z_upper - z_lower) for s in (k, k + 1)]
        pieces += flight(rounded(ends[0]), z[0], rounded(ends[1]), z[1])
        if k < landings:
            beyond = rounded(lower + (start + flight_share + share) * (upper - lower))
            pieces.append(Piece(shapely.Polygon([*rounded(ends[1]), *beyond[::-1]]), z[1], z[1], z[1]))
    return pieces


def switchback(
    lower: FloatArray, z_lower: float, upper: FloatArray, z_upper: float, way: FloatArray, run: float, depth: float
) -> list[Piece]:
    """Return a flight away from the lower edge, a half landing, and a flight back beside it to the upper edge.

    `lower`, `upper` (2, 2) [m]: parallel edges side by side; `way` (2,): unit vector in the direction of the first
    flight; `run` [m]: length of the first flight in plan; the second one begins at the same landing; `depth` [m]: depth
    of the landing.
    """
    upper = _like(lower, upper)
    across = np.array([way[1], -way[0]])
    back = run - float((upper.mean(axis=0) - lower.mean(axis=0)) @ way)
    if back < LEAST_RUN:
        raise ValueError(f"a first flight of {run:g} m leaves {back:.2f} m for the second one; increase length")
    z_middle = z_lower + (z_upper - z_lower) * run / (run + back)
    turn_lower, turn_upper = lower + run * way, upper + back * way
    first = flight(lower, z_lower, rounded(turn_lower), z_middle)
    second = flight(rounded(turn_upper), z_middle, upper, z_upper)
    both = shapely.union_all([step.plan for step in first]).intersection(
        shapely.union_all([step.plan for step in second])
    )
    if both.area > LEAST_AREA:
        raise ValueError("the two flights overlap in plan; put the upper edge beside the lower one")
    side = np.concatenate([turn_lower, turn_upper]) @ across
    level = float((turn_lower @ way).mean())
    corners = [level * way + s * across for s in (side.min(), side.max())]
    corners += [(level + depth) * way + s * across for s in (side.max(), side.min())]
    middle = Piece(shapely.Polygon(rounded(np.array(corners))), z_middle, z_middle, z_middle)
    return [*first, middle, *second]


def too_low(piece: Piece, z: float, headroom: float) -> BaseGeometry:
    """Return the part of a piece in plan that is less than `headroom` above or below a floor at height `z` [m]."""
    if piece.z_min >= z + headroom or piece.z_max <= z - headroom:
        return shapely.Polygon()
    if not callable(piece.height):
        return piece.plan
    part, height = piece.plan, piece.height
    if piece.z_max > z + headroom:
        part = below(part, height, z + headroom)
    if piece.z_min < z - headroom:
        part = below(part, lambda x, y: -height(x, y), headroom - z)
    return part


def _plane(corners: FloatArray, heights: FloatArray) -> Callable[[float, float], float]:
    """Return the height of the plane through three points as a function of (x, y)."""
    origin = corners[0]
    gradient = np.linalg.solve(corners[1:] - origin, heights[1:] - heights[0])

    def height(x: float, y: float) -> float:
        return float(heights[0] + gradient[0] * (x - origin[0]) + gradient[1] * (y - origin[1]))

    return height


def _like(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the upper edge with the same orientation as the lower one."""
    return upper if (upper[1] - upper[0]) @ (lower[1] - lower[0]) >= 0.0 else upper[::-1]
