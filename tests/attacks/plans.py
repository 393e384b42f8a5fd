"""Attacks by plans: any value of a key of a plan makes a building, or is refused in one line that names the key."""

import copy
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evac.base.errors import BuildingError
from evac.building.plan.plantable import SECTIONS, plan_of

#: A sound plan with something of every kind.
PLAN: dict[str, list[dict[str, Any]]] = {
    "storeys": [
        {
            "name": "ground",
            "polygons": ["POLYGON ((0 0, 8 0, 8 8, 0 8, 0 0))", "POLYGON ((8.2 0, 14 0, 14 8, 8.2 8, 8.2 0))"],
        },
        {"name": "first", "z": 3.2, "polygons": [[0, 0], [14, 0], [14, 8], [0, 8]], "wall": 0.0},
    ],
    "doors": [{"name": "door", "storey": "ground", "segment": [[8.1, 2], [8.1, 3]], "reach": 0.5}],
    "stairs": [
        {
            **{"name": "stair", "lower": "ground", "lower_edge": [[1, 0.8], [1, 2]], "upper": "first"},
            **{"length": 5.5, "direction": [1, 0]},
        }
    ],
    "exits": [{"name": "main", "storey": "ground", "segment": [[0, 3.5], [0, 4.7]]}],
    "openings": [{"storey": "ground", "segment": [[3, 0], [4, 0]], "name": "opening"}],
    "areas": [{"name": "office", "storey": "first", "polygon": [[8, 3], [13, 3], [13, 7], [8, 7]]}],
    "obstacles": [{"name": "table", "storey": "first", "polygon": [[10, 5], [12, 5], [12, 6], [10, 6]]}],
}
#: Keys that the plan leaves out.
FURTHER = {
    "storeys": ("file", "options"),
    "stairs": ("upper_edge", "landing", "landings", "turn", "gap"),
    "doors": ("outside",),
    "exits": ("polygon",),
}
VALUES = (
    *(1e308, -1e308, 1e100, 1e17, 1e9, 1e-300, float("nan"), float("inf"), -1, 0, 10**400, True, None, 3 + 4j, b"x"),
    *("", "x", "a\nb", "..", "nan", "POLYGON EMPTY", "POLYGON ((1e308 0, 1 1, 2 2, 1e308 0))", "POINT (1 1)"),
    *([], [1, "x"], [None], [float("nan"), 1], [1e-300, 0], [1e308, 1e308], [True, False], [[0, 0], [1]]),
    *([[1, "x"], [2, 3]], [[1e308, 0], [0, 1e308]], [[0, 0]] * 3, [[[0, 0]]], ["POLYGON ((0 0, 1 0, 1 1, 0 0))", 5]),
    *({}, {"type": "Polygon"}, {"type": "Polygon", "coordinates": [[["a", 1]]]}, {"type": "Feature", "geometry": None}),
)


@dataclass(frozen=True)
class Case:
    """One value of one key of the plan."""

    section: str
    index: int
    key: str
    value: int

    def __str__(self) -> str:
        return f"{self.section}.{self.index}.{self.key}={VALUES[self.value]!r:.40}"


def _crasher(section: str, key: str, value: Any) -> Case:
    return Case(section, 0, key, next(k for k, one in enumerate(VALUES) if one == value))


#: What once went wrong.
CRASHERS = (
    _crasher("stairs", "direction", [1, "x"]),
    _crasher("stairs", "length", 1e100),
    _crasher("doors", "segment", [[1e308, 0], [0, 1e308]]),
    _crasher("doors", "reach", 1e308),
    _crasher("storeys", "z", 10**400),
    _crasher("storeys", "options", -1),
    _crasher("storeys", "polygons", "POLYGON ((1e308 0, 1 1, 2 2, 1e308 0))"),
    _crasher("storeys", "name", "a\nb"),
)


def cases(number: int, seed: int) -> Iterator[Case]:
    """Yield the crashers, then cases that the seed determines."""
    yield from CRASHERS
    generator = random.Random(seed)
    for _ in range(number):
        section = generator.choice(list(PLAN))
        index = generator.randrange(len(PLAN[section]))
        key = generator.choice([*PLAN[section][index], *FURTHER.get(section, ())])
        yield Case(section, index, key, generator.randrange(len(VALUES)))


def run(case: Case, folder: Path) -> str:
    """Make the building, or refuse the value."""
    assert set(PLAN) <= set(SECTIONS)
    table = copy.deepcopy(PLAN)
    table[case.section][case.index][case.key] = VALUES[case.value]
    message = ""
    try:
        plan_of(table, folder / "plan.toml", folder).building()
    except BuildingError as error:
        message = str(error)
    assert "\n" not in message, message
    assert not message or "plan.toml" in message, message
    return "refused" if message else "made"
