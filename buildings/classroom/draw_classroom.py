"""Draw the classroom: ``python draw_classroom.py`` writes classroom.msh beside this file."""

from pathlib import Path

from shapely import MultiPolygon, box

from evac import Plan

WIDTH, LENGTH = 5.85, 6.75
COLUMNS, ROWS = 5, 6
ACROSS, ALONG = 1.35, 0.9
DESK_WIDTH, DESK_DEPTH = 0.45, 0.35
#: Centre of the desk nearest to the corner (0, 0): half a desk from the side wall, behind it 0.9 m of passage.
FIRST_DESK = (0.225, 1.575)
DOOR = (5.35, 5.85)


def desks() -> MultiPolygon:
    """Return the plan of the desks, the outer columns standing against the side walls."""
    x, y = FIRST_DESK
    return MultiPolygon(
        [
            box(
                x + ACROSS * column - DESK_WIDTH / 2,
                y + ALONG * row - DESK_DEPTH / 2,
                x + ACROSS * column + DESK_WIDTH / 2,
                y + ALONG * row + DESK_DEPTH / 2,
            )
            for column in range(COLUMNS)
            for row in range(ROWS)
        ]
    )


def draw() -> Plan:
    """Return the room, its desks and the door in its back wall y = 0."""
    plan = Plan("classroom")
    plan.storey("classroom", box(0.0, 0.0, WIDTH, LENGTH))
    plan.obstacle("desks", "classroom", desks())
    plan.exit("door", "classroom", [(DOOR[0], 0.0), (DOOR[1], 0.0)])
    return plan


if __name__ == "__main__":
    draw().write(Path(__file__).with_name("classroom.msh"))
