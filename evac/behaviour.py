"""Behaviours: what people decide at the tick. The base class of behaviour plugins."""

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from evac.errors import PluginError, plugin_code
from evac.parameters import Configurable

if TYPE_CHECKING:
    from evac.building.model import Building
    from evac.directions.fields import Fields
    from evac.directions.routes import Route
    from evac.physics.state import Crowd, World
    from evac.scene import Scene


_LEGAL = {
    "speed_factor": "finite and not negative",
    "extra_direction": "finite",
    "start_time": "a number, inf for never",
}

#: What behaviours may write.
WRITABLE = ("start_time", "route", "speed_factor", "extra_direction")


class Behaviour(Configurable):
    """Acts on whole arrays at every tick; owns its private state.

    Attributes
    ----------
    reads, writes : tuple of str
        Names of `Crowd` arrays. The crowd handed over is read-only except for ``writes``, which may hold
        start_time, route, speed_factor and extra_direction.
    """

    reads: ClassVar[tuple[str, ...]] = ()
    writes: ClassVar[tuple[str, ...]] = ()

    #: Whether it takes what the others have written: it acts behind them, wherever a case names it.
    acts_last: ClassVar[bool] = False

    #: Keys that `people` groups may set for this behaviour, e.g. ``("teacher",)``.
    group_keys: ClassVar[tuple[str, ...]] = ()

    def routes(self) -> tuple["Route", ...]:
        """Return the routes it may give people beyond those their groups name; each costs a field.

        Returns
        -------
        tuple of Route
            Rows of ``scene.fields.routes`` then hold them.
        """
        return ()

    def prepare(self, scene: "BehaviourScene") -> None:
        """Set up once, before the first step; may write the declared arrays.

        Parameters
        ----------
        scene : BehaviourScene
        """

    def act(self, crowd: "Crowd", time: float) -> None:
        """Act at one tick: write the declared arrays in place, from where everybody is now.

        Parameters
        ----------
        crowd : Crowd
            Arrays of everybody, those out included (level -1); read-only except for ``writes``.
        time : float
            Of the tick [s].
        """

    def is_needed(self, scene: "BehaviourScene") -> bool:
        """Return False if it would change nothing in this scene, so that it can be left out.

        Parameters
        ----------
        scene : BehaviourScene
            As `prepare` gets it.
        """
        return True

    def acts_at_ticks(self) -> bool:
        """Return False if all its work is done by `prepare`; asked once, after that.

        `act` is then called only at the tick after a change of the scene.
        """
        return True

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the private arrays needed to go on from here, by names of the plugin's own; they are copied."""
        return {}

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore the arrays that `state` returned."""


class BehaviourScene:
    """What a behaviour sees of the simulation when it prepares.

    Attributes
    ----------
    crowd : Crowd
        Read-only except for the behaviour's ``writes``.
    scene : Scene
        Building, fields and world, as they are at the moment, and how often they have changed: its ``version``.
    groups : tuple of Group
        ``evac.people.population.Group``: name, rows (int32 array of people), settings (dict of the
        group's keys for this behaviour).
    generator : numpy.random.Generator
        The behaviour's own, spawned from (seed, name).
    tick : float [s]
    """

    def __init__(
        self,
        crowd: "Crowd",
        scene: "Scene",
        groups: tuple[Any, ...],
        generator: np.random.Generator,
        tick: float,
    ) -> None:
        self.crowd = crowd
        self.scene = scene
        self.groups = groups
        self.generator = generator
        self.tick = tick

    @property
    def building(self) -> "Building":
        """The building as it is now."""
        return self.scene.building

    @property
    def fields(self) -> "Fields":
        """The directions as they are now."""
        return self.scene.fields

    @property
    def world(self) -> "World":
        """Building and directions as kernels read them; it changes with the scene."""
        return self.scene.world

    @property
    def version(self) -> int:
        """How often the scene has changed."""
        return self.scene.version


def check_writes(behaviour: Behaviour) -> None:
    """Refuse a behaviour that declares to write what it may not.

    Parameters
    ----------
    behaviour : Behaviour

    Raises
    ------
    PluginError
        Naming the behaviour and the array.
    """
    with plugin_code(f"behaviour {behaviour.name!r}: writes"):
        declared = list(behaviour.writes)
    for array in declared:
        if array not in WRITABLE:
            raise PluginError(f"{behaviour.name}: declares to write {array!r}; behaviours write {', '.join(WRITABLE)}")


def crowd_for(behaviour: Behaviour, crowd: "Crowd") -> "Crowd":
    """Return views of a crowd's arrays, read-only but for those that a behaviour declares to write.

    Raises
    ------
    PluginError
        As `check_writes`.
    """
    check_writes(behaviour)
    views = {name: array.view() for name, array in crowd.values().items()}
    for name, view in views.items():
        view.flags.writeable = name in behaviour.writes
    return type(crowd)(**views)


def check_written(behaviour: Behaviour, crowd: "Crowd", routes: int, time: float) -> None:
    """Refuse numbers that a behaviour may not write, which would otherwise look like a failure of the physics.

    Parameters
    ----------
    behaviour : Behaviour
    crowd : Crowd
    routes : int
        Number of routes that there are.
    time : float [s]

    Raises
    ------
    PluginError
        A number is not legal for its array, or there is no such route; names behaviour, time and person.
    """
    for name in set(behaviour.writes) & {"speed_factor", "extra_direction", "start_time"}:
        written = getattr(crowd, name)
        is_lost = np.isnan(written) if name == "start_time" else ~np.isfinite(written)  # who never starts has inf
        if name == "speed_factor":
            is_lost |= written < 0.0
        if is_lost.any():
            person = int(np.argwhere(is_lost)[0, 0])
            raise PluginError(
                f"t = {time:.3f} s: behaviour {behaviour.name!r} wrote {written[person]} to {name} of person {person}; "
                f"it must be {_LEGAL[name]}"
            )
    if "route" in behaviour.writes:
        lost = np.flatnonzero((crowd.route < 0) | (crowd.route >= routes))
        if len(lost):
            raise PluginError(
                f"t = {time:.3f} s: behaviour {behaviour.name!r} wrote route {crowd.route[lost[0]]} for person "
                f"{lost[0]}; there are {routes}"
            )
