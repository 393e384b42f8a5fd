"""Together: families and groups that gather at a place first, and wait for each other on their way."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import ScenarioError, counted
from evac.base.parameters import Parameter, did_you_mean
from evac.building.model.building import FLAT
from evac.directions.routes import Route
from evac.people.behaviour import Behaviour, BehaviourScene
from evac.people.places import have_stopped
from evac.physics.state import Crowd

PAUSE = 0.1  #: Time after the start of a person within which it has not arrived, because it has not begun to walk [s].

#: Decrease of the remaining travel time of the last member below its minimum so far that counts as progress [s].
PROGRESS = 0.5

#: Distance [m] and difference of the remaining travel times [s] up to which somebody is close behind, and the share of
#: the desired speed below which this person does not get on.
BEHIND, LATER, HELD_UP = 1.5, 5.0, 0.5

# What the members of a unit do.
GATHERS, COUNTS, LEAVES = range(3)


class Together(Behaviour):
    """Families and other units stay together: those ahead wait for the last, and they may gather at a place first.

    A unit consists of `size` people of a group, or of all people of the groups with the same `unit`. Positions are
    compared by the remaining travel time T. A member who is ahead of the last one by dT = T_last - T, or by T if that
    is less, walks at the share 2 (1 - dT / lag) of the speed, limited to [0, 1]. Nobody waits for a last member who has
    made no progress for `patience`, nor before people of other units who are close behind and do not get on.

    A unit with the key `gather`, the name of an area in `places`, goes there first. Once all members have arrived, or
    `patience` after the last arrival, they are counted, which takes the time `count`, and leave. An example is a class
    that its teacher counts; with `teacher_following`, the class also walks behind the teacher. The notes of the results
    name who was missing.
    """

    name = "together"
    saved = ("_stage", "_since", "_least", "_counted", "_arrived")
    reads = ("position", "level", "contact_radius", "route", "start_time", "speed")
    writes = ("route", "speed_factor")
    group_keys = ("size", "unit", "gather")

    size = Parameter(0, "number of people of a unit; 0: all people of a group", minimum=0)
    unit = Parameter("", "name of the unit, common to several groups; empty: a group has its own units")
    gather = Parameter("", "area at which a unit gathers, one of `places`; empty: none")
    places: Any = Parameter((), "areas at which units gather")
    lag = Parameter(3.0, "lead over the last member at which the others stop", unit="s", above=0.0)
    count = Parameter(10.0, "time for which a unit stays once all have gathered", unit="s", minimum=0.0)
    patience = Parameter(30.0, "time without progress after which nobody waits", unit="s", minimum=0.0, infinite=True)

    def routes(self) -> tuple[Route, ...]:
        """Return a route to each place."""
        return tuple(Route(area=place) for place in self.places)

    def prepare(self, scene: BehaviourScene) -> None:
        """Divide the groups into units."""
        self._scene = scene
        rows: list[IntArray] = [np.zeros(0, np.int32)]
        unit: list[IntArray] = [np.zeros(0, np.int32)]
        places: list[str] = []
        self._names: list[str] = []
        named: dict[str, int] = {}
        for group in _taking_part(scene):
            place, people = self._checked_place(group), len(group.rows)
            name = group.settings.get("unit", self.unit)
            if name:
                own = np.full(people, named.setdefault(name, len(places)))
            else:
                own = len(places) + np.arange(people) // (group.settings.get("size", self.size) or people)
            new = int(own[-1]) + 1 - len(places)
            places += [place] * new
            self._names += [name] if name and new else [f"{group.name} {number}" for number in range(1, new + 1)]
            rows.append(group.rows)
            unit.append(own.astype(np.int32))
        self._rows, self._unit, self._place = np.concatenate(rows), np.concatenate(unit), places
        self._stage = np.array([GATHERS if place else LEAVES for place in places], dtype=np.int32)
        routes = scene.scene.fields.routes
        for k in np.flatnonzero(self._stage[self._unit] == GATHERS).tolist():
            steepest = routes[scene.crowd.route[self._rows[k]]].steepest
            to_place = Route(area=self._place[self._unit[k]], steepest=steepest)
            scene.crowd.route[self._rows[k]] = routes.index(to_place)
        self._arrived = np.zeros(len(self._rows), dtype=np.uint8)
        self._since = np.zeros(len(places))  # last progress, or the end of the count [s]
        self._least = np.full(len(places), np.inf)  # least travel time of the last member [s]
        self._counted = np.full(len(places), np.inf)  # when each unit was counted [s]

    def _checked_place(self, group: Any) -> str:
        """Return the place at which a group gathers; an empty text if it does not."""
        place: str = group.settings.get("gather", self.gather)
        if place and place not in self.places:
            hint = did_you_mean(place, self.places) if self.places else "it is empty"
            key = f"people.{group.name}.behaviours.together.gather"
            raise ScenarioError(f"{key}: {place!r} is not in behaviours.together.places; {hint}")
        return place

    def act(self, crowd: Crowd, time: float) -> None:
        """Lead the units to their places, count them, and let those ahead wait for the last."""
        is_inside = crowd.level[self._rows] >= 0
        self._gather(crowd, time)
        self._end_stages(crowd, time, is_inside)
        stage = self._stage[self._unit]
        crowd.speed_factor[self._rows[(stage != LEAVES) & (self._arrived == 1)]] = 0.0
        is_there = self._scene.scene.places.arrived[self._rows]
        self._wait(crowd, time, is_inside & (stage == LEAVES) & ~is_there)

    def _gather(self, crowd: Crowd, time: float) -> None:
        """Note who has arrived at the place of its unit."""
        started = time > crowd.start_time[self._rows] + PAUSE
        coming = (self._arrived == 0) & started & (self._stage[self._unit] == GATHERS)
        for unit in np.unique(self._unit[coming]).tolist():
            members = np.flatnonzero(coming & (self._unit == unit))
            area = next(area for area in self._scene.scene.building.areas if area.name == self._place[unit])
            fields, velocity = self._scene.scene.fields, self._scene.displacement_velocity
            there = have_stopped(fields, crowd, self._rows[members], velocity, area)
            if len(there):
                self._arrived[np.isin(self._rows, there)] = 1
                self._since[unit] = time

    def _end_stages(self, crowd: Crowd, time: float, is_inside: NDArray[np.bool_]) -> None:
        """Let units count when all have arrived, and leave when they are counted."""
        missing = np.bincount(self._unit[is_inside & (self._arrived == 0)], minlength=len(self._since))
        arrived = np.bincount(self._unit[self._arrived == 1], minlength=len(self._since))
        complete = (missing == 0) | ((arrived > 0) & (time - self._since > self.patience))
        begins = (self._stage == GATHERS) & complete
        ends = (self._stage == COUNTS) & (time >= self._since)
        self._stage[begins], self._since[begins] = COUNTS, time + self.count
        self._stage[ends], self._since[ends], self._counted[ends] = LEAVES, time, time
        if ends.any():
            places, rows = self._scene.scene.places, self._rows[ends[self._unit] & is_inside]
            crowd.route[rows] = places.exit_routes(rows)
            places.assign(self._scene.scene.fields)

    def _wait(self, crowd: Crowd, time: float, walks: NDArray[np.bool_]) -> None:
        """Let those ahead of the last member of their unit wait."""
        rows, unit = self._rows[walks], self._unit[walks]
        remaining = self._scene.scene.fields.travel_time_at(*crowd.ways(rows))
        last = np.full(len(self._since), -np.inf)
        np.maximum.at(last, unit[np.isfinite(remaining)], remaining[np.isfinite(remaining)])
        progresses = np.isfinite(last) & (last < self._least - PROGRESS)
        self._least[progresses], self._since[progresses] = last[progresses], time
        waits = np.isfinite(remaining) & (time - self._since[unit] <= self.patience)
        lead: FloatArray = np.minimum(np.where(waits, last[unit] - remaining, 0.0), remaining)
        ahead = np.flatnonzero(lead > 0.5 * self.lag)
        ahead = ahead[~self._holds_up(crowd, time, rows[ahead], remaining[ahead])]
        crowd.speed_factor[rows[ahead]] *= np.maximum(2.0 * (1.0 - lead[ahead] / self.lag), 0.0)

    def _holds_up(self, crowd: Crowd, time: float, rows: IntArray, remaining: FloatArray) -> NDArray[np.bool_]:
        """Return behind which of those who would wait others are close who do not get on."""
        from scipy.spatial import cKDTree

        waits = np.zeros(len(crowd.level), np.bool_)
        waits[rows] = True
        unit = np.full(len(crowd.level), -1)
        unit[self._rows] = self._unit
        slow = np.hypot(*self._scene.displacement_velocity.T) < HELD_UP * crowd.speed[:, FLAT]
        slow = np.flatnonzero(slow & (crowd.level >= 0) & (crowd.start_time < time))
        near = cKDTree(crowd.position[rows]).query_ball_point(crowd.position[slow], BEHIND) if len(rows) else []
        ahead = np.array([k for own in near for k in own], np.intp)
        other = np.repeat(slow, [len(own) for own in near]) if len(rows) else slow[:0]
        later = self._scene.scene.fields.travel_time_at(
            crowd.level[other], crowd.position[other], crowd.route[rows[ahead]], crowd.contact_radius[rows[ahead]]
        )
        later -= remaining[ahead]
        is_behind = (later > 0.0) & (later < LATER) & (unit[other] != unit[rows[ahead]])
        ahead, other = ahead[is_behind], other[is_behind]
        while (goes_on := waits[rows[ahead]] & ~waits[other]).any():  # who goes on may be held up in turn
            waits[rows[ahead[goes_on]]] = False
        return ~waits[rows]

    def notes(self) -> tuple[str, ...]:
        """Return a line for each unit that was to gather and was not counted, or of which people were missing."""
        lines = []
        for unit, name in enumerate(self._names):
            members = np.flatnonzero(self._unit == unit)
            missing = self._rows[members[self._arrived[members] == 0]].tolist()
            who = f"{counted(len(missing), 'person', 'people')} missing: {', '.join(map(str, missing))}"
            if self._place[unit] and np.isinf(self._counted[unit]):
                lines.append(f"{name!r} was not counted; {len(members) - len(missing)} of {len(members)} were there")
            elif self._place[unit] and missing:
                there = f"{len(members) - len(missing)} of {len(members)} at {self._place[unit]!r}"
                lines.append(f"{name!r} counted {there} at {self._counted[unit]:.1f} s; {who}")
        return tuple(lines)

    def is_needed(self, scene: BehaviourScene) -> bool:
        """Return False if no group has one of the keys."""
        return bool(_taking_part(scene))


def _taking_part(scene: BehaviourScene) -> list[Any]:
    """Return the groups with one of the keys; at a rate, nobody of a group may come."""
    keys = set(Together.group_keys)
    return [group for group in scene.groups if len(group.rows) and group.settings.keys() & keys]
