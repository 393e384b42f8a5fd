"""Checks of behaviours: declared arrays, in all branches that a case or an artificial scene reaches."""

import ast
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import numpy as np

from evac.base.errors import plugin_code
from evac.case.case import Case
from evac.conformance.failures import CheckError, scene
from evac.people.behaviour import DECLARE, Behaviour, BehaviourScene
from evac.simulation.simulation import Simulation

#: Maximum number of ticks of a case, while lines of the behaviour have not been executed.
MOST_TICKS = 1000

#: Contact force on each person in an artificial crush [N].
CRUSH = 5000.0


def check_declared_arrays(case: Case, name: str, ticks: int = 20) -> str:
    """Check that a behaviour reads and writes only the arrays that it declares, in all branches of its code.

    The case runs until all lines of `act`, and of what it calls in the same file, have been executed, or to its end.
    For the remaining lines artificial scenes are tried: a closed exit, a crush, the last person inside.

    Returns
    -------
    str
        Description of the lines that were not executed; empty if there are none.
    """
    simulation, behaviour, view = _prepared(case, name)
    lines = _Lines(behaviour)
    for tick in range(MOST_TICKS):
        if simulation.ended or (tick >= ticks and not lines.missing()):
            break
        with scene(f"t = {simulation.time:.1f} s of {case.title}"):
            _act(behaviour, view, simulation, lines, simulation.time)
            simulation.advance_tick()
    if lines.missing():
        simulation, behaviour, view = _prepared(case, name)
        for title, time in _made_scenes(simulation):
            with scene(f"{title} in {case.title}"):
                _act(behaviour, view, simulation, lines, time)
    missing = lines.missing()
    return f"{missing} not executed in {case.title!r} and therefore not checked" if missing else ""


def check_distance(case: Case, name: str) -> None:
    """Check that a behaviour that keeps distances slows people down behind people who have left, inside and outside."""
    simulation, behaviour, view = _prepared(case, name)
    crowd, building = simulation.population.crowd, simulation.building
    way = next((way for way in building.exits if building.link_of(way) not in building.closed), None)
    with scene(f"three people at an exit of {case.title}"):
        if simulation.outside is None or way is None or len(crowd.level) < 3:
            raise CheckError("the case has no open exit, or fewer than three people", "give a case that has")
        outside = simulation.outside.arrays
        x1, y1, x2, y2 = max(way.segments, key=lambda piece: np.hypot(*(piece[2:] - piece[:2])))
        normal = np.array([y2 - y1, x1 - x2]) / np.hypot(x2 - x1, y2 - y1)
        places = np.array([(x1 + x2) / 2, (y1 + y2) / 2]) + np.multiply.outer((-0.4, 0.2, 0.8), normal)
        crowd.level[:], crowd.level[0], crowd.start_time[:] = -1, way.level, -1.0
        crowd.position[0], outside.position[:3], outside.direction[:3] = places[0], places, normal
        outside.depth[:3] = -0.4, 0.2, 0.8
        found = []
        for number in range(3):
            outside.level[1 : 1 + number] = way.level
            crowd.speed_factor[:], crowd.extra_direction[:], outside.speed_factor[:] = 1.0, 0.0, 1.0
            behaviour.act(view.crowd, 0.0)
            found.append((crowd.speed_factor[0], outside.speed_factor[1]))
        for what, slowed, free in (
            ("a person inside behind a person who has left", found[1][0], found[0][0]),
            ("a person who has left behind another one", found[2][1], found[1][1]),
        ):
            if not slowed < free:
                remedy = "use scene.outside, and multiply its speed_factor; or do not set keeps_distance"
                raise CheckError(f"does not slow down {what}, 0.6 m ahead", remedy)


def _prepared(case: Case, name: str) -> tuple[Simulation, Behaviour, BehaviourScene]:
    """Return a simulation, and a prepared behaviour with its scene."""
    with scene(case.title):
        simulation = Simulation(case, full=True)
        found = next((pair for pair in simulation.behaviours if pair[0].name == name), None)
        if found is None:
            raise CheckError(f"the case does not use behaviour {name!r}", "give a case that does")
        behaviour, view = found
        with _declared_only(behaviour, simulation):
            behaviour.prepare(view)
        return simulation, behaviour, view


def _act(behaviour: Behaviour, view: BehaviourScene, simulation: Simulation, lines: "_Lines", time: float) -> None:
    """Call `act` once, and refuse accesses to arrays that are not declared."""
    with _declared_only(behaviour, simulation), lines.noted():
        behaviour.act(view.crowd, time)


@contextmanager
def _declared_only(behaviour: Behaviour, simulation: Simulation) -> Iterator[None]:
    """Refuse that the block writes arrays that the behaviour does not declare, also with kernels."""
    crowd = simulation.population.crowd
    before = {key: array.copy() for key, array in crowd.values().items() if key not in behaviour.writes}
    with plugin_code("its method", behaviour, DECLARE):
        yield
    for key, array in before.items():
        if not np.array_equal(array, getattr(crowd, key), equal_nan=True):
            raise CheckError(f"writes {key!r} without declaring it", "add it to `writes`")


def _made_scenes(simulation: Simulation) -> Iterator[tuple[str, float]]:
    """Change a simulation to artificial scenes, one after the other; yield the name and the time [s] of each."""
    crowd, end = simulation.population.crowd, simulation.case.simulation.duration
    inside = np.flatnonzero(crowd.level >= 0)
    if simulation.building.exits and len(simulation.building.exits) > 1:
        simulation.scene.set_open(simulation.building.exits[0].name, False)
        yield "a closed exit", simulation.time
    crowd.velocity[:] = 0.0
    crowd.contact_force[:] = CRUSH
    crowd.position[inside] = crowd.position[inside[0]] + 1e-3 * np.arange(len(inside))[:, None]
    crowd.level[inside] = crowd.level[inside[0]]
    yield "a crush", simulation.time
    yield "a crush at the end of the run", end
    crowd.contact_force[:] = 0.0
    crowd.level[inside[1:]] = -1
    yield "the last person inside", end


class _Lines:
    """The executed lines of the file of a behaviour."""

    def __init__(self, behaviour: Behaviour) -> None:
        code = getattr(type(behaviour).act, "__code__", None)
        self._file = code.co_filename if isinstance(code, CodeType) else ""
        self._seen: dict[CodeType, set[int]] = {}
        self._exempt = _raising(self._file)

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Record the lines that are executed in the block."""
        before = sys.gettrace()
        sys.settrace(self._enter)
        try:
            yield
        finally:
            sys.settrace(before)

    def _enter(self, frame: FrameType, event: str, argument: Any) -> Any:
        if frame.f_code.co_filename != self._file:
            return None
        self._seen.setdefault(frame.f_code, set())
        return self._note

    def _note(self, frame: FrameType, event: str, argument: Any) -> Any:
        self._seen[frame.f_code].add(frame.f_lineno)
        return self._note

    def missing(self) -> str:
        """Describe the lines not executed in functions that were; empty if there are none. `raise` is exempt."""
        lines = set()
        for code, seen in self._seen.items():
            own = {line for *_, line in code.co_lines() if line} - {code.co_firstlineno}
            lines |= own - seen - self._exempt
        if not lines:
            return ""
        return f"lines {', '.join(map(str, sorted(lines)))} of {Path(self._file).name} are"


def _raising(file: str) -> set[int]:
    """Return the lines of the `raise` statements of a file; none if its source cannot be read."""
    try:
        tree = ast.parse(Path(file).read_text(encoding="utf-8"))
    except (OSError, SyntaxError, ValueError):
        return set()
    spans = [(node.lineno, node.end_lineno or node.lineno) for node in ast.walk(tree) if isinstance(node, ast.Raise)]
    return {line for first, last in spans for line in range(first, last + 1)}
