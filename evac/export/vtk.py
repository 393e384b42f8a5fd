"""VTK animation of a trajectory."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray
from pyvista import PolyData

from evac.base.errors import ResultError
from evac.base.phases import told
from evac.building.model.building import Building
from evac.building.model.elevation import on_level, triangles_on
from evac.export.exporter import file_stems
from evac.folder.files import (
    ANIMATION_NAME,
    BUILDING_FOLDER,
    FRAMES_FOLDER,
    building_name,
    frame_name,
    replacing,
    writing,
)
from evac.trajectory.trajectory import Frame, Trajectory

#: Values of the building's cell array ``kind``.
KINDS = ("floor", "flight", "landing", "wall", "exit", "closed exit", "portal", "closed portal", "area", "car")


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
    with writing("the VTK animation", folder):
        for name in (FRAMES_FOLDER, BUILDING_FOLDER):
            if (folder / name).is_symlink():
                raise NotADirectoryError(f"{folder / name} is a link")
            (folder / name).mkdir(parents=True, exist_ok=True)
        for name, content in _files(trajectory):
            with replacing(folder / name, "the VTK animation", is_synced=not name.endswith(".vtp")) as new:
                if isinstance(content, str):
                    new.write_text(content, encoding="utf-8")
                else:
                    content.save(new)
    return folder / ANIMATION_NAME


def _files(trajectory: Trajectory) -> Iterator[tuple[str, PolyData | str]]:
    """Yield the files of an animation, each with its content; the last one names the others."""
    buildings = [trajectory.building_at(time) for time in trajectory.time.tolist()]
    states = {building.condition: building for building in buildings}
    yield from _building_files([*states.values()])
    for k in told("writing the VTK animation", range(len(trajectory)), len(trajectory)):
        yield frame_name(k), people_polydata(trajectory, trajectory[k])
        if trajectory.building.lifts:
            yield frame_name(k).replace("frame_", "cars_"), cars_polydata(trajectory, trajectory[k])
    names = {condition: building_name(k) for k, condition in enumerate(states)}
    shown = [names[building.condition] for building in buildings]
    yield ANIMATION_NAME, _pvd(trajectory.time, shown, bool(trajectory.building.lifts))


def people_polydata(trajectory: Trajectory, frame: Frame) -> PolyData:
    """Return the people of one frame as points with data arrays."""
    person = frame["person"]
    people = PolyData(np.column_stack([frame["position"], frame["z"]]))
    people.field_data["group_names"] = [*trajectory.groups]
    arrays = {
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
    }
    people.point_data.update({name: values for name, values in arrays.items() if values.ndim == 1 or len(values)})
    people.set_active_scalars("speed")
    return people


def cars_polydata(trajectory: Trajectory, frame: Frame) -> PolyData:
    """Return the cars of lifts at a time: floor and sides, with cell arrays.

    These are lift (index in the field array ``lift_names``), level, whether the doors are open, and the number of
    people.
    """
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
    cars = _of_cells(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
    cars.cell_data.update(dict(zip(("lift", "level", "open", "people"), np.array(rows, np.int32).T, strict=True)))
    cars.field_data["lift_names"] = [lift.name for lift in building.lifts]
    return cars


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
    for exit_ in building.exits:
        kind = "exit" if building.is_open(exit_) else "closed exit"
        yield "exits", exit_.name, _line_part(building, kind, exit_.level, exit_.segments)
    for portal in building.portals:
        kind = "portal" if building.is_open(portal) else "closed portal"
        yield "portals", portal.name, _line_part(building, kind, portal.levels[0], portal.segments)
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
    part, count = _of_cells(points[used], corners.reshape(cells.shape)), len(cells)
    part.cell_data["level"], part.cell_data["kind"] = (
        np.full(count, of, np.int32) for of in (level, KINDS.index(kind))
    )
    part.field_data["level_names"] = [item.name for item in building.levels]
    part.field_data["kind_names"] = [*KINDS]
    return part


def _of_cells(points: NDArray[np.float64], corners: NDArray[np.integer]) -> PolyData:
    """Return lines (c, 2) or triangles (c, 3) between points (n, 3) [m]."""
    cells = np.insert(corners, 0, corners.shape[1], axis=1).ravel()
    return PolyData(points, **{"lines" if corners.shape[1] == 2 else "faces": cells})


def _building_files(states: Sequence[Building]) -> Iterator[tuple[str, PolyData | str]]:
    """Yield a file for each part of a building in all its states, and for each state a file that lists them."""
    for k, building in enumerate(states):
        parts = list(building_blocks(building))
        stems = file_stems(f"{k:05d} {block} {name}" if k else f"{block} {name}" for block, name, _ in parts)
        blocks: dict[str, list[str]] = {}
        for stem, (block, name, data) in zip(stems, parts, strict=True):
            file = f"{BUILDING_FOLDER}/{stem}.vtp"
            yield file, data
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
        yield building_name(k), text


def _pvd(times: NDArray[np.float64], buildings: Sequence[str], has_cars: bool) -> str:
    entry = '    <DataSet timestep="{}" part="{}" name="{}" file="{}"/>'
    lines = []
    for k, (time, building) in enumerate(zip(times.tolist(), buildings, strict=True)):
        lines.append(entry.format(repr(time), 0, "people", frame_name(k)))
        lines.append(entry.format(repr(time), 1, "building", building))
        if has_cars:
            lines.append(entry.format(repr(time), 2, "cars", frame_name(k).replace("frame_", "cars_")))
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n'
    return head + "  <Collection>\n" + "\n".join(lines) + "\n  </Collection>\n</VTKFile>\n"
