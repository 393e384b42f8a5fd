"""Openings: possible exits of a building whose file names none."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from evac.base.arrays import FloatArray
from evac.building.geometry.segments import segment_lengths
from evac.building.model.building import Building, Level
from evac.building.model.elevation import level_elevation

#: Least width of an opening [m].
LEAST_WIDTH = 0.5
#: Greatest distance of an opening from the outline of its level [m].
REACH = 0.05
#: Greatest thickness of a wall between two rooms [m].
THICKEST = 1.0
#: Relative positions along a wall at which ground behind it is searched.
LOOKS = (0.1, 0.3, 0.5, 0.7, 0.9)


@dataclass(frozen=True)
class Opening:
    """A part of an outline that can become an exit."""

    number: int  # number in lists, from 1
    level: str  # name of its level in the building that the files describe, which edits may have taken away
    z: float  # height [m]
    segment: FloatArray  # (4,) float64: x1, y1, x2, y2 [m]
    width: float  # [m]

    def exit(self) -> dict[str, Any]:
        """Return the opening as an exit of a case."""
        x1, y1, x2, y2 = np.round(self.segment, 3).tolist()
        return {"name": f"exit {self.number}", "segment": [[x1, y1], [x2, y2]], "level": self.level}


def find_openings(building: Building, given: Sequence[tuple[str, ArrayLike]]) -> list[Opening]:
    """Return the openings of a building, the widest first.

    Parameters
    ----------
    building : Building
    given : sequence of (level, (4,) array [m])
        Openings in the file; if there are none, the outer edges of all floors are used.
    """
    found: list[tuple[int, FloatArray]] = []
    for name, ends in given:
        segment = np.asarray(ends, dtype=np.float64)
        on = _level_of(building, name, segment)
        if on is not None:
            found.append((on, segment))
    for level in building.levels if not found else ():
        if level.kind == "floor":
            found += [(level.index, wall) for wall in _outer(building, level)]
    width = segment_lengths(np.array([segment for _, segment in found]).reshape(-1, 4))
    order = sorted(range(len(found)), key=lambda k: (-round(float(width[k]), 3), found[k][0], *found[k][1].tolist()))
    kept = [k for k in order if width[k] >= LEAST_WIDTH]
    openings = []
    for number, k in enumerate(kept, start=1):
        level, segment = building.levels[found[k][0]], found[k][1]
        middle = ((segment[:2] + segment[2:]) / 2)[None]
        z = float(level_elevation(building.vertices, level, middle)[0])
        openings.append(Opening(number, level.name, z, segment, float(width[k])))
    return openings


def _outer(building: Building, level: Level) -> FloatArray:
    """Return the walls (w, 4) of a floor that are not inner walls: no ground at about its height is close behind."""
    walls = building.walls[building.wall_level == level.index]
    rings = shapely.union_all([part.exterior for part in shapely.get_parts(level.polygon)])
    middle = (walls[:, :2] + walls[:, 2:]) / 2
    step = (walls[:, 2:] - walls[:, :2]) / segment_lengths(walls)[:, None]
    outward = np.column_stack([step[:, 1], -step[:, 0]])
    near = [one.polygon for one in building.levels if one.kind == "floor" and abs(one.z_min - level.z_min) < THICKEST]
    ground = shapely.union_all(near)
    is_outer = shapely.dwithin(shapely.points(middle), rings, 1e-6)
    for share in LOOKS:
        start = walls[:, :2] + share * (walls[:, 2:] - walls[:, :2])
        behind = shapely.linestrings(np.stack([start + REACH * outward, start + THICKEST * outward], axis=1))
        is_outer &= ~shapely.intersects(behind, ground)
    outer: FloatArray = walls[is_outer]
    return outer


def _level_of(building: Building, name: str, segment: FloatArray) -> int | None:
    """Return the level with a given name, or a part of it, on whose outline a segment lies."""
    middle = shapely.points((segment[:2] + segment[2:]) / 2)
    for level in building.levels:
        is_named = level.name == name or level.name.startswith(f"{name} (")
        if is_named and level.polygon.boundary.distance(middle) <= REACH:
            return level.index
    return None
