"""The scene: the one owner of building, fields and world, which may change during a run."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.building.links import links_named
from evac.building.model import Building
from evac.directions.fields import Fields
from evac.physics.state import World
from evac.physics.world import make_world, set_open


@dataclass(frozen=True)
class Ground:
    """What scenes begin with, and what runs can have in common: it does not depend on the seed, and never changes.

    Attributes
    ----------
    building : Building
    fields : Fields
        Of the building as it is.
    world : World
        Both as kernels read them.
    """

    building: Building
    fields: Fields
    world: World


def make_ground(building: Building, fields: Fields) -> Ground:
    """Return the ground of a building and its fields."""
    return Ground(building, fields, make_world(building, fields))


class Scene:
    """What people walk in. Portals and exits open and close, after which directions are solved again.

    Parameters
    ----------
    ground : Ground
        What it begins with, which it leaves as it is: many scenes, one after another or at once, may have it in common.
    solve : callable, optional
        ``solve(building) -> Fields``, called when a portal or exit has opened or closed.

    Attributes
    ----------
    ground : Ground
        What it began with.
    building : Building
        With the portals and exits that are closed now.
    fields : Fields
    version : int
        How often the scene has changed. Whoever keeps something derived from it compares versions at the tick.
    """

    def __init__(self, ground: Ground, solve: Callable[[Building], Fields] | None = None) -> None:
        self.building = ground.building
        self.fields = ground.fields
        self.version = 0
        self.ground = ground
        self._solve = solve

    @cached_property
    def world(self) -> World:
        """The scene as kernels read it; it changes with the scene."""
        world = self.ground.world  # all but its open flags, which alone are written, stays common to many scenes
        return world.replace(link_open=world.link_open.copy(), wall_open=world.wall_open.copy())

    def set_open(self, name: str, is_open: bool) -> None:
        """Open or close an exit, a portal, or the portals of a stair: closed ones are walls on both sides.

        Directions are solved again, and the version rises, unless nothing changes.

        Parameters
        ----------
        name : str
            As ``building.closed`` of a case takes it.
        is_open : bool

        Raises
        ------
        BuildingError
            Nothing has such a name.
        """
        links = links_named(self.building, name)
        closed = self.building.closed - links if is_open else self.building.closed | links
        self._close(frozenset(closed))

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the links that are closed, and the version."""
        return {"closed": np.array(sorted(self.building.closed), dtype=np.int64), "version": np.array([self.version])}

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore what `state` returned."""
        self._close(frozenset(state["closed"].tolist()))
        self.version = int(state["version"][0])

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
