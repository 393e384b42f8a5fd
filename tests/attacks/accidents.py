"""Attacks on a run: it is stopped by a signal, or the disk is full, at any moment."""

import contextlib
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from evac.base.errors import ResultError
from evac.trajectory.trajectory import read_trajectory
from tests.attacks.commands import write_case

#: Longest time that a run takes to end after a signal [s].
LONGEST = 300.0


@dataclass(frozen=True)
class Case:
    """One accident.

    Attributes
    ----------
    kind : str
        Name of a signal, or "disk".
    at : float
        Seconds after the start, or bytes that a file may be long.
    """

    kind: str
    at: float

    def __str__(self) -> str:
        return f"{self.kind}-{self.at:g}"


KINDS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGKILL", "disk")

#: What once went wrong.
CRASHERS: tuple[Case, ...] = ()


def cases(number: int, seed: int) -> Iterator[Case]:
    """Yield the crashers, then accidents that the seed determines; each kind in turn."""
    yield from CRASHERS
    generator = random.Random(seed)
    for k in range(number):
        kind = KINDS[k % len(KINDS)]
        yield Case(kind, 10.0 ** generator.uniform(0.0, 6.0) if kind == "disk" else generator.uniform(0.0, 3.0))


def run(case: Case, folder: Path) -> str:
    """Run a case that takes some seconds; return with which status it ended."""
    write_case(folder)
    changes = ["simulation.duration=6000", "simulation.no_progress=inf", "people.drawn.speed=0", "people.put.speed=0"]
    if case.kind == "disk":
        changes = ["output.animation=true", "output.picture=true"]

    def limited() -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell lets background jobs ignore it,
        if hasattr(signal, "SIGHUP"):
            signal.signal(signal.SIGHUP, signal.SIG_DFL)  # and nohup this one
        if case.kind == "disk":
            resource.setrlimit(resource.RLIMIT_FSIZE, (int(case.at), int(case.at)))

    process = subprocess.Popen(
        [sys.executable, "-m", "evac", "run", "case.toml", "--out", "result", "--set", *changes],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        preexec_fn=limited,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    if case.kind != "disk":
        time.sleep(case.at)
        process.send_signal(getattr(signal, case.kind))
    _, said = process.communicate(timeout=LONGEST)
    _check_end(case, process.returncode, said)
    for path in folder.rglob("trajectory.evac"):
        # Of a shorter one the header itself may not be whole.
        with contextlib.nullcontext() if path.stat().st_size > 2000 else contextlib.suppress(ResultError):
            read_trajectory(path)
    return str(process.returncode)


def _check_end(case: Case, status: int, said: str) -> None:
    if case.kind == "disk":
        assert status in (0, 2, 3), (status, said)
        assert "Traceback" not in said, said
        assert status != 2 or "evac: " in said, said
        return
    if "init_import_site" in said:
        return  # Python itself has not started yet
    number = int(getattr(signal, case.kind))
    assert status in (-number, 128 + number, 130), (status, said)
    # While Python starts, nobody but Python answers a signal.
    assert "Traceback" not in said or case.at < 1.5, said
