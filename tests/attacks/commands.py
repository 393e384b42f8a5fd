"""Commands of evac as a user gives them, within this process, and what they are never to do."""

import contextlib
import io
from pathlib import Path

from evac.cli import main

#: Everybody out or done, bad input, people left.
STATUSES = (0, 2, 3)


def call(words: list[str]) -> tuple[int, str]:
    """Give a command; return its status and what it says on standard error.

    Raises
    ------
    AssertionError
        The status is none that is documented, or bad input is not told in a line that begins as others do.
    """
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = main(words)
        except SystemExit as error:  # argparse
            status = error.code if isinstance(error.code, int) else 1
    said = err.getvalue()
    assert status in STATUSES, (status, said[-2000:])
    assert "Traceback" not in said, said[-2000:]
    assert "crash" not in said, said[-2000:]
    if status == 2:
        assert any(told in said for told in ("evac: ", "usage: ", "no case has been written")), said[-2000:]
    assert len(said) < 100_000, f"{len(said)} characters"
    return status, said


CASE = """\
title = "Everything"

[building]
mesh = "room.obj"
[[building.exits]]
name = "door"
segment = [[0.0, 1.5], [0.0, 2.5]]
z = 0.0
[[building.areas]]
name = "room"
polygon = [[1.0, 0.5], [5.5, 0.5], [5.5, 3.5], [1.0, 3.5]]
z = 0.0
[[building.obstacles]]
name = "table"
polygon = [[5.0, 3.6], [5.8, 3.6], [5.8, 3.9], [5.0, 3.9]]
z = 0.0

[directions]
spacing = 0.1

[presets.slow]
speed = { uniform = [0.5, 1.0] }

[[people]]
name = "drawn"
number = 5
area = "room"
preset = "slow"
[people.behaviours.response_time]
time = { uniform = [0.0, 1.0] }

[[people]]
name = "put"
positions = [[0.5, 1.0], [0.5, 3.0]]
velocity = [[0.0, 0.0], [0.1, 0.0]]
z = 0.0

[contact]
model = "MODEL"

[forces.social]

[behaviours.response_time]
[behaviours.route_choice]
[behaviours.headway]

[simulation]
duration = 0.3
seed = 1

[output]
every = 0.1
animation = false
picture = false
"""
ROOM = "v 0 0 0\nv 6 0 0\nv 6 4 0\nv 0 4 0\nf 1 2 3 4\n"

MODELS = ("nsm2", "nsm1", "dem")


def write_case(folder: Path, model: str = "nsm2") -> Path:
    """Write a small case that uses most keys, and return its file."""
    (folder / "room.obj").write_text(ROOM, encoding="utf-8")
    path = folder / "case.toml"
    path.write_text(CASE.replace("MODEL", model), encoding="utf-8")
    return path
