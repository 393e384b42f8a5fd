"""Data classes of a plan: storeys, stairs, and items on a storey."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import DOOR_REACH

#: Largest distance of an exit or a stair end from the outline of its floor [m].
SNAP = 0.15
#: Options for a door with a room on one side only.
OUTSIDE = ("refuse", "exit", "opening")


@dataclass(frozen=True)
class Storey:
    """A storey: its polygons, or the file that contains them; see `evac.building.plan.plan.Plan.storey`."""

    name: str
    z: float
    polygons: tuple[BaseGeometry, ...] = ()
    file: Path | None = None
    wall: float = 0.0
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Stair:
    """A stair between two storeys; see `evac.building.plan.plan.Plan.stair`."""

    name: str
    lower: str
    lower_edge: FloatArray
    upper: str
    upper_edge: FloatArray | None
    length: float | None
    direction: FloatArray | None
    landing: float | None
    landings: int
    turn: str | None
    gap: float


@dataclass(frozen=True)
class Item:
    """A door, exit, opening, area or obstacle on a storey: a segment (2, 2) or polygons."""

    name: str
    storey: str
    segment: FloatArray | None = None
    polygons: tuple[BaseGeometry, ...] = ()
    reach: float = DOOR_REACH
    outside: str = "refuse"
