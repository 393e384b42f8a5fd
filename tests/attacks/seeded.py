"""Cases that a kind and a seed determine, and the small case that attacks change."""

import random
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

MODELS = ("nsm2", "nsm1", "dem")


def seeded(kinds: Iterable[Any], number: int, *kept: tuple[Any, int]) -> list[Any]:
    """Return parameters (kind, seed): those kept since they once failed, a number for each kind, and slow ones."""
    kinds, generator = list(kinds), random.Random(1)
    cases = [*kept, *((kind, generator.randrange(10**6)) for _ in range(10 * number) for kind in kinds)]
    fast = len(kept) + number * len(kinds)
    return [
        pytest.param(*case, id=f"{case[0]}-{case[1]}", marks=[] if k < fast else [pytest.mark.slow])
        for k, case in enumerate(cases)
    ]


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


def write_case(folder: Path, model: str = "nsm2") -> Path:
    """Write a small case that uses most keys, and return its file."""
    (folder / "room.obj").write_text(ROOM, encoding="utf-8")
    path = folder / "case.toml"
    path.write_text(CASE.replace("MODEL", model), encoding="utf-8")
    return path
