"""Crowds walking in a hall, for a time or into a jam, and the cost of a person-step."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from evac.directions.fields import PackedFields
from evac.evidence.scaling.halls import Hall
from evac.evidence.scaling.minimal import Minimal, make_minimal, walk_minimal
from evac.evidence.scenes import COARSE, make_engine, make_model
from evac.jit import Struct
from evac.physics.contact.model import ContactModel
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


class Variant(NamedTuple):
    """A contact model with the settings of a walk."""

    name: str  # name in the tables
    model: ContactModel  # the model that is timed
    # the model for the walk into the jam: NSM1, whose solve is the most expensive, with a coarse tolerance
    rough: ContactModel
    step: float  # [s]


def make_variant(name: str, step: float, label: str = "", **parameters: Any) -> Variant:
    """Return a variant by the model's name in `scenes.MODELS`, with other parameters and a label where given."""
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
        """Make some ticks."""
        for _ in range(ticks):
            self._before[:] = self.crowd.position
            self.engine.advance(model, self.crowd, self.made, self.per_tick, self.step, False, False)
            self.made += self.per_tick

    def into_a_jam(self, variant: Variant) -> str:
        """Walk until the crowd is jammed and has settled; return why the walk ended."""
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


class Cost(NamedTuple):
    """Cost of the timed ticks of a walk."""

    seconds: float  # median of a step
    per_person: float  # median of a person-step [s]
    minimal: float  # median of a person-step of the minimal kernel [s]
    ratio: float  # median of person-steps over those of the minimal kernel beside them
    spread: float  # greatest over least
    builds: float  # of the lists, per step
    iterations: float  # per step


def time_ticks(walk: Walk, model: ContactModel, ticks: int) -> Cost:
    """Take the CPU time of some ticks of a walk, Python's part included, in turns with the minimal kernel."""
    minimal = start_minimal(walk.crowd, walk.engine.data.world.fields, walk.per_tick, walk.step)
    before = walk.engine.report()
    inside, spans, least = [], [], []
    for _ in range(ticks):
        inside.append(max(walk.inside, 1))
        spans.append(cpu_time(lambda: walk.advance(model)) / walk.per_tick)
        least.append(minimal_cost(minimal, walk.per_tick, walk.step))
    after = walk.engine.report()
    steps = ticks * walk.per_tick
    per_person = np.array(spans) / inside
    return Cost(
        float(np.median(spans)),
        float(np.median(per_person)),
        float(np.median(least)),
        float(np.median(per_person / least)),
        max(spans) / min(spans),
        (after["list_builds"] - before["list_builds"]) / steps,
        (after["iterations"] - before["iterations"]) / steps,
    )


def start_minimal(crowd: Crowd, fields: PackedFields, steps: int, step: float) -> Minimal:
    """Return a crowd as it stands for the minimal kernel, which has made so many steps of a length [s] with it."""
    minimal = make_minimal(crowd, fields, step)
    walk_minimal(minimal, steps, step)
    return minimal


def minimal_cost(minimal: Minimal, steps: int, step: float) -> float:
    """Make so many steps of a length [s] with the minimal kernel; return the CPU time of a person-step [s]."""
    return cpu_time(lambda: walk_minimal(minimal, steps, step)) / steps / len(minimal.radius)


def cpu_time(call: Callable[[], Any]) -> float:
    """Return the CPU time of a call [s]."""
    start = time.process_time()
    call()
    return time.process_time() - start


def memory(walk: Walk, model: ContactModel) -> int:
    """Return the bytes of all arrays whose size grows with the number of people, including those of the model."""
    state, people = walk.engine.data, len(walk.crowd.level)
    growing = (state.bodies, state.lists, state.contacts, state.warm_start, state.problem, state.events)
    return sum(map(bytes_of, (walk.crowd, *growing, model.own(people, state.world))))


def bytes_of(struct: Struct) -> int:
    """Return the bytes of all arrays in a struct, those of structs in it apart."""
    return sum(value.nbytes for value in struct.values().values() if isinstance(value, np.ndarray))
