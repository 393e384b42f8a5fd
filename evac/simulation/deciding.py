"""The behaviours of a run: which of them act at a tick, and what is checked of what they write."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.distributions import MOST_WORDS, generator_state, restore_generator
from evac.base.errors import naming, plugin_code
from evac.base.plugin_state import state_of
from evac.base.saved import part_of, taken
from evac.people.behaviour import DECLARE, Behaviour, BehaviourScene, check_written
from evac.people.outside import PeopleOutside
from evac.physics.state import Crowd
from evac.simulation.scene import Scene


class Deciding:
    """Calls the behaviours of a run; errors name the behaviour.

    Parameters
    ----------
    used : sequence of (Behaviour, BehaviourScene)
        In the order in which they act.
    scene : Scene
    crowd : Crowd
    outside : PeopleOutside or None
    is_full : bool
        Whether behaviours that have nothing to do at a tick are called, too.

    Attributes
    ----------
    acts : dict of str to bool
        By name, whether each acts at every tick.
    reads_forces : bool
        Whether one of them reads contact forces, which are then needed at every tick.
    version : int
        Version of the scene at the last tick.
    """

    def __init__(
        self,
        used: Sequence[tuple[Behaviour, BehaviourScene]],
        scene: Scene,
        crowd: Crowd,
        outside: PeopleOutside | None,
        is_full: bool,
    ) -> None:
        self._used, self._scene, self._crowd, self._is_full = used, scene, crowd, is_full
        self._outside = None if outside is None else outside.arrays
        self.acts: dict[str, bool] = {}
        self.reads_forces = any("contact_force" in behaviour.reads for behaviour, _ in used)
        self.version = scene.version

    def prepare(self, source: Path) -> None:
        """Call `prepare` of the behaviours of the case in a file."""
        for behaviour, scene in self._used:
            with naming(source), plugin_code(f"behaviour {behaviour.name!r}: prepare", behaviour, DECLARE):
                behaviour.prepare(scene)
            self._check(behaviour, scene, 0.0)
            with plugin_code(f"behaviour {behaviour.name!r}: acts_at_ticks", behaviour):
                self.acts[behaviour.name] = behaviour.acts_at_ticks()
        self._scene.has_begun = True

    def act(self, time: float) -> None:
        """Reset speed factors and extra directions, then call the behaviours; after a change of the scene, all."""
        changed, self.version = self._scene.version != self.version, self._scene.version
        acting = [one for one in self._used if self.acts[one[0].name] or changed]
        renewed = {name for behaviour, _ in acting for name in behaviour.writes}
        if "speed_factor" in renewed:
            self._crowd.speed_factor[:] = 1.0
        if "extra_direction" in renewed:
            self._crowd.extra_direction[:] = 0.0
        if self._outside is not None and any(behaviour.keeps_distance for behaviour, _ in acting):
            self._outside.speed_factor[:] = 1.0
        for behaviour, scene in self._used if self._is_full else acting:
            with plugin_code(f"t = {time:.3f} s: behaviour {behaviour.name!r}", behaviour, DECLARE):
                behaviour.act(scene.crowd, time)
            self._check(behaviour, scene, time)

    def _check(self, behaviour: Behaviour, scene: BehaviourScene, time: float) -> None:
        routes = len(self._scene.fields.routes)
        check_written(behaviour, scene.level_fields, self._crowd, self._outside, routes, time)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of the private arrays of the behaviours, and the states of their generators."""
        state: dict[str, NDArray[Any]] = {}
        for behaviour, scene in self._used:
            state |= state_of(behaviour, f"behaviour {behaviour.name!r}", f"behaviour.{behaviour.name}.")
            state[f"generator.{behaviour.name}"] = generator_state(scene.generator)
        return state

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Restore the arrays that `state` returned; behaviours that a changed case has added stay as they are."""
        for behaviour, scene in self._used:
            if f"generator.{behaviour.name}" in state:
                what = f"behaviour {behaviour.name!r}: restore"
                with plugin_code(what, behaviour), part_of(state, f"behaviour.{behaviour.name}.") as own:
                    behaviour.restore(own)
                with part_of(state, "generator.") as own:
                    words = taken(own, behaviour.name, np.uint64, MOST_WORDS.shape, 0, MOST_WORDS)
                restore_generator(scene.generator, words)
