"""Places: refuges, in which people wait whose routes do not lead out of the building, and assembly areas."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray
from evac.base.defaults import SIGN_RANGE
from evac.base.errors import ScenarioError
from evac.base.parameters import did_you_mean
from evac.base.saved import Saved
from evac.building.model.building import Area, Building, Place
from evac.building.options import Placed
from evac.building.surface.places import find_level
from evac.directions.fields import Fields
from evac.directions.routes import Route
from evac.people.groups import route_of
from evac.physics.state import Crowd

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.case.schema import GroupSettings, PlaceSettings

ON_WALL = 0.5  #: Distance from a level within which a sign may be, so that it may hang on a wall [m].
STANDS = 0.1  #: Speed along the way below which people have come to a stop, and stay where they are in a place [m/s].


@dataclass(frozen=True)
class PeopleAt:
    """A refuge or assembly area and its people at the end of a run."""

    name: str
    kind: str  # "refuge" or "assembly"
    capacity: int | None  # greatest number of people; None: any
    people: tuple[int, ...]
    last: float | None  # when the last of them had come to a stop there [s]; None if nobody was there

    def __str__(self) -> str:
        """Return kind and name, such as ``"refuge 'lobby'"``."""
        return f"{'assembly area' if self.kind == 'assembly' else self.kind} {self.name!r}"


def with_places(case: "Case", building: Building) -> Building:
    """Return the building with the places and lines of a case."""
    places, problems = list[Place](), list[str]()
    for one in case.place:
        try:
            places.append(_area(building, one) if one.area is not None else _point(building, one))
        except ValueError as error:
            problems.append(f"{case.source}: place.{one.name}.{error}")
    for line in case.line:
        level = building.level_named(line.level)
        if level is None:
            hint = did_you_mean(line.level, [one.name for one in building.levels])
            problems.append(f"{case.source}: line.{line.name}.level: no level is named {line.level!r}; {hint}")
        elif not (drawn := shapely.LineString(line.segment)).intersects(level.polygon):
            problems.append(f"{case.source}: line.{line.name}.segment: it is not on level {level.name!r}; move it")
        else:
            places.append(Place(line.name, "line", level.index, drawn))
    ends = {way.name: way.name for way in building.exits} | {one.name: one.area for one in places if one.area}
    for name in sorted(case.directions.costs.keys() - ends.keys()):
        problems.append(f"{case.source}: directions.costs: no exit or place {name!r}; {did_you_mean(name, [*ends])}")
    if problems:
        raise ScenarioError("\n".join(problems))
    costs = frozenset((ends[name], cost) for name, cost in case.directions.costs.items())
    return replace(building, places=tuple(places), costs=costs)


def _area(building: Building, place: "PlaceSettings") -> Place:
    areas = [area.name for area in building.areas]
    assert place.area is not None
    if areas.count(place.area) != 1:
        hint = did_you_mean(place.area, areas) if areas else "there are no areas: add one to building.areas"
        raise ValueError(f"area: no single area is named {place.area!r}; {hint}")
    area = building.areas[areas.index(place.area)]
    if building.levels[area.level].kind == "car":
        raise ValueError(f"area: {place.area!r} is in a lift, which takes people away; draw an area before its door")
    return Place(place.name, place.kind, area.level, area.polygon, place.area, place.capacity)


def _point(building: Building, place: "PlaceSettings") -> Place:
    assert place.position is not None
    exits, point = [exit_.name for exit_ in building.exits], shapely.Point(place.position)
    if place.exit is not None and place.exit not in exits:
        raise ValueError(f"exit: no exit is named {place.exit!r}; {did_you_mean(place.exit, exits)}")
    level = find_level(building, Placed(level=place.level, z=place.z), point)
    if not shapely.dwithin(level.polygon, point, ON_WALL):
        raise ValueError(f"position: {list(place.position)} is not on level {level.name!r}; move it")
    seen = 0.0 if place.exit is None else place.range or SIGN_RANGE
    return Place(place.name, place.kind, level.index, point, exit=place.exit or "", range=seen)


def routes_to_places(case: "Case", people: "GroupSettings") -> dict[str, Route]:
    """Return the route of a group to each place to which it may go, by the name of the place.

    These are the assembly areas that the group or an event names, and for groups that do not use all stairs or do not
    turn in narrow doors the refuges.
    """
    own = replace(route_of(people), exits=())
    sent = {*people.assembly}
    for one in case.event:
        if one.kind == "strategy" and one.target == people.name and isinstance(one.value, tuple):
            sent |= {*one.value}
    return {
        place.name: replace(own, area=place.area or "")
        for place in case.place
        if (place.kind == "assembly" and place.name in sent) or (place.kind == "refuge" and is_limited(people))
    }


def is_limited(people: "GroupSettings") -> bool:
    """Return whether a group does not use all stairs, or does not turn in narrow doors."""
    return people.steepest is not None or not people.turns


def have_stopped(
    fields: Fields, crowd: Crowd, rows: NDArray[np.integer[Any]], velocity: FloatArray, place: Area | Place
) -> NDArray[np.integer[Any]]:
    """Return the people who are in a place and come no nearer to its innermost point, because others stand there."""
    shape = place.polygon if isinstance(place, Area) else place.shape
    rows = rows[crowd.level[rows] == place.level]
    rows = rows[shapely.intersects_xy(shape, *crowd.position[rows].T)]
    along = fields.directions_at(place.level, crowd.position[rows], crowd.route[rows], crowd.contact_radius[rows])
    has_stopped: NDArray[np.bool_] = (along * velocity[rows]).sum(axis=1) < STANDS
    return rows[has_stopped]


class Places(Saved):
    """The people who go to a refuge or to an assembly area, and those who have arrived.

    People whose group has `assembly` go to the nearest of these areas that they can reach and that is not full. Who
    cannot reach one leaves by an exit. People whose group has `steepest`, or does not turn, and who have no way out
    that is as wide as they are, go to the nearest refuge that they can reach and that is not full. If a way out, or to
    an assembly area, opens before they have arrived, they take it. Who has arrived (`arrived`, (n,)) stays, with the
    speed factor zero, until an event sends the group elsewhere, or a lift leads out of a refuge. `of_groups` (n,) are
    the routes that groups have in the case.
    """

    saved = ("_before", "_meant", "_sent", "_is_brought", "_since", "arrived")

    def __init__(self, case: "Case", building: Building, routes: Sequence[Route], crowd: Crowd) -> None:
        self._places = tuple(place for place in building.places if place.area)
        self._crowd = crowd
        self._index = {place.name: index for index, place in enumerate(self._places)}
        self._is_assembly = np.array([place.kind == "assembly" for place in self._places], dtype=np.bool_)
        self._ways = [
            {self._index[name]: routes.index(route) for name, route in routes_to_places(case, people).items()}
            for people in case.people
        ]
        # Route of each group to each place, -1 if it has none, also in the last column, which stands for no place.
        self._way_to: IntArray = np.full((len(case.people), len(self._places) + 1), -1, dtype=np.int32)
        for group, ways in enumerate(self._ways):
            self._way_to[group, [*ways]] = [*ways.values()]
        self._ends_inside = np.array([bool(route.area) for route in routes], dtype=np.bool_)
        self._rides = np.array([bool(route.lifts) for route in routes])
        self._is_limited = [is_limited(people) for people in case.people]
        self.of_groups: IntArray = crowd.route.copy()
        self._before: IntArray = crowd.route.copy()  # route of each person until it was sent to a place
        self._meant: IntArray = np.full(len(crowd.level), -1, dtype=np.int32)
        self._since: FloatArray = np.full(len(crowd.level), np.nan)  # when each person arrived [s]
        self.arrived: NDArray[np.bool_] = np.zeros(len(crowd.level), dtype=np.bool_)
        self._is_brought: NDArray[np.bool_] = np.zeros(len(crowd.level), dtype=np.bool_)
        # Assembly areas to which each group goes at present.
        self._sent: NDArray[np.bool_] = np.zeros((len(case.people), len(self._places)), dtype=np.bool_)
        for group, people in enumerate(case.people):
            self.send(group, people.assembly)

    def has_assembly_areas(self, names: Sequence[str]) -> bool:
        """Return whether names are those of assembly areas, at least one."""
        return bool(names) and all(name in self._index and self._is_assembly[self._index[name]] for name in names)

    def can_be_sent(self, group: int, names: Sequence[str]) -> bool:
        """Return whether a group has routes to assembly areas."""
        return {self._index[name] for name in names} <= self._ways[group].keys()

    def send(self, group: int, names: Sequence[str]) -> bool:
        """Send a group to assembly areas, or to exits if no names are given; return whether that is new.

        `assign` must follow.
        """
        before = self._sent[group].copy()
        self._sent[group] = False
        self._sent[group, [self._index[name] for name in names]] = True
        rows = np.flatnonzero((self._crowd.group == group) & (self._meant >= 0))
        moves = rows[~self._sent[group, self._meant[rows]] & self._is_assembly[self._meant[rows]]]
        self.arrived[moves] = False
        return bool((before != self._sent[group]).any())

    @property
    def at_refuge(self) -> NDArray[np.bool_]:
        """Who is in a refuge (n,)."""
        at_refuge: NDArray[np.bool_] = self.arrived & np.append(~self._is_assembly, False)[self._meant]
        return at_refuge

    @property
    def stands_firm(self) -> NDArray[np.bool_]:
        """Who cannot make room for others: who is in a refuge, or has been brought to its place (n,)."""
        firm: NDArray[np.bool_] = self.at_refuge | self.arrived & self._is_brought
        return firm

    @property
    def waits_for_lift(self) -> NDArray[np.bool_]:
        """Who is in a refuge, and leaves as soon as there is a lift (n,)."""
        waits: NDArray[np.bool_] = self.at_refuge & self._rides[self._before]
        return waits

    def exit_routes(self, rows: NDArray[np.integer[Any]]) -> IntArray:
        """Return the routes of people to exits: of those who go to an area, the route that they had before."""
        goes = (self._meant[rows] >= 0) | self._is_led(rows)
        routes: IntArray = np.where(goes, self._before[rows], self._crowd.route[rows])
        return routes

    def _is_led(self, rows: NDArray[np.integer[Any]]) -> NDArray[np.bool_]:
        """Return who is on the way to an area because a behaviour wants it."""
        own = self._way_to[self._crowd.group[rows], self._meant[rows]]
        is_led: NDArray[np.bool_] = self._ends_inside[self._crowd.route[rows]] & (self._crowd.route[rows] != own)
        return is_led

    def set_exit_routes(self, rows: NDArray[np.integer[Any]], routes: IntArray) -> None:
        """Set the routes of people to exits; those who go to a place take them if they do so no more."""
        goes = (self._meant[rows] >= 0) | self._is_led(rows)
        self._before[rows[goes]] = routes[goes]
        self._crowd.route[rows[~goes]] = routes[~goes]

    def assign(self, fields: Fields) -> None:
        """Send people to places, and those who have none to their exits, unless a behaviour leads them to an area."""
        taken_up = np.bincount(self._meant[self._meant >= 0], minlength=len(self._places))
        for group, ways in enumerate(self._ways):
            if not ways:
                continue
            is_asked = (self._crowd.level >= 0) & ~self._is_brought & (~self.arrived | self.waits_for_lift)
            rows = np.flatnonzero((self._crowd.group == group) & is_asked)
            rows = rows[~self._is_led(rows)]
            self._before[rows] = self.exit_routes(rows)
            out = self._times(fields, rows, self._before[rows], self._is_limited[group])
            times = np.full((len(rows), len(self._places)), np.inf)
            for place, route in ways.items():
                if self._sent[group, place] or not self._is_assembly[place]:
                    routes = np.full(len(rows), route, np.int32)
                    times[:, place] = self._times(fields, rows, routes, self._is_limited[group])
            for k, row in enumerate(rows.tolist()):
                self._assign(row, times[k], bool(np.isfinite(out[k])), taken_up)
            goes = self._meant[rows] >= 0
            self.arrived[rows[~goes]] = False
            to_places = [ways[place] for place in self._meant[rows[goes]].tolist()]
            self._crowd.route[rows] = self._before[rows]
            self._crowd.route[rows[goes]] = to_places

    def _assign(self, row: int, times: FloatArray, can_leave: bool, taken_up: NDArray[np.int64]) -> None:
        """Send a person to a place with room, by its travel times to all of them."""
        if self._meant[row] >= 0:
            taken_up[self._meant[row]] -= 1
        room = [place.capacity is None or taken_up[k] < place.capacity for k, place in enumerate(self._places)]
        is_possible = np.isfinite(times) & room
        own = is_possible & self._is_assembly
        if not own.any() and not can_leave:
            own = is_possible
        if not own.any():
            self._meant[row] = -1
        elif self._meant[row] < 0 or not own[self._meant[row]]:
            self._meant[row] = int(np.argmin(np.where(own, times, np.inf)))
        if self._meant[row] >= 0:
            taken_up[self._meant[row]] += 1

    def _times(self, fields: Fields, rows: NDArray[np.integer[Any]], routes: IntArray, is_limited: bool) -> FloatArray:
        """Return the travel times of people on their routes [s], inf if no way is as wide as their bodies."""
        crowd = self._crowd
        place = crowd.ways(rows, routes)
        times = fields.travel_time_at(*place)
        if is_limited:
            times[~fields.are_passable(*place)] = np.inf
        return times

    def settle(self, time: float, fields: Fields, velocity: FloatArray) -> None:
        """Let those stay who have come to a stop in their place; velocities (n, 2) are those of displacement [m/s]."""
        crowd = self._crowd
        for index, place in enumerate(self._places):
            coming = np.flatnonzero((self._meant == index) & ~self.arrived & (crowd.level >= 0))
            rows = have_stopped(fields, crowd, coming, velocity, place)
            self.arrived[rows], self._since[rows] = True, time

    @property
    def full(self) -> tuple[str, ...]:
        """The names of refuges to which as many people go as they have room for."""
        meant = np.bincount(self._meant[self._meant >= 0], minlength=len(self._places)).tolist()
        return tuple(
            place.name
            for place, people in zip(self._places, meant, strict=True)
            if place.kind == "refuge" and people == place.capacity
        )

    def goes(self, person: int) -> bool:
        """Return whether a person is on the way to a place."""
        return bool(self._meant[person] >= 0 and not self.arrived[person])

    def release(self, people: "int | IntArray") -> None:
        """Let people leave their place, because they are sent elsewhere; they are not assigned to places any more."""
        self._is_brought[people], self.arrived[people], self._meant[people] = True, False, -1

    def take_in(self, person: int, name: str, time: float) -> None:
        """Let a person stay in a place to which it was brought."""
        self._meant[person], self.arrived[person], self._since[person] = self._index[name], True, time

    def people_at(self) -> tuple[PeopleAt, ...]:
        """Return the refuges and assembly areas with the people who have arrived."""
        rows = [np.flatnonzero(self.arrived & (self._meant == index)) for index in range(len(self._places))]
        return tuple(
            PeopleAt(
                place.name,
                place.kind,
                place.capacity,
                tuple(there.tolist()),
                float(self._since[there].max()) if len(there) else None,
            )
            for place, there in zip(self._places, rows, strict=True)
        )
