"""Overlays of polygons on the grid of plans, on which they are exact."""

from collections.abc import Callable, Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

#: Grid to which coordinates of plans are rounded, on which overlays are exact [m].
GRID = 1e-6
#: Minimum area of polygons, and of changes by repairs that are reported [m2].
LEAST_AREA = 1e-6


def flat_parts(geometry: BaseGeometry) -> BaseGeometry:
    """Return the polygons of a geometry; points and lines left by overlay operations are dropped."""
    parts = [part for part in shapely.get_parts(geometry, return_index=False) if part.geom_type == "Polygon"]
    kept = [part for part in parts if part.area > LEAST_AREA]
    return kept[0] if len(kept) == 1 else shapely.MultiPolygon(kept)


def united(polygons: Sequence[BaseGeometry]) -> BaseGeometry:
    """Return the union of polygons on the grid of plans."""
    return flat_parts(shapely.union_all(polygons, grid_size=GRID))


def cut(geometry: BaseGeometry, away: BaseGeometry) -> BaseGeometry:
    """Return the difference of two polygons, on the grid of plans."""
    return flat_parts(shapely.difference(geometry, away, grid_size=GRID))


def common(geometry: BaseGeometry, other: BaseGeometry) -> BaseGeometry:
    """Return the intersection of two polygons, on the grid of plans."""
    return flat_parts(shapely.intersection(geometry, other, grid_size=GRID))


def place_of(geometry: BaseGeometry) -> tuple[float, float]:
    """Return a point (x, y) on a geometry, for a message or a finding."""
    x, y = shapely.get_coordinates(geometry.representative_point())[0].tolist()
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
