"""Checks of behaviours: declared arrays, in a case and in artificial scenes, and distances to people who have left."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from evac.base.errors import plugin_code
from evac.case.case import Case
from evac.conformance.failures import CheckError, require, scene
from evac.people.behaviour import DECLARE, Behaviour, BehaviourScene, check_written
from evac.simulation.simulation import Simulation

#: Contact force on each person in an artificial crush [N].
CRUSH = 5000.0


def check_declared_arrays(case: Case, name: str, ticks: int = 20) -> None:
    """Check that a behaviour reads and writes only the arrays that it declares.

    The case runs for a number of ticks. Then artificial scenes are made: a closed exit, a crush, also at the end of the
    run, and the last person inside.
    """
    simulation, behaviour, view = _prepared(case, name)
    for _ in range(ticks):
        if not simulation.ended:
            with scene(f"t = {simulation.time:.1f} s of {case.title}"):
                with _declared_only(behaviour, simulation):
                    behaviour.act(view.crowd, simulation.time)
                outside = None if simulation.outside is None else simulation.outside.arrays
                routes = len(simulation.fields.routes)
                check_written(behaviour, view.level_fields, view.crowd, outside, routes, simulation.time)
                simulation.advance_tick()
    simulation, behaviour, view = _prepared(case, name)
    for title, time in _made_scenes(simulation):
        with scene(f"{title} in {case.title}"), _declared_only(behaviour, simulation):
            behaviour.act(view.crowd, time)


def check_distance(case: Case, name: str) -> None:
    """Check that a behaviour that keeps distances slows people down behind people who have left, inside and outside."""
    simulation, behaviour, view = _prepared(case, name)
    crowd, building = simulation.population.crowd, simulation.building
    way = next((way for way in building.exits if building.link_of(way) not in building.closed), None)
    with scene(f"three people at an exit of {case.title}"):
        if simulation.outside is None or way is None or len(crowd.level) < 3:
            raise CheckError("the case has no open exit, or fewer than three people", "give a case that has")
        outside = simulation.outside.arrays
        x1, y1, x2, y2 = max(way.segments, key=lambda piece: np.hypot(*(piece[2:] - piece[:2])))
        normal = np.array([y2 - y1, x1 - x2]) / np.hypot(x2 - x1, y2 - y1)
        places = np.array([(x1 + x2) / 2, (y1 + y2) / 2]) + np.multiply.outer((-0.4, 0.2, 0.8), normal)
        crowd.level[:], crowd.level[0], crowd.start_time[:] = -1, way.level, -1.0
        crowd.position[0], outside.position[:3], outside.direction[:3] = places[0], places, normal
        outside.depth[:3] = -0.4, 0.2, 0.8
        inside, behind = [], []
        for number in range(3):
            outside.level[1 : 1 + number] = way.level
            crowd.speed_factor[:], crowd.extra_direction[:], outside.speed_factor[:] = 1.0, 0.0, 1.0
            behaviour.act(view.crowd, 0.0)
            inside.append(crowd.speed_factor[0])
            behind.append(outside.speed_factor[1])
        remedy = "use scene.outside, and multiply its speed_factor; or do not set keeps_distance"
        wrong = "does not slow down a person {}, 0.6 m ahead"
        require(inside[1] < inside[0], wrong.format("inside behind a person who has left"), remedy)
        require(behind[2] < behind[1], wrong.format("who has left behind another one"), remedy)


def _prepared(case: Case, name: str) -> tuple[Simulation, Behaviour, BehaviourScene]:
    """Return a simulation, and a prepared behaviour with its scene."""
    with scene(case.title):
        simulation = Simulation(case, full=True)
        found = next((pair for pair in simulation.behaviours if pair[0].name == name), None)
        if found is None:
            raise CheckError(f"the case does not use behaviour {name!r}", "give a case that does")
        return simulation, *found


@contextmanager
def _declared_only(behaviour: Behaviour, simulation: Simulation) -> Iterator[None]:
    """Refuse that the block writes arrays that the behaviour does not declare, also with kernels."""
    crowd = simulation.population.crowd
    before = {key: array.copy() for key, array in crowd.values().items() if key not in behaviour.writes}
    with plugin_code("its method", behaviour, DECLARE):
        yield
    for key, array in before.items():
        is_same = np.array_equal(array, getattr(crowd, key), equal_nan=True)
        require(is_same, f"writes {key!r} without declaring it", "add it to `writes`")


def _made_scenes(simulation: Simulation) -> Iterator[tuple[str, float]]:
    """Change a simulation to artificial scenes, one after the other; yield the name and the time [s] of each."""
    crowd, end = simulation.population.crowd, simulation.case.simulation.duration
    inside = np.flatnonzero(crowd.level >= 0)
    if len(simulation.building.exits) > 1:
        simulation.scene.set_open(simulation.building.exits[0].name, False)
        yield "a closed exit", simulation.time
    crowd.velocity[:] = 0.0
    crowd.contact_force[:] = CRUSH
    crowd.position[inside] = crowd.position[inside[0]] + 1e-3 * np.arange(len(inside))[:, None]
    crowd.level[inside] = crowd.level[inside[0]]
    yield "a crush", simulation.time
    yield "a crush at the end of the run", end
    crowd.contact_force[:] = 0.0
    crowd.level[inside[1:]] = -1
    yield "the last person inside", end
