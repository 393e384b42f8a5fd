"""Travel times and directions of a building, per (level, route)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.directions.routes import Route

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]


@dataclass(frozen=True)
class Fields:
    """Directions for everybody, packed for the kernels; frozen until something closes.

    Attributes
    ----------
    routes : tuple of Route
        What ``Crowd.route`` indexes.
    grid_origin : (levels, 2) float64
        Plan position of node (0, 0) of each level's grid [m].
    grid_shape : (levels, 2) int32
    spacing : float
        Distance of nodes [m].
    field_of : (levels, routes) int32
        Field of a level and route; -1 where the route's destination cannot be reached from the level.
    field_offset : (fields,) int64
    direction : (nodes, 2) float64
        Unit vectors of steepest descent, bent around corners by the clearance slowness.
    travel_time : (nodes,) float64
        Plain travel time to the destination [s] at the reference speeds; inf where there is no way.
    graph : networkx.Graph
        Levels and portals with lengths.
    """

    routes: tuple[Route, ...]
    grid_origin: FloatArray
    grid_shape: IntArray
    spacing: float
    field_of: IntArray
    field_offset: NDArray[np.int64]
    direction: FloatArray
    travel_time: FloatArray
    graph: Any
