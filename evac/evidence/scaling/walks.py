"""Crowds walking in a hall, for a time or into a jam, and the cost of a person-step."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from evac.evidence.models import COARSE, make_engine, make_model
from evac.evidence.scaling.halls import Hall
from evac.jit import Struct
from evac.physics.contact_model import ContactModel
from evac.physics.state import Crowd, copy_of
from evac.physics.world import make_world

TICK = 0.1  # s

#: A crowd is jammed when the median of speed over desired speed has fallen below this.
JAMMED = 0.25

#: Least time of a jam, since crowds start from rest [s].
STARTED = 1.0

#: The walk of a crowd without a jam ends after this time [s], or when this share of the people is out.
LONGEST = 8.0
WALKED_OUT = 0.5

#: Ticks with the default model between the jam and the timing.
SETTLING = 2


@dataclass(frozen=True)
class Variant:
    """A contact model with the settings of a walk.

    Attributes
    ----------
    name : str
        Name in the tables.
    model : ContactModel
        The model that is timed.
    rough : ContactModel
        The model for the walk into the jam: NSM1, whose solve is the most expensive, with a coarse tolerance.
    step : float [s]
    """

    name: str
    model: ContactModel
    rough: ContactModel
    step: float


def make_variant(name: str, step: float, label: str = "", **parameters: Any) -> Variant:
    """Return a variant by the model's name in `models.MODELS`, with other parameters and a label where given."""
    model = make_model(name, **parameters)
    coarse: dict[str, Any] = {**parameters, **COARSE}
    rough = make_model(name, **coarse) if name.startswith("NSM1") else model
    return Variant(label or name, model, rough, step)


class Walk:
    """A walk of a copy of a hall's crowd, tick by tick."""

    def __init__(self, hall: Hall, step: float) -> None:
        self.crowd: Crowd = copy_of(hall.crowd)
        self.engine = make_engine(make_world(hall.building, hall.fields), len(self.crowd.level))
        self.step = step
        self.per_tick = round(TICK / step)
        self.made = 0  # steps
        self._before = self.crowd.position.copy()  # at the start of the last tick [m]

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.made * self.step

    @property
    def inside(self) -> int:
        """Number of people inside."""
        return int((self.crowd.level >= 0).sum())

    @property
    def pace(self) -> float:
        """Median of speed, by displacement over the last tick, over desired speed of who is inside; 0 of nobody."""
        inside = self.crowd.level >= 0
        speed = np.hypot(*(self.crowd.position - self._before)[inside].T) / TICK
        return float(np.median(speed / self.crowd.speed[inside, 0])) if len(speed) else 0.0

    def advance(self, model: ContactModel, ticks: int = 1) -> None:
        """Make some ticks.

        Raises
        ------
        SimulationError
            The model cannot make a step.
        """
        for _ in range(ticks):
            self._before[:] = self.crowd.position
            self.engine.advance(model, self.crowd, self.made, self.per_tick, self.step, False, False)
            self.made += self.per_tick

    def freely(self, variant: Variant, ticks: int) -> str:
        """Walk for a time; return why the walk ended.

        Raises
        ------
        SimulationError
            The model cannot make a step.
        """
        self.advance(variant.model, ticks)
        return "time"

    def into_a_jam(self, variant: Variant) -> str:
        """Walk until the crowd is jammed and has settled; return why the walk ended.

        Raises
        ------
        SimulationError
            The model cannot make a step.
        """
        people = len(self.crowd.level)
        ended = ""
        while not ended:
            self.advance(variant.rough)
            if self.inside < (1.0 - WALKED_OUT) * people:
                ended = f"{100.0 * WALKED_OUT:.0f} % are out"
            elif self.pace < JAMMED and self.time >= STARTED:
                ended = "jam"
            elif self.time >= LONGEST:
                ended = "longest time"
        self.advance(variant.model, SETTLING)
        return ended


@dataclass(frozen=True)
class Cost:
    """Cost of the timed ticks of a walk."""

    seconds: float  # median of a step
    per_person: float  # median of a person-step [s]
    spread: float  # greatest over least
    builds: float  # of the lists, per step
    iterations: float  # per step


def time_ticks(walk: Walk, model: ContactModel, ticks: int) -> Cost:
    """Take the CPU time of some ticks of a walk, Python's part included.

    Raises
    ------
    SimulationError
        The model cannot make a step.
    """
    spans, per_person = [], []
    before = walk.engine.report()
    for _ in range(ticks):
        inside = walk.inside
        start = time.process_time()
        walk.advance(model)
        spans.append((time.process_time() - start) / walk.per_tick)
        per_person.append(spans[-1] / max(inside, 1))
    after = walk.engine.report()
    steps = ticks * walk.per_tick
    return Cost(
        float(np.median(spans)),
        float(np.median(per_person)),
        max(spans) / min(spans),
        (after["list_builds"] - before["list_builds"]) / steps,
        (after["iterations"] - before["iterations"]) / steps,
    )


def memory(walk: Walk, model: ContactModel) -> int:
    """Return the bytes of all arrays whose size grows with the number of people, including those of the model."""
    state, people = walk.engine.state, len(walk.crowd.level)
    growing = (state.bodies, state.lists, state.contacts, state.warm_start, state.problem, state.events)
    return sum(map(_bytes, (walk.crowd, *growing, model.own(people, state.world))))


def _bytes(struct: Struct) -> int:
    """Return the bytes of all arrays in a struct."""
    return sum(value.nbytes for value in struct.values().values() if isinstance(value, np.ndarray))
