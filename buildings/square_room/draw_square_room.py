"""Draw the square room: ``python draw_square_room.py`` writes square_room.msh beside this file."""

from pathlib import Path

from shapely import box

from evac import Plan

SIDE = 5.0
DOOR = 0.82


def draw() -> Plan:
    """Return the room with its door in the middle of the wall x = SIDE."""
    plan = Plan("square_room")
    plan.storey("room", box(0.0, 0.0, SIDE, SIDE))
    plan.exit("door", "room", [(SIDE, (SIDE - DOOR) / 2), (SIDE, (SIDE + DOOR) / 2)])
    return plan


if __name__ == "__main__":
    draw().write(Path(__file__).with_name("square_room.msh"))
