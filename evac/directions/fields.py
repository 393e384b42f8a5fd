"""Travel times and directions of a building, per (level, route)."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from evac.arrays import FloatArray
from evac.directions.routes import Route
from evac.jit import Floats, IntGrid, IntPairs, Longs, Pairs, Quads, Struct

if TYPE_CHECKING:
    from evac.directions.lengths import Marched


class CellWalls(Struct):
    """The walls through cells of the grids, so that nodes on the other side of a wall can be left out of a sample.

    Cell (ix, iy) of a level, from node (ix, iy) to (ix + 1, iy + 1), is number ``offset + ix * ny + iy``.

    Attributes
    ----------
    offset : (levels,) int64
    cell : (c,) int64
        Numbers of the cells that walls pass through, rising.
    start : (c + 1,) int64
        First wall of each of them in `wall`.
    wall : (w, 4) float64 [m]
    steepest : float
        Greatest increase of a travel time [s] or length [m] over a metre in plan.
    """

    offset: Longs
    cell: Longs
    start: Longs
    wall: Quads
    steepest: float


#: Of fields without walls.
NO_CELL_WALLS = CellWalls(
    offset=np.zeros(0, np.int64),
    cell=np.zeros(0, np.int64),
    start=np.zeros(1, np.int64),
    wall=np.zeros((0, 4)),
    steepest=0.0,
)


class PackedFields(Struct):
    """Travel times and directions as kernels read them: one field for each level and route, one after another.

    Attributes
    ----------
    origin : (levels, 2) float64
        Plan position of node (0, 0) of each level's grid [m].
    shape : (levels, 2) int32
        Nodes along x and y.
    spacing : float
        Distance of nodes [m].
    field_of : (levels, routes) int32
        Field of a level and route; -1 where the route's destination cannot be reached from the level.
    offset : (fields,) int64
        First node of each field; node (ix, iy) is at offset + ix * ny + iy.
    direction : (nodes, 2) float64
        Unit vectors of steepest descent, bent around corners by the clearance slowness; zero where
        there is no way.
    travel_time : (nodes,) float64
        Plain travel time to the destination [s] at the reference speeds; inf where there is no way,
        negative behind the exits.
    walls : CellWalls
    """

    origin: Pairs
    shape: IntPairs
    spacing: float
    field_of: IntGrid
    offset: Longs
    direction: Pairs
    travel_time: Floats
    walls: CellWalls


@dataclass(frozen=True)
class Fields:
    """Directions for everybody; never changed.

    Attributes
    ----------
    routes : tuple of Route
        What ``Crowd.route`` indexes.
    packed : PackedFields
        Their travel times and directions.
    comfort : float
        Weight of the time on stairs that the strategy "comfortable" was marched with.
    clearance : float
        Width that directions keep clear of walls, where there is room [m].
    marched : Marched, optional
        What lengths are computed from; without it there are none.
    """

    routes: tuple[Route, ...]
    packed: PackedFields
    comfort: float = 1.0
    clearance: float = 0.0
    marched: "Marched | None" = None

    @cached_property
    def lengths(self) -> FloatArray:
        """Flat, up and down lengths (nodes, 3) of the way to the destination, along the slope [m]."""
        from evac.directions.lengths import find_lengths

        if self.marched is None:
            return np.zeros((0, 3))
        return find_lengths(self.marched, self.routes, self.packed.field_of, self.packed.travel_time)

    def __repr__(self) -> str:
        return f"<Fields: {len(self.routes)} routes, nodes {self.packed.spacing:g} m apart>"

    def travel_time_at(self, level: ArrayLike, position: FloatArray, route: ArrayLike) -> FloatArray:
        """Return the travel time (n,) [s] of a route from positions; inf where it cannot be reached.

        Parameters
        ----------
        level : (n,) or int
        position : (n, 2) [m]
        route : (n,) or int
        """
        from evac.directions.sampling import sample_travel_times

        return _sampled(sample_travel_times, self.packed, level, position, route, ())

    def lengths_at(self, level: ArrayLike, position: FloatArray, route: ArrayLike) -> FloatArray:
        """Return the flat, up and down lengths (n, 3) [m] of a route's way from positions; inf without a way."""
        from evac.directions.sampling import sample_travel_times

        columns = [
            _sampled(sample_travel_times, self.packed.replace(travel_time=length), level, position, route, ())
            for length in np.ascontiguousarray(self.lengths.T)
        ]
        # Within a cell of an exit the bilinear value can fall below zero by rounding.
        return np.maximum(np.stack(columns, axis=1), 0.0)

    def directions_at(self, level: ArrayLike, position: FloatArray, route: ArrayLike) -> FloatArray:
        """Return the unit directions (n, 2) of a route at positions; zero where it cannot be reached."""
        from evac.directions.sampling import sample_directions

        return _sampled(sample_directions, self.packed, level, position, route, (2,))


def _sampled(
    sample: Any, packed: PackedFields, level: ArrayLike, position: FloatArray, route: ArrayLike, shape: tuple[int, ...]
) -> FloatArray:
    """Call a kernel with as many levels and routes as positions, for results of a shape each."""
    place = np.ascontiguousarray(np.asarray(position, dtype=np.float64).reshape(-1, 2))
    number = len(place)
    found = np.empty((number, *shape))
    sample(
        packed,
        place,
        np.ascontiguousarray(np.broadcast_to(np.asarray(level, dtype=np.int32), number)),
        np.ascontiguousarray(np.broadcast_to(np.asarray(route, dtype=np.int32), number)),
        found,
    )
    return found
