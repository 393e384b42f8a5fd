"""What behaviours have to hold to: only declared arrays, in every branch that a case or a scene made of it reaches."""

import ast
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import numpy as np

from evac.behaviour import Behaviour, BehaviourScene
from evac.errors import ConformanceWarning, PluginError
from evac.physics.state import Crowd
from evac.scenario.case import Case
from evac.simulation import Simulation

#: A case is run for at most so many ticks while lines of the behaviour wait to be reached.
MOST_TICKS = 1000

#: Contact force on everybody in a scene of a crush [N].
CRUSH = 5000.0


def check_declared_arrays(case: Case, name: str, ticks: int = 20) -> None:
    """A behaviour touches only the arrays that it declares, wherever its code branches.

    The case is run until every line that acts has been reached, or to its end; what is missing then is tried in
    scenes made of it: a closed door, a crush, the last person inside, the end of the run.
    """
    seen: set[str] = set()
    simulation, behaviour, scene = _prepared(case, name, seen)
    lines = _Lines(behaviour)
    for tick in range(MOST_TICKS):
        if simulation.ended or (tick >= ticks and not lines.missing()):
            break
        _act(behaviour, scene, simulation, lines, f"t = {simulation.time:.1f} s of {case.title!r}")
        simulation.advance_tick()
    if lines.missing():
        simulation, behaviour, scene = _prepared(case, name, seen)
        for title, time in _made_scenes(simulation):
            _act(behaviour, scene, simulation, lines, f"{title} in {case.title!r}", time)
    if undeclared := sorted(seen - {*behaviour.reads, *behaviour.writes}):
        names = ", ".join(undeclared)
        raise PluginError(f"{case.title!r}: reads {names} without declaring it; add it to `reads`")
    if missing := lines.missing():
        warnings.warn(
            f"{name}: check_declared_arrays: {missing} not reached in {case.title!r}, so what they read and write is"
            f" not checked; give a case that reaches them: check_plugin({type(behaviour).__name__}, case)",
            ConformanceWarning,
            stacklevel=3,
        )


def _prepared(case: Case, name: str, seen: set[str]) -> tuple[Simulation, Behaviour, BehaviourScene]:
    """Return a run of a case, and a behaviour of it, prepared, with its scene; `seen` gets the arrays that it reads."""
    simulation = Simulation(case, full=True)
    found = next((pair for pair in simulation.behaviours if pair[0].name == name), None)
    if found is None:
        raise PluginError(f"{case.title!r}: does not use behaviour {name!r}; give a case that does")
    behaviour, scene = found
    scene.crowd = _WatchedCrowd(**scene.crowd.values())
    scene.crowd.__dict__["noted"] = seen
    behaviour.prepare(scene)
    return simulation, behaviour, scene


def _act(
    behaviour: Behaviour,
    scene: BehaviourScene,
    simulation: Simulation,
    lines: "_Lines",
    what: str,
    time: float | None = None,
) -> None:
    """Let the behaviour act once, and refuse writes that it does not declare."""
    crowd = simulation.population.crowd
    before = {key: array.copy() for key, array in crowd.values().items() if key not in behaviour.writes}
    try:
        with lines.noted():
            behaviour.act(scene.crowd, simulation.time if time is None else time)
    except ValueError as error:
        if "read-only" not in str(error):
            raise
        raise PluginError(
            f"{what}: writes an array that it does not declare: {error}; add it to `writes`, or write to a copy"
        ) from error
    for key, array in before.items():
        if not np.array_equal(array, getattr(crowd, key), equal_nan=True):
            raise PluginError(
                f"{what}: writes {key!r}, which it does not declare; add it to `writes`, or leave it alone"
            )


def _made_scenes(simulation: Simulation) -> Iterator[tuple[str, float]]:
    """Make scenes of a run that begins, one after the other; yield what each is, and its time [s]."""
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
    """The lines of a behaviour's file that run while it acts."""

    def __init__(self, behaviour: Behaviour) -> None:
        code = getattr(type(behaviour).act, "__code__", None)
        self._file = code.co_filename if isinstance(code, CodeType) else ""
        self._seen: dict[CodeType, set[int]] = {}
        self._exempt = _raising(self._file)

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Note the lines that run in the block."""
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
        """Return the lines that have not run, of the functions that have, or nothing; lines that raise do not count."""
        lines = set()
        for code, seen in self._seen.items():
            own = {line for *_, line in code.co_lines() if line} - {code.co_firstlineno}
            lines |= own - seen - self._exempt
        if not lines:
            return ""
        return f"lines {', '.join(map(str, sorted(lines)))} of {Path(self._file).name} are"


def _raising(file: str) -> set[int]:
    """Return the lines of a file that raise an exception; none if its source cannot be read."""
    try:
        tree = ast.parse(Path(file).read_text(encoding="utf-8"))
    except (OSError, SyntaxError, ValueError):
        return set()
    spans = [(node.lineno, node.end_lineno or node.lineno) for node in ast.walk(tree) if isinstance(node, ast.Raise)]
    return {line for first, last in spans for line in range(first, last + 1)}


class _WatchedCrowd(Crowd):
    """A crowd that notes which arrays are asked for."""

    def __getattribute__(self, name: str) -> Any:
        if name in Crowd.kinds:
            self.__dict__.setdefault("noted", set()).add(name)
        return super().__getattribute__(name)
