"""The union of polygons, without the losses that overlays of floating point coordinates have at times."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

#: A union that lacks no more than this share of the polygons' area lacks nothing.
SAME_AREA = 1e-8
#: Grid that coordinates are snapped to where the union would lack a polygon otherwise [m].
SNAP = 1e-8
#: How far a polygon may reach beyond the union that holds it [m].
ROUNDING = 1e-6


def union(polygons: Sequence[BaseGeometry] | NDArray[np.object_]) -> BaseGeometry:
    """Return the union of polygons, every one of which it covers.

    GEOS may leave out a polygon, without an error, whose side has vertices of its neighbour a rounding error off. Such
    a union is computed again on a grid, where overlays are exact.
    """
    joined = shapely.union_all(polygons)
    total = float(shapely.area(polygons).sum())
    if joined.area >= (1.0 - SAME_AREA) * total:
        return joined
    reach = joined.buffer(ROUNDING)
    shapely.prepare(reach)
    if shapely.covers(reach, polygons).all():
        return joined
    return shapely.union_all(polygons, grid_size=SNAP)
