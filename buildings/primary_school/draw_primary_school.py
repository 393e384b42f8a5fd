"""Draw the primary school: ``python draw_primary_school.py`` writes primary_school.msh beside this file.

x runs along the corridor, y from the entrance to the classrooms' windows. Each storey has a classroom on
either side of the stairwell, behind a corridor; the ground floor has the entrance hall as well.
"""

from pathlib import Path

from shapely import MultiPolygon, box, union_all
from shapely.affinity import scale
from shapely.geometry.base import BaseGeometry

from evac_buildings.drawing import Drawing

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


def draw_storey(drawing: Drawing, storey: int) -> None:
    """Add the floor of a storey: corridor, doorways, both classrooms, and the entrance hall at the bottom."""
    height = storey * STOREY_HEIGHT
    mirror = {"a": lambda plan: plan, "b": lambda plan: scale(plan, xfact=-1.0, origin=(AXIS, 0.0))}
    floor = [box(0.0, 0.0, LENGTH, CORRIDOR), _stairwell(0.0, WALL)]
    floor += [side(classroom("door")) for side in mirror.values()]
    if storey == 0:
        floor.append(box(HALL[0], HALL[2], HALL[1], 0.0))
        middle = EXIT_WIDTH / 2
        drawing.edge("exit:main_door", (AXIS - middle, HALL[2]), (AXIS + middle, HALL[2]))
    drawing.surface(f"floor:{STOREYS[storey]}", union_all(floor, grid_size=1e-6), height)
    for letter, side in mirror.items():
        desks, teacher = side(classroom("desks")), side(classroom("teacher"))
        room = side(classroom("room")).difference(union_all([desks, teacher]), grid_size=1e-6)
        drawing.surface(f"area:class_{storey}{letter}", room, height)
        drawing.surface(f"area:teacher_{storey}{letter}", teacher, height)
        drawing.surface(f"obstacle:desks_{storey}{letter}", desks, height)


def _stairwell(start: float, end: float) -> BaseGeometry:
    """Return the plan of the stairwell from `start` to `end` [m] behind the corridor."""
    half = FLIGHT_WIDTH + FLIGHT_GAP / 2
    return box(AXIS - half, CORRIDOR + start, AXIS + half, CORRIDOR + end)


def draw_stair(drawing: Drawing, tag: str, bottom: float) -> None:
    """Add a switchback stair up from `bottom` [m]: the eastern flight, the half-landing, the western flight."""
    half, gap = FLIGHT_WIDTH + FLIGHT_GAP / 2, FLIGHT_GAP / 2
    foot, head = _SOUTH, _SOUTH + FLIGHT_RUN
    rise = STOREY_HEIGHT / 2
    east, west = box(AXIS + gap, foot, AXIS + half, head), box(AXIS - half, foot, AXIS - gap, head)
    drawing.surface(tag, east, lambda x, y: bottom + rise * (y - foot) / FLIGHT_RUN)
    drawing.surface(tag, _stairwell(WALL + FLIGHT_RUN, WALL + FLIGHT_RUN + LANDING_DEPTH), bottom + rise)
    drawing.surface(tag, west, lambda x, y: bottom + STOREY_HEIGHT - rise * (y - foot) / FLIGHT_RUN)


def draw() -> Drawing:
    """Return the school: three storeys and the two stairs between them."""
    drawing = Drawing()
    for storey in range(len(STOREYS)):
        draw_storey(drawing, storey)
    draw_stair(drawing, "stair:lower", 0.0)
    draw_stair(drawing, "stair:upper", STOREY_HEIGHT)
    return drawing


if __name__ == "__main__":
    draw().write(Path(__file__).with_name("primary_school.msh"))
