"""Travel times and directions of a building for each level and route."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from evac.base.arrays import BoolArray, FloatArray, IntArray
from evac.directions.routes import Route
from evac.jit import Floats, IntGrid, IntPairs, Longs, Pairs, Quads, Struct

if TYPE_CHECKING:
    from evac.directions.lengths import Marched
    from evac.directions.raster.grids import BuildingGrids


class CellWalls(Struct):
    """The walls through each grid cell, so that interpolation can exclude nodes on the other side of a wall.

    Cell (ix, iy) of a level, from node (ix, iy) to (ix + 1, iy + 1), has the index ``offset + ix * ny + iy``.
    """

    # (levels, columns) int32: index of the first cell of each level; gaps that a class of bodies does not fit through
    # are walls for it
    offset: IntGrid
    cell: Longs  # (c,) int64: indices of the cells that walls pass through, ascending
    start: Longs  # (c + 1,) int64: first wall of each of these cells in `wall`
    wall: Quads  # (w, 4) float64 [m]
    steepest: float  # largest increase of a travel time [s] or length [m] per metre in plan


#: Cell walls of fields without walls.
NO_CELL_WALLS = CellWalls(
    offset=np.zeros((0, 0), np.int32),
    cell=np.zeros(0, np.int64),
    start=np.zeros(1, np.int64),
    wall=np.zeros((0, 4)),
    steepest=0.0,
)


class PackedFields(Struct):
    """Travel times and directions for kernels: the fields of all levels and columns, concatenated.

    A column is a route for a class of bodies: those of the first class on each route, then those of the next class.
    Bodies are of different classes if there is a gap that only the narrower one fits through; see `columns_of`.
    """

    origin: Pairs  # (levels, 2) plan position of node (0, 0) of the grid of each level [m]
    shape: IntPairs  # (levels, 2) numbers of nodes along x and y
    spacing: float  # [m]
    width: Floats  # (classes - 1,) greatest width of bodies of each class except the last [m], ascending
    field_of: IntGrid  # (levels, columns) -1 if the destination of the route cannot be reached from the level
    offset: Longs  # (fields,) first node of each field; node (ix, iy) is at offset + ix * ny + iy
    # (nodes, 2) unit vectors of steepest descent, with the slowness increased near walls; zero where there is no way
    direction: Pairs
    # (nodes,) plain travel time to the destination [s] at the reference speeds; inf where there is no way, negative
    # behind exits
    travel_time: Floats
    walls: CellWalls


def columns_of(fields: PackedFields, route: ArrayLike, radius: ArrayLike) -> IntArray:
    """Return the columns (n,) of routes (n,) for bodies of radii (n,) [m]; a number stands for all."""
    if not len(fields.width):
        return np.asarray(route, dtype=np.int32)
    routes = fields.field_of.shape[1] // (len(fields.width) + 1)
    columns: IntArray = np.asarray(
        np.asarray(route) + routes * np.searchsorted(fields.width, 2.0 * np.asarray(radius)), dtype=np.int32
    )
    return columns


@dataclass(frozen=True)
class ClassGrids:
    """The grids that the fields of a class of bodies were solved on, and the slowness factors (nodes,) near walls."""

    grids: "BuildingGrids"
    factor: FloatArray


@dataclass(frozen=True)
class Fields:
    """Travel times, directions and path lengths of a building; immutable."""

    routes: tuple[Route, ...]  # to which `Crowd.route` refers
    packed: PackedFields
    comfort: float = 1.0  # weight of the time on stairs in the strategy "comfortable"
    clearance: float = 0.0  # distance that directions keep from walls where there is room [m]
    marched: "Marched | None" = None  # data that lengths are computed from; lengths are empty without it
    # for each class of bodies, if there is a route with the strategy "quickest", or smoke
    grids: tuple[ClassGrids, ...] = ()
    # of fields of which some follow the crowd: those of the empty building, whose lengths they have
    uncongested: "Fields | None" = None

    @cached_property
    def lengths(self) -> FloatArray:
        """Flat, up and down lengths (nodes, 3) of the path to the destination, along the slope [m]."""
        from evac.directions.lengths import find_lengths

        if self.uncongested is not None:
            return self.uncongested.lengths
        if self.marched is None:
            return np.zeros((3, 0)).T
        return find_lengths(self.marched, self.routes, self.packed)

    @cached_property
    def _passable(self) -> PackedFields:
        """The fields with infinite travel times from where no way is as wide as the bodies."""
        from evac.directions.lengths import passable_times

        if self.uncongested is not None:
            return self.uncongested._passable
        if self.marched is None:
            return self.packed
        return self.packed.replace(travel_time=passable_times(self.marched, self.packed))

    def with_own_directions(self) -> "Fields":
        """Return fields with copies of travel times and directions, which routes that are solved again may change."""
        packed = self.packed
        own = packed.replace(direction=packed.direction.copy(), travel_time=packed.travel_time.copy())
        return replace(self, packed=own, uncongested=self)

    def __repr__(self) -> str:
        return f"<Fields: {len(self.routes)} routes, nodes {self.packed.spacing:g} m apart>"

    def travel_time_at(
        self, level: ArrayLike, position: FloatArray, route: ArrayLike, radius: ArrayLike = 0.0
    ) -> FloatArray:
        """Return the travel times (n,) [s] of routes from positions (n, 2) [m]; inf where the destination cannot be
        reached.

        Gaps that a body of the radius (n,) [m] does not fit through are walls for it; by default, it is the narrowest
        one.
        """
        return self._times_at(self.packed, level, position, route, radius)

    def lengths_at(
        self, level: ArrayLike, position: FloatArray, route: ArrayLike, radius: ArrayLike = 0.0
    ) -> FloatArray:
        """Return the flat, up and down path lengths (n, 3) [m] of routes from positions; inf if unreachable.

        They are also inf where no way to the destination is as wide as the body, although there is a travel time, and a
        direction towards the narrow place.
        """
        columns = [
            self._times_at(self.packed.replace(travel_time=length), level, position, route, radius)
            for length in self.lengths.T
        ]
        # Within a cell of an exit, the bilinear value can be negative by rounding.
        return np.maximum(np.stack(columns, axis=1), 0.0)

    def are_passable(
        self, level: ArrayLike, position: FloatArray, route: ArrayLike, radius: ArrayLike = 0.0
    ) -> BoolArray:
        """Return whether a way to the destination is as wide as the body (n,), for routes from positions.

        Where it is not, there can be a travel time nevertheless, and a direction towards the narrow place.
        """
        return np.isfinite(self._times_at(self._passable, level, position, route, radius))

    def _times_at(
        self, packed: PackedFields, level: ArrayLike, position: FloatArray, route: ArrayLike, radius: ArrayLike
    ) -> FloatArray:
        from evac.directions.sampling import sample_travel_times

        return _sampled(sample_travel_times, packed, level, position, columns_of(packed, route, radius), ())

    def directions_at(
        self, level: ArrayLike, position: FloatArray, route: ArrayLike, radius: ArrayLike = 0.0
    ) -> FloatArray:
        """Return the unit directions (n, 2) of routes at positions; zero where the destination cannot be reached."""
        from evac.directions.sampling import sample_directions

        return _sampled(sample_directions, self.packed, level, position, columns_of(self.packed, route, radius), (2,))


def _sampled(
    sample: Any, packed: PackedFields, level: ArrayLike, position: FloatArray, column: ArrayLike, shape: tuple[int, ...]
) -> FloatArray:
    """Call a sampling kernel with levels and columns broadcast to the positions."""
    place = np.ascontiguousarray(np.asarray(position, dtype=np.float64).reshape(-1, 2))
    number = len(place)
    values = np.empty((number, *shape))
    sample(
        packed,
        place,
        np.ascontiguousarray(np.broadcast_to(np.asarray(level, dtype=np.int32), number)),
        np.ascontiguousarray(np.broadcast_to(np.asarray(column, dtype=np.int32), number)),
        values,
    )
    return values
