"""Draw the square room: ``python draw_square_room.py`` writes square_room.msh beside this file."""

from pathlib import Path

from shapely import box

from evac_buildings.drawing import Drawing

SIDE = 5.0
DOOR = 0.82


def draw() -> Drawing:
    """Return the room with its door in the middle of the wall x = SIDE."""
    drawing = Drawing()
    drawing.surface("floor:room", box(0.0, 0.0, SIDE, SIDE))
    drawing.edge("exit:door", (SIDE, (SIDE - DOOR) / 2), (SIDE, (SIDE + DOOR) / 2))
    return drawing


if __name__ == "__main__":
    draw().write(Path(__file__).with_name("square_room.msh"))
