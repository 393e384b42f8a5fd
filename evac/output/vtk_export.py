"""VTK animation of a trajectory: one .vtp file per frame, the building as one more, a .pvd that lists them."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evac.building.elevation import elevation
from evac.building.model import Building
from evac.errors import ResultError
from evac.output.files import ANIMATION_NAME, BUILDING_NAME, FRAMES, FRAMES_FOLDER, frame_name, writing
from evac.output.polydata import PolyData, write_polydata
from evac.output.trajectory import Frame, Trajectory

#: Values of the building's cell array ``kind``.
KINDS = ("floor", "flight", "landing", "wall", "exit", "closed exit", "closed portal")


def export_vtk(trajectory: Trajectory, folder: Path) -> Path:
    """Write ``animation.pvd``, ``building.vtp`` and ``frames/frame_00000.vtp``, ... to `folder`.

    Each frame holds one point per person inside, at true height, with the point arrays person, group
    (row of the field array ``group_names``, -1 for none), level (row of ``level_names``), speed and velocity
    [m/s] (along the slope on stairs), contact_force [N], crowd_pressure [N/m] and radius [m]. In the .pvd, people
    are part 0 and the building part 1 of every time [s].

    Returns
    -------
    path : Path
        The .pvd file.

    Raises
    ------
    ResultError
        The trajectory has no frame, or a file cannot be written.
    """
    if not len(trajectory):
        raise ResultError(f"{trajectory.path}: no frame to export; the run ended before its first output")
    with writing("the VTK animation", folder):
        (folder / FRAMES_FOLDER).mkdir(parents=True, exist_ok=True)
        for stale in folder.glob(FRAMES):
            stale.unlink()
        write_polydata(building_polydata(trajectory.building), folder / BUILDING_NAME)
        for k in range(len(trajectory)):
            write_polydata(people_polydata(trajectory, trajectory.frame(k)), folder / frame_name(k))
        path = folder / ANIMATION_NAME
        path.write_text(_pvd(trajectory.time), encoding="utf-8")
    return path


def people_polydata(trajectory: Trajectory, frame: Frame) -> PolyData:
    """Return the people of one frame as points with arrays; heights are true."""
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
        },
        texts={"group_names": trajectory.groups},
        shown="speed",
    )


def building_polydata(building: Building) -> PolyData:
    """Return floors, flights and landings as triangles; walls, exits and closed portals as lines on their level.

    Cell arrays: ``level`` and ``kind`` (row of `KINDS`); field arrays ``level_names`` and ``kind_names``. A closed
    portal stands on both of its levels.
    """
    lines = [("wall", building.walls, building.wall_level)]
    for exit_ in building.exits:
        kind = "exit" if building.is_open(exit_) else "closed exit"
        lines.append((kind, exit_.segments, np.full(len(exit_.segments), exit_.level)))
    for portal in building.portals:
        if not building.is_open(portal):
            for index in portal.levels:
                lines.append(("closed portal", portal.segments, np.full(len(portal.segments), index)))
    ends = np.concatenate([segments_in_space(building, segments, level) for _, segments, level in lines]).reshape(-1, 3)
    level = [on for _, _, on in lines] + [np.full(len(item.triangles), item.index) for item in building.levels]
    kind_of = [np.full(len(segments), KINDS.index(kind)) for kind, segments, _ in lines]
    kind_of += [np.full(len(item.triangles), KINDS.index(item.kind)) for item in building.levels]
    return PolyData(
        points=np.concatenate([building.vertices, ends]),
        lines=len(building.vertices) + np.arange(len(ends)).reshape(-1, 2),
        polygons=np.concatenate([item.triangles for item in building.levels]),
        cell_arrays={
            "level": np.concatenate(level).astype(np.int32),
            "kind": np.concatenate(kind_of).astype(np.int32),
        },
        texts={"level_names": [item.name for item in building.levels], "kind_names": KINDS},
    )


def segments_in_space(
    building: Building, segments: NDArray[np.float64], level: NDArray[np.integer]
) -> NDArray[np.float64]:
    """Return the two ends of plan `segments` (s, 4) on their `level` (s,) as points (s, 2, 3) [m]."""
    ends = segments.reshape(-1, 2)
    z = elevation(building, np.repeat(level, 2).astype(np.int32), ends)
    return np.column_stack([ends, z]).reshape(-1, 2, 3)


def _pvd(times: NDArray[np.float64]) -> str:
    entry = '    <DataSet timestep="{}" part="{}" name="{}" file="{}"/>'
    lines = []
    for k, time in enumerate(times.tolist()):
        lines.append(entry.format(repr(time), 0, "people", frame_name(k)))
        lines.append(entry.format(repr(time), 1, "building", BUILDING_NAME))
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n'
    return head + "  <Collection>\n" + "\n".join(lines) + "\n  </Collection>\n</VTKFile>\n"
