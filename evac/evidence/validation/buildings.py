"""Buildings of the standard tests, drawn as bare OBJ meshes, and cases that run people through them.

Every building is written to a file and read back with the case that names it, so that the whole process from a mesh to
the table of people is validated.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from evac.case.case import Case
from evac.case.loading import load_case

Face = Sequence[tuple[float, float, float]]
Segment = Sequence[Sequence[float]]

MESH_NAME = "building.obj"

#: Speed of the crowd where a test names none: men of 30 to 50 years (IMO MSC.1/Circ.1238, annex 3) [m/s].
CROWD_SPEED = {"uniform": [0.97, 1.62]}


def rectangle(x1: float, y1: float, x2: float, y2: float, z1: float = 0.0, z2: float | None = None) -> Face:
    """Return a face over [x1, x2] x [y1, y2] that rises from z1 at x1 to z2 at x2 [m]; level if z2 is not given."""
    z2 = z1 if z2 is None else z2
    return [(x1, y1, z1), (x2, y1, z2), (x2, y2, z2), (x1, y2, z1)]


def write_obj(path: Path, faces: Iterable[Face]) -> Path:
    """Write faces as an OBJ mesh; corners at the same place are left for evac to weld."""
    faces = list(faces)
    corners = iter(range(1, 1 + sum(len(face) for face in faces)))
    lines = ["v {!r} {!r} {!r}".format(*map(float, point)) for face in faces for point in face]
    lines += ["f " + " ".join(str(next(corners)) for _ in face) for face in faces]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def write_case(
    folder: Path,
    faces: Iterable[Face],
    exits: Iterable[tuple[str, Segment, float]],
    people: Iterable[Mapping[str, Any]],
    areas: Iterable[tuple[str, Sequence[float], float]] = (),
    sections: Mapping[str, Any] | None = None,
) -> Case:
    """Write a mesh and the case.toml that names it into `folder`, and load the case.

    Exits are (name, segment [m], z [m]), areas in which people start (name, (x1, y1, x2, y2) [m], z [m]). A group
    without name is named by its index. `sections` are other keys of the case, dotted, or whole sections.
    """
    write_obj(folder / MESH_NAME, faces)
    (folder / "case.toml").write_text(f'[building]\nmesh = "{MESH_NAME}"\n', encoding="utf-8")
    building = {
        "building.exits": [{"name": name, "segment": segment, "z": z} for name, segment, z in exits],
        "building.areas": [
            {"name": name, "polygon": [[x1, y1], [x2, y1], [x2, y2], [x1, y2]], "z": z}
            for name, (x1, y1, x2, y2), z in areas
        ],
    }
    groups = [{"name": f"group {number}", **group} for number, group in enumerate(people)]
    return load_case(folder / "case.toml", {**building, "people": groups, **(sections or {})})


def across(x: float, y1: float, y2: float) -> Segment:
    """Return the segment of an exit at `x` from y1 to y2 [m]."""
    return [[x, y1], [x, y2]]


def straight_stair(run: float = 8.0, rise: float = 6.0, width: float = 2.0, landing: float = 2.0) -> list[Face]:
    """Return a stair along x from (0, 0) with floors before and behind it; RiMEA 2 and 3 as it stands [m]."""
    return [
        rectangle(-landing, 0, 0, width, 0.0),
        rectangle(0, 0, run, width, 0.0, rise),
        rectangle(run, 0, run + landing, width, rise),
    ]


def corner() -> list[Face]:
    """Return the corner of RiMEA 6: a leg along x to 12 m, 2 m wide, and one along y from x = 10 to 12 m."""
    return [rectangle(0, 0, 10, 2), rectangle(10, 0, 12, 2), rectangle(10, 2, 12, 12)]


def two_rooms(width: float, length: float, exit_width: float) -> tuple[list[Face], Segment]:
    """Return the two rooms of RiMEA 12 with a bottleneck between them, and the exit of the second [m]."""
    far = 10.0 + length
    faces = [
        rectangle(0, 0, 10, 10),
        rectangle(10, 5 - width / 2, far, 5 + width / 2),
        rectangle(far, 0, far + 10, 10),
    ]
    return faces, across(far + 10, 5 - exit_width / 2, 5 + exit_width / 2)


def hall_and_stair(width: float) -> list[Face]:
    """Return the stair of ISO 20414 test 12: a hall of 8 x 10 m, 3 m up, and a flight of 4.24 m between landings."""
    low, high = 5 - width / 2, 5 + width / 2
    return [
        rectangle(0, 0, 8, 10, 3.0),
        rectangle(8, low, 10, high, 3.0),
        rectangle(10, low, 13, high, 3.0, 0.0),
        rectangle(13, low, 15, high, 0.0),
        rectangle(15, 0, 23, 10, 0.0),
    ]


def rooms_along_a_corridor() -> tuple[list[Face], list[tuple[str, Segment, float]], list[Sequence[float]]]:
    """Return the cabins of RiMEA 10: faces, exits main and secondary, and the twelve rooms (x1, y1, x2, y2) [m].

    Rooms 0 to 5 lie below the corridor, 6 to 11 above; walls are 0.1 m thick, doors 0.9 m wide. The passage to
    the main exit takes the place of a part of the third room above.
    """
    faces = [rectangle(0, 5, 18, 6), rectangle(6, 6, 7.2, 11)]
    rooms: list[Sequence[float]] = []
    for k in range(6):
        rooms.append((3 * k + 0.05, 0.0, 3 * k + 2.95, 4.8))
        faces.append(rectangle(3 * k + 1.05, 4.8, 3 * k + 1.95, 5))
    for k in range(6):
        left = 7.25 if k == 2 else 3 * k + 0.05
        door = 7.6 if k == 2 else 3 * k + 1.05
        rooms.append((left, 6.2, 3 * k + 2.95, 11.0))
        faces.append(rectangle(door, 6, door + 0.9, 6.2))
    faces += [rectangle(*room) for room in rooms]
    exits: list[tuple[str, Segment, float]] = [
        ("main", [[6, 11], [7.2, 11]], 0.0),
        ("secondary", across(18, 5, 6), 0.0),
    ]
    return faces, exits, rooms


def two_ways() -> list[Face]:
    """Return RiMEA 14: two halls, a long way round on their floor, and a short one down and up two stairs."""
    return [
        rectangle(0, 0, 5, 20),
        rectangle(5, 15, 25, 20),
        rectangle(25, 0, 30, 20),
        rectangle(5, 4, 10, 6, 0.0, -5.0),
        rectangle(10, 3, 20, 7, -5.0),
        rectangle(20, 4, 25, 6, -5.0, 0.0),
    ]
