"""The scene: owner of building, fields and world, which changes during a run."""

import json
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import IntArray
from evac.base.change import Change
from evac.base.errors import BuildingError, ScenarioError
from evac.base.saved import Bounds, Saved, SavedError
from evac.building.model.building import Building
from evac.building.model.cells import MOST_FIELDS, LevelField
from evac.building.model.links import building_at
from evac.directions.fields import Fields
from evac.directions.quickest import Quickest, Settings
from evac.directions.routes import QUICKEST
from evac.directions.smoky import Smoky
from evac.people.places import Places
from evac.people.population import Population
from evac.physics.state import World
from evac.physics.world import make_world, set_open
from evac.simulation.doorways import begin_to_leave, clear_doorways, let_pass, turn_round
from evac.simulation.kinds import KINDS, check

#: How people have been in an area since it was barred: not, since before, or they have entered it.
OUTSIDE, FROM_BEFORE, ENTERED = 0, 1, 2

#: Times that differ by less are the same [s]: a multiple of the tick is rounded.
AT_ONCE = 1e-9


@dataclass(frozen=True)
class Ground:
    """The initial building and directions, which runs can share: independent of the seed and never changed."""

    building: Building
    fields: Fields  # directions of the building
    world: World  # both in the form that kernels read


def make_ground(building: Building, fields: Fields) -> Ground:
    """Return the ground of a building and its fields."""
    return Ground(building, fields, make_world(building, fields))


class Scene(Saved):
    """The building in which people walk, and the only owner of what changes in it during a run.

    Parameters
    ----------
    ground : Ground
        The initial state. It is not modified, so that several scenes may share it.
    people : Population, optional
        Those on the line of a link that closes are let through.
    places : Places, optional
        The refuges and assembly areas.
    solve : callable, optional
        ``solve(building) -> Fields``, called when a portal or exit has opened or closed.
    settings : Settings, optional
        Of the strategy "quickest"; without them its directions do not follow the crowd.

    Attributes
    ----------
    ground : Ground
        The initial state.
    building : Building
        The building with its currently closed portals and exits.
    fields : Fields
    quickest : Quickest or None
        The directions that follow the crowd, if a route has the strategy "quickest".
    smoky : Smoky or None
        The routes in smoke, from when smoke is first noticed after a change of the building.
    time : float
        Simulated time [s]: the beginning of the next tick.
    changes : list of Change
        The changes so far, in order, each with the time at which it took effect.
    new_ways : list of int
        The people who have begun another way at this tick, on which progress counts anew.
    """

    saved = ("time", "_journal", "quickest", "_is_in_smoke", "smoky", "_owned", "_in_barred")

    def __init__(
        self,
        ground: Ground,
        people: Population | None = None,
        places: Places | None = None,
        solve: Callable[[Building], Fields] | None = None,
        settings: Settings | None = None,
    ) -> None:
        self.building = ground.building
        self._settings = settings
        self.quickest: Quickest | None = None
        self.smoky: Smoky | None = None
        self.fields = self._own_fields(ground.fields)
        self.time = 0.0
        self.changes: list[Change] = []
        self.ground = ground
        self._has_begun = self._has_ended = False
        self._waiting: list[Change] = []
        self._new_ways: list[int] = []
        self.people, self.places = people, places
        self._held: set[int] = set()  # closed links that let people through who stand on their lines
        self._owned: dict[str, LevelField] = {}
        self._in_barred: dict[str, NDArray[np.uint8]] = {}  # by area, how each person has been in it
        self._solve = solve

    def begin(self) -> None:
        """Note that behaviours are prepared, so that no field can be added."""
        self._has_begun = True

    def end_tick(self, time: float) -> None:
        """Let the time go on [s], to the beginning of the next tick."""
        self.time = time

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
        """Number of changes so far. Code that caches derived data must compare versions at each tick."""
        return len(self.changes)

    @cached_property
    def world(self) -> World:
        """The scene in the form that kernels read; updated when the scene changes."""
        world = self.ground.world  # scenes share all arrays except those that are written
        own = {name: getattr(world, name).copy() for name in ("link_open", "link_from", "wall_open")}
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
        made = KINDS[change.kind].act(self, change)
        if made is not None:
            given = {name: value for name, value in change.values.items() if name != "let_through"}
            self.changes.append(replace(change, time=self.time, values={**given, **made}))

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
        if self.people is not None and (self._held or self.building.one_way):
            self._keep_open(clear_doorways(self.building, self.people.crowd))
        if not self._waiting:
            return
        waiting, self._waiting = sorted(self._waiting, key=lambda change: change.time), []
        for change in waiting:
            self.apply(change)

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
            self._in_barred = {change.what: self._nobody() for change in self.changes if change.kind == "bar"}
            self.set_building(building_at(self.ground.building, self.changes, np.inf))
        except (ValueError, TypeError, BuildingError) as error:
            raise SavedError(f"journal: {error}") from error

    @property
    def _is_in_smoke(self) -> bool:
        return self.smoky is not None

    @_is_in_smoke.setter
    def _is_in_smoke(self, is_in_smoke: bool) -> None:
        if is_in_smoke:
            self.in_smoke()

    def bounds(self) -> dict[str, Bounds]:
        """Return the bounds of times, texts and marks."""
        journal = Bounds(0, 255, shape=(None,))
        return {"time": Bounds(0.0), "_journal": journal, "_in_barred": Bounds(OUTSIDE, ENTERED)}

    def _own_fields(self, fields: Fields) -> Fields:
        """Return fields for this scene alone: others if some of them follow the crowd."""
        self.smoky = None
        if self._settings is None or not any(route.strategy == QUICKEST for route in fields.routes):
            return fields
        self.quickest = Quickest(fields, self._settings, self.quickest)
        return self.quickest.fields

    def in_smoke(self) -> Smoky:
        """Return the routes in smoke, which the scene follows from now on."""
        if self.smoky is None:
            self.smoky = Smoky(self.fields, self.quickest)
            self.fields = self.smoky.fields
            self.world.fields = self.fields.packed
        return self.smoky

    def keep_doorway_open(self) -> None:
        """Let those people through who were on the lines of closed links when the state was saved."""
        if self.people is not None:
            crowd, passing = self.people.crowd, self.people.crowd.passing
            is_free = (passing >= 0) & ~np.isin(passing, [*self.building.shut, *self.building.directed])
            passing[is_free], crowd.ahead[is_free] = -1, 0.0
            self._keep_open(set(passing[passing >= 0].tolist()))

    def act_on_areas(self) -> None:
        """Multiply the speed factors of people in slow areas, after behaviours; note who enters barred ones."""
        assert self.people is not None
        for name, share in sorted(self.building.slowed):
            self.people.crowd.speed_factor[self.people.rows_in(self.building, name)] *= share
        for name in self.building.barred:
            noted, inside = self._in_barred[name], self._nobody().astype(np.bool_)
            inside[self.people.rows_in(self.building, name)] = True
            noted[inside & (noted == OUTSIDE)] = ENTERED
            noted[~inside & (noted == FROM_BEFORE)] = OUTSIDE

    @property
    def entered(self) -> dict[str, tuple[int, ...]]:
        """The people who have entered each area while it was barred, because they had no other way."""
        found = {name: tuple(np.flatnonzero(one == ENTERED).tolist()) for name, one in self._in_barred.items()}
        return {name: rows for name, rows in found.items() if rows}

    def _nobody(self) -> NDArray[np.uint8]:
        assert self.people is not None
        return np.full(len(self.people.crowd.level), OUTSIDE, np.uint8)

    def _keep_open(self, links: set[int]) -> None:
        """Keep closed links open for those whom they let through, and only these links."""
        for link in self._held - links:
            self._set_open(link)
        self._held = links & self.building.shut
        for link in self._held:
            set_open(self.world, link, 2)
        assert self.people is not None
        let_pass(self.building, self.people.crowd)

    def _set_open(self, link: int) -> None:
        """Set the flags of a link in the world."""
        directed = self.building.directed
        if link < self.building.n_links:
            self.world.link_from[link] = directed.get(link, -1)
        set_open(self.world, link, 2 if link in directed else link not in self.building.shut)

    def set_building(self, building: Building) -> list[int]:
        """Take over a building that is in another condition; return the people on the lines of links that close."""
        if building.condition == self.building.condition:
            return []
        before, self.building = self.building, building
        closing = building.shut - before.shut
        turning = {link for link, _ in building.one_way - before.one_way} & building.directed.keys()
        on_lines: list[int] = []
        if self.people is not None:
            on_lines = begin_to_leave(before, self.fields, self.people.crowd, closing)
            turn_round(before, self.people.crowd, {link: building.directed[link] for link in turning})
            for name in building.barred - before.barred:
                noted = self._in_barred.setdefault(name, self._nobody())
                rows = self.people.rows_in(building, name)
                noted[rows[noted[rows] == OUTSIDE]] = FROM_BEFORE
        for link in before.closed ^ building.closed | {link for link, _ in before.one_way ^ building.one_way}:
            self._set_open(link)
        self.keep_doorway_open()
        if self._solve is not None:
            self.fields = self._own_fields(self._solve(building))
            self.world.fields = self.fields.packed
        return on_lines
