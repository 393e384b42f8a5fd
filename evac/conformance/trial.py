"""What a plugin does in a case: which of its methods and lines run, and whether the run is another one without it."""

import inspect
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import numpy as np

from evac.base.errors import counted
from evac.case.case import Case
from evac.simulation.simulation import Simulation

#: Tables of case.toml with plugins without which a case can be run.
OPTIONAL = {"behaviour": "behaviours", "force": "forces"}


def tried_in(case: Case, plugins: list[tuple[str, str]]) -> Iterator[str]:
    """Run a case, and yield lines on plugins of one file, each given as kind and name."""
    classes = {name: case.registry.get(kind, name) for kind, name in plugins}
    files = {Path(inspect.getfile(cls)).resolve() for cls in classes.values()}
    with _traced(files) as (calls, lines):
        whole = Simulation(case)
        whole.run()
    for kind, name in plugins:
        yield from (f"{kind} {name}: {line}" for line in _methods(classes[name], calls, lines))
        if kind in OPTIONAL and getattr(case, OPTIONAL[kind]).get(name, False) is False:
            yield f"{kind} {name}: the case does not use it; add [{OPTIONAL[kind]}.{name}]"
        elif kind in OPTIONAL:
            without = Simulation(case.change({f"{OPTIONAL[kind]}.{name}": False}))
            without.run()
            if _same(whole, without):
                yield f"{kind} {name}: had no effect; the run without it is the same in all bits"


def _same(one: Simulation, other: Simulation) -> bool:
    """Return whether two runs end with the same people at the same places."""
    first, second = one.population.crowd, other.population.crowd
    names = ("position", "velocity", "exit_time", "exit_used", "distance", "start_time")
    return one.step == other.step and all(
        np.array_equal(getattr(first, name), getattr(second, name), equal_nan=True) for name in names
    )


def _methods(cls: type, calls: Counter[CodeType], lines: set[tuple[CodeType, int]]) -> Iterator[str]:
    """Yield a line for each method of a class that is written in Python."""
    for method in vars(cls).values():
        code = getattr(getattr(method, "__func__", method), "__code__", None)
        if not isinstance(code, CodeType):
            continue
        if not calls[code]:
            yield f"{code.co_name} never ran"
            continue
        first = code.co_firstlineno
        known = {line for _, _, line in code.co_lines() if line is not None and line > first}
        missing = sorted(known - {line for own, line in lines if own is code})
        left = f", but not line {', '.join(map(str, missing))}" if missing else ""
        yield f"{code.co_name} ran {'once' if calls[code] == 1 else counted(calls[code], 'time')}{left}"


@contextmanager
def _traced(files: set[Path]) -> Iterator[tuple[Counter[CodeType], set[tuple[CodeType, int]]]]:
    """Count the calls of functions in files, and note the lines that run."""
    calls, lines, names = Counter[CodeType](), set[tuple[CodeType, int]](), {str(file) for file in files}

    def on_line(frame: FrameType, event: str, _: Any) -> Any:
        lines.add((frame.f_code, frame.f_lineno))
        return on_line

    def on_call(frame: FrameType, event: str, _: Any) -> Any:
        if frame.f_code.co_filename not in names:
            return None
        calls[frame.f_code] += 1
        return on_line

    before = sys.gettrace()
    sys.settrace(on_call)
    try:
        yield calls, lines
    finally:
        sys.settrace(before)
