"""Helpers: people who fetch others who cannot leave alone, and bring them out, to a refuge or to an assembly area."""

import math
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import ScenarioError
from evac.base.parameters import Parameter, did_you_mean
from evac.building.model.building import DOWN, FLAT, UP
from evac.directions.routes import PREFERRED, WEIGHED, Route
from evac.people.behaviour import Behaviour, BehaviourScene
from evac.people.places import have_stopped
from evac.physics.state import Crowd

REACH = 0.6  #: Gap between the bodies of a helper and a person at which the helper has come [m].

#: Distance within which a helper walks straight to the person [m], and weight of that direction.
NEAR, STRAIGHT = 6.0, 4.0

#: Distance of a helper beyond which the person waits for it, or it for the person [m]; distance within which helpers
#: ahead do not slow down, greater than the one that people keep from those ahead at the speed of devices [m].
LOST, BESIDE = 3.0, 2.0

BESIDE_DOOR = 0.5  #: Distance from a door at which its two sides are looked at [m].
HASTE = 1.3  #: Speed of helpers who have fallen behind, over that of the device.
LEAD = 2.0  #: Time to the exit from which helpers who are still needed let the person go alone [s].
FASTEST = 10.0  #: Greatest speed of a device [m/s].
FLIGHT = 0.5  #: Length of a stair below which a device need not go up or down, because lengths are interpolated [m].
RAMP = 0.0834  #: Slope of ramps for wheelchairs.

# What is done for a person.
WAITS, IS_FETCHED, IS_PREPARED, IS_BROUGHT, IS_THERE = range(5)


class Device(NamedTuple):
    """Speeds of a way to bring somebody [m/s], up and down along the slope, helpers for it, and the steepest slope."""

    flat: float
    up: float
    down: float
    handlers: int
    steepest: float | None = None


DEVICES = {
    "evacuation_chair": Device(1.3, 0.0, 0.84, 1),
    "carry": Device(1.0, 0.6, 0.6, 2),
    "support": Device(0.78, 0.31, 0.31, 1),
    "push": Device(1.3, 1.3, 1.3, 1, RAMP),
}


class Helpers(Behaviour):
    """Groups with the key `fetches` are helpers, who bring out the people of the group that it names.

    People of a group with the key `device` do not leave alone. They wait in one of the `areas` in which they start, or
    go to a refuge among these `areas` if the case has one for them. As soon as somebody waits, the nearest free
    helpers, as many as the device needs (`handlers`), go to that person. After the time `preparation` they go together
    at the speeds of the device, and by lifts if the key `lifts` says so; the person waits for a helper who is more than
    3 m away, as one whom the car had no room for. They leave by one of `exits`, or go to the refuge or assembly area in
    `to`. Helpers who are still needed turn back there, 2 s before an exit, and fetch the next person; the others leave
    by the exits of their group. People whom the device cannot bring all the way are not fetched. The notes of the
    results say who was fetched when, and by whom.

    | device | flat | up | down | helpers | source |
    |---|---|---|---|---|---|
    | `evacuation_chair` | 1.3 | 0 | 0.84 | 1 | down: fastest device of Hunt et al. 2020; flat: as `push` |
    | `carry` | 1.0 | 0.6 | 0.6 | 2 | down: slowest device of Hunt et al. 2020; others: assumed |
    | `support` | 0.78 | 0.31 | 0.31 | 1 | Boyce et al. 1999; stairs: Peacock et al. 2014, as the preset `accompanied` |
    | `push` | 1.3 | 1.3 | 1.3 | 1 | Boyce et al. 1999, as the preset `pushed_wheelchair`; ramps up to 1:12, no stairs |

    Speeds are in m/s, on stairs along the slope. It is assumed that the evacuation chair is the fastest device of Hunt
    et al., and carrying the slowest; the default of `preparation` is an assumption, too. `devices` adds others, such as
    ``{ sledge = { flat = 0.7, up = 0.0, down = 0.6, handlers = 2 } }``.

    References
    ----------
    Hunt et al.: Simulating movement devices used in hospital evacuation. Fire Technology (2020),
    10.1007/s10694-020-00971-5, abstract: mean speeds on stairs from 0.6 to 0.84 m/s.
    """

    name = "helpers"
    saved = ("_state", "_task", "_until", "_by")
    reads = ("position", "level", "radius", "contact_radius", "route", "speed", "start_time", "speed_factor")
    writes = ("route", "speed_factor", "extra_direction")
    group_keys = ("device", "fetches")

    device = Parameter("", "device with which people of the group are brought out")
    fetches = Parameter("", "name of the group that people of this group fetch")
    areas: Any = Parameter((), "areas in which people wait for helpers, each in one room")
    exits: Any = Parameter((), "exits to which people are brought; empty: any")
    to = Parameter("", "area of a refuge or assembly area to which people are brought, instead of exits")
    lifts: Any = Parameter("", "whether people are brought by lifts, as `lifts` of groups: weighed or preferred")
    preparation = Parameter(30.0, "time from the arrival of the helpers until they go", unit="s", minimum=0.0)
    devices: Any = Parameter({}, "further devices, with the keys flat, up, down and handlers")

    def __init__(self, **values: Any) -> None:
        super().__init__(**values)
        if self.lifts not in ("", WEIGHED, PREFERRED):
            hint = did_you_mean(str(self.lifts), [WEIGHED, PREFERRED])
            raise ScenarioError(f"behaviours.helpers.lifts: there is no {self.lifts!r}; {hint}")
        self._devices: dict[str, Device] = DEVICES | {name: _device(name, one) for name, one in self.devices.items()}

    def routes(self) -> tuple[Route, ...]:
        """Return the routes to the areas and out, also without stairs."""
        return (*(Route(area=area) for area in self.areas), self._way(None), self._way(RAMP))

    def _way(self, steepest: float | None) -> Route:
        """Return the route on which people are brought."""
        return Route(() if self.to else self.exits, steepest=steepest, area=self.to, lifts=self.lifts)

    def prepare(self, scene: BehaviourScene) -> None:
        """Find the people, their devices and their helpers."""
        self._scene = scene
        areas = {area.name: area for area in scene.building.areas}
        self._areas = [areas[name] for name in self.areas]
        walls, level = scene.building.walls.reshape(-1, 2, 2), scene.building.wall_level
        self._walls = [shapely.multilinestrings(walls[level == k]) for k in range(len(scene.building.levels))]
        self._check_areas()
        places = {place.area: place for place in scene.building.places if place.area}
        self._place = places.get(self.to)
        if self.to and self._place is None:
            hint = did_you_mean(self.to, list(places))
            raise ScenarioError(
                f"behaviours.helpers.to: {self.to!r} is not the area of a refuge or an assembly area; {hint}"
            )
        groups = {group.name: group for group in scene.groups}
        fetched = [group for group in scene.groups if group.settings.get("device", self.device)]
        self._people = np.concatenate([np.zeros(0, np.int32), *(group.rows for group in fetched)])
        room = None if self._place is None else self._place.capacity
        if room is not None and room < len(self._people):
            raise ScenarioError(
                f"behaviours.helpers.to: {self.to!r} has room for {room}, but {len(self._people)} people are brought "
                "there; raise its capacity"
            )
        self._device = [self._device_of(group) for group in fetched for _ in group.rows]
        helpers, self._may = [np.zeros(0, np.int32)], np.zeros((0, len(self._people)), np.bool_)
        for group in scene.groups:
            wanted = group.settings.get("fetches", self.fetches)
            if wanted:
                if wanted not in groups or groups[wanted] not in fetched:
                    hint = did_you_mean(wanted, [one.name for one in fetched])
                    raise ScenarioError(
                        f"people.{group.name}.behaviours.helpers.fetches: no group {wanted!r} has a device; {hint}"
                    )
                helpers.append(group.rows)
                may = np.tile(np.isin(self._people, groups[wanted].rows), (len(group.rows), 1))
                self._may = np.concatenate([self._may, may])
        self._helpers = np.concatenate(helpers)
        self._own = scene.crowd.route[self._helpers].copy()
        self._state = np.full(len(self._people), WAITS, np.int32)
        self._task = np.full(len(self._helpers), -1, np.int32)  # person whom each helper fetches
        self._until = np.full(len(self._people), np.nan)  # end of the preparation [s]
        self._by = np.zeros((len(self._people), len(self._helpers)), np.uint8)  # who has fetched whom
        self._check_people()

    def _device_of(self, group: Any) -> Device:
        name = group.settings.get("device", self.device)
        if name not in self._devices:
            hint = did_you_mean(name, list(self._devices))
            raise ScenarioError(f"people.{group.name}.behaviours.helpers.device: there is no {name!r}; {hint}")
        return self._devices[name]

    def _check_areas(self) -> None:
        """Check that areas are rooms, because the way to an area ends when helpers have entered it."""
        for area in self._areas:
            for door in (one for one in self._scene.building.doors if one.level == area.level):
                x1, y1, x2, y2 = door.segment.tolist()
                off = BESIDE_DOOR / math.hypot(x2 - x1, y2 - y1)
                sides = [(0.5 * (x1 + x2) + k * (y2 - y1), 0.5 * (y1 + y2) - k * (x2 - x1)) for k in (-off, off)]
                if shapely.contains_xy(area.polygon, sides).all():
                    raise ScenarioError(
                        f"behaviours.helpers.areas: {area.name!r} is on both sides of door {door.name!r}; name an area "
                        "for each room, because helpers walk straight to people in an area"
                    )

    def _check_people(self) -> None:
        """Check that all people can be fetched."""
        crowd = self._scene.crowd
        for k, (person, device) in enumerate(zip(self._people.tolist(), self._device, strict=True)):
            group = next(one.name for one in self._scene.groups if person in one.rows)
            if self._may[:, k].sum() < device.handlers:
                raise ScenarioError(
                    f"people.{group}: {device.handlers} helpers are needed for a person, {self._may[:, k].sum()} fetch "
                    "the group; give a group of more people the key behaviours.helpers.fetches"
                )
            is_inside = crowd.level[person] >= 0 and not self._is_on_the_way(person)
            if is_inside and self._area_of(crowd, person) is None:
                x, y = crowd.position[person]
                raise ScenarioError(
                    f"people.{group}: person {person} at ({x:.2f}, {y:.2f}) is in none of behaviours.helpers.areas; "
                    "name an area there"
                )
            if (crowd.speed[person] <= 0.0).any():
                raise ScenarioError(f"people.{group}.speed: 0 cannot be scaled to that of the device; give another")

    def _is_on_the_way(self, person: int) -> bool:
        """Return whether a person walks to a refuge."""
        places = self._scene.scene.places
        return places is not None and places.goes(person)

    def _area_of(self, crowd: Crowd, person: int) -> Any:
        """Return the area that a person is in; None if it is in none."""
        x, y = crowd.position[person]
        inside = (one for one in self._areas if one.level == crowd.level[person])
        return next((one for one in inside if shapely.intersects_xy(one.polygon, x, y)), None)

    def act(self, crowd: Crowd, time: float) -> None:
        """Let helpers fetch and bring people, and let those stand who wait."""
        for k, person in enumerate(self._people.tolist()):
            if crowd.level[person] < 0 and self._state[k] != IS_THERE:
                if self._state[k] != WAITS:
                    self._release(crowd, k, IS_THERE)
                continue
            match self._state[k]:
                case state if state == WAITS:
                    self._call(crowd, time, k)
                case state if state == IS_FETCHED:
                    self._fetch(crowd, time, k)
                case state if state == IS_PREPARED and time >= self._until[k]:
                    self._set_off(crowd, k)
                case state if state == IS_PREPARED:
                    self._scene.begin_ways(self._people[k : k + 1])  # a run does not end for the time that this takes
                case state if state == IS_BROUGHT:
                    self._bring(crowd, time, k)
            if self._state[k] in (IS_FETCHED, IS_PREPARED, IS_THERE) or (
                self._state[k] == WAITS and not self._is_on_the_way(person)
            ):
                crowd.speed_factor[person] = 0.0
        may_be_needed = self._may[:, self._waits].any(axis=1)
        crowd.speed_factor[self._helpers[(self._task < 0) & may_be_needed]] = 0.0

    def _call(self, crowd: Crowd, time: float, k: int) -> None:
        """Send the nearest free helpers to a person who waits."""
        person = int(self._people[k])
        area = None if self._is_on_the_way(person) else self._area_of(crowd, person)
        if area is None or not self._can_bring(crowd, k):
            return
        free = np.flatnonzero((self._task < 0) & self._may[:, k])
        rows = self._helpers[free]
        is_able = (crowd.level[rows] >= 0) & (crowd.start_time[rows] <= time)
        free, rows = free[is_able], rows[is_able]
        known = self._scene.fields.routes
        to_area = [Route(area=area.name, steepest=known[own].steepest) for own in self._own[free]]
        routes = np.array([known.index(route) for route in to_area], np.int32)
        away = self._scene.fields.travel_time_at(*crowd.ways(rows, routes))
        nearest = np.argsort(away, kind="stable")[: self._device[k].handlers]
        if len(nearest) == self._device[k].handlers and np.isfinite(away[nearest]).all():
            self._task[free[nearest]], self._state[k] = k, IS_FETCHED
            crowd.route[rows[nearest]] = routes[nearest]
            self._scene.begin_ways(rows[nearest])
            self._by[k, free[nearest]] = 1

    def _fetch(self, crowd: Crowd, time: float, k: int) -> None:
        """Lead the helpers to a person; begin the preparation when all of them are there."""
        person, helpers = self._people[k], self._helpers[self._task == k]
        if (crowd.level[helpers] < 0).any():  # pushed out
            self._release(crowd, k, WAITS)
            return
        apart = crowd.position[person] - crowd.position[helpers]
        distance = np.hypot(*apart.T)
        is_here = crowd.level[helpers] == crowd.level[person]
        has_come = is_here & (distance <= crowd.radius[person] + crowd.radius[helpers] + REACH)
        crowd.speed_factor[helpers[has_come]] = 0.0
        self._turn_to(crowd, helpers[is_here & ~has_come & (distance < NEAR)], int(person))
        if has_come.all():
            self._state[k], self._until[k] = IS_PREPARED, time + self.preparation

    def _turn_to(self, crowd: Crowd, helpers: IntArray, person: int) -> None:
        """Let helpers walk straight to a person whom they see, or in whose area they are."""
        area, (x, y) = self._area_of(crowd, person), crowd.position[helpers].T
        ends = np.broadcast_to(crowd.position[person], (len(helpers), 2))
        lines = shapely.linestrings(np.stack([crowd.position[helpers], ends], axis=1))
        is_free = ~shapely.intersects(self._walls[crowd.level[person]], lines)
        helpers = helpers[is_free | (area is not None and shapely.contains_xy(area.polygon, x, y))]
        apart = crowd.position[person] - crowd.position[helpers]
        crowd.extra_direction[helpers] += STRAIGHT * apart / np.maximum(np.hypot(*apart.T), REACH)[:, None]

    def _set_off(self, crowd: Crowd, k: int) -> None:
        """Let a person and its helpers go."""
        person, helpers = self._people[k], self._helpers[self._task == k]
        if self._scene.scene.places is not None:
            self._scene.scene.places.release(int(person))
        self._state[k] = IS_BROUGHT
        crowd.route[person] = crowd.route[helpers] = self._way_of(k)
        self._scene.begin_ways(np.append(helpers, person))

    def _way_of(self, k: int) -> int:
        """Return the index of the route on which a person is brought."""
        return self._scene.fields.routes.index(self._way(self._device[k].steepest))

    def _can_bring(self, crowd: Crowd, k: int) -> bool:
        """Return whether the device of a person can go all the way: up, down, and not steeper than it may."""
        person, device = self._people[k : k + 1], self._device[k]
        place = crowd.ways(person, self._way_of(k))
        if self.lifts and math.isinf(self._scene.fields.lengths_at(*place)[0, 0]):  # by lift, which has no length
            return math.isfinite(self._scene.fields.travel_time_at(*place)[0])
        _, up, down = self._scene.fields.lengths_at(*place)[0].tolist()
        return math.isfinite(up) and (device.up > 0.0 or up < FLIGHT) and (device.down > 0.0 or down < FLIGHT)

    def _bring(self, crowd: Crowd, time: float, k: int) -> None:
        """Keep a person and its helpers together at the speed of the device."""
        person, device = int(self._people[k]), self._device[k]
        helpers = self._helpers[self._task == k]
        helpers = helpers[crowd.level[helpers] >= 0]
        rows = np.concatenate([[person], helpers])
        crowd.route[rows] = self._way_of(k)
        remaining = self._scene.fields.travel_time_at(*crowd.ways(rows))
        pace = self._share(crowd, rows, device)
        away = np.hypot(*(crowd.position[helpers] - crowd.position[person]).T)
        is_behind = remaining[1:] > remaining[0]
        pace[1:] *= np.where(is_behind, HASTE, np.clip((LOST - away) / (LOST - BESIDE), 0.0, 1.0))
        stays = self._place is None and remaining[0] < LEAD and bool(self._may[self._task == k][:, self._waits].any())
        if stays:
            pace[1:] = 0.0  # they are still needed, and let the person go the last steps alone
        elif (is_behind & (away > LOST)).any():
            pace[0] = 0.0
        crowd.speed_factor[rows] *= pace
        is_lost = is_behind & (away > LOST) & (crowd.level[helpers] == crowd.level[person]) & (not stays)
        self._turn_to(crowd, helpers[is_lost], person)
        if self._place is not None:
            velocity = self._scene.displacement_velocity
            there = have_stopped(self._scene.fields, crowd, rows[:1], velocity, self._place)
            if len(there) and not (away > LOST).any():
                self._scene.scene.places.take_in(person, self._place.name, time)
                self._release(crowd, k, IS_THERE)

    def _share(self, crowd: Crowd, rows: NDArray[np.integer[Any]], device: Device) -> FloatArray:
        """Return the factors that give people the speed of a device where they are, by their own speeds."""
        levels = self._scene.building.levels
        along = self._scene.fields.directions_at(*crowd.ways(rows))
        climb = np.array([levels[level].climb for level in crowd.level[rows].tolist()])
        rise = (along * climb).sum(axis=1)
        column = np.where(~climb.any(axis=1), FLAT, np.where(rise > 0.0, UP, DOWN))
        share: FloatArray = np.array([device.flat, device.up, device.down])[column] / crowd.speed[rows, column]
        return share

    @property
    def _waits(self) -> NDArray[np.bool_]:
        """Who waits for helpers."""
        waits: NDArray[np.bool_] = self._state == WAITS
        return waits

    def _release(self, crowd: Crowd, k: int, state: int) -> None:
        """Release the helpers of a person, who is in another state now."""
        self._state[k] = state
        mine = np.flatnonzero(self._task == k)
        self._task[mine] = -1
        inside = mine[crowd.level[self._helpers[mine]] >= 0]
        crowd.route[self._helpers[inside]] = self._own[inside]
        self._scene.begin_ways(self._helpers[inside])

    def notes(self) -> tuple[str, ...]:
        """Return a line for each person: who has fetched it, or that nobody has."""
        lines = []
        for k, person in enumerate(self._people.tolist()):
            by = ", ".join(map(str, self._helpers[self._by[k] == 1].tolist()))
            if np.isnan(self._until[k]):
                lines.append(f"person {person} was not fetched")
            else:
                is_safe = self._state[k] == IS_THERE or self._scene.crowd.level[person] < 0
                where = "out or there" if is_safe else "not there at the end"
                begin = self._until[k] - self.preparation
                lines.append(f"person {person} was fetched by {by} at {begin:.1f} s, {where}")
        return tuple(lines)

    def is_needed(self, scene: BehaviourScene) -> bool:
        """Return False if nobody is to be fetched."""
        return any(len(group.rows) and group.settings.get("device", self.device) for group in scene.groups)


def _device(name: str, value: Any) -> Device:
    """Return a device that a case describes."""
    match value:
        case {"flat": float(flat), "up": float(up), "down": float(down), "handlers": int(handlers)} if len(value) == 4:
            if flat > 0.0 and min(up, down) >= 0.0 and max(flat, up, down) <= FASTEST and handlers >= 1:
                return Device(flat, up, down, handlers)
    speeds = f"flat, up and down in m/s, the first one above 0, all up to {FASTEST:g}"
    raise ScenarioError(
        f"behaviours.helpers.devices.{name}: must be a table of {speeds}, and handlers, not {value!r:.100}"
    )
