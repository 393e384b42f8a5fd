"""The scene: owner of building, fields and world, which changes during a run."""

import json
from collections.abc import Callable, Hashable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from evac.base.arrays import IntArray
from evac.base.change import ALL, LIFT, Change
from evac.base.errors import BuildingError, ScenarioError, counted, some_of
from evac.base.saved import Saved, SavedError
from evac.building.model.building import Building
from evac.building.model.cells import MOST_FIELDS, LevelField
from evac.building.model.links import building_at
from evac.directions.fields import Fields
from evac.directions.routes import Route, WaitsForLifts, no_waits
from evac.people.places import Places
from evac.people.population import Population
from evac.people.ways import without_way
from evac.physics.state import World
from evac.physics.world import make_world, set_open
from evac.simulation.changes import AT_ONCE, CHANGE_KINDS, check
from evac.simulation.doorways import Controls, begin_to_leave, clear_doorways, let_pass, turn_round

if TYPE_CHECKING:
    from evac.directions.local import LocalWays
    from evac.directions.quickest import Quickest, Settings
    from evac.directions.routefield import RouteField
    from evac.directions.smoky import Smoky

#: How people have been in an area since it was barred: not, since before, or they have entered it.
OUTSIDE, FROM_BEFORE, ENTERED = 0, 1, 2


@dataclass
class SharedScene:
    """The initial building and directions, which runs can share: independent of the seed."""

    building: Building
    fields: Fields  # directions of the building
    columns: "dict[int, RouteField] | None" = None  # of ways round the crowd, if many runs share them
    floors: dict[Hashable, Any] = field(default_factory=dict)  # of compartments, see `evac.conditions.safety.Safety`

    @cached_property
    def world(self) -> World:
        """Both in the form that kernels read."""
        return make_world(self.building, self.fields)


class Scene(Saved):
    """The building in which people walk, and the only owner of what changes in it during a run.

    Parameters
    ----------
    shared_scene : SharedScene
        The initial state. It is not modified, so that several scenes may share it.
    people : Population
        Those on the line of a link that closes are let through.
    places : Places
        The refuges and assembly areas.
    solve : callable
        ``solve(building) -> Fields``, called with `Building.for_ways` when it has changed.
    let_in : callable
        Places people who were added.
    settings : Settings
        Of directions that follow the crowd.
    keeps_distances : bool
        Whether people keep distances, so that they walk round the crowd.
    """

    saved = (
        *("time", "_journal", "ways_version", "quickest", "_is_in_smoke", "smoky", "local", "_owned", "_in_barred"),
        *("controls", "cut_off_at"),
    )
    growing = ("_journal",)

    def __init__(
        self,
        shared_scene: SharedScene,
        people: Population,
        places: Places,
        solve: Callable[[Building], Fields],
        let_in: Callable[[], None],
        settings: "Settings",
        keeps_distances: bool,
    ) -> None:
        self.building, self.shared_scene = shared_scene.building, shared_scene
        self._settings, self._keeps_distances = settings, keeps_distances
        #: the directions that follow the crowd, if a route has the strategy "quickest"
        self.quickest: Quickest | None = None
        self.waits_for_lifts: WaitsForLifts = no_waits
        self.local: LocalWays | None = None  #: the ways round the crowd of other routes, if people keep distances
        #: the routes in smoke, from when smoke is first noticed after a change of the building
        self.smoky: Smoky | None = None
        self.fields = self._own_fields(shared_scene.fields)
        self.time = 0.0  #: simulated time, the beginning of the next tick [s]
        self.changes: list[Change] = []  #: the changes so far, in order, each with the time at which it took effect
        self._of_lifts = 0
        self.ways_version = 0
        self._has_begun = self._has_ended = False
        self._waiting: list[Change] = []
        self._new_ways: list[int] = []
        self.people, self.places = people, places
        self._held: set[int] = set()  # closed links that let people through who stand on their lines
        self._owned: dict[str, LevelField] = {}
        self._in_barred: dict[str, NDArray[np.uint8]] = {}  # by area, how each person has been in it
        self._solve, self._let_in = solve, let_in
        number = len(people.crowd.level)
        self.controls = Controls(number, len(self.building.links))  #: whom controlled links let through
        #: (n,): since when each person has no way left [s], NaN for those who have one
        self.cut_off_at = np.full(number, np.nan)

    def begin(self) -> None:
        """Note that behaviours are prepared, so that no field can be added."""
        self._has_begun = True

    def end(self) -> None:
        """Note that the last tick is made, so that no change takes effect."""
        self._has_ended = True

    def begin_ways(self, rows: IntArray) -> None:
        """Note people who begin another way at this tick, on which progress counts anew."""
        self._new_ways += rows.tolist()

    def take_new_ways(self) -> list[int]:
        """Return the people who have begun another way since this was called before."""
        new, self._new_ways = self._new_ways, []
        return new

    @property
    def version(self) -> int:
        """A number that grows with all changes except those of lifts that leave the ways as they are.

        Code that caches data about the scene must compare versions at each tick.
        `ways_version` is the number of those that changed the ways: what follows from fields alone compares it.
        """
        return len(self.changes) - self._of_lifts + self.ways_version

    @cached_property
    def world(self) -> World:
        """The scene in the form that kernels read; updated when the scene changes."""
        world = self.shared_scene.world  # scenes share all arrays except those that are written
        own = {name: getattr(world, name).copy() for name in ("link_open", "link_from", "wall_open", "carry")}
        return world.replace(fields=self.fields.packed, **own)

    def apply(self, change: Change) -> None:
        """Change the scene now, or at the beginning of the tick at the time of the change, if that lies ahead.

        What depends on it is computed again, and the change is added to `changes`, unless it has no effect, for
        example because the run has ended.

        Parameters
        ----------
        change : Change

        Raises
        ------
        ScenarioError, BuildingError
            It is not a change, there is no such kind, or what is to be changed does not exist or cannot be changed so.
        """
        if not isinstance(change, Change):
            raise ScenarioError(f"{change!r:.80} is not a change; give evac.Change(time, kind, what)")
        check(self, change)
        if change.time > self.time + AT_ONCE or self._has_ended:
            self._waiting.append(change)
            return
        self.make(change)

    def make(self, change: Change) -> None:
        """Make a change now that can be made, such as one of a car."""
        with self.people.writable():
            made = CHANGE_KINDS[change.kind].act(self, change)
        if made is not None:
            given = {name: value for name, value in change.values.items() if name != "let_through"}
            self._of_lifts += change.kind == LIFT
            self.changes.append(replace(change, time=self.time, values={**given, **made}))

    def people_in(self, where: str | shapely.Geometry | Sequence[Sequence[float]], level: str = "") -> IntArray:
        """Return the rows of people inside.

        Parameters
        ----------
        where : str, shapely geometry, or sequence of (x, y)
            Name of an area, level, stair or group, everybody if it is empty; or a polygon in plan, or its corners [m].
        level : str
            Name of the level of a polygon; all levels if it is empty.

        Raises
        ------
        ScenarioError
            There is nothing of this name.
        """
        is_named = isinstance(where, str | shapely.Geometry)
        return self.people.rows_in(self.building, where if is_named else shapely.Polygon(where), level)

    def add(self, group: str, position: Sequence[float] | None = None) -> int:
        """Let the next person of a group with ``arrive.reserve`` come in, now or as soon as there is room.

        Parameters
        ----------
        group : str
        position : (x, y), optional
            Where, on the level of the group [m]; by default where the people of the group enter.

        Returns
        -------
        int
            Row of the person, whose level is -1 until there is room.

        Raises
        ------
        ScenarioError
            The group has no reserve, or no more people in it, or the position is not on its level.
        """
        place = None if position is None else (float(position[0]), float(position[1]))
        with self.people.writable():
            person = self.people.add(self.building, group, self.time, place)
            self._let_in()
        return person

    def remove(self, rows: ArrayLike) -> None:
        """Take people inside out of the building, who count as out from now on, by no exit.

        Parameters
        ----------
        rows : (k,) int
            Those who are not inside are left as they are.
        """
        with self.people.writable():
            self.people.remove(self._rows(rows), self.time)

    def send(self, rows: ArrayLike, route: Route) -> None:
        """Send people on another route, whatever events and places they followed.

        Parameters
        ----------
        rows : (k,) int
        route : Route
            One of ``fields.routes``; others are arguments of `Simulation`, or named in `Behaviour.routes`.

        Raises
        ------
        ScenarioError
            There are no directions for the route.
        """
        if route not in self.fields.routes:
            known = "; ".join(map(str, self.fields.routes))
            raise ScenarioError(f"there are no directions for {route}, only {known}; give it to Simulation as `routes`")
        chosen = self._rows(rows)
        self.places.release(chosen)
        self.people.crowd.route[chosen] = self.fields.routes.index(route)
        self.begin_ways(chosen)

    def set_open(self, name: str, is_open: bool) -> None:
        """Open or close an exit, a portal, or the portals of a stair now: closed ones are walls on both sides.

        Parameters
        ----------
        name : str
            Name of an exit, portal or stair, as in the key ``building.closed`` of a case.
        is_open : bool

        Raises
        ------
        BuildingError
            No exit, portal or stair has this name.
        """
        self.apply(Change(self.time, "open" if is_open else "close", name))

    def apply_waiting(self) -> None:
        """Apply the changes whose time has come, in the order of their times."""
        if self._held or self.building.one_way or self.building.controls:
            self._keep_open(clear_doorways(self.building, self.people.crowd))
        waiting, self._waiting = sorted(self._waiting, key=lambda change: change.time), []
        for change in waiting:
            self.apply(change)
        for name in sorted(self.building.emptying):
            if not len(self.people.rows_in(self.building, name)):
                self.apply(Change(self.time, "close", name, {"value": ALL}))
        for link in self.controls.act(self.time, self.building, self.fields, self.people.crowd):
            self.set_open(self.building.links[link].name, False)

    def changes_before(self, time: float) -> list[Change]:
        """Return the changes that lie ahead and are made before a time [s]."""
        return [change for change in self._waiting if change.time < time]

    def add_field(self, name: str, unit: str, spacing: float) -> LevelField:
        """Return a new field for its owner, which writes its values; see `BehaviourScene.level_field`."""
        refusals = {
            "the run has begun": self._has_begun,
            "it exists already": name in self._owned,
            f"there are {MOST_FIELDS} fields": len(self._owned) >= MOST_FIELDS,
        }
        for why in (why for why, is_so in refusals.items() if is_so):
            raise ValueError(f"field {name!r}: {why}; call scene.level_field once for each field, in prepare()")
        self._owned[name] = LevelField(self.building, name, unit, spacing)
        return self._owned[name]

    @property
    def fields_of_behaviours(self) -> Mapping[str, LevelField]:
        """The fields of all behaviours by name, with read-only views of their values; complete when the run begins."""
        fields = {}
        for name, own in self._owned.items():
            fields[name] = field = copy(own)
            field.values = own.values.view()
            field.values.flags.writeable = False
        return fields

    @property
    def _journal(self) -> NDArray[np.uint8]:
        """The changes so far and those to come, as JSON."""
        rows = [[change.as_row() for change in changes] for changes in (self.changes, self._waiting)]
        return np.frombuffer(json.dumps(rows).encode(), np.uint8)

    @_journal.setter
    def _journal(self, text: NDArray[np.uint8]) -> None:
        try:
            self.changes, self._waiting = (
                [Change.from_row(row) for row in rows] for rows in json.loads(text.tobytes())
            )
            self._of_lifts = sum(change.kind == LIFT for change in self.changes)
            self._in_barred = {change.what: self._nobody() for change in self.changes if change.kind == "bar"}
            self.set_building(building_at(self.shared_scene.building, self.changes, np.inf))
        except (ValueError, TypeError, BuildingError) as error:
            raise SavedError(f"journal: {error}") from error

    @property
    def _is_in_smoke(self) -> bool:
        return self.smoky is not None

    @_is_in_smoke.setter
    def _is_in_smoke(self, is_in_smoke: bool) -> None:
        if is_in_smoke:
            self.in_smoke()

    def _own_fields(self, fields: Fields) -> Fields:
        """Return fields for this scene alone: others if some of them follow the crowd."""
        self.smoky = None
        self._clear = fields
        if any(route.follows_crowd for route in fields.routes):
            from evac.directions.quickest import Quickest

            self.quickest = Quickest(fields, self._settings, self.quickest)
            fields = self.quickest.fields
        if self._keeps_distances and any(route.goes_round_crowd for route in fields.routes):
            from evac.directions.local import LocalWays

            fields = fields.with_own_directions() if fields is self._clear else fields
            first = self.shared_scene.columns if self._clear is self.shared_scene.fields else None
            self.local = LocalWays(fields, self._clear, self._settings, self.local, first)
        return fields

    def follow_crowd(self, tick: int, length: float) -> None:
        """Find the ways that follow the crowd again, if that is due at a tick of this length [s]."""
        crowd = self.people.crowd
        of = crowd.level, crowd.position, crowd.route, crowd.contact_radius
        if self.quickest is not None and self.quickest.is_due(tick, length):
            self.quickest.update(*of, self.waits_for_lifts)
        if self.local is not None and self.local.is_due(tick, length):
            self.local.update(*of, crowd.firmness > 1.0)

    def in_smoke(self) -> "Smoky":
        """Return the routes in smoke, which the scene follows from now on."""
        if self.smoky is None:
            from evac.directions.smoky import Smoky

            self.smoky = Smoky(self.fields, self._clear, self.quickest, self.local)
            self.fields = self.smoky.fields
            self.world.fields = self.fields.packed
        return self.smoky

    def keep_doorway_open(self) -> None:
        """Let those people through who were on the lines of closed links when the state was saved."""
        crowd, passing = self.people.crowd, self.people.crowd.passing
        is_free = (passing >= 0) & ~np.isin(passing, [*self.building.shut, *self._selective])
        passing[is_free], crowd.ahead[is_free] = -1, 0.0
        self._keep_open(set(passing[passing >= 0].tolist()))

    def act_on_areas(self) -> None:
        """Multiply the speed factors of people in slow areas, after behaviours; note who enters barred ones."""
        for name, share in sorted(self.building.slowed):
            self.people.crowd.speed_factor[self.people.rows_in(self.building, name)] *= share
        for name in self.building.barred:
            noted, inside = self._in_barred[name], self._nobody().astype(np.bool_)
            inside[self.people.rows_in(self.building, name)] = True
            noted[inside & (noted == OUTSIDE)] = ENTERED
            noted[~inside & (noted == FROM_BEFORE)] = OUTSIDE

    def note_cut_off(self) -> None:
        """Note who has no way left, after a change and when people have chosen among those that are left."""
        lost = without_way(self.fields, self.people.crowd)
        self.cut_off_at[~lost] = np.nan
        self.cut_off_at[lost & np.isnan(self.cut_off_at)] = self.time

    @property
    def entered(self) -> dict[str, tuple[int, ...]]:
        """The people who have entered each area while it was barred, because they had no other way."""
        found = {name: tuple(np.flatnonzero(one == ENTERED).tolist()) for name, one in self._in_barred.items()}
        return {name: rows for name, rows in found.items() if rows}

    def _rows(self, rows: ArrayLike) -> IntArray:
        """Return rows of people, which may be given as a mask of all."""
        given, number = np.atleast_1d(np.asarray(rows)), len(self.people.crowd.level)
        if given.dtype == np.bool_ and given.shape == (number,):
            return np.flatnonzero(given).astype(np.int32)
        is_row = np.issubdtype(given.dtype, np.integer) or not given.size
        if not (is_row and ((given >= 0) & (given < number)).all()):
            raise ScenarioError(f"rows of people are {given!r:.80}; give integers from 0 to {number - 1}, or a mask")
        return given.astype(np.int32)

    def _nobody(self) -> NDArray[np.uint8]:
        return np.full(len(self.people.crowd.level), OUTSIDE, np.uint8)

    def _keep_open(self, links: set[int]) -> None:
        """Keep closed links open for those whom they let through, and only these links."""
        for link in self._held - links:
            self._set_open(link)
        self._held = links & self.building.shut
        for link in self._held:
            set_open(self.world, link, 2)
        let_pass(self.building, self.people.crowd)

    def _set_open(self, link: int) -> None:
        """Set the flags of a link in the world."""
        if len(self.building.links[link].levels) == 2:
            everybody = -1 if link in self.building.controlled else self.building.directed.get(link, -1)
            self.world.link_from[link] = everybody
        set_open(self.world, link, 2 if link in self._selective else link not in self.building.shut)

    @property
    def _selective(self) -> set[int]:
        """The open links that are not open for everybody."""
        return {*self.building.directed, *self.building.controlled} - self.building.shut

    def set_building(self, building: Building) -> list[int]:
        """Take over a building that is in another condition; return the people on the lines of links that close."""
        if building.condition == self.building.condition:
            return []
        before, self.building = self.building, building
        controlled = {link for link, _ in before.controls ^ building.controls}
        closing = building.shut - before.shut | controlled.intersection(building.controlled) - before.controlled.keys()
        turning = {link for link, _ in building.one_way - before.one_way} & building.directed.keys()
        on_lines = begin_to_leave(before, self.fields, self.people.crowd, closing)
        turn_round(before, self.people.crowd, {link: building.directed[link] for link in turning - closing})
        for name in building.barred - before.barred:
            noted = self._in_barred.setdefault(name, self._nobody())
            rows = self.people.rows_in(building, name)
            noted[rows[noted[rows] == OUTSIDE]] = FROM_BEFORE
        changing = before.closed ^ building.closed | controlled
        self.controls.reset(changing)
        for link in changing | {link for link, _ in before.one_way ^ building.one_way}:
            self._set_open(link)
        self.world.carry[:] = building.ground_velocity
        self.keep_doorway_open()
        if building.for_ways.condition != before.for_ways.condition:
            self.fields = self._own_fields(self._solve(building.for_ways))
            self.world.fields = self.fields.packed
            self.ways_version += 1
        return on_lines


def doorway_warning(change: Change) -> str:
    """Return a warning that names the people who stood on the lines of links when they closed."""
    people = change.values["let_through"]
    return f"{change}: {counted(len(people), 'person', 'people')} on its line let through: {some_of(people)}"
