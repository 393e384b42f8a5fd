"""The cars of lifts: their doors, their rides, and whom they let in, all of which are changes of the scene."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray
from evac.base.change import ARRIVES, CLOSES, LEAVES, LIFT, OPENS, Change
from evac.base.errors import counted, fault, plugin_code
from evac.base.saved import Saved
from evac.building.model.building import Building, Portal
from evac.building.model.lifts import Lift
from evac.directions.routes import PREFERRED
from evac.people.dispatcher import Car, Dispatcher, StopCall
from evac.physics.extent import extent
from evac.results.results import LiftUse
from evac.simulation.changes import AT_ONCE
from evac.simulation.doorways import REACH, nearest_points
from evac.simulation.scene import Scene

#: Phases of a car: with closed doors, while these open, with open doors, while they close, on its way, and while those
#: who do not fit step back.
STANDS, OPENING, OPEN, CLOSING, RIDES, BACK = range(6)

#: Time that people in the doorway have after the doors should have closed [s].
PATIENCE = 2.0

#: Time that doors stay open longer while people are in the doorway, or come who were called from other doors of the
#: bank, and after which those on the line of a door turn again [s].
COMING = 10.0

#: Of the calculation by hand: time in which one person gets in or out, and the least for all [s], and the share by
#: which trips take longer.
TRANSFER, LEAST_TRANSFER, INEFFICIENCY = 1.0, 4.0, 0.1

#: Distance from a door from which people call the lift [m], and time between two looks at who does [s].
CALL, LOOK = 5.0, 0.5

#: By how much longer the way from a door may be than from where somebody stands who waits before it [s].
SLACK = 0.5

#: Weight of the direction to the door to which people are called, beside that of their way.
LEAD = 10.0

#: Distance between places in a car at most [m]; from their places people stand still, and slow down [m].
WIDEST, AT_REST, BRAKES = 0.6, 0.05, 0.3

#: Lengths in a car that differ by less are equal [m].
NEARLY = 1e-6

#: Distance from a door within which people make room for those who step back [m].
CLEARED = 1.2

#: Distance from the middle of a door from which people walk straight to it, and before that towards a place ahead [m].
ASIDE, AHEAD = 0.5, 0.8


class Trip(NamedTuple):
    """A ride with people."""

    lift: int
    time: float  # at which the car leaves [s]
    origin: int
    to: int
    people: int
    mass: float  # [kg]


class Lobby(NamedTuple):
    """The doors of the cars of a bank on a level."""

    level: int
    cars: tuple[tuple[int, int, Portal], ...]  # number of the lift, stop, and door


class Lifts(Saved):
    """Moves the cars of a scene.

    A car lets in the people before its door who ride lifts, the nearest first, as many as there are places left; for
    all others the open door is a wall, and those inside may always get out. Doors take the time that it takes them, and
    wait for whom they would hit. Who does not get out of their way steps back.
    """

    saved = (
        *("phase", "stop", "to", "until", "waits_since", "trips", "rides"),
        *("_last", "_count", "_lets_out", "_called", "_place", "_is_led", "_waits_at", "_since", "_looked"),
    )
    growing = ("trips", "rides")

    def __init__(self, scene: Scene, dispatcher: Dispatcher) -> None:
        self._dispatcher = dispatcher
        self._scene, self._lifts, self._crowd = scene, scene.building.lifts, scene.people.crowd
        people = len(self._crowd.level)
        # What each car does, until when [s], where it is or what stop it has left, and to which it rides.
        self.phase, self.to, self._count = np.zeros((3, len(self._lifts)), np.int64)
        self.stop = np.array([lift.start for lift in self._lifts], np.int64)
        self._lets_out = np.zeros(len(self._lifts), np.bool_)  # cars whose doors have opened for those inside
        self.until, self._last = np.zeros((2, len(self._lifts)))
        self.waits_since = np.full(people, np.nan)  # before a door [s]; NaN for who does not wait, or is in a car
        # The rides so far as `Trip`, and who has ridden: person, lift, and how long the person has waited [s].
        self.trips, self.rides = np.zeros((0, len(Trip._fields))), np.zeros((0, 3))
        self._called: NDArray[np.int64] = np.full(people, -1, np.int64)  # car to which each person was called
        self._place = np.full((people, 2), np.nan)  # where each person stands in its car [m]
        self._is_led = np.zeros(people, np.bool_)
        found = [spots_in(scene.building, lift) for lift in self._lifts]
        self._spots, self._spacing = [spots for spots, _ in found], [spacing for _, spacing in found]
        self._rooms = [room for lift in self._lifts for room in lift.rooms]
        self._carries = np.array([self._can_carry(k) for k in range(len(self._lifts))])
        self._lobbies = lobbies_of(scene.building)
        self._lines = [np.concatenate([door.segments for *_, door in lobby.cars]) for lobby in self._lobbies]
        self._lobby = {(car, stop): k for k, one in enumerate(self._lobbies) for car, stop, _ in one.cars}
        self._waits_at: NDArray[np.int64] = np.full(people, -1, np.int64)  # lobby before whose doors each person waits
        self._since = np.zeros(len(self._lobbies))  # since when the first of them has waited [s]
        self._looked = -LOOK
        scene.waits_for_lifts = self._longer_waits

    @property
    def is_busy(self) -> bool:
        """Whether a car does something that ends by itself."""
        return bool(np.isin(self.phase, (OPENING, CLOSING, RIDES)).any())

    def act(self) -> None:
        """Make what is due at this tick, and let people in."""
        if self._scene.time >= self._looked + LOOK - AT_ONCE:
            self._looked = self._scene.time
            self._look()
        for k in range(len(self._lifts)):
            while self._goes_on(k):
                pass
            self._let_in(k)

    def use(self) -> list[LiftUse]:
        """Return what each lift has carried so far."""
        rows = []
        for k, lift in enumerate(self._lifts):
            own = self.trips[self.trips[:, 0] == k].tolist()
            trips = [Trip(k, time, int(origin), int(to), int(n), mass) for _, time, origin, to, n, mass in own]
            waits, capacity = self.rides[self.rides[:, 1] == k][:, 2], lift.operation.capacity
            ends = [one.time + lift.flight(one.origin, one.to) + lift.operation.opening for one in trips]
            rows.append(
                LiftUse(
                    name=lift.name,
                    storeys=list(lift.storeys),
                    capacity=capacity,
                    trips=len(trips),
                    people=len(waits),
                    mean_load=float(np.mean([one.people / capacity for one in trips])) if trips else None,
                    mean_wait=float(waits.mean()) if trips else None,
                    longest_wait=float(waits.max()) if trips else None,
                    last_ride=max(ends) if trips else None,
                    by_hand=self._by_hand(k) if trips else None,
                )
            )
        return rows

    def _by_hand(self, k: int) -> float:
        """Return the time by hand in which the cars of a bank bring the people down whom they have brought [s]."""
        # It is that of ELVAC (Klote and Alvord, NISTIR 4730, 1992): the round trips of full cars from each storey over
        # the number of cars, and longer by a share; people get in and out one after the other.
        lift, own = self._lifts[k], self._lifts[k].operation
        bank = [other for other, one in enumerate(self._lifts) if one is lift or own.bank == one.operation.bank]
        bank, total = bank if own.bank else [k], 0.0
        trips = self.trips[np.isin(self.trips[:, 0], bank)]
        stops = np.where(trips[:, 2] == lift.discharge, trips[:, 3], trips[:, 2]).astype(int)
        for stop in np.unique(stops).tolist():
            left = int(trips[stops == stop][:, Trip._fields.index("people")].sum())
            for people in [own.capacity] * (left // own.capacity) + [left % own.capacity] * (left % own.capacity > 0):
                total += _round_trip(lift, stop, people)
        return (1.0 + INEFFICIENCY) * total / len(bank)

    def warnings(self) -> tuple[str, ...]:
        """Return a line for each group some of whose people wait for lifts of which none can carry them."""
        waits = np.array([one.lifts == PREFERRED or one.steepest is not None for one in self._scene.fields.routes])
        lost = waits[self._crowd.route] & ~self._carries.any(axis=0)
        lines = []
        for group in self._scene.people.groups:
            if len(rows := group.rows[lost[group.rows]]):
                mass, width = self._crowd.mass[rows].max(), 2.0 * self._crowd.contact_radius[rows].max()
                people = counted(len(group.rows), "person", "people")
                lines.append(
                    f"people.{group.name}: no lift can carry {len(rows)} of {people}, up to {mass:.0f} kg and "
                    f"{width:.2f} m wide: raise the load, or widen doors and ground of a lift"
                )
        return tuple(lines)

    def notes(self) -> tuple[str, ...]:
        """Return a line on each lift that has carried people."""
        return tuple(
            f"lift {one['name']!r}: {counted(one['people'], 'person', 'people')} in {counted(one['trips'], 'trip')}, "
            f"who waited {one['mean_wait']:.1f} s on average and {one['longest_wait']:.1f} s at most"
            for one in self.use()
            if one["trips"]
        )

    def _inside(self, k: int) -> IntArray:
        """Return the people in a car."""
        room = self._lifts[k].rooms[self.stop[k]]
        return np.flatnonzero(self._crowd.level == room).astype(np.int32)

    def _doors(self, k: int) -> tuple[int, ...]:
        return self._lifts[k].doors[self.stop[k]]

    def _on_line(self, k: int) -> IntArray:
        """Return the people on the line of the doors of a car whom they let through."""
        found = [np.zeros(0, np.int32)]
        for door in self._doors(k):
            rows = np.flatnonzero(self._crowd.passing == door).astype(np.int32)
            if len(rows):
                segments = self._scene.building.portals[door].segments
                _, away, outward = nearest_points(segments, self._crowd.position[rows])
                found.append(rows[away < extent(self._crowd, rows, *outward.T)])
        return np.concatenate(found)

    def _change(self, k: int, what: str, *stops: int) -> None:
        lift = self._lifts[k]
        value = (what, *(lift.storeys[stop] for stop in stops))
        self._scene.make(Change(self._scene.time, LIFT, lift.name, {"value": value}))

    def _enter(self, k: int, phase: int, until: float) -> bool:
        self.phase[k], self.until[k] = phase, until
        return True

    def _goes_on(self, k: int) -> bool:
        """Take a car to its next phase if it is due; return whether it was."""
        phase, until = int(self.phase[k]), float(self.until[k])
        if phase in (OPENING, CLOSING, RIDES) and until > self._scene.time + AT_ONCE:
            return False
        if phase == STANDS:
            return self._leave(k)
        if phase == OPEN:
            return self._close(k)
        own = self._lifts[k].operation
        if phase == RIDES:
            self._change(k, ARRIVES, int(self.stop[k]), int(self.to[k]))
            self.stop[k] = self.to[k]
            return self._enter(k, OPENING, until + own.opening)
        if phase == OPENING:
            self._change(k, OPENS, int(self.stop[k]))
            self._last[k], self._count[k] = until, len(self._inside(k))
            self._lets_out[k] = self._count[k] > 0
            self._call_in(k, int(self.stop[k]))
            return self._enter(k, OPEN, until)
        if len(self._on_line(k)):
            if self._scene.time > until + (PATIENCE if phase == CLOSING else COMING):  # and again, if that was in vain
                self._crowd.ahead[np.isin(self._crowd.passing, self._doors(k))] *= -1.0
                self.phase[k], self.until[k] = BACK, self._scene.time
            return False
        return self._enter(k, STANDS, until if phase == CLOSING else self._scene.time)

    def _leave(self, k: int) -> bool:
        """Let a car with closed doors leave for its next stop, or open its doors again."""
        lift, stop, rows = self._lifts[k], int(self.stop[k]), self._inside(k)
        if not len(rows):
            to = self._next_stop(k)
        else:
            to = lift.discharge if stop != lift.discharge else int(self._goals(k, stop, rows[:1])[0])
        if to is None:
            return False
        time = self._scene.time
        is_next = 0.0 <= time - self.until[k] < LOOK  # right after the doors have closed
        start = float(self.until[k]) if is_next else time
        if to == stop:
            return self._enter(k, OPENING, start + lift.operation.opening)
        self._change(k, LEAVES, stop, to)
        self.to[k] = to
        self._call_in(k, to)  # so that they stand before its door when it arrives
        if len(rows):
            mass = float(self._crowd.mass[rows].sum())
            self.trips = np.vstack([self.trips, Trip(k, time, stop, to, len(rows), mass)])
            since = self.waits_since[rows]
            waited = np.where(np.isnan(since), 0.0, self._last[k] - since)
            new = np.column_stack([rows, np.full(len(rows), k), np.maximum(waited, 0.0)])
            self.rides = np.vstack([self.rides, new])
            self.waits_since[rows] = np.nan
        return self._enter(k, RIDES, start + lift.flight(stop, to))

    def _close(self, k: int) -> bool:
        """Begin to close the doors of a car: when all are out, or it is full, or nobody has come in for a while."""
        lift, stop, inside = self._lifts[k], int(self.stop[k]), len(self._inside(k))
        is_in_doorway = len(self._on_line(k)) > 0
        if inside > self._count[k]:
            self._last[k] = self._scene.time
        self._count[k] = max(inside, self._count[k])  # who steps back and in again does not hold the doors
        if self._lets_out[k]:
            is_done = not is_in_doorway and (self._goals(k, stop, self._inside(k)) != stop).all()
        else:
            taken, halves = self._place[self._inside(k)], self._half(k, self._inside(k))
            has_place = _are_free(self._spots[k], 0.5 * self._spacing[k], taken, halves).any()
            is_full = inside >= lift.operation.capacity or not has_place
            level = self._lobbies[self._lobby[k, stop]].level
            comes = ((self._called == k) & (self._crowd.level == level)).any()
            dwell = lift.operation.dwell + (COMING if comes or is_in_doorway else 0.0)
            is_done = is_full or not self._runs(k) or self._scene.time - self._last[k] >= dwell - AT_ONCE
        if not is_done:
            return False
        self._called[self._called == k] = -1
        self._change(k, CLOSES, stop)
        return self._enter(k, CLOSING, self._scene.time + lift.operation.closing)

    def _runs(self, k: int) -> bool:
        """Return whether a lift is in service."""
        return self._lifts[k].doors[0][0] in self._scene.building.awaited

    def _longer_waits(self, on_way: IntArray) -> dict[int, float]:
        """Return by how much longer people wait for each lift than is expected always [s], by the rooms of its car."""
        # They wait until the last of those on the way to each room (levels,), and of those before its doors, are taken
        # in: the cars of a bank make a trip for as many as they have places, wherever the dispatcher sends the next
        # that is free.
        waits = {room: np.inf for lift in self._lifts for room in lift.rooms if room != lift.rooms[lift.discharge]}
        people = [sum(int(on_way[door.other(lobby.level)]) for *_, door in lobby.cars) for lobby in self._lobbies]
        free = {k: self._free_in(k) for k in range(len(self._lifts)) if self._runs(k)}
        left = {self._lobby[k, stop] for k in free for stop in range(len(self._lifts[k].rooms))}
        while free:
            k = min(free, key=lambda car: (free[car], car))
            lift, now = self._lifts[k], self._scene.time
            stops = {at: self._lobby[k, at] for at in range(len(lift.rooms)) if at != lift.discharge}
            calls = [StopCall(at, max(1, people[lobby]), now) for at, lobby in stops.items() if lobby in left]
            to = self._ask(k, lift.discharge, calls) if calls else None
            if to is None:
                del free[k]
                continue
            wait = free[k] + lift.flight(lift.discharge, to) + lift.operation.opening - lift.operation.wait
            for car, at, _ in self._lobbies[stops[to]].cars:
                waits[self._lifts[car].rooms[at]] = max(0.0, wait)
            if load := min(people[stops[to]], lift.operation.capacity):
                free[k] += _round_trip(lift, to, load)
            people[stops[to]] -= load
            left -= {stops[to]} if people[stops[to]] == 0 else set()
        return waits

    def _free_in(self, k: int) -> float:
        """Return by hand in how much time a car leaves its discharge to fetch people [s], or has left it if < 0."""
        lift, stop, to = self._lifts[k], int(self.stop[k]), int(self.to[k])
        if self.phase[k] == STANDS:
            return 0.0
        ride = self.until[k] - self._scene.time if self.phase[k] == RIDES else lift.flight(stop, lift.discharge)
        if self.phase[k] == RIDES and to != lift.discharge:
            return float(ride - lift.flight(lift.discharge, to))
        own, people = lift.operation, len(self._inside(k))
        return float(ride + own.opening + own.closing + max(LEAST_TRANSFER, TRANSFER * people))

    def _next_stop(self, k: int) -> int | None:
        """Return the next stop of a car: its dispatcher chooses, but those who ride up from its discharge go first."""
        lift, stop, calls = self._lifts[k], int(self.stop[k]), list[StopCall]()
        if not self._runs(k):
            return None if stop == lift.discharge else lift.discharge
        waiting = {*self._waits_at[self._waits_at >= 0].tolist()}
        below = self._lobby[k, lift.discharge]
        rides_up = below in waiting and self._left_to(k, below) > 0
        if rides_up and stop == lift.discharge:
            return stop
        for at in range(len(lift.rooms)):
            lobby = self._lobby[k, at]
            if at != lift.discharge and lobby in waiting and (people := self._left_to(k, lobby)):
                calls.append(StopCall(at, people, float(self._since[lobby])))
        return self._ask(k, stop, calls) if calls else lift.discharge if rides_up else None

    def _ask(self, k: int, stop: int, calls: list[StopCall]) -> int | None:
        """Return which of some stops the dispatcher chooses for a car at a stop; None if it stays."""
        lift = self._lifts[k]
        car = Car(lift.name, lift.storeys, lift.heights, stop, lift.discharge, lift.operation.capacity)
        what, dispatcher = f"dispatcher {self._dispatcher.name!r}", self._dispatcher
        with plugin_code(f"t = {self._scene.time:.3f} s: {what}", dispatcher):
            to = dispatcher.next_stop(car, tuple(calls), self._scene.time)
        if to is not None and to not in [call.stop for call in calls]:
            remedy = f"return the stop of a call, here one of {[call.stop for call in calls]}, or None"
            raise fault(what, f"returned {to!r:.40} for {lift.name!r}", remedy, dispatcher, "next_stop")
        return to

    def _left_to(self, k: int, lobby: int) -> int:
        """Return for how many of those whom a car can carry before a lobby no other car is there or comes."""
        rows = np.flatnonzero((self._waits_at == lobby) & self._carries[k])
        for other, at, _ in self._lobbies[lobby].cars:
            to = int((self.to if self.phase[other] == RIDES else self.stop)[other])
            if other != k and to == at and self.phase[other] in (OPENING, OPEN, RIDES):
                places = self._lifts[other].operation.capacity - len(self._inside(other))
                rows = np.delete(rows, np.flatnonzero(self._carries[other, rows])[: max(0, places)])
        return len(rows)

    def _look(self) -> None:
        """Note who waits before the doors of each lobby, and since when."""
        scene, crowd = self._scene, self._crowd
        rides = np.array([bool(route.lifts) for route in scene.fields.routes])
        able = np.flatnonzero((crowd.level >= 0) & (crowd.start_time <= scene.time) & rides[crowd.route])
        able = able[np.argsort(crowd.level[able], kind="stable")].astype(np.int32)
        levels = np.array([lobby.level for lobby in self._lobbies])
        first, last = (np.searchsorted(crowd.level[able], levels, side) for side in ("left", "right"))
        near = [able[begin:end] for begin, end in zip(first, last, strict=True)]
        near = [
            rows[nearest_points(lines, crowd.position[rows])[1] < CALL] if len(rows) else rows
            for rows, lines in zip(near, self._lines, strict=True)
        ]
        rows, of = np.concatenate(near).astype(np.int32), np.repeat(np.arange(len(near)), [len(one) for one in near])
        goes, times = self._goes_to_lifts(rows, of)
        order = np.argsort(-times[goes], kind="stable")  # of two lobbies, who is near both waits at that of their way
        self._waits_at[:], self._since[:] = -1, scene.time
        self._waits_at[rows[goes][order]] = of[goes][order]
        rows = np.flatnonzero(self._waits_at >= 0).astype(np.int32)
        np.fmin.at(self._since, self._waits_at[rows], self.waits_since[rows])
        waits = self._waits_at >= 0
        is_aboard = np.isin(crowd.level, self._rooms)
        self.waits_since[~waits & ~is_aboard] = np.nan
        self.waits_since[waits & np.isnan(self.waits_since)] = scene.time

    def _goes_to_lifts(self, rows: IntArray, of: NDArray[np.int64]) -> tuple[NDArray[np.bool_], FloatArray]:
        """Return who of some people before lobbies is on the way to the doors there, and how long it takes [s]."""
        if not len(rows):
            return np.zeros(0, np.bool_), np.zeros(0)
        fields, doors = self._scene.fields, np.array([len(lines) for lines in self._lines])[of]
        here = fields.travel_time_at(*self._crowd.ways(rows))
        level, position, route, radius = (np.repeat(values, doors, axis=0) for values in self._crowd.ways(rows))
        middles = np.concatenate([self._lines[k].reshape(-1, 2, 2).mean(axis=1) for k in of.tolist()])
        there = fields.travel_time_at(level, middles, route, radius)
        first = np.cumsum(doors) - doors
        times = np.minimum.reduceat(there + np.hypot(*(middles - position).T), first)
        there = np.minimum.reduceat(there, first)
        goes: NDArray[np.bool_] = np.isfinite(there) & (there < here + SLACK)
        for number in np.unique(of).tolist():
            car, stop, _ = self._lobbies[number].cars[0]
            if stop == self._lifts[car].discharge:
                goes[of == number] &= self._goals(car, stop, rows[of == number]) != stop
        return goes, times

    def _goals(self, k: int, stop: int, rows: IntArray) -> IntArray:
        """Return the stops where people in a car at a stop, or before its doors, get out: there, or after a ride."""
        lift = self._lifts[k]
        doors = [self._scene.building.portals[door] for door in lift.doors[stop]]
        stops = [at for at in range(len(lift.rooms)) if at != stop and lift.discharge in (at, stop) and self._runs(k)]
        levels = [*(door.other(lift.rooms[stop]) for door in doors), *(lift.rooms[at] for at in stops)]
        places = [*(door.segments.reshape(-1, 2).mean(axis=0) for door in doors), *[lift.back] * len(stops)]
        _, _, route, radius = self._crowd.ways(rows)
        level, place = (np.repeat(np.array(values), len(rows), axis=0) for values in (levels, places))
        own = np.tile(route, len(levels)), np.tile(radius, len(levels))
        times = self._scene.fields.travel_time_at(level.astype(np.int32), place, *own).reshape(len(levels), -1)
        times[len(doors) :] += np.array([lift.flight(stop, at) for at in stops]).reshape(-1, 1)
        goals: IntArray = np.array([*[stop] * len(doors), *stops], np.int32)[times.argmin(axis=0)]
        return goals

    def _can_carry(self, k: int) -> NDArray[np.bool_]:
        """Return whom a car can carry at all: by their mass, and as wide as its doors and its ground are."""
        lift, crowd = self._lifts[k], self._crowd
        x1, y1, x2, y2 = self._scene.building.levels[lift.rooms[0]].polygon.bounds
        lines = [self._scene.building.portals[door].segments for own in lift.doors for door in own]
        width = min(np.hypot(*(line[:, 2:] - line[:, :2]).T).sum() for line in lines)
        fits: NDArray[np.bool_] = 2.0 * crowd.contact_radius <= min(width, x2 - x1, y2 - y1)
        return fits if lift.operation.load is None else fits & (crowd.mass <= lift.operation.load)

    def _places_for(self, k: int, rows: IntArray, inside: IntArray) -> FloatArray:
        """Return the places of some people, in their order, in a car besides those in it; NaN if it has no room."""
        # There is room by number, load and ground; who is too heavy or too wide lets the others pass.
        own, mass = self._lifts[k].operation, self._crowd.mass
        load, total = np.inf if own.load is None else own.load, mass[inside].sum()
        places, taken, halves = np.full((len(rows), 2), np.nan), self._place[inside], self._half(k, inside)
        for number, row in enumerate(rows):
            if len(taken) >= own.capacity:
                break
            if self._carries[k, row] and total + mass[row] <= load:
                half = self._half(k, row)
                spots = self._off_walls(k, row, self._spots[k]) if half > 0.5 * WIDEST else self._spots[k]
                free = spots[_are_free(spots, half, taken, halves)]
                if len(free):
                    places[number] = free[0]
                    taken, halves, total = np.vstack([taken, free[:1]]), np.append(halves, half), total + mass[row]
        return places

    def _half(self, k: int, rows: IntArray | np.int32) -> FloatArray:
        """Return half of the width that people take in a car [m]: of a place, or of bodies that are wider than any."""
        radius = self._crowd.radius[rows]
        half: FloatArray = np.where(radius > 0.5 * WIDEST, radius, 0.5 * self._spacing[k])
        return half

    def _off_walls(self, k: int, rows: IntArray | np.int32, spots: FloatArray) -> FloatArray:
        """Return places in a car [m], from the walls as far as the bodies of people need."""
        x1, y1, x2, y2 = self._scene.building.levels[self._lifts[k].rooms[0]].polygon.bounds
        off = np.minimum(self._crowd.contact_radius[rows], 0.5 * min(x2 - x1, y2 - y1))[..., None]
        moved: FloatArray = np.clip(spots, np.array([x1, y1]) + off, np.array([x2, y2]) - off)
        return moved

    def _waiting(self, k: int, stop: int) -> IntArray:
        """Return who waits before the doors of the lobby of a car at a stop."""
        lobby = self._lobby[k, stop]
        rows = np.flatnonzero((self._waits_at == lobby) & (self._crowd.level == self._lobbies[lobby].level))
        return rows.astype(np.int32)

    def _let_in(self, k: int) -> None:
        """Let in the nearest people before an open door, as many as there are places left; they are chosen anew."""
        lift, stop = self._lifts[k], int(self.stop[k])
        if self.phase[k] != OPEN or self._lets_out[k] or not self._runs(k):
            return
        crowd, lobby = self._crowd, self._lobbies[self._lobby[k, stop]]
        rows = self._waiting(k, stop)
        own = self._on_line(k)
        for door in (door for car, at, door in lobby.cars if (car, at) == (k, stop)):
            _, distance, _ = nearest_points(door.segments, crowd.position[rows])
            others = np.setdiff1d(np.flatnonzero((crowd.passing == door.index) & (crowd.level == lobby.level)), own)
            crowd.passing[others] = -1
            in_car = np.union1d(self._inside(k), own)
            is_free = (crowd.passing[rows] < 0) & np.isin(self._called[rows], (-1, k))
            near = np.flatnonzero((distance < REACH) & is_free)
            new = rows[near][np.lexsort((rows[near], distance[near]))]
            if stop == lift.discharge:  # a ride up has one goal, too
                goals = self._goals(k, stop, np.concatenate([in_car, new]))
                new = new[goals[len(in_car) :] == goals[:1]]
            self._place[new] = places = self._places_for(k, new, in_car)
            crowd.passing[new[np.isfinite(places[:, 0])]] = door.index

    def _call_in(self, k: int, stop: int) -> None:
        """Call the nearest who wait before the doors of a bank to an empty car; whom it has called stays called."""
        lobby = self._lobbies[self._lobby[k, stop]]
        if len(inside := self._inside(k)) or len(lobby.cars) < 2:
            return
        rows = self._waiting(k, stop)
        rows = rows[np.isin(self._called[rows], (-1, k))]
        door = next(door for car, _, door in lobby.cars if car == k)
        _, distance, _ = nearest_points(door.segments, self._crowd.position[rows])
        rows = rows[np.lexsort((rows, distance, self._called[rows] != k))]
        self._called[rows[np.isfinite(self._places_for(k, rows, inside)[:, 0])]] = k

    def steer(self) -> None:
        """Lead people who were called to a car to its door, and those in a car to their places; after behaviours."""
        crowd = self._crowd
        crowd.extra_direction[self._is_led] = 0.0
        self._is_led[:] = False
        is_aboard = np.isin(crowd.level, self._rooms) | np.isin(crowd.passing, [*self._scene.building.lift_doors])
        self._place[~is_aboard] = np.nan
        for k in range(len(self._lifts)):
            self._stand(k)
            if self.phase[k] == BACK:
                self._clear(k)
        for k in np.unique(self._called[self._called >= 0]).tolist():
            stop = (self.to if self.phase[k] == RIDES else self.stop)[k]
            lobby = self._lobbies[self._lobby[k, int(stop)]]
            rows = np.flatnonzero((self._called == k) & (crowd.level == lobby.level)).astype(np.int32)
            door = next(door for car, _, door in lobby.cars if car == k)
            nearest, _, outward = nearest_points(door.segments, crowd.position[rows], crowd.contact_radius[rows])
            back = outward if door.levels[1] == lobby.level else -outward  # away from the car
            towards = nearest - crowd.position[rows]
            off = -(towards * back).sum(axis=1)[:, None]
            sideways = towards + off * back
            across = np.hypot(*sideways.T)[:, None]
            # Past the posts of other doors, and first out of the niche of such a door, in which bodies are wedged.
            sideways *= np.where(off < AHEAD, ASIDE / np.maximum(across, ASIDE), 1.0)
            towards = np.where(across > ASIDE, sideways + (AHEAD - off) * back, towards)
            crowd.extra_direction[rows] = LEAD * towards / np.maximum(np.hypot(*towards.T), 1e-9)[:, None]
            self._is_led[rows] = True

    def _clear(self, k: int) -> None:
        """Lead the people before the doors of a car away, so that those who step back have room."""
        crowd = self._crowd
        for door in (self._scene.building.portals[door] for door in self._doors(k)):
            rows = np.flatnonzero(crowd.level == door.other(self._lifts[k].rooms[self.stop[k]])).astype(np.int32)
            nearest, distance, _ = nearest_points(door.segments, crowd.position[rows])
            near = distance < CLEARED
            away = (crowd.position[rows] - nearest)[near]
            crowd.extra_direction[rows[near]] = LEAD * away / np.maximum(distance[near], 1e-9)[:, None]
            self._is_led[rows[near]] = True

    def _get_out(self, k: int) -> None:
        """Let people out one after the other, the nearest to the door first, if there are wide bodies among them."""
        rows = self._inside(k)
        if len(rows) > 1 and (self._crowd.radius[rows] > 0.5 * WIDEST).any():
            rows = rows[self._goals(k, int(self.stop[k]), rows) == self.stop[k]]
            doors = [self._scene.building.portals[door].segments for door in self._doors(k)]
            _, distance, _ = nearest_points(np.concatenate(doors), self._crowd.position[rows])
            self._crowd.speed_factor[rows[distance > distance.min(initial=np.inf)]] = 0.0

    def _stand(self, k: int) -> None:
        """Lead people in a car to their places."""
        if self.phase[k] == OPEN and self._lets_out[k]:
            self._get_out(k)
            return
        rows = np.union1d(self._inside(k), self._on_line(k))
        has_place = np.isfinite(self._place[rows, 0])
        rows = rows[has_place & ~self._crowd.ahead[rows].any(axis=1)]  # others leave the line of a door
        towards = self._off_walls(k, rows, self._place[rows]) - self._crowd.position[rows]
        off = np.maximum(np.hypot(*towards.T), 1e-9)
        self._crowd.extra_direction[rows] = LEAD * towards / off[:, None]
        self._crowd.speed_factor[rows] = np.clip((off - AT_REST) / BRAKES, 0.0, 1.0)
        self._is_led[rows] = True


def _are_free(spots: FloatArray, half: float | FloatArray, taken: FloatArray, halves: FloatArray) -> NDArray[np.bool_]:
    """Return which spots (s, 2) are free for somebody, by half the widths [m], beside those whose places are taken."""
    apart = np.hypot(*(spots[:, None] - taken).T).T
    free: NDArray[np.bool_] = ~(apart < half + halves - NEARLY).any(axis=1)
    return free


def spots_in(building: Building, lift: Lift) -> tuple[FloatArray, float]:
    """Return places (s, 2) [m] in a car, as many as its capacity at least, the farthest first, and how far apart."""
    room = building.levels[lift.rooms[0]].polygon
    lines = np.concatenate([building.portals[door].segments for own in lift.doors for door in own])
    door = shapely.multipoints(lines.reshape(-1, 2, 2).mean(axis=1))
    x1, y1, x2, y2 = room.bounds
    for spacing in WIDEST * 0.95 ** np.arange(100):
        free = room.buffer(-0.45 * spacing)
        across, along = (max(1, int((size - 0.9 * spacing) / spacing + 1.0)) for size in (x2 - x1, y2 - y1))
        count, middle = np.array([across, along]), 0.5 * np.array([x1 + x2, y1 + y2])
        x, y = (at + spacing * (np.arange(n) - 0.5 * (n - 1)) for n, at in zip(count, middle, strict=True))
        points = np.column_stack([part.ravel() for part in np.meshgrid(x, y)])
        points = points[shapely.intersects_xy(free, *points.T)]
        if len(points) >= lift.operation.capacity:
            break
    away = np.round(shapely.distance(shapely.points(points), door), 6)
    return points[np.lexsort((*points.T, -away))], spacing


def _round_trip(lift: Lift, stop: int, people: int) -> float:
    """Return the time by hand in which a car fetches some people from a stop [s], who get in and out one by one."""
    way = lift.flight(lift.discharge, stop) + lift.operation.opening + lift.operation.closing
    return 2.0 * (way + max(LEAST_TRANSFER, TRANSFER * people))


def lobbies_of(building: Building) -> list[Lobby]:
    """Return the lobbies of a building: those of the lifts of a bank on each level before their doors."""
    found: dict[tuple[str, int], list[tuple[int, int, Portal]]] = {}
    for k, lift in enumerate(building.lifts):
        for stop, (room, doors) in enumerate(zip(lift.rooms, lift.doors, strict=True)):
            for door in doors:
                portal = building.portals[door]
                key = lift.operation.bank or lift.name, portal.other(room)
                found.setdefault(key, []).append((k, stop, portal))
    return [Lobby(level, tuple(cars)) for (_, level), cars in found.items()]


def carry(scene: Scene, lift: Lift, origin: int, to: int) -> None:
    """Move the people of a car from the room of one stop to that of another; their places in plan stay."""
    crowd = scene.people.crowd
    rows = np.flatnonzero(crowd.level == lift.rooms[origin]).astype(np.int32)
    crowd.level[rows], crowd.passing[rows], crowd.ahead[rows] = lift.rooms[to], -1, 0.0
    for link in _passed(scene.building, lift, origin, to) if len(rows) else ():
        scene.people.log(rows, link, scene.time)
    scene.begin_ways(rows)


def _passed(building: Building, lift: Lift, origin: int, to: int) -> Iterable[int]:
    """Yield the numbers of the rides from a stop to another one, in this order."""
    of_levels = {ride.levels: building.link_of(ride) for ride in building.rides}
    stops = range(origin, to) if origin < to else range(origin - 1, to - 1, -1)
    yield from (of_levels[lift.rooms[stop], lift.rooms[stop + 1]] for stop in stops)
