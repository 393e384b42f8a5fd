"""Draw the primary school: ``python draw_primary_school.py`` writes primary_school.msh beside this file.

x runs along the corridor, y from the entrance to the classrooms' windows. Each storey has a classroom on
either side of the stairwell, behind a corridor; the ground floor has the entrance hall as well.
"""

from pathlib import Path

from shapely import MultiPolygon, box, union_all
from shapely.affinity import scale
from shapely.geometry.base import BaseGeometry

from evac import Plan

STOREYS = ("ground", "first", "second")
STOREY_HEIGHT = 3.3
LENGTH = 19.6
AXIS = LENGTH / 2
CORRIDOR = 2.4
WALL = 0.2
ROOM_WIDTH, ROOM_DEPTH = 8.0, 7.0
DOOR = (6.4, 7.4)
DESK_DEPTH, DESK_LENGTH = 0.5, 1.3
DESK_ROWS = (0.95, 2.35, 3.75, 5.15)
TEACHER = (6.3, 7.5, 1.0)
FLIGHT_WIDTH, FLIGHT_GAP, FLIGHT_RUN = 1.5, 0.2, 2.8
LANDING_DEPTH = 1.6
HALL = (6.8, 12.8, -3.0)
EXIT_WIDTH = 1.8

_SOUTH = CORRIDOR + WALL


def classroom(part: str) -> BaseGeometry:
    """Return the plan of the western classroom's `part`: "room", "desks", "teacher" or "door"."""
    if part == "room":
        return box(0.0, _SOUTH, ROOM_WIDTH, _SOUTH + ROOM_DEPTH)
    if part == "teacher":
        return box(TEACHER[0], _SOUTH, TEACHER[1], _SOUTH + TEACHER[2])
    if part == "door":
        return box(DOOR[0], CORRIDOR, DOOR[1], _SOUTH)
    aisle = (ROOM_DEPTH - 3 * DESK_LENGTH) / 4
    souths = [_SOUTH + aisle + column * (DESK_LENGTH + aisle) for column in range(3)]
    return MultiPolygon([box(x, y, x + DESK_DEPTH, y + DESK_LENGTH) for x in DESK_ROWS for y in souths])


def draw_storey(plan: Plan, storey: int) -> None:
    """Add a storey: corridor, doorways, both classrooms, and the entrance hall at the bottom."""
    name = STOREYS[storey]
    mirror = {"a": lambda plan: plan, "b": lambda plan: scale(plan, xfact=-1.0, origin=(AXIS, 0.0))}
    floor = [box(0.0, 0.0, LENGTH, CORRIDOR), _stairwell()]
    floor += [side(classroom(part)) for side in mirror.values() for part in ("door", "room")]
    if storey == 0:
        floor.append(box(HALL[0], HALL[2], HALL[1], 0.0))
        middle = EXIT_WIDTH / 2
        plan.exit("main_door", name, [(AXIS - middle, HALL[2]), (AXIS + middle, HALL[2])])
    plan.storey(name, union_all(floor, grid_size=1e-6), storey * STOREY_HEIGHT)
    for letter, side in mirror.items():
        teacher = side(classroom("teacher"))
        plan.obstacle(f"desks_{storey}{letter}", name, side(classroom("desks")))
        plan.area(f"class_{storey}{letter}", name, side(classroom("room")).difference(teacher))
        plan.area(f"teacher_{storey}{letter}", name, teacher)


def _stairwell() -> BaseGeometry:
    """Return the plan of the way from the corridor to the foot of the stair."""
    half = FLIGHT_WIDTH + FLIGHT_GAP / 2
    return box(AXIS - half, CORRIDOR, AXIS + half, _SOUTH)


def draw_stair(plan: Plan, name: str, lower: int) -> None:
    """Add a stair up from a storey: the eastern flight, the half-landing, the western flight."""
    half, gap = FLIGHT_WIDTH + FLIGHT_GAP / 2, FLIGHT_GAP / 2
    east, west = ([(AXIS + s * gap, _SOUTH), (AXIS + s * half, _SOUTH)] for s in (1, -1))
    plan.stair(name, STOREYS[lower], east, STOREYS[lower + 1], west, length=FLIGHT_RUN, landing=LANDING_DEPTH)


def draw() -> Plan:
    """Return the school: three storeys and the two stairs between them."""
    plan = Plan("primary_school")
    for storey in range(len(STOREYS)):
        draw_storey(plan, storey)
    draw_stair(plan, "lower", 0)
    draw_stair(plan, "upper", 1)
    return plan


if __name__ == "__main__":
    draw().write(Path(__file__).with_name("primary_school.msh"))
