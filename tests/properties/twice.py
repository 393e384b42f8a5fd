"""Runs that are made twice, the second time killed and resumed or has all parts: with the same bits."""

import random
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import evac
from evac.folder.files import CROSSINGS_NAME, PEOPLE_NAME, TRAJECTORY_NAME
from evac.simulation import checkpoints

if TYPE_CHECKING:
    from evac.case.case import Case

#: How the second run differs: it is killed and resumed, or has all parts.
KINDS = ("resumed", "full")


class Killed(BaseException):
    """Ends a run as a signal does."""


def made_again(kind: str, case: "Case", one: evac.Results, folder: Path, generator: random.Random) -> evac.Results:
    """Make a run in a folder, ``one``, again; return its results, whose tables and trajectory have the same bytes."""
    names = [PEOPLE_NAME, TRAJECTORY_NAME, *({CROSSINGS_NAME} & {path.name for path in one.folder.iterdir()})]
    if kind == "full":
        two = evac.run(case, folder / "two", progress=False, full=True)
    else:
        two = killed_and_resumed(case, one, folder / "two", generator)
    for name in names:
        assert (one.folder / name).read_bytes() == (two.folder / name).read_bytes(), f"{name} differs"
    assert one.changes == two.changes
    return two


def killed_and_resumed(case: "Case", one: evac.Results, folder: Path, generator: random.Random) -> evac.Results:
    """Kill a run before a random tick, that after the last one included, and resume it from its last checkpoint."""
    tick = case.simulation.tick
    ticks = generator.randrange(1, max(2, round(one.time / tick)))
    every = tick * generator.choice([0.5, 4.5, 20.5])  # of simulated time, since saving takes longer than a tick
    now = 0.0

    def kill(progress: Any) -> None:
        nonlocal now
        now = progress.time
        if now > (ticks - 0.5) * tick:
            raise Killed

    try:
        with patch(f"{checkpoints.__name__}.time", SimpleNamespace(monotonic=lambda: now)):
            evac.run(case, folder, progress=kill, checkpoint=every)
    except Killed:
        return evac.resume(folder, registry=case.registry, progress=False)
    raise AssertionError("the run was not killed")
