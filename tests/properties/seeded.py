"""Seeds that hypothesis draws, and the small case that some tests change."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, given, settings, strategies

MODELS = ("nsm2", "nsm1", "dem")

#: Seeds of random cases.
SEEDS = strategies.integers(0, 10**6)


def drawn(number: int, **given_by: Any) -> Callable[[Any], Any]:
    """Run a test with so many examples, always the same ones; by default with values of `seed`."""
    share = settings.default.max_examples / 100.0  # 1, unless a profile wants more
    options = settings(
        max_examples=max(1, round(number * share)),
        derandomize=True,
        deadline=None,
        database=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.differing_executors],
    )
    return lambda test: options(given(**(given_by or {"seed": SEEDS}))(test))


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
