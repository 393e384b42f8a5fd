"""The behaviours of a run: which of them act at a tick, and what is checked of what they write."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evac.base.distributions import MOST_WORDS, generator_for, generator_state, restore_generator
from evac.base.errors import fault, is_one_line, naming, plugin_code
from evac.base.saved import Saved, part_of, state_of, taken
from evac.people.behaviour import DECLARE, Behaviour, BehaviourScene, check_written, crowd_for, outside_for
from evac.physics.state import FIRM

if TYPE_CHECKING:
    from evac.simulation.simulation import Simulation


class Deciding(Saved):
    """Calls the behaviours of a run; errors name the behaviour.

    `used` has the behaviours with an effect, each with the scene that it can access, and `acts` by name whether it acts
    at every tick; `held` (n,) are people whom they let stand, to wait for others for example, but not behind others.
    """

    saved = ("version", "held")

    def __init__(self, simulation: "Simulation", behaviours: Sequence[Behaviour]) -> None:
        self._case, self._scene, self._is_full = simulation.case, simulation.scene, simulation.full
        self._population, self._places, self._crowd = (
            simulation.population,
            simulation.places,
            simulation.population.crowd,
        )
        self._outside = None if simulation.outside is None else simulation.outside.arrays
        self._share = None if simulation.exposure is None else simulation.exposure.share  # of the speed, left by smoke
        self._stopped = None if simulation.exposure is None else simulation.exposure.stopped
        self._displacement_velocity = simulation.displacement_velocity
        self.used: list[tuple[Behaviour, BehaviourScene]] = []
        for behaviour in behaviours:
            view = self._view(behaviour)
            with naming(self._case.source), plugin_code(f"behaviour {behaviour.name!r}: is_needed", behaviour):
                if self._is_full or behaviour.is_needed(view):
                    self.used.append((behaviour, view))
        self.acts: dict[str, bool] = {}
        self.reads_forces: bool = any("contact_force" in behaviour.reads for behaviour, _ in self.used)
        self.version = self._scene.version
        self.held = np.zeros(len(self._crowd.level), np.bool_)

    def _view(self, behaviour: Behaviour) -> BehaviourScene:
        """Return the scene that a behaviour can access."""
        case, outside = self._case, None if self._outside is None else outside_for(behaviour, self._outside)
        generator = generator_for(case.simulation.seed, "behaviour", behaviour.name)
        crowd, groups = crowd_for(behaviour, self._crowd), self._population.groups_for(behaviour.name)
        moved = self._displacement_velocity
        alarmed = tuple(place for phase in case.phase for place in phase.of)
        return BehaviourScene(
            crowd, self._scene, groups, generator, case.simulation.tick, outside, case.folder, moved, alarmed
        )

    def prepare(self) -> None:
        """Call `prepare` of the behaviours."""
        for behaviour, scene in self.used:
            with naming(self._case.source), plugin_code(f"behaviour {behaviour.name!r}: prepare", behaviour, DECLARE):
                behaviour.prepare(scene)
            self._check(behaviour, scene, 0.0)
            with plugin_code(f"behaviour {behaviour.name!r}: acts_at_ticks", behaviour):
                self.acts[behaviour.name] = behaviour.acts_at_ticks()
        self._scene.begin()

    def act(self, time: float, program: Callable[[], object] | None = None) -> None:
        """Reset speed factors and extra directions, then call a program and behaviours, all if the scene changed."""
        changed, self.version = self._scene.version != self.version, self._scene.version
        if changed:
            self._places.assign(self._scene.fields)
        # The scene, lifts and smoke multiply the speed factors.
        building = self._scene.building
        again = changed or bool(building.slowed or building.lifts) or self._share is not None
        acting = [
            (behaviour, scene)
            for behaviour, scene in self.used
            if self.acts[behaviour.name] or changed or (again and "speed_factor" in behaviour.writes)
        ]
        renewed = {name for behaviour, _ in acting for name in behaviour.writes}
        if again or "speed_factor" in renewed:
            self._crowd.speed_factor[:], self.held[:] = 1.0, False
        if self._case.place:
            self._crowd.speed_factor[self._places.arrived] = 0.0
        if self._case.place or len(self._population.staying) or self._stopped is not None:
            stands_firm = self._places.stands_firm
            stands_firm[self._population.staying] = True
            if self._stopped is not None:
                stands_firm |= self._stopped
            self._crowd.firmness[:] = np.where(stands_firm, FIRM, 1.0)
        if self._share is not None:
            self._crowd.speed_factor *= self._share
        if "extra_direction" in renewed:
            self._crowd.extra_direction[:] = 0.0
        if self._outside is not None and any(behaviour.keeps_distance for behaviour, _ in acting):
            self._outside.speed_factor[:] = 1.0
        if program is not None:
            with self._population.writable(False):
                program()
            self._population.check_written(len(self._scene.fields.routes))
            self.held[:] = self._crowd.speed_factor == 0.0
        for behaviour, scene in self.used if self._is_full else acting:
            with plugin_code(f"t = {time:.3f} s: behaviour {behaviour.name!r}", behaviour, DECLARE):
                behaviour.act(scene.crowd, time)
            self._check(behaviour, scene, time)
            if not behaviour.acts_last:  # those that do slow people down behind others
                self.held[:] = self._crowd.speed_factor == 0.0

    def _check(self, behaviour: Behaviour, scene: BehaviourScene, time: float) -> None:
        """Check what a behaviour wrote; those who do not leave never start, whatever it was."""
        if len(self._population.staying):
            self._crowd.start_time[self._population.staying] = np.inf
        routes = len(self._scene.fields.routes)
        check_written(behaviour, scene.level_fields, self._crowd, self._outside, routes, time)

    def notes(self) -> tuple[str, ...]:
        """Return the lines of the behaviours on people, each one line of text."""
        found: list[str] = []
        for behaviour, _ in self.used:
            what = f"behaviour {behaviour.name!r}: notes"
            with plugin_code(what, behaviour):
                lines = behaviour.notes()
            for line in lines:
                if not (isinstance(line, str) and is_one_line(line)):
                    raise fault(what, f"returned {line!r:.100}", "each must be one line of text", behaviour, "notes")
                found.append(f"{behaviour.name}: {line}")
        return tuple(found)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return what is saved, with the arrays of the behaviours and the states of their generators."""
        state = super().state()
        for behaviour, scene in self.used:
            state |= state_of(behaviour, f"behaviour {behaviour.name!r}", f"behaviour.{behaviour.name}.")
            state[f"generator.{behaviour.name}"] = generator_state(scene.generator)
        return state

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore what `state` returned."""
        super().restore(state)
        for behaviour, scene in self.used:
            what = f"behaviour {behaviour.name!r}: restore"
            with plugin_code(what, behaviour), part_of(state, f"behaviour.{behaviour.name}.") as own:
                behaviour.restore(own)
            words = taken(state, f"generator.{behaviour.name}", np.uint64, MOST_WORDS.shape, 0, MOST_WORDS)
            restore_generator(scene.generator, words)
