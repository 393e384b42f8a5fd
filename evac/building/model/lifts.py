"""Lifts: a room for each stop of a car, and how the car moves. Only buildings with lifts import this module."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.change import ARRIVES, LEAVES, LIFT, OPENS, Change, LiftOptions
from evac.base.errors import BuildingError
from evac.base.parameters import did_you_mean
from evac.building.model.building import Building, Jump
from evac.building.model.elevation import on_level, triangles_on

#: Distance of the place at the back of a car to which people walk from its walls, in a car that is wide enough [m].
OFF_WALLS = 0.25


CAR_HEIGHT = 2.1  #: Height of a car where it is drawn [m].
LEAST_GROUND = 0.12  #: Least ground of a car for each person [m2]: less than the 0.17 m2 of EN 81-20 for 13 people.


@dataclass(frozen=True)
class Motion:
    """The ideal motion of a car over a distance [m], limited by speed [m/s], acceleration [m/s2] and jerk [m/s3]."""

    distance: float
    speed: float
    acceleration: float
    jerk: float

    @property
    def peaks(self) -> tuple[float, float]:
        """The greatest acceleration and the greatest speed that are reached."""
        d, v, j = self.distance, self.speed, self.jerk
        a = min(self.acceleration, math.sqrt(v * j))  # a slow car reaches its speed before its acceleration
        if d >= v * a / j + v * v / a:
            return a, v
        if d >= 2.0 * a**3 / j**2:
            return a, 0.5 * a * (math.sqrt((a / j) ** 2 + 4.0 * d / a) - a / j)
        a = float(np.cbrt(0.5 * d * j * j))
        return a, a * a / j

    @property
    def duration(self) -> float:
        """Time from start to stop [s]."""
        if self.distance <= 0.0:
            return 0.0
        a, v = self.peaks
        return self.distance / v + v / a + a / self.jerk

    def at(self, time: float) -> float:
        """Return the distance covered at a time after the start [m]."""
        if self.distance <= 0.0 or time <= 0.0:
            return 0.0
        a, v = self.peaks
        rise, hold = a / self.jerk, max(0.0, v / a - a / self.jerk)
        cruise = max(0.0, self.duration - 4.0 * rise - 2.0 * hold)
        x = speed = acceleration = 0.0
        left = time
        for span, jerk in zip((rise, hold, rise, cruise, rise, hold, rise), (1, 0, -1, 0, -1, 0, 1), strict=True):
            t, j = min(span, left), jerk * self.jerk
            x += speed * t + acceleration * t * t / 2.0 + j * t**3 / 6.0
            speed += acceleration * t + j * t * t / 2.0
            acceleration += j * t
            left -= t
        return min(x, self.distance) if left <= 0.0 else self.distance


@dataclass(frozen=True)
class Lift:
    """A lift: equal rooms above each other, a level each. Its car is in one of them, or on the way between two."""

    name: str
    storeys: tuple[str, ...]  # names of its stops, from bottom to top
    rooms: tuple[int, ...]  # the level of the car at each stop
    doors: tuple[tuple[int, ...], ...]  # the portals of each room
    heights: tuple[float, ...]  # of the stops [m]
    back: tuple[float, float]  # place in plan at the back of the car to which people walk [m]
    operation: LiftOptions

    @property
    def discharge(self) -> int:
        """The stop at which people get out."""
        return 0 if self.operation.discharge is None else self.storeys.index(self.operation.discharge)

    @property
    def start(self) -> int:
        """The stop at which the car is at first."""
        return self.discharge if self.operation.start is None else self.storeys.index(self.operation.start)

    def motion(self, origin: int, to: int) -> Motion:
        """Return the motion of the car between two stops."""
        own = self.operation
        return Motion(abs(self.heights[to] - self.heights[origin]), own.speed, own.acceleration, own.jerk)

    def flight(self, origin: int, to: int) -> float:
        """Return the time from closed doors at one stop until the doors begin to open at another one [s]."""
        return 0.0 if origin == to else self.operation.start_delay + self.motion(origin, to).duration

    def delay(self, stop: int) -> float:
        """Return the time that people expect from arrival at a stop to open doors at the discharge, or back [s]."""
        own = self.operation
        return own.wait + own.closing + self.flight(stop, self.discharge) + own.opening


def with_lifts_of(
    building: Building, drawn: Sequence[tuple[str, Sequence[str], LiftOptions]], given: Mapping[str, LiftOptions]
) -> Building:
    """Return a building with lifts made of its levels `NAME STOREY`; what a case gives replaces what is drawn."""
    names = [name for name, *_ in drawn]
    for name in given:
        if name not in names:
            hint = did_you_mean(name, names) if names else "the building has none"
            raise BuildingError(f"{building.source}: building.lifts.{name}: there is no such lift; {hint}")
    lifts = []
    for name, storeys, operation in drawn:
        rooms = [level for storey in storeys if (level := building.level_named(f"{name} {storey}")) is not None]
        own = given.get(name, LiftOptions()).model_dump(exclude_unset=True)
        operation = operation.model_copy(update=own)
        for key in ("discharge", "start"):
            if (storey := getattr(operation, key)) not in (None, *storeys):
                raise BuildingError(
                    f"{building.source}: lift {name!r}: operation.{key}: it does not stop at {storey!r}; "
                    f"{did_you_mean(str(storey), list(storeys))}"
                )
        ground = rooms[0].polygon.area / operation.capacity
        if ground < LEAST_GROUND:
            raise BuildingError(
                f"{building.source}: lift {name!r}: operation.capacity: {operation.capacity} people do not fit on "
                f"{rooms[0].polygon.area:.2f} m2; give at most {int(rooms[0].polygon.area / LEAST_GROUND)}"
            )
        doors = tuple(tuple(portal.index for portal in building.portals_of(room.index)) for room in rooms)
        lines = np.concatenate([building.portals[door].segments for own in doors for door in own])
        levels, heights = tuple(room.index for room in rooms), tuple(room.z_min for room in rooms)
        back = _back(rooms[0].polygon, lines)
        lifts.append(Lift(name, tuple(storeys), levels, doors, heights, back, operation))
    return with_lifts(building, tuple(lifts))


def with_lifts(building: Building, lifts: tuple[Lift, ...]) -> Building:
    """Return a building whose levels are the rooms of lifts: their doors are closed, and people wait before them."""
    doors = replace(building, lifts=lifts).lift_doors
    building = replace(
        building,
        levels=tuple(replace(one, kind="car") if one.index in doors.values() else one for one in building.levels),
        lifts=lifts,
        closed=building.closed | frozenset(doors),
        one_way=building.one_way | frozenset(doors.items()),
    )
    for lift in lifts:
        building = with_service(building, lift.name, lift.operation.service)
    return building


def with_service(building: Building, name: str, runs: bool) -> Building:
    """Return a building in which a lift runs, so that ways lead through it, or does not."""
    lift = next(lift for lift in building.lifts if lift.name == name)
    rooms = [building.levels[room].name for room in lift.rooms]
    below, others = rooms[lift.discharge], [stop for stop in range(len(rooms)) if stop != lift.discharge]
    jumps = frozenset(
        Jump(*ends, lift.delay(stop)) for stop in others for ends in ((rooms[stop], below), (below, rooms[stop]))
    )
    doors = frozenset(door for own in lift.doors for door in own)
    return replace(
        building,
        awaited=building.awaited | doors if runs else building.awaited - doors,
        jumps=building.jumps | jumps if runs else building.jumps - jumps,
    )


def _back(polygon: BaseGeometry, doors: FloatArray) -> tuple[float, float]:
    """Return the place in a car that is farthest from the middle of its doors, in the middle of its back."""
    inner = polygon.buffer(-OFF_WALLS)
    free = polygon.representative_point().buffer(0.01) if inner.is_empty else inner
    x1, y1, x2, y2 = free.bounds
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(x1, x2, 41), np.linspace(y1, y2, 41)))
    points = np.column_stack([x, y])[shapely.intersects_xy(free, x, y)]
    centre = np.array(polygon.centroid.coords[0])
    x1, y1, x2, y2 = doors[0]
    ahead = np.array([y1 - y2, x2 - x1]) / np.hypot(x2 - x1, y2 - y1)
    along = points @ ahead * np.sign(ahead @ (centre - doors[0, :2]))
    off = np.round(np.hypot(*(points - centre).T), 6)
    x0, y0 = points[np.lexsort((off, -np.round(along, 6)))[0]].tolist()
    return x0, y0


class CarState(NamedTuple):
    """Where a car is: the level of the stop at which it is or which it has left, and how far it is above this [m]."""

    level: int
    rise: float
    is_open: bool  # whether its doors are open


def cars_at(building: Building, changes: Iterable[Change], time: float) -> list[CarState]:
    """Return where the car of each lift is at a time, by the changes before it."""
    lifts = {lift.name: lift for lift in building.lifts}
    states = {name: CarState(lift.rooms[lift.start], 0.0, False) for name, lift in lifts.items()}
    for change in changes:
        if (
            change.kind != LIFT or change.time >= time
        ):  # what is recorded at a time is the state before the changes at it
            continue
        lift = lifts[change.what]
        what, *storeys = change.values["value"]
        stops = [lift.storeys.index(storey) for storey in storeys]
        rise = 0.0
        if what == LEAVES:
            done = lift.motion(*stops).at(time - change.time - lift.operation.start_delay)
            rise = math.copysign(done, lift.heights[stops[1]] - lift.heights[stops[0]])
        states[lift.name] = CarState(lift.rooms[stops[what == ARRIVES]], rise, what == OPENS)
    return [*states.values()]


def car_body(building: Building, car: CarState) -> tuple[FloatArray, FloatArray]:
    """Return the outline of the ground of a car (c, 3) [m], and its triangles there (t, 3, 3) [m]."""
    up, polygon = np.array([0.0, 0.0, car.rise]), building.levels[car.level].polygon
    outline = on_level(building, car.level, shapely.get_coordinates(polygon.exterior)[:-1])
    return outline + up, triangles_on(building, car.level, polygon).reshape(-1, 3, 3) + up
