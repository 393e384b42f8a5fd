"""Another engine can stand beside the compiled one: people who walk freely, in NumPy and Python."""

import numpy as np
import pytest

from evac.case.loading import load_case
from evac.physics import stepping
from evac.physics.engine import CompiledEngine, Engine
from evac.physics.motion import EXIT, desired_direction, desired_speed
from evac.physics.seams import way_out
from evac.physics.state import Events, allocate
from evac.results.ending import EVERYBODY_OUT
from evac.simulation import assembly
from evac.simulation.assembly import make_behaviours, make_building, make_contact_model, make_forces
from evac.simulation.needed import run_kernels
from evac.simulation.simulation import Simulation

#: So far apart that nobody meets anybody on the way to the door.
PLACES = [[4.0, 2.5], [2.0, 2.5], [0.5, 2.6]]


class FreeWalk(Engine):
    """Makes steps of the drive alone, of one body after the other, on one level without obstacles."""

    saved = ("steps",)

    def __init__(self, world, people, *_):
        self.world, self.steps = world, 0
        self.events = allocate(Events, people)

    def load(self, model):
        pass

    def advance(self, model, crowd, first, steps, length, explicit, report):
        self.events.number = 0
        self.steps += steps
        for now in range(first, first + steps):
            for i in np.flatnonzero(crowd.level >= 0):
                self._walk(crowd, i, now * length, length)
        return self.events

    def _walk(self, crowd, i, time, h):
        direction = np.array(desired_direction(self.world, crowd, i))
        speed = desired_speed(self.world, crowd, i, *direction) if time >= crowd.start_time[i] else 0.0
        crowd.velocity[i] += -np.expm1(-h / crowd.tau[i]) * (speed * direction - crowd.velocity[i])
        before, way = crowd.position[i].copy(), h * crowd.velocity[i]
        crowd.position[i] += way
        share = way_out(self.world, crowd.level[i], *before, *crowd.position[i], 0.0)
        crowd.distance[i] += np.hypot(*way) * (share if share >= 0.0 else 1.0)
        if share >= 0.0:
            k, events = self.events.number, self.events
            events.row[k], events.kind[k], events.link[k], events.time[k] = i, EXIT, 0, time + share * h
            events.number += 1
            crowd.level[i] = -1

    def own_arrays(self):
        return []

    def explain(self, model):
        return [("contacts", False, "nobody meets")]

    def explain_forces(self):
        return {}

    def contact_report(self, model):
        energy = {"driving_work": 0.0, "contact_dissipation": 0.0, "contact_creation": 0.0}
        none = dict.fromkeys(("unconverged_steps", "failed_solves", "failed_position_corrections"), 0)
        own = {"steps": self.steps, "greatest_overlap": 0.0, "energy": energy}
        return {"model": model.name, "parameters": model.values(), **own, **none}

    def close(self):
        pass


def walkers():
    people = {"name": "people", "positions": PLACES, "level": "room", "radius": 0.2, "speed": 1.3}
    changes = {"people": [people], "contact.model": "dem", "behaviours.response_time.time": {"uniform": [0.0, 0.5]}}
    return load_case("square_room", changes)


@pytest.fixture
def free_walk(monkeypatch):
    monkeypatch.setattr(assembly, "ENGINE", FreeWalk)


def test_an_engine_in_numpy_makes_the_same_run(free_walk, monkeypatch):
    simulation = Simulation(walkers())
    found = simulation.run()
    monkeypatch.undo()
    wanted = Simulation(walkers()).run()
    assert found.ended == wanted.ended == EVERYBODY_OUT
    assert [row[1] for row in found.plan if row[0] == "contacts"] == ["out"]
    assert wanted.report["contacts"] == 0
    assert found.report["steps"] == wanted.report["steps"] > 100
    for name in ("exit_time", "position", "velocity", "distance"):
        np.testing.assert_allclose(getattr(found.crowd, name), getattr(wanted.crowd, name), rtol=1e-12, err_msg=name)
    np.testing.assert_array_equal(found.crowd.exit_used, wanted.crowd.exit_used)


def test_kernels_of_the_step_loop_are_compiled_for_their_engine_alone():
    case = walkers()
    scene = make_building(case), make_contact_model(case), make_forces(case), make_behaviours(case), False
    assert stepping.advance in run_kernels(case, CompiledEngine, *scene)
    assert stepping.advance not in run_kernels(case, FreeWalk, *scene)


def test_a_run_with_another_engine_is_resumed(free_walk):
    whole = Simulation(walkers())
    for _ in range(10):
        whole.advance_tick()
    state = {key: value.copy() for key, value in whole.state().items()}
    resumed = Simulation(walkers())
    resumed.restore(state)
    wanted, found = whole.run(), resumed.run()
    assert found.report["steps"] == wanted.report["steps"]
    np.testing.assert_array_equal(found.crowd.exit_time, wanted.crowd.exit_time)
