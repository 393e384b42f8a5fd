"""Options of a building's file: how it is read, and what is added to it; keys of ``[building]`` and of Python alike."""

import math
from typing import Literal, Self

from pydantic import model_validator

from evac.base.change import Control, LiftOptions, Moving
from evac.base.defaults import HEADROOM, LEAST_LENGTH, WELD
from evac.base.keys import Coordinate, Name, Point, Real, Switch, Table, key, wrong

MOST_ITEMS = 10_000  #: Greatest number of exits, of areas and of obstacles, and of groups of people.


def check_level(what: str, level: str | None, z: float | None) -> None:
    """Check that a level is given either by name or by height."""
    if (z is None) == (level is None):
        raise wrong("level", f"give {what} by name, or its height z{', not both' if z is not None else ''}")


class Placed(Table):
    """An item on one level."""

    z: Coordinate | None = key("height of the level it is on; this or `level`", "m", None)
    level: str | None = key("name of the level it is on; this or `z`", "", None)

    @model_validator(mode="after")
    def _on_one_level(self) -> Self:
        check_level("the level", self.level, self.z)
        return self


class ExitLine(Placed):
    """`[[building.exits]]`: an exit given as a line, in addition to those of the file."""

    name: Name = key("name of the exit")
    segment: tuple[Point, Point] = key("its two ends [[x1, y1], [x2, y2]]", "m")

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        if math.dist(*self.segment) <= LEAST_LENGTH:
            raise wrong("segment", f"its two ends are the same point {list(self.segment[0])}; draw it along the door")
        return self


class Outline(Placed):
    """`[[building.areas]]`, `[[building.obstacles]]`: a polygon on a level."""

    name: Name = key("name of the area or obstacle")
    polygon: tuple[Point, ...] = key("its corners [[x, y], ...], at least three", "m", min_length=3)


#: Greatest slope of ramps, as rise over run: 1 in 8, that of existing ramps in NFPA 101. People walk on them at their
#: speed on the level, as the SFPE Handbook (5th edition, 2016, table 59.2) has one k for corridors, ramps and doors.
RAMP = 1.0 / 8.0


class SurfaceOptions(Table):
    """How the surface in a building's file becomes walkable ground."""

    weld: Real = key("vertices closer than this are merged", "m", WELD, ge=0, le=1)
    flat_angle: Real = key("cells less steep than this are floors and landings", "deg", 3.0, gt=0, lt=90)
    walkable_angle: Real = key("cells steeper than this cannot be walked on", "deg", 50.0, gt=0, lt=90)
    ramp: Real = key(
        "slopes up to this, as rise over run, are ramps, walked at the speed on the level; 0: all are stairs",
        "",
        RAMP,
        ge=0,
        le=1.0,
    )
    scale: Real = key("factor that turns the mesh's unit of length into metres", "", 1.0, ge=1e-6, le=1e6)
    up: Literal["z", "y"] = key("axis of the mesh that points upwards", "", "z")
    headroom: Real = key(
        "surfaces of solid bodies, and near flights of treads, with less clear height are left out; 0: none",
        "m",
        HEADROOM,
        ge=0,
        le=10,
    )
    treads: Switch = key("whether stairs modelled as treads become inclined flights", "", True)

    @model_validator(mode="after")
    def _angles_in_order(self) -> Self:
        if self.flat_angle >= self.walkable_angle:
            raise wrong(
                "flat_angle", f"must be less than walkable_angle {self.walkable_angle:g}, got {self.flat_angle:g}"
            )
        return self


class BuildingOptions(SurfaceOptions):
    """How a building's file is read, and what is added to it."""

    exits: tuple[ExitLine, ...] = key("exits in addition to those of the mesh", "", (), max_length=MOST_ITEMS)
    areas: tuple[Outline, ...] = key("start areas in addition to those of the mesh", "", (), max_length=MOST_ITEMS)
    obstacles: tuple[Outline, ...] = key("obstacles in addition to those of the mesh", "", (), max_length=MOST_ITEMS)
    north: Real | None = key(
        "direction of north in plan, counterclockwise from y; by default that of the file, if it tells it",
        "deg",
        None,
        ge=-360,
        le=360,
    )
    missing: tuple[str, ...] = key("what an incomplete import lacks; every run reports it as a quality warning", "", ())
    controls: dict[Name, Control] = key(
        "tables `[building.controls.NAME]`: how an exit, portal, stair or door of the building lets people through",
        "",
        {},
    )
    moving: dict[Name, Moving] = key(
        "tables `[building.moving.NAME]`: how the ground of a stair moves, which is an escalator or a moving walkway",
        "",
        {},
    )
    lifts: dict[Name, LiftOptions] = key(
        "tables `[building.lifts.NAME]`: how a lift of the building works, instead of what its plan says", "", {}
    )
    closed: tuple[str, ...] = key(
        "exits, portals, stairs and doors, by name, that are closed for the whole run", "", ()
    )
