"""Refuges: areas in which people wait whose routes do not lead out of the building."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray
from evac.base.saved import taken
from evac.building.model.building import Area, Building
from evac.directions.routes import Route
from evac.people.groups import route_of
from evac.physics.state import Crowd

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.case.schema import GroupSettings
    from evac.directions.fields import Fields

#: Speed below which people have come to a stop, and stay where they are in a refuge [m/s].
STANDS = 0.1


@dataclass(frozen=True)
class Refuge:
    """A refuge and its people at the end of a run.

    Attributes
    ----------
    name : str
    capacity : int or None
        Greatest number of people; None: any.
    people : tuple of int
        The people who were in it.
    """

    name: str
    capacity: int | None
    people: tuple[int, ...]


def routes_to_refuges(case: "Case", people: "GroupSettings") -> tuple[Route, ...]:
    """Return the route of a group to each refuge; none for groups that use all stairs and turn in narrow doors."""
    if people.steepest is None and people.turns:
        return ()
    own = replace(route_of(people), exits=())
    return tuple(replace(own, refuge=place.area) for place in case.place)


class Refuges:
    """The people who go to a refuge because their way out is barred, and those who have arrived.

    People whose group has `steepest`, or does not turn, and who have no way out that is as wide as they are, go to the
    nearest refuge that they can reach and that is not full, where they stay. If a way out opens before, they take it.

    Parameters
    ----------
    case : Case
    building : Building
    routes : sequence of Route
        Routes of the fields.
    crowd : Crowd

    Attributes
    ----------
    arrived : (n,) bool
        Whether each person stays in its refuge. Its speed factor is zero.
    """

    def __init__(self, case: "Case", building: Building, routes: Sequence[Route], crowd: Crowd) -> None:
        areas = {area.name: area for area in building.areas}
        self._places, self._crowd = case.place, crowd
        self._areas: list[Area] = [areas[place.area] for place in case.place]
        self._ways = [[routes.index(route) for route in routes_to_refuges(case, people)] for people in case.people]
        self._before: IntArray = crowd.route.copy()  # route of each person until it was sent to a refuge
        self._meant: IntArray = np.full(len(crowd.level), -1, dtype=np.int32)
        self.arrived: NDArray[np.bool_] = np.zeros(len(crowd.level), dtype=np.bool_)

    def assign(self, fields: "Fields") -> None:
        """Send the people who cannot get out to refuges, and those who can to their exits.

        Parameters
        ----------
        fields : Fields
            The present ones.
        """
        crowd = self._crowd
        for group, ways in enumerate(self._ways):
            is_asked = (crowd.group == group) & (crowd.level >= 0) & ~self.arrived & bool(ways)
            for row in np.flatnonzero(is_asked).tolist():
                if self._meant[row] < 0:
                    self._before[row] = crowd.route[row]
                times = self._times(fields, row, [self._before[row], *ways])
                room = [np.isfinite(times[1 + k]) and self._has_room(k, row) for k in range(len(ways))]
                if np.isfinite(times[0]) or not any(room):
                    self._meant[row], crowd.route[row] = -1, self._before[row]
                elif self._meant[row] < 0 or not room[self._meant[row]]:
                    nearest = int(np.argmin(np.where(room, times[1:], np.inf)))
                    self._meant[row], crowd.route[row] = nearest, ways[nearest]

    def _times(self, fields: "Fields", row: int, routes: Sequence[int]) -> FloatArray:
        """Return the travel times of a person on some routes [s], inf if no way is as wide as its body."""
        crowd, n = self._crowd, len(routes)
        place = crowd.level[row], np.repeat(crowd.position[row : row + 1], n, axis=0), routes, crowd.contact_radius[row]
        is_wide = np.isfinite(fields.lengths_at(*place)).all(axis=1)
        return np.where(is_wide, fields.travel_time_at(*place), np.inf)

    def _has_room(self, place: int, row: int) -> bool:
        """Return whether a refuge has room for a person besides the others who go there."""
        capacity = self._places[place].capacity
        others = int(np.count_nonzero(self._meant == place)) - int(self._meant[row] == place)
        return capacity is None or others < capacity

    def settle(self, velocity: FloatArray) -> None:
        """Let those stay who have come to a stop in their refuge.

        Parameters
        ----------
        velocity : (n, 2) float64
            Displacement velocities [m/s].
        """
        crowd = self._crowd
        coming = (self._meant >= 0) & ~self.arrived & (crowd.level >= 0)
        coming &= np.hypot(*velocity.T) < STANDS
        for place, area in enumerate(self._areas):
            rows = np.flatnonzero(coming & (self._meant == place) & (crowd.level == area.level))
            self.arrived[rows[shapely.intersects_xy(area.polygon, *crowd.position[rows].T)]] = True

    def found(self) -> tuple[Refuge, ...]:
        """Return the refuges with the people who have arrived."""
        return tuple(
            Refuge(place.name, place.capacity, tuple(np.flatnonzero(self.arrived & (self._meant == index)).tolist()))
            for index, place in enumerate(self._places)
        )

    def state(self) -> dict[str, NDArray[Any]]:
        """Return where people are meant to go, by which route they went before, and who has arrived."""
        return {"meant": self._meant.copy(), "before": self._before.copy(), "arrived": self.arrived.astype(np.uint8)}

    def restore(self, state: Mapping[str, NDArray[Any]], routes: int) -> None:
        """Restore the arrays that `state` returned, of a run with a number of routes."""
        self._before[:] = taken(state, "before", np.int32, self._before.shape, 0, routes - 1)
        self._meant[:] = taken(state, "meant", np.int32, self._meant.shape, -1, len(self._places) - 1)
        self.arrived[:] = taken(state, "arrived", np.uint8, self.arrived.shape, 0, 1)
