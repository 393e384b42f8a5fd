"""VTK animation of a trajectory, written without VTK, whose import takes longer than writing the files."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from evac.base.errors import ResultError
from evac.base.progress import track
from evac.building.model.building import Building, Exit, Portal
from evac.building.model.elevation import on_level, triangles_on
from evac.export.exporter import file_stems
from evac.folder import files
from evac.trajectory.trajectory import Frame, Trajectory

_NO_CELLS = np.zeros((0, 1), dtype=np.int64)


@dataclass(frozen=True)
class PolyData:
    """Points, cells and their data arrays."""

    points: NDArray[np.float64]  # (n, 3) float64: coordinates [m]; float32 would be too coarse far from the origin
    # vertices, lines, polygons: (c, corners) int: rows of `points`; cells are numbered in this order
    vertices: NDArray[np.integer] = field(default_factory=lambda: _NO_CELLS)
    lines: NDArray[np.integer] = field(default_factory=lambda: _NO_CELLS)
    polygons: NDArray[np.integer] = field(default_factory=lambda: _NO_CELLS)
    # point_arrays, cell_arrays: mapping of str to (n,) or (n, components) array: arrays of int32 or float32, by name
    point_arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    cell_arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    texts: Mapping[str, Sequence[str]] = field(default_factory=dict)  # string arrays of the whole file, by name
    shown: str = ""  # name of the point array that viewers show by default, empty for none


def vtp_bytes(data: PolyData) -> bytes:
    """Return the content of a ``.vtp`` file."""
    raw = _Raw()
    texts = "".join(raw.text(name, words) for name, words in data.texts.items())
    point_arrays = "".join(raw.array(name, values) for name, values in data.point_arrays.items())
    cell_arrays = "".join(raw.array(name, values) for name, values in data.cell_arrays.items())
    points = raw.array("Points", data.points)
    kinds = {"Verts": data.vertices, "Lines": data.lines, "Polys": data.polygons}
    cells = "".join(f"<{kind}>{raw.cells(corners)}</{kind}>\n" for kind, corners in kinds.items())
    numbers = " ".join(f'NumberOf{kind}="{len(corners)}"' for kind, corners in kinds.items())
    shown = f' Scalars="{data.shown}"' if data.shown else ""
    head = f"""<?xml version="1.0"?>
<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">
<PolyData>
<FieldData>{texts}</FieldData>
<Piece NumberOfPoints="{len(data.points)}" {numbers} NumberOfStrips="0">
<PointData{shown}>{point_arrays}</PointData>
<CellData>{cell_arrays}</CellData>
<Points>{points}</Points>
{cells}</Piece>
</PolyData>
<AppendedData encoding="raw">
_"""
    return b"".join([head.encode(), *raw.blocks, b"\n</AppendedData>\n</VTKFile>\n"])


class _Raw:
    """The bytes after the XML, each block preceded by its length; methods return the XML elements for them."""

    def __init__(self) -> None:
        self.blocks: list[bytes] = []
        self._end = 0

    def array(self, name: str, values: NDArray[Any]) -> str:
        """Add an array (n,) or (n, components)."""
        kind = f"{'Float' if values.dtype.kind == 'f' else 'Int'}{8 * values.dtype.itemsize}"
        components = f' NumberOfComponents="{values.shape[1]}"' if values.ndim > 1 else ""
        place = self._add(values.astype(values.dtype.newbyteorder("<"), copy=False).tobytes())
        return f'<DataArray type="{kind}" Name="{name}"{components} {place}/>\n'

    def text(self, name: str, words: Sequence[str]) -> str:
        """Add an array of strings."""
        place = self._add(b"".join(word.encode() + b"\0" for word in words))
        return f'<Array type="String" Name="{name}" NumberOfTuples="{len(words)}" {place}/>\n'

    def cells(self, corners: NDArray[np.integer]) -> str:
        """Add cells (c, corners)."""
        count, size = corners.shape
        ends = size * np.arange(1, count + 1, dtype=np.int64)
        return self.array("connectivity", corners.ravel().astype(np.int64)) + self.array("offsets", ends)

    def _add(self, content: bytes) -> str:
        place = f'format="appended" offset="{self._end}"'
        self.blocks += [len(content).to_bytes(8, "little"), content]
        self._end += 8 + len(content)
        return place


#: Values of the building's cell array ``kind``.
CELL_KINDS = ("floor", "flight", "landing", "wall", "exit", "closed exit", "portal", "closed portal", "area", "car")


def export_vtk(trajectory: Trajectory, folder: Path) -> Path:
    """Write ``animation.pvd``, ``building.vtm`` with ``building/``, and ``frames/frame_00000.vtp``, ... to `folder`.

    If links open or close during the run, ``building_00001.vtm``, ... contain the building after that.

    Each frame has one point per person inside, at the height of the floor, with the point arrays person, group
    (index in the field array ``group_names``, -1 for none), level (index in ``level_names``), speed and velocity
    [m/s] (along the slope on stairs), contact_force [N], crowd_pressure [N/m], radius [m] and, if recorded, dose. In
    the .pvd, people are part 0 and the building part 1 of every time [s]. The building is a tree of blocks, see
    `building_blocks`. Of a building with lifts, their cars are part 2, see `cars_polydata`.
    """
    if not len(trajectory):
        raise ResultError(f"{trajectory.path}: no frame to export; the run ended before its first output")
    with files.writing("the VTK animation", folder):
        for name in (files.FRAMES_FOLDER, files.BUILDING_FOLDER):
            if (folder / name).is_symlink():
                raise NotADirectoryError(f"{folder / name} is a link")
            (folder / name).mkdir(parents=True, exist_ok=True)
        for name, content in _files(trajectory):
            with files.replacing(folder / name, "the VTK animation", is_synced=not name.endswith(".vtp")) as new:
                new.write_bytes(content)
    return folder / files.ANIMATION_NAME


def _files(trajectory: Trajectory) -> Iterator[tuple[str, bytes]]:
    """Yield the files of an animation, each with its content; the last one names the others."""
    buildings = [trajectory.building_at(time) for time in trajectory.time.tolist()]
    states = {building.condition: building for building in buildings}
    yield from _building_files([*states.values()])
    for k in track("writing the VTK animation", range(len(trajectory)), len(trajectory)):
        yield files.frame_name(k), vtp_bytes(people_polydata(trajectory, trajectory[k]))
        if trajectory.building.lifts:
            yield files.frame_name(k).replace("frame_", "cars_"), vtp_bytes(cars_polydata(trajectory, trajectory[k]))
    names = {condition: files.building_name(k) for k, condition in enumerate(states)}
    shown = [names[building.condition] for building in buildings]
    yield files.ANIMATION_NAME, _pvd(trajectory.time, shown, bool(trajectory.building.lifts)).encode()


def people_polydata(trajectory: Trajectory, frame: Frame) -> PolyData:
    """Return the people of one frame as points with data arrays."""
    person = frame["person"]
    return PolyData(
        points=np.column_stack([frame["position"], frame["z"]]),
        vertices=np.arange(len(person))[:, None],
        point_arrays={
            "person": person,
            "group": trajectory.group[person],
            "level": frame["level"],
            "speed": frame["speed"].astype(np.float32),
            "velocity": frame["velocity"].astype(np.float32),
            "contact_force": frame["contact_force"].astype(np.float32),
            "crowd_pressure": frame["crowd_pressure"].astype(np.float32),
            "radius": trajectory.radius[person].astype(np.float32),
            "height": trajectory.height[person].astype(np.float32),
            **({"dose": frame["dose"].astype(np.float32)} if trajectory.has_dose else {}),
        },
        texts={"group_names": trajectory.groups},
        shown="speed",
    )


def cars_polydata(trajectory: Trajectory, frame: Frame) -> PolyData:
    """Return the cars of lifts at a time: floor and sides, with cell arrays."""
    from evac.building.model.lifts import CAR_HEIGHT, car_body, cars_at

    building = trajectory.building
    corners, rows = [], []
    for k, car in enumerate(cars_at(building, trajectory.changes, frame["time"])):
        outline, ground = car_body(building, car)
        ahead, up = np.roll(outline, -1, axis=0), np.array([0.0, 0.0, CAR_HEIGHT])
        sides = np.stack([outline, ahead, ahead + up, outline, ahead + up, outline + up], axis=1)
        corners += [ground, sides.reshape(-1, 3, 3)]
        row = [k, car.level, int(car.is_open), int((frame["level"] == car.level).sum())]
        rows += (len(ground) + 2 * len(outline)) * [row]
    triangles = np.concatenate(corners)
    return PolyData(
        points=triangles.reshape(-1, 3),
        polygons=np.arange(3 * len(triangles)).reshape(-1, 3),
        cell_arrays=dict(zip(("lift", "level", "open", "people"), np.array(rows, np.int32).T, strict=True)),
        texts={"lift_names": [lift.name for lift in building.lifts]},
    )


def building_blocks(building: Building) -> Iterator[tuple[str, str, PolyData]]:
    """Yield the parts of a building: block, name and cells of each.

    The blocks are ``levels`` (triangles), ``walls`` (lines, by level), ``exits``, ``portals`` and ``areas``. Every
    part has the cell arrays ``level`` (index in the field array ``level_names``) and ``kind`` (in ``kind_names``).
    """
    for level in building.levels:
        yield "levels", level.name, _part(building, level.kind, level.index, building.vertices, level.triangles)
    for level in building.levels:
        walls = building.walls[building.wall_level == level.index]
        if len(walls):
            yield "walls", level.name, _line_part(building, "wall", level.index, walls)
    links: list[Exit | Portal] = [*building.exits, *building.portals]
    for link in links:
        kind = "exit" if isinstance(link, Exit) else "portal"
        state = kind if building.is_open(link) else f"closed {kind}"
        yield f"{kind}s", link.name, _line_part(building, state, link.levels[0], link.segments)
    for area in building.areas:
        corners = triangles_on(building, area.level, area.polygon)
        yield "areas", area.name, _part(building, "area", area.level, corners, np.arange(len(corners)).reshape(-1, 3))


def _line_part(building: Building, kind: str, level: int, segments: NDArray[np.float64]) -> PolyData:
    """Return plan segments (s, 4) on their level as lines."""
    ends = on_level(building, level, segments.reshape(-1, 2))
    return _part(building, kind, level, ends, np.arange(len(ends)).reshape(-1, 2))


def _part(
    building: Building, kind: str, level: int, points: NDArray[np.float64], cells: NDArray[np.integer]
) -> PolyData:
    """Return cells of one kind on one level, without unused points."""
    used, corners = np.unique(cells, return_inverse=True)
    corners = corners.reshape(cells.shape)
    count = len(cells)
    return PolyData(
        points=points[used],
        **{"lines" if cells.shape[1] == 2 else "polygons": corners},
        cell_arrays={
            "level": np.full(count, level, np.int32),
            "kind": np.full(count, CELL_KINDS.index(kind), np.int32),
        },
        texts={"level_names": [item.name for item in building.levels], "kind_names": CELL_KINDS},
    )


def _building_files(states: Sequence[Building]) -> Iterator[tuple[str, bytes]]:
    """Yield a file for each part of a building in all its states, and for each state a file that lists them."""
    for k, building in enumerate(states):
        parts = list(building_blocks(building))
        stems = file_stems(f"{k:05d} {block} {name}" if k else f"{block} {name}" for block, name, _ in parts)
        blocks: dict[str, list[str]] = {}
        for stem, (block, name, data) in zip(stems, parts, strict=True):
            file = f"{files.BUILDING_FOLDER}/{stem}.vtp"
            yield file, vtp_bytes(data)
            entries = blocks.setdefault(block, [])
            entries.append(f'      <DataSet index="{len(entries)}" name={quoteattr(name)} file={quoteattr(file)}/>\n')
        tree = "".join(
            f'    <Block index="{index}" name="{block}">\n{"".join(entries)}    </Block>\n'
            for index, (block, entries) in enumerate(blocks.items())
        )
        text = (
            '<?xml version="1.0"?>\n<VTKFile type="vtkMultiBlockDataSet" version="1.0" byte_order="LittleEndian">\n'
            f"  <vtkMultiBlockDataSet>\n{tree}  </vtkMultiBlockDataSet>\n</VTKFile>\n"
        )
        yield files.building_name(k), text.encode()


def _pvd(times: NDArray[np.float64], buildings: Sequence[str], has_cars: bool) -> str:
    entry = '    <DataSet timestep="{}" part="{}" name="{}" file="{}"/>'
    lines = []
    for k, (time, building) in enumerate(zip(times.tolist(), buildings, strict=True)):
        lines.append(entry.format(repr(time), 0, "people", files.frame_name(k)))
        lines.append(entry.format(repr(time), 1, "building", building))
        if has_cars:
            lines.append(entry.format(repr(time), 2, "cars", files.frame_name(k).replace("frame_", "cars_")))
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n'
    return head + "  <Collection>\n" + "\n".join(lines) + "\n  </Collection>\n</VTKFile>\n"
