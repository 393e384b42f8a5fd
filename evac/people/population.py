"""The population: arrays of all people, their groups, exit times and crossings."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import BoolArray, FloatArray, IntArray
from evac.base.defaults import LEAST_HEIGHT, LEAST_RADIUS, MOST_HEIGHT, MOST_MASS, MOST_RADIUS, MOST_SPEED, MOST_TAU
from evac.base.distributions import Distribution, generator_for
from evac.base.errors import ScenarioError, SimulationError, naming
from evac.base.parameters import did_you_mean
from evac.base.saved import Saved, SavedError, taken
from evac.building.model.building import DOWN, FLAT, UP, Area, Building
from evac.building.model.elevation import elevation
from evac.building.model.findings import Finding
from evac.building.surface.places import HEIGHT_REACH
from evac.directions.fields import Fields
from evac.people.behaviour import Behaviour, is_legal
from evac.people.groups import contact_radii, opens_later, route_of
from evac.people.placement import clearance, place
from evac.people.starts import LeftOut, Source, left_out, start_in, starts_of, times_of_arrival
from evac.physics.motion import EXIT
from evac.physics.state import Crowd, Events, make_crowd

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.case.schema import GroupSettings


ROUNDING = 1e-6  #: Tolerance for rounded positions outside a level or inside a wall [m].


#: Arrays of the crowd that are heeded if others than their owners write them between ticks, and before the first one.
HEEDED = ("start_time", "speed", "route")
INITIAL = (*HEEDED, "position", "velocity", "level", "radius", "contact_radius", "height", "mass", "tau", "group")

#: Allowed ranges of the drawn quantities; smaller masses and relaxation times make the models overflow.
BOUNDS = {
    "radius": (LEAST_RADIUS, MOST_RADIUS),
    "height": (LEAST_HEIGHT, MOST_HEIGHT),
    "mass": (0.001, MOST_MASS),
    "tau": (1e-6, MOST_TAU),
    "speed": (0.0, MOST_SPEED),
    "speed_up": (0.0, MOST_SPEED),
    "speed_down": (0.0, MOST_SPEED),
}


@dataclass(frozen=True)
class Group:
    """A named group of people."""

    name: str
    rows: IntArray  #: (k,) int32: rows of its people in `Crowd`
    #: settings of the group for behaviours, by behaviour name; in `Population.groups_for`, the settings for one
    settings: Mapping[str, Any]
    comes_in: bool = False  #: whether its people arrive during the run through an exit or a portal


class Population(Saved):
    """All people of a run, and the log of their crossings.

    It owns the crowd, of which each array has one writer, see docs/architecture.md. `staying` (k,) are the people who
    do not leave, `sources` the places where people come in, `left_out` the ground on which nobody starts, and `reserve`
    (n,) whether people come only if somebody adds them.
    """

    def __init__(
        self,
        crowd: Crowd,
        groups: tuple[Group, ...],
        building: Building,
        routes: int,
        staying: IntArray | None = None,
        sources: "Sequence[Source]" = (),
        left_out: tuple[Finding, ...] = (),
    ) -> None:
        self.crowd = crowd
        self.groups = groups
        self.sources, self.left_out = tuple(sources), left_out
        self.staying = np.zeros(0, np.int32) if staying is None else staying
        self._building, self._n_portals, self._routes = building, len(building.portals), routes
        self._log: list[tuple[IntArray, IntArray, FloatArray]] = []
        self._protected: list[NDArray[Any]] = []
        self.is_read_only, self._is_writable = False, False
        self.reserve: BoolArray = np.zeros(len(crowd.level), np.bool_)
        self._reserves = {source.name: source for source in self.sources if np.isinf(source.due).any()}
        for source in self._reserves.values():
            self.reserve[source.rows] = True

    def protect(self, heeded: Sequence[str] = HEEDED) -> None:
        """Make the arrays read-only that would not be heeded if others than their owners wrote them."""
        self._protected = [array for name, array in self.crowd.values().items() if name not in heeded]
        for array in self._protected:
            array.flags.writeable = self._is_writable

    @contextmanager
    def writable(self, is_writable: bool = True) -> Iterator[None]:
        """Let the arrays be written by their owners, unless recorders read them, or not; afterwards it is as before."""
        if self.is_read_only or self._is_writable == is_writable:
            yield
            return
        self._set_writable(is_writable)
        try:
            yield
        finally:
            self._set_writable(not is_writable)

    def _set_writable(self, is_writable: bool) -> None:
        self._is_writable = is_writable
        for array in self._protected:
            array.flags.writeable = is_writable

    def check_written(self, routes: int) -> None:
        """Check what a program has written between two ticks; SimulationError names the first person."""
        if is_legal(self.crowd, routes):
            return
        start_time, speed, route = (getattr(self.crowd, name) for name in HEEDED)
        wrong = (
            np.isnan(start_time),
            ~(np.isfinite(speed) & (speed >= 0.0)).all(axis=1),
            (route < 0) | (route >= routes),
        )
        legal = "a number, inf for never", "finite and not negative", f"from 0 to {routes - 1}, see Simulation(routes)"
        for name, people, remedy in zip(HEEDED, wrong, legal, strict=True):
            if people.any():
                person = int(np.argmax(people))
                value = getattr(self.crowd, name)[person].tolist()
                raise SimulationError(f"crowd.{name}: {value} was written for person {person}; it must be {remedy}")

    def add(self, building: Building, group: str, time: float, place: tuple[float, float] | None) -> int:
        """Let the next person of a group with a reserve come, see `Scene.add`."""
        if group not in self._reserves:
            hint = did_you_mean(group, [*self._reserves]) if self._reserves else "give a group arrive.reserve"
            raise ScenarioError(f"people.{group}: there is no reserve of this name; {hint}")
        person = self._reserves[group].add(building, self.crowd, time, place)
        self.reserve[person] = False
        return person

    def remove(self, rows: IntArray, time: float) -> None:
        """Take people inside out at a time [s]."""
        crowd = self.crowd
        rows = rows[crowd.level[rows] >= 0]
        crowd.level[rows], crowd.exit_time[rows] = -1, time
        crowd.passing[rows], crowd.ahead[rows] = -1, 0.0

    @property
    def inside(self) -> int:
        """Number of people still inside, or still to come."""
        return int(np.count_nonzero(np.isnan(self.crowd.exit_time)))

    @property
    def next_arrival(self) -> float:
        """Earliest time of those who have not come [s]; infinite if everybody has."""
        late = [source.due[np.isnan(self.crowd.arrival_time[source.rows])] for source in self.sources]
        return float(np.concatenate([[np.inf], *late]).min())

    def arrive(self, building: Building, time: float) -> IntArray:
        """Let the people come whose time has come, and return them; who finds no place waits outside."""
        came = [source.let_in(building, self.crowd, time) for source in self.sources]
        return np.concatenate([np.zeros(0, np.int32), *came])

    @property
    def crossings(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Persons (m,) int32, portals (m,) int32 and times (m,) float64 [s] of all portal crossings, in order."""
        empty = (np.empty(0, np.int32), np.empty(0, np.int32), np.empty(0))
        rows, links, times = zip(empty, *self._log, strict=True)
        return np.concatenate(rows), np.concatenate(links), np.concatenate(times)

    def groups_for(self, behaviour: str) -> tuple[Group, ...]:
        """Return the groups with the settings for one behaviour only, as in its `BehaviourScene`."""
        return tuple(replace(group, settings=dict(group.settings.get(behaviour, {}))) for group in self.groups)

    def rows_in(self, building: Building, name: str | shapely.Geometry, level: str = "") -> IntArray:
        """Return the people inside who are in an area or on a level, or belong to a group; an empty name means all.

        Parameters
        ----------
        building : Building
        name : str or shapely geometry
            A polygon in plan is on all levels, or on the one of the name `level`.
        level : str

        Raises
        ------
        ScenarioError
            There is nothing of this name.
        """
        if isinstance(name, shapely.Geometry):
            rows = self.rows_in(building, level)
            inside: BoolArray = shapely.intersects_xy(name, *self.crowd.position[rows].T)
            return rows[inside]
        crowd, parts = self.crowd, building.parts_named(name)
        is_in = crowd.level >= 0
        if parts:
            is_in[:] = False
            for part in parts:
                here = np.flatnonzero(crowd.level == part.level)
                is_in[here] = shapely.intersects_xy(part.polygon, *crowd.position[here].T)
        elif name:
            groups = [group.name for group in self.groups]
            if name not in groups:
                known = groups + [area.name for area in building.areas] + [level.title for level in building.levels]
                raise ScenarioError(f"no area, level, stair or group is named {name!r}; {did_you_mean(name, known)}")
            is_in &= crowd.group == groups.index(name)
        return np.flatnonzero(is_in).astype(np.int32)

    def settle(self, events: Events) -> IntArray:
        """Record the crossings of a tick: exit times, exits used, and the log of portal crossings; return who left."""
        count = int(events.number)
        if not count:
            return np.zeros(0, np.int32)
        row, link, time = events.row[:count], events.link[:count], events.time[:count]
        is_exit = events.kind[:count] == EXIT
        self.crowd.exit_time[row[is_exit]] = time[is_exit]
        self.crowd.exit_used[row[is_exit]] = link[is_exit] - self._n_portals
        if not is_exit.all():
            self._log.append((row[~is_exit].copy(), link[~is_exit].copy(), time[~is_exit].copy()))
        left: IntArray = row[is_exit]
        return left

    def log(self, rows: IntArray, link: int, time: float) -> None:
        """Add a link that people have passed without a crossing in plan, such as a ride, to the log."""
        self._log.append((rows, np.full(len(rows), link, np.int32), np.full(len(rows), time)))

    saved = ("crowd", "_reserves")

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of all arrays and of the log."""
        row, link, time = self.crossings
        return super().state() | {"crossing_row": row, "crossing_link": link, "crossing_time": time}

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore what `state` returned."""
        super().restore(state)
        for source in self._reserves.values():
            self.reserve[source.rows] = np.isinf(source.due)
        crowd = self.crowd
        building = self._building  # perhaps another one than that of the checkpoint
        counts = len(building.levels), len(building.exits), len(building.links), self._routes
        for name, count in zip(("level", "exit_used", "passing", "route"), counts, strict=True):
            if not -1 <= getattr(crowd, name).min() <= getattr(crowd, name).max() < count:
                raise SavedError(f"crowd.{name}: there are only {count}")
        is_out = (crowd.level < 0) & ~np.isnan(crowd.arrival_time)
        if not np.array_equal(is_out, np.isfinite(crowd.exit_time)) or (crowd.exit_used[~is_out] >= 0).any():
            raise SavedError("crowd.level: is not -1 for exactly those who have an exit_time, as all with an exit_used")
        rows = taken(state, "crossing_row", np.int32, (None,), 0, len(is_out) - 1)
        links = taken(state, "crossing_link", np.int32, rows.shape, 0, len(self._building.links) - 1)
        self._log = [(rows, links, taken(state, "crossing_time", np.float64, rows.shape, 0.0))]


def build_population(
    case: "Case", building: Building, fields: Fields, seed: int, behaviours: Sequence[Behaviour] = ()
) -> Population:
    """Draw the properties and start positions of all people.

    Each quantity of each group has its own random generator, spawned from (seed, group, quantity), so it is
    independent of other groups and quantities, the contact model and the step. People with given positions are
    placed first; people in areas do not overlap them. Given positions may overlap each other, but not walls.
    """
    due = {people.name: times_of_arrival(people, seed) for people in case.people if people.arrive is not None}
    counts = [len(due[people.name]) if people.name in due else people.count for people in case.people]
    if not any(counts):
        raise ScenarioError(f"{case.source}: people: nobody comes with seed {seed}; raise arrive.rate or arrive.to")
    crowd = make_crowd(np.zeros((sum(counts), 2)), level=-1)
    ends = np.cumsum(counts)
    own = case.simulation.population_seed
    groups = tuple(
        Group(
            people.name,
            np.arange(end - count, end, dtype=np.int32),
            people.behaviours,
            people.arrive is not None and bool(people.arrive.exit or people.arrive.portal),
        )
        for people, count, end in zip(case.people, counts, ends, strict=True)
    )
    for index, (people, group) in enumerate(zip(case.people, groups, strict=True)):
        crowd.group[group.rows] = index
        crowd.route[group.rows] = fields.routes.index(route_of(people))
        with naming(case.source):
            _draw_quantities(crowd, people, group.rows, seed if own is None else own)
        drawn = crowd.radius[group.rows]
        crowd.contact_radius[group.rows] = contact_radii(behaviours, people, drawn)
    for people, group in zip(case.people, groups, strict=True):
        if people.positions is not None:
            _take_positions(case, building, crowd, people, group.rows)
    findings: list[Finding] = []
    out: dict[int, tuple[LeftOut, FloatArray]] = {}
    for people, group in zip(case.people, groups, strict=True):
        if people.positions is None and people.arrive is None:
            findings += _take_area(case, building, fields, crowd, people, group.rows, seed, out)
    sources = []
    for people, group in zip(case.people, groups, strict=True):
        if people.arrive is not None:
            crowd.arrival_time[group.rows] = np.nan
            sources.append(Source(people, group.rows, due[people.name], seed))
    stay = [group.rows for people, group in zip(case.people, groups, strict=True) if not people.leave]
    staying = np.concatenate([np.zeros(0, np.int32), *stay])
    crowd.start_time[staying] = np.inf
    return Population(crowd, groups, building, len(fields.routes), staying, sources, tuple(dict.fromkeys(findings)))


def _draw_quantities(crowd: Crowd, people: "GroupSettings", rows: IntArray, seed: int) -> None:
    """Draw the properties of the people of one group."""

    def drawn(quantity: str, distribution: Distribution) -> FloatArray:
        values = distribution.draw(generator_for(seed, "people", people.name, quantity), len(rows))
        least, greatest = BOUNDS[quantity]
        for value in (values.min(), values.max()) if len(rows) else ():  # at a rate, nobody may come
            if not least <= value <= greatest:
                raise ScenarioError(
                    f"people.{people.name}.{quantity}: the value {value:.3g} of one person is outside "
                    f"[{least:g}, {greatest:g}]; add minimum and maximum to the distribution"
                )
        return values

    crowd.radius[rows] = drawn("radius", people.radius)
    crowd.height[rows] = drawn("height", people.height)
    crowd.mass[rows] = drawn("mass", people.mass)
    crowd.tau[rows] = drawn("tau", people.tau)
    flat = drawn("speed", people.speed)
    crowd.speed[rows, FLAT] = flat
    for use, quantity in ((UP, "speed_up"), (DOWN, "speed_down")):
        given = getattr(people, quantity)
        own = isinstance(given, Distribution)
        speed = drawn(quantity, given) if own else flat * drawn(quantity, given.factor)
        crowd.speed[rows, use] = np.minimum(speed, flat) if people.limit_stair_speeds else speed


def _take_positions(case: "Case", building: Building, crowd: Crowd, people: "GroupSettings", rows: IntArray) -> None:
    """Put a group at its given positions; refuse positions in walls."""
    position = np.array(people.positions, dtype=np.float64)
    level = _levels_of(case, building, people, position)
    _put_inside(building, level, position)
    crowd.position[rows] = position
    crowd.level[rows] = level
    if people.velocity is not None:
        crowd.velocity[rows] = people.velocity
    for index in np.unique(level):
        here = np.flatnonzero(level == index)
        distance = clearance(position[here], building.walls[building.wall_level == index])
        stuck = np.flatnonzero(distance < crowd.radius[rows[here]] - ROUNDING)
        if stuck.size:
            row = here[stuck[0]]
            x, y = position[row]
            raise ScenarioError(
                f"{case.source}: people.{people.name}.positions.{row}: ({x:g}, {y:g}) on level "
                f"{building.levels[index].name!r} is {distance[stuck[0]]:.3f} m from a wall, less than the body "
                f"radius {crowd.radius[rows[row]]:.3f} m; move it, or reduce the radius"
            )


def _put_inside(building: Building, level: IntArray, position: FloatArray) -> None:
    """Move positions that are outside their level by rounding to the inside, so that they can cross its portals."""
    for index in np.unique(level):
        polygon = building.levels[index].polygon
        here = np.flatnonzero(level == index)
        outside = here[~shapely.covers(polygon.buffer(-ROUNDING), shapely.points(position[here]))]
        if outside.size:
            lines = shapely.shortest_line(polygon.buffer(-2.0 * ROUNDING), shapely.points(position[outside]))
            position[outside] = shapely.get_coordinates(lines).reshape(-1, 2, 2)[:, 0]


def _levels_of(case: "Case", building: Building, people: "GroupSettings", position: FloatArray) -> IntArray:
    """Return the level (k,) of each given position; a floor is preferred at its common edge with a flight."""
    x, y = position.T
    points = shapely.points(x, y)
    named = building.level_named(people.level) if people.level is not None else None
    candidates = building.levels if named is None else (named,)
    level_of = np.full(len(position), -1, dtype=np.int32)
    least = np.full(len(position), np.inf)
    for level in sorted(candidates, key=lambda level: level.kind == "flight"):
        shapely.prepare(level.polygon)
        is_on = shapely.dwithin(level.polygon, points, ROUNDING)
        off = np.zeros(len(position))
        if people.z is not None:
            off = np.abs(elevation(building, np.full(len(position), level.index), position) - people.z)
            is_on &= off <= HEIGHT_REACH
        better = is_on & (off < least - ROUNDING)
        level_of[better], least[better] = level.index, off[better]
    if (level_of < 0).any():
        row = int(np.argmax(level_of < 0))
        where = f"outside level {named.name!r}" if named else f"on no level at height z = {people.z:g} m"
        raise ScenarioError(
            f"{case.source}: people.{people.name}.positions.{row}: ({x[row]:g}, {y[row]:g}) is {where}; "
            "move it, or name another level"
        )
    return level_of


def _take_area(
    case: "Case",
    building: Building,
    fields: Fields,
    crowd: Crowd,
    people: "GroupSettings",
    rows: IntArray,
    seed: int,
    out: dict[int, tuple[LeftOut, FloatArray]],
) -> tuple[Finding, ...]:
    """Place a group at random in its areas, clear of walls, doors and people.

    `out` gets what is left out of levels, and their walls and links (w, 4) [m].
    """
    generator = generator_for(seed, "people", people.name, "position")
    widest, first, findings = float(crowd.contact_radius[rows].max()), 0, list[Finding]()
    for area, number in starts_of(str(case.source), people, building):
        own = rows[first : first + number]
        first += number
        if not number:
            continue

        def has_way(points: FloatArray, area: Area = area) -> BoolArray:
            if not people.leave or opens_later(case):
                return np.ones(len(points), np.bool_)
            return fields.are_passable(area.level, points, crowd.route[rows[0]], widest)

        if area.level not in out:
            links = [link.segments for link in building.links_of(area.level)]
            walls = np.concatenate([building.walls[building.wall_level == area.level], *links])
            out[area.level] = left_out(building, building.levels[area.level]), walls
        left, walls = out[area.level]
        start = start_in(building, area, left, has_way)
        findings += start.findings
        kind = "level" if people.level is not None else "area"
        where = "" if kind == "level" else f" on level {building.levels[area.level].name!r}"
        there = np.flatnonzero(crowd.level == area.level)
        crowd.position[own] = place(
            area.polygon,
            crowd.radius[own],
            np.concatenate([walls, start.faces]),
            np.column_stack((crowd.position[there], crowd.radius[there])),
            generator,
            f"{case.source}: people.{people.name}.number: {kind} {area.name!r}{where}",
            start.may_start,
        )
        crowd.level[own] = area.level
    return tuple(findings)
