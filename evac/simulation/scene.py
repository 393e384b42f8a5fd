"""The scene: owner of building, fields and world, which may change during a run."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.saved import taken
from evac.building.model.building import Building
from evac.building.model.links import links_named
from evac.directions.fields import Fields
from evac.physics.state import World
from evac.physics.world import make_world, set_open

#: Greatest number of changes that a saved state can have.
MOST_VERSIONS = 2**31 - 1


@dataclass(frozen=True)
class Ground:
    """The initial building and directions, which runs can share: independent of the seed and never changed.

    Attributes
    ----------
    building : Building
    fields : Fields
        Directions of the building.
    world : World
        Both in the form that kernels read.
    """

    building: Building
    fields: Fields
    world: World


def make_ground(building: Building, fields: Fields) -> Ground:
    """Return the ground of a building and its fields."""
    return Ground(building, fields, make_world(building, fields))


class Scene:
    """The building in which people walk. If portals or exits open or close, the directions are solved again.

    Parameters
    ----------
    ground : Ground
        The initial state. It is not modified, so that several scenes may share it.
    solve : callable, optional
        ``solve(building) -> Fields``, called when a portal or exit has opened or closed.

    Attributes
    ----------
    ground : Ground
        The initial state.
    building : Building
        The building with its currently closed portals and exits.
    fields : Fields
    version : int
        Number of changes of the scene so far. Code that caches derived data must compare versions at each tick.
    """

    def __init__(self, ground: Ground, solve: Callable[[Building], Fields] | None = None) -> None:
        self.building = ground.building
        self.fields = ground.fields
        self.version = 0
        self.ground = ground
        self._solve = solve

    @cached_property
    def world(self) -> World:
        """The scene in the form that kernels read; updated when the scene changes."""
        world = self.ground.world  # scenes share all arrays except the open flags, the only ones that are written
        return world.replace(link_open=world.link_open.copy(), wall_open=world.wall_open.copy())

    def set_open(self, name: str, is_open: bool) -> None:
        """Open or close an exit, a portal, or the portals of a stair: closed ones are walls on both sides.

        If this is a change, directions are solved again and `version` increases.

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
        links = links_named(self.building, name)
        closed = self.building.closed - links if is_open else self.building.closed | links
        self._close(frozenset(closed))

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the indices of the closed links, and the version."""
        return {"closed": np.array(sorted(self.building.closed), dtype=np.int64), "version": np.array([self.version])}

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore the arrays that `state` returned.

        Raises
        ------
        SavedError
            An array is not what `state` returns.
        """
        closed = taken(state, "closed", np.int64, (None,), 0, self.building.n_links - 1)
        version = taken(state, "version", np.int64, (1,), 0, MOST_VERSIONS)
        self._close(frozenset(closed.tolist()))
        self.version = int(version[0])

    def _close(self, closed: frozenset[int]) -> None:
        if closed == self.building.closed:
            return
        for link in closed ^ self.building.closed:
            set_open(self.world, link, link not in closed)
        self.building = replace(self.building, closed=closed)
        if self._solve is not None:
            self.fields = self._solve(self.building)
            self.world.fields = self.fields.packed
        self.version += 1
