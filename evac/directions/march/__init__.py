"""Travel times by fast marching: the base class of solvers, and two solvers.

`FastMarching` (`marching.py`) calls scikit-fmm, level by level, and solves all fields of a building before a run.
`CompiledMarch` (`compiled.py`) is one wave through all levels in compiled code, which solves some levels again during a
run, from times near the ends of ways that the first one has found; only runs whose ways follow the crowd, or smoke,
load it. `evac evidence directions` compares both with exact times.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Self

from evac.base.arrays import FloatArray
from evac.building.model.building import Area, Building, Exit
from evac.directions.lengths import barred_on, ends_of_route, slowness_of
from evac.directions.raster.grids import BuildingGrids
from evac.directions.routes import Route


@dataclass(frozen=True)
class EikonalProblem:
    """What the travel times of a route follow from: |grad T| = slowness factor, with T = 0 or a cost at each end."""

    slowness: FloatArray  # (levels, 3) float64: cost per metre in plan, by level and use (flat, up, down) [s/m]
    factor: FloatArray  # (nodes,) float64: factor of the slowness at each node; at least 1
    ends: list[Exit | Area]
    barred: frozenset[tuple[int, int]] = frozenset()  # portals that are not passed, each with the level before it
    lifts: bool = False  # whether jumps by lifts count
    # whether the cost per metre is uniform on each level, except for gaps that nobody fits through
    is_plain: bool = True

    @classmethod
    def of(cls, building: Building, route: Route, rate: FloatArray, factor: FloatArray, is_plain: bool = False) -> Self:
        """Return that of a route, with the costs (3,) per metre along the slope in each use [s/m]."""
        slowness, ends = slowness_of(building, rate, route), ends_of_route(building, route)
        return cls(slowness, factor, ends, barred_on(building, route), bool(route.lifts), is_plain)


class EikonalSolver(ABC):
    """A solver of a problem on the grids of a building."""

    def __init__(self, grids: BuildingGrids, problem: EikonalProblem) -> None:
        self.grids, self.problem = grids, problem

    @abstractmethod
    def solve(self) -> FloatArray:
        """Return the minimum cost (nodes,) from each node to any end [s]; inf where none can be reached.

        Nodes in front of an exit that lie behind its line have negative costs.
        """
