"""What a plugin does in a case: which of its methods run, and whether the run is another one without it."""

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
    with _counted({str(Path(inspect.getfile(cls)).resolve()) for cls in classes.values()}) as calls:
        whole = Simulation(case)
        whole.run()
    for kind, name in plugins:
        yield from (f"{kind} {name}: {line}" for line in _methods(classes[name], calls))
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


def _methods(cls: type, calls: Counter[CodeType]) -> Iterator[str]:
    """Yield a line for each method of a class that is written in Python."""
    for method in vars(cls).values():
        code = getattr(getattr(method, "__func__", method), "__code__", None)
        if isinstance(code, CodeType):
            ran = "ran once" if calls[code] == 1 else f"ran {counted(calls[code], 'time')}"
            yield f"{code.co_name} {ran if calls[code] else 'never ran'}"


@contextmanager
def _counted(files: set[str]) -> Iterator[Counter[CodeType]]:
    """Count the calls of functions in files."""
    calls = Counter[CodeType]()

    def on_event(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_filename in files:
            calls[frame.f_code] += 1

    before = sys.getprofile()
    sys.setprofile(on_event)
    try:
        yield calls
    finally:
        sys.setprofile(before)
