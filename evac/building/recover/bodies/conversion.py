"""Convert the bodies of a building model to a plan: storeys, doors, exits, stairs and obstacles."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.errors import BuildingError
from evac.building.geometry import common, cut, place_of, united
from evac.building.model.findings import Finding, numbered
from evac.building.plan.plan import Plan
from evac.building.recover.bodies.body import Body, snapped
from evac.building.recover.bodies.doorways import HALF_STOREY, Doorway, doorways_of, passages_of
from evac.building.recover.bodies.flights import FoundStair, meeting, stairs_of
from evac.building.recover.bodies.floors import Floor, Rules, floors_of

#: Kinds of bodies. Openings are holes in walls, with or without a door or window in them.
KINDS = ("space", "slab", "roof", "wall", "column", "opening", "door", "window", "stair", "landing", "furniture")
#: Minimum area of the remaining part of a room in which people can start [m2].
LEAST_ROOM = 0.5
#: Distance by which areas extend beyond their rooms, less than the thickness of walls [m].
BEYOND = 0.02


def plan_of_bodies(
    source: Path, bodies: Sequence[Body], storeys: Sequence[tuple[str, float]], rules: Rules, findings: list[Finding]
) -> Plan:
    """Return the plan of a building.

    `source`: for messages; `bodies`: of the kinds `KINDS`; `storeys` [m]: names and heights. The floors themselves are
    found from the bodies; `findings`: findings so far; they become the first findings of the plan.
    """
    passages, openings = passages_of(bodies)
    solid = [body for body in bodies if body.kind not in ("opening", "door", "window")]
    floors = floors_of([*solid, *openings], passages, storeys, rules, findings)
    if not floors:
        kinds = sorted({body.kind for body in bodies})
        lost = "".join(f"; {one.text}" for one in findings if one.kind == "missing")
        raise BuildingError(
            f"{source}: the file has no floor: neither a space nor a slab with a level top, only "
            f"{', '.join(kinds) or 'nothing'}{lost}"
        )
    ways = doorways_of(passages, floors, [body for body in bodies if body.kind == "wall"], findings)
    passable = [way.ground for way in ways]
    for floor in floors:
        own = [ground for way, ground in zip(ways, passable, strict=True) if way.floor is floor]
        floor.ground = snapped(united([floor.ground, *own]))
    stairs = stairs_of(bodies, floors, rules.cut_slabs, findings)
    plan = Plan(source)
    plan.findings = findings
    for floor in floors:
        more = [polygon for stair in stairs for of, polygon in stair.ground if of is floor]
        for polygon in more:
            text = f"{polygon.area:.3f} m2 of floor added at the end of a stair"
            findings.append(Finding("repaired", text, floor.name, place_of(polygon)))
        floor.ground = meeting(floor, stairs)
        inner = [ground for way, ground in zip(ways, passable, strict=True) if way.floor is floor and way.sides == 2]
        plan.storey(floor.name, cut(floor.ground, united(inner)), floor.z)
        slab = "" if floor.rooms else ", of slabs"
        plan.note("found", f"{floor.ground.area:.2f} m2 at {floor.z:.2f} m{slab}", floor.name)
    for stair in stairs:
        stair.add_to(plan)
    _add_doors(plan, ways, rules)
    _add_rooms(plan, floors, stairs)
    if not plan.exits:
        _note_alone(plan, floors, stairs)
    return plan


def _add_doors(plan: Plan, ways: Sequence[Doorway], rules: Rules) -> None:
    """Add the doors and exits."""
    outer = [way for way in ways if way.sides == 1 and way.leads_out and way.is_filled]
    floors = list({way.floor.name: way.floor for way in outer}.values())
    if rules.exits == "none":
        floors = []
    elif rules.exits == "ground" and floors:
        ground = min(floors, key=lambda floor: (abs(floor.z - rules.ground_z), floor.z))
        floors = [floor for floor in floors if abs(floor.z - ground.z) <= HALF_STOREY]
        text = "doors that lead outside are exits on this storey but not on others (exits, ground_z)"
        plan.note("assumed", text, ground.name)
    taken: set[str] = set()
    for way in ways:
        name = numbered(way.name, taken)
        taken.add(name)
        is_exit = way in outer and way.floor in floors
        if is_exit:
            plan.exit(name, way.floor.name, way.segment)
        elif way.sides == 2:
            plan.door(name, way.floor.name, way.segment, reach=way.reach)
        else:
            plan.opening(way.floor.name, way.segment, name)
        width = float(np.hypot(*(way.segment[1] - way.segment[0])))
        x, y = way.segment.mean(axis=0).tolist()
        kind = "door" if way.is_filled else "opening"
        to = "the outside" if way.leads_out else "a void inside of the building"
        what = "exit" if is_exit else kind if way.sides == 2 else f"{kind} to {to} (not an exit)"
        plan.note("found", f"{what} {name!r}, {width:.2f} m wide", way.floor.name, (x, y))


def _add_rooms(plan: Plan, floors: Sequence[Floor], stairs: Sequence[FoundStair]) -> None:
    """Add the spaces as areas, except those that are covered by stairs."""
    away = united([stair.plan for stair in stairs])
    names: set[str] = set()
    for floor in floors:
        taken: list[BaseGeometry] = []
        for room, polygon in floor.rooms:
            if common(cut(polygon, away), floor.ground).area < LEAST_ROOM:
                text = f"{room!r} is not an area: a stair covers it, or it has no floor"
                plan.note("left out", text, floor.name, place_of(polygon))
                continue
            name = room if room not in names else f"{room} of {floor.name}"
            names.add(name)
            # Slightly larger than the room, so that the outline of the area follows the outline of the floor at walls.
            grown = snapped(shapely.buffer(polygon, BEYOND, join_style="mitre"))
            area = common(cut(grown, united(taken)), floor.ground)
            taken.append(area)
            plan.area(name, floor.name, area)


def _note_alone(plan: Plan, floors: Sequence[Floor], stairs: Sequence[FoundStair]) -> None:
    """Warn of each storey to which no stair leads; where there are exits, the building tells what has no way out."""
    met = {floor.name for stair in stairs for floor in stair.floors}
    for floor in floors:
        if len(floors) > 1 and floor.name not in met:
            plan.note("warning", "no stair leads here", floor.name, place_of(floor.ground))
