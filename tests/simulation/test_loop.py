"""The list of what happens at ticks, to which others may add."""

import time

import pytest

import evac
from evac.results.ending import INTERRUPTED
from evac.simulation.loop import Operation
from evac.simulation.simulation import Simulation
from tests.runs import assert_same_bits, run_ticks


@pytest.fixture
def case():
    return evac.load("square_room", {"simulation.duration": 1.0, "output.every": 0.2})


def test_operations_begin_once_and_act_when_they_are_due(case):
    simulation, seen = Simulation(case), []
    begun = []
    odd = Operation(
        "odd",
        "output",
        lambda: seen.append((simulation.step, simulation.scene.time, len(simulation.scene.changes))),
        lambda: simulation.step // case.simulation.steps_per_tick % 2 == 1,
        lambda: begun.append(simulation.recording.is_started),
    )
    simulation.loop.operations.append(odd)
    simulation.advance_tick()
    simulation.scene.set_open("door", False)
    simulation.run()
    k, tick = case.simulation.steps_per_tick, case.simulation.tick
    assert begun == [True]
    assert [step for step, _, _ in seen] == [k, 3 * k, 5 * k, 7 * k, 9 * k]
    assert [time for _, time, _ in seen] == pytest.approx([tick * step / k for step, _, _ in seen])
    assert [changes for _, _, changes in seen] == [0, 1, 1, 1, 1]


def test_an_operation_before_the_physics_sees_the_state_before_it(case):
    simulation, plain = Simulation(case), run_ticks(Simulation(case), 5)
    places = [simulation.population.crowd.position.copy()]
    at = [operation.name for operation in simulation.loop.operations].index("physics")
    before = Operation("before", "physics", lambda: places.append(simulation.population.crowd.position.copy()))
    simulation.loop.operations.insert(at, before)
    run_ticks(simulation, 5)
    assert_same_bits(simulation, plain)
    assert (places[0] == places[1]).all()
    assert (places[1] != places[2]).any()


def test_a_run_can_be_stopped_by_an_operation(case):
    simulation = Simulation(case)
    simulation.loop.operations.append(Operation("stop", "output", simulation.stop, lambda: simulation.time > 0.45))
    results = simulation.run()
    assert (results.ended, results.time) == (INTERRUPTED, pytest.approx(0.5))


def test_a_step_is_made_by_one_thread():
    """The CPU time of the process is that of its main thread."""
    simulation = Simulation(evac.load("square_room"))
    simulation.advance_tick()
    process, thread = time.process_time(), time.thread_time()
    while not simulation.ended:
        simulation.advance_tick()
    assert time.process_time() - process < 1.1 * (time.thread_time() - thread)
