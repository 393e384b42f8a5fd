"""Simulations of small buildings written as OBJ meshes, and what their people did."""

import numpy as np

from evac.evidence.validation.buildings import write_case
from evac.evidence.validation.kinematics import ONE
from evac.simulation.simulation import Simulation


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
    others = [row for row in range(len(state["population.level"])) if row != person]
    state["population.level"][others] = -1
    state["population.exit_time"][others] = 0.0
    state["population.exit_used"][others] = 0
    used = simulation.engine.snapshot()  # arrays do not shrink
    for name in ("span", "room"):
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
