"""evac as one of the programs that are compared."""

import numpy as np

from evac.evidence.models import plugins
from evac.evidence.scaling.halls import Hall
from evac.evidence.scaling.minimal import make_minimal, walk_minimal
from evac.evidence.scaling.walks import TICK, Walk, cpu_time
from evac.people.behaviour import BehaviourScene
from evac.people.outside import make_outside
from evac.physics.contact.model import ContactModel
from evac.simulation.scene import Scene, make_ground


class EvacWalk:
    """A contact model of evac."""

    def __init__(self, hall: Hall, step: float, model: ContactModel) -> None:
        self.walk, self.model = Walk(hall, step), model

    @property
    def inside(self) -> int:
        """Number of people in the hall."""
        return self.walk.inside

    def advance(self) -> float:
        """Make the steps of a tick; return their CPU time [s]."""
        return cpu_time(lambda: self.walk.advance(self.model))


class MinimalWalk:
    """The minimal kernel: DEM without walls."""

    def __init__(self, hall: Hall, step: float) -> None:
        self.minimal = make_minimal(hall.crowd, hall.fields.packed, step)
        self.step = step
        self.inside = len(self.minimal.radius)

    def advance(self) -> float:
        """Make the steps of a tick; return their CPU time [s]."""
        return cpu_time(lambda: walk_minimal(self.minimal, round(TICK / self.step), self.step))


class HeadwayWalk(EvacWalk):
    """A contact model of evac with the behaviour headway, which acts at the start of every tick."""

    def __init__(self, hall: Hall, step: float, model: ContactModel) -> None:
        super().__init__(hall, step, model)
        self.behaviour = plugins().get("behaviour", "headway")()
        scene = Scene(make_ground(hall.building, hall.fields))
        outside = make_outside(len(self.walk.crowd.level))
        self.behaviour.prepare(BehaviourScene(self.walk.crowd, scene, (), np.random.default_rng(0), TICK, outside))

    def advance(self) -> float:
        """Let the behaviour act and make the steps of a tick; return the CPU time of both [s]."""
        return cpu_time(self.act) + super().advance()

    def act(self) -> None:
        """Let the behaviour decide."""
        crowd = self.walk.crowd
        crowd.speed_factor[:] = 1.0
        crowd.extra_direction[:] = 0.0
        self.behaviour.act(crowd, self.walk.time)
