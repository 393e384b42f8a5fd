"""Simulations of small buildings written as OBJ meshes, and what their people did."""

import numpy as np

from evac.case.loading import load_case
from evac.simulation.simulation import Simulation
from evac.standard.alone import ONE

MESH_NAME = "building.obj"


def make_case(folder, faces, exits, people, model="nsm2", **sections):
    """Write the mesh into `folder` and return a checked case: exits as (name, segment, z), people as groups."""
    return write_case(folder, faces, exits, [ONE | group for group in people], (), {"contact.model": model} | sections)


def track(simulation):
    """Run tick by tick and yield (time, crowd), the start included."""
    yield simulation.time, simulation.population.crowd
    while not simulation.ended:
        simulation.advance_tick()
        yield simulation.time, simulation.population.crowd


def crossing_times(simulation, person=0):
    """Return (portal, time) of every portal that a person crossed, in order."""
    rows, links, times = simulation.population.crossings
    return [(int(link), float(time)) for row, link, time in zip(rows, links, times, strict=True) if row == person]


def alone(simulation, person, state):
    """Run one person of a simulation from its start in `state`, as if nobody else were there.

    Returns its remaining travel times [s], one for every tick until it is out or the run ends.
    """
    state = {key: array.copy() for key, array in state.items()}
    others = [row for row in range(len(state["population.crowd.level"])) if row != person]
    state["population.crowd.level"][others] = -1
    state["population.crowd.exit_time"][others] = 0.0
    state["population.crowd.exit_used"][others] = 0
    used = simulation.engine.state()  # arrays do not shrink
    for name in ("room", "data.lists.pair_reach", "data.lists.wall_reach"):
        state[f"engine.{name}"] = np.maximum(state[f"engine.{name}"], used[name])
    simulation.restore(state)
    crowd, remaining = simulation.population.crowd, []
    while not simulation.ended and crowd.level[person] >= 0:
        place = crowd.level[[person]], crowd.position[[person]], crowd.route[[person]]
        remaining.append(float(simulation.fields.travel_time_at(*place)[0]))
        simulation.advance_tick()
    return remaining


def simulate(*arguments, **sections):
    return Simulation(make_case(*arguments, **sections))


def rectangle(x1, y1, x2, y2, z1=0.0, z2=None):
    """Return a face over [x1, x2] x [y1, y2] that rises from z1 at x1 to z2 at x2 [m]; level if z2 is not given."""
    z2 = z1 if z2 is None else z2
    return [(x1, y1, z1), (x2, y1, z2), (x2, y2, z2), (x1, y2, z1)]


def write_obj(path, faces):
    """Write faces as an OBJ mesh; corners at the same place are left for evac to weld."""
    faces = list(faces)
    corners = iter(range(1, 1 + sum(len(face) for face in faces)))
    lines = ["v {!r} {!r} {!r}".format(*map(float, point)) for face in faces for point in face]
    lines += ["f " + " ".join(str(next(corners)) for _ in face) for face in faces]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def write_case(
    folder,
    faces,
    exits,
    people,
    areas=(),
    sections=None,
):
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


def across(x, y1, y2):
    """Return the segment of an exit at `x` from y1 to y2 [m]."""
    return [[x, y1], [x, y2]]


def straight_stair(run=8.0, rise=6.0, width=2.0, landing=2.0):
    """Return a stair along x from (0, 0) with floors before and behind it; RiMEA 2 and 3 as it stands [m]."""
    return [
        rectangle(-landing, 0, 0, width, 0.0),
        rectangle(0, 0, run, width, 0.0, rise),
        rectangle(run, 0, run + landing, width, rise),
    ]
