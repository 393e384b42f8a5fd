"""Small buildings written as OBJ meshes, and cases that run people through them."""

from evac.scenario.loading import case_from
from evac.simulation import Simulation

ONE = {"radius": 0.2, "mass": 80.0, "tau": 0.5}


def rectangle(x1, y1, x2, y2, z1=0.0, z2=None):
    """A quad that rises from z1 at x1 to z2 at x2."""
    z2 = z1 if z2 is None else z2
    return [(x1, y1, z1), (x2, y1, z2), (x2, y2, z2), (x1, y2, z1)]


def write_obj(path, faces):
    points = [point for face in faces for point in face]
    corners = iter(range(1, len(points) + 1))
    lines = ["v {!r} {!r} {!r}".format(*map(float, point)) for point in points]
    lines += ["f " + " ".join(str(next(corners)) for _ in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


def make_case(folder, faces, exits, people, model="nsm2", **sections):
    """Write the mesh into `folder` and return a checked case: exits as (name, segment, z), people as groups."""
    write_obj(folder / "mesh.obj", faces)
    table = {
        "building": {
            "mesh": "mesh.obj",
            "exits": [{"name": name, "segment": segment, "z": z} for name, segment, z in exits],
        },
        "people": [ONE | {"name": f"group {k}"} | group for k, group in enumerate(people)],
        "contact": {"model": model},
    }
    return case_from(table | sections, folder / "case.toml")


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
    others = [row for row in range(len(state["population.level"])) if row != person]
    state["population.level"][others] = -1
    state["population.exit_time"][others] = 0.0
    simulation.restore(state)
    crowd, remaining = simulation.population.crowd, []
    while not simulation.ended and crowd.level[person] >= 0:
        place = crowd.level[[person]], crowd.position[[person]], crowd.route[[person]]
        remaining.append(float(simulation.fields.travel_time_at(*place)[0]))
        simulation.advance_tick()
    return remaining


def straight_stair(run=8.0, rise=6.0, width=2.0, landing=2.0):
    """A stair along x from (0, 0) with floors before and behind it, as RiMEA 2 and 3."""
    return [
        rectangle(-landing, 0, 0, width, 0.0),
        rectangle(0, 0, run, width, 0.0, rise),
        rectangle(run, 0, run + landing, width, rise),
    ]


def simulate(*arguments, **sections):
    return Simulation(make_case(*arguments, **sections))
