"""The families of attacks, by name."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.attacks import (
    accidents,
    checkpoints,
    drawings,
    imports,
    kernels,
    keys,
    models,
    plans,
    scenes,
    streams,
    tables,
    texts,
    timetables,
    trajectories,
    walks,
)


@dataclass(frozen=True)
class Family:
    """Attacks of one kind.

    Attributes
    ----------
    cases : callable
        Yields what once went wrong, then the given number of cases that the given seed determines.
    run : callable
        Runs one case in an empty folder; returns what came of it, if there are several outcomes, and raises where that
        is not what is promised.
    number : int
        Cases of a full attack.
    share : int
        Cases beside those kept that `test_attacks.py` runs; none of families with tests of their own.
    """

    cases: Callable[[int, int], Iterator[Any]]
    run: Callable[[Any, Path], str | None]
    number: int
    share: int


FAMILIES = {
    "keys": Family(keys.cases, keys.run, 4000, 40),
    "texts": Family(texts.cases, texts.run, 200, 12),
    "scenes": Family(scenes.cases, scenes.run, 350, 6),
    "trajectories": Family(trajectories.cases, trajectories.run, 350, 0),
    "streams": Family(streams.stream_cases, streams.run_stream, 252, 0),
    "plugins": Family(streams.plugin_cases, streams.run_plugin, 493, 0),
    "models": Family(models.cases, models.run, 800, 14),
    "plans": Family(plans.cases, plans.run, 2000, 40),
    "drawings": Family(drawings.cases, drawings.run, 1200, 25),
    "imports": Family(imports.cases, imports.run, 3000, 9),
    "kernels": Family(kernels.cases, kernels.run, 60, 2),
    "checkpoints": Family(checkpoints.cases, checkpoints.run, 700, 12),
    "tables": Family(tables.cases, tables.run, 300, 12),
    "timetables": Family(timetables.cases, timetables.run, 1000, 4),
    "walks": Family(walks.cases, walks.run, 400, 4),
    "accidents": Family(accidents.cases, accidents.run, 80, 2),
}
