"""Threads that share the step loop: no bit tells how many there are, and all end with the run."""

import gc
import os
import threading
from unittest.mock import Mock

import numpy as np
import pytest

from evac.base.errors import ScenarioError, SimulationError
from evac.jit.kernels import INTERPRETED
from evac.physics import driver
from evac.physics.allocation import allocate, make_lists, make_room_for_contacts
from evac.physics.engine import CompiledEngine
from evac.physics.order import rows_by_place
from evac.physics.phases import make_alone
from evac.physics.state import CHUNK, Events, copy_of, make_crowd
from evac.physics.threads import threads
from evac.physics.threads.team import conduct
from evac.physics.threads.threads import MOST_BY_DEFAULT, PEOPLE_PER_THREAD, number_of_threads, unused_threads
from evac.physics.world import make_world
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1
from evac_plugins.contact_nsm2 import Nsm2
from evac_plugins.force_social import SocialForce
from tests.physics.scenes import fields_towards, make_building, make_engine, random_crowd

pytestmark = pytest.mark.skipif(INTERPRETED, reason="kernels that are not compiled have one thread")

#: Two rooms with a portal between them, and a door.
ROOMS = make_building(
    bounds=((0.0, 0.0, 6.0, 10.0), (6.0, 0.0, 11.0, 10.0)),
    walls=[
        (6, 10, 0, 10),
        (0, 10, 0, 0),
        (0, 0, 6, 0),
        (6, 0, 11, 0),
        (11, 0, 11, 4.4),
        (11, 5.6, 11, 10),
        (11, 10, 6, 10),
    ],
    wall_level=[0, 0, 0, 1, 1, 1, 1],
    portals=[(0, 1, (6, 0, 6, 10))],
    exits=[(1, (11, 4.4, 11, 5.6))],
)

#: Enough for each of three threads to have bodies of its own.
PEOPLE = 5 * CHUNK - 7

MODELS = {
    "dem": Dem(),
    "nsm1": Nsm1(),
    "nsm1 overdamped": Nsm1(variant="overdamped"),
    "nsm2": Nsm2(normal_dissipation=1e5, position_correction=True),
}


def crowd_in_rooms():
    crowd = random_crowd(PEOPLE, (0.0, 0.0), (11.0, 10.0), seed=3)
    crowd.level[:] = crowd.position[:, 0] > 6.0
    return crowd


CROWD = crowd_in_rooms()


def walked(model, number, steps=60, prepare=None, forces=(), speed=1.0):
    """Return crowd, crossings and report of a walk with so many threads."""
    crowd = copy_of(CROWD)
    crowd.speed *= speed
    engine = make_engine(crowd, ROOMS, fields_towards((13.0, 5.0), 2), forces, threads=number)
    if prepare is not None:
        prepare(engine)
    crossings = []
    try:
        for first in range(0, steps, 10):
            events = engine.advance(model, crowd, first, 10, 0.01, False, True)
            columns = (events.row, events.kind, events.link, events.time)
            crossings += [tuple(column[k] for column in columns) for k in range(events.number)]
    finally:
        engine.close()
    return crowd, crossings, engine.contact_report(model)


def assert_same(found, wanted):
    for name in wanted[0].kinds:
        np.testing.assert_array_equal(getattr(found[0], name), getattr(wanted[0], name), err_msg=name)
    assert found[1:] == wanted[1:]


@pytest.mark.parametrize("name", MODELS)
def test_the_number_of_threads_changes_no_bit(name):
    wanted = walked(MODELS[name], 1)
    assert len(wanted[1]) > 10
    assert wanted[2]["contacts"] > 100
    for number in (2, 3):
        assert_same(walked(MODELS[name], number), wanted)


@pytest.mark.parametrize("name", ["nsm1", "nsm2"])
def test_a_large_problem_is_solved_to_the_same_bits(name):
    """Also where threads come late, since there are more of them than cores."""
    places = np.stack(np.meshgrid(np.arange(0.2, 10.9, 0.2), np.arange(0.2, 9.9, 0.2)), axis=2).reshape(-1, 2)
    crowd = make_crowd(places, radius=0.103, level=(places[:, 0] > 6.0).astype(np.int32))
    found = []
    for number in (1, 5):
        walked_crowd = copy_of(crowd)
        engine = make_engine(walked_crowd, ROOMS, fields_towards((13.0, 5.0), 2), threads=number)
        engine.advance(MODELS[name], walked_crowd, 0, 3, 0.01, False, True)
        engine.close()
        found.append((walked_crowd, [], engine.contact_report(MODELS[name])))
    for other in found[1:]:
        assert_same(other, found[0])


def test_forces_at_a_distance_are_the_same_with_threads():
    wanted = walked(Dem(), 1, forces=[SocialForce()])
    assert_same(walked(Dem(), 3, forces=[SocialForce()]), wanted)


def leave_no_room(engine):
    engine.state.lists, engine.state.events = make_lists(PEOPLE, 1, 1, 2), allocate(Events, 1)
    make_room_for_contacts(engine.state, 1)


@pytest.mark.parametrize("name", MODELS)
def test_room_runs_out_in_the_same_steps(name):
    wanted = walked(MODELS[name], 1, 20, leave_no_room)
    for number in (2, 3):
        assert_same(walked(MODELS[name], number, 20, leave_no_room), wanted)


def test_walls_that_would_be_crossed_cut_the_same_steps():
    """Until even cut steps cannot be made: the same person, place and counts are told."""
    told = []
    for number in (1, 3):
        engines = []
        with pytest.raises(SimulationError) as caught:
            walked(Dem(stiffness=300.0), number, prepare=engines.append, speed=3.0)
        told.append((str(caught.value), engines[0].report()))
    assert told[0][1]["wall_crossings_prevented"] > 1
    assert told[1] == told[0]


@pytest.mark.parametrize("number", [1, 3])
def test_a_step_that_cannot_be_made_names_the_first_body_and_ends_the_threads(number):
    """Of two bodies without a velocity, which different threads have, the first one in order is named."""
    before = threading.active_count()
    crowd = copy_of(CROWD)
    crowd.velocity[[0, PEOPLE - 1]] = np.nan
    engine = make_engine(crowd, ROOMS, fields_towards((13.0, 5.0), 2), threads=number)
    first = min((0, PEOPLE - 1), key=rows_by_place(crowd).tolist().index)
    with pytest.raises(SimulationError, match=rf"person {first} .*NaN"):
        engine.advance(Dem(), crowd, 0, 10, 0.01, False, False)
    engine.close()
    assert threading.active_count() == before


def test_an_interrupt_lets_threads_leave_and_the_run_can_go_on(monkeypatch):
    before = threading.active_count()
    model, crowd = Dem(), copy_of(CROWD)
    engine = make_engine(crowd, ROOMS, fields_towards((13.0, 5.0), 2), threads=3)
    engine.advance(model, crowd, 0, 10, 0.01, False, True)
    assert threading.active_count() == before + 2
    with monkeypatch.context() as patched:
        patched.setattr(driver, "advance", Mock(side_effect=KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            engine.advance(model, crowd, 10, 10, 0.01, False, True)
    for first in range(10, 60, 10):
        engine.advance(model, crowd, first, 10, 0.01, False, True)
    engine.close()
    assert threading.active_count() == before
    wanted, _, _ = walked(Dem(), 1)
    np.testing.assert_array_equal(crowd.position, wanted.position)


def test_an_interrupt_while_threads_leave_does_not_keep_them(monkeypatch):
    """As Ctrl-C that comes while the step loop waits for the threads to leave."""
    before = threading.active_count()
    crowd = copy_of(CROWD)
    engine = make_engine(crowd, ROOMS, fields_towards((13.0, 5.0), 2), threads=2)
    engine.advance(Dem(), crowd, 0, 10, 0.01, False, True)

    with monkeypatch.context() as patched:
        patched.setattr(threads, "conduct", Mock(side_effect=KeyboardInterrupt, address=threads.conduct.address))
        with pytest.raises(KeyboardInterrupt):
            engine.advance(Dem(), crowd, 10, 10, 0.01, False, True)
    engine.close()
    assert threading.active_count() == before


def test_threads_of_which_an_interrupt_stopped_the_start_end_with_their_engine(monkeypatch):
    before = threading.active_count()
    crowd = copy_of(CROWD)
    engine = make_engine(crowd, ROOMS, fields_towards((13.0, 5.0), 2), threads=3)
    start = threading.Thread.start

    def start_first(thread):
        if thread.name == "evac 2":
            raise KeyboardInterrupt
        start(thread)

    with monkeypatch.context() as patched:
        patched.setattr(threading.Thread, "start", start_first)
        with pytest.raises(KeyboardInterrupt):
            engine.advance(Dem(), crowd, 0, 10, 0.01, False, True)
    waiting = [one for one in threading.enumerate() if one.name == "evac 1"]
    assert len(waiting) == 1
    del engine
    gc.collect()
    waiting[0].join(10.0)
    assert threading.active_count() == before


def test_threads_end_with_their_engine():
    before = threading.active_count()
    crowd = copy_of(CROWD)
    engine = make_engine(crowd, ROOMS, fields_towards((13.0, 5.0), 2), threads=2)
    engine.advance(Dem(), crowd, 0, 10, 0.01, False, True)
    serving = [one for one in threading.enumerate() if one.daemon and one.name.startswith("evac")]
    del engine
    for thread in serving:
        thread.join(10.0)
    assert threading.active_count() == before


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork")
def test_a_fork_begins_threads_of_its_own():
    wanted, _, _ = walked(Dem(), 1, 20)
    crowd = copy_of(CROWD)
    engine = make_engine(crowd, ROOMS, fields_towards((13.0, 5.0), 2), threads=2)
    engine.advance(Dem(), crowd, 0, 10, 0.01, False, True)
    child = os.fork()
    if child == 0:
        engine.advance(Dem(), crowd, 10, 10, 0.01, False, True)
        os._exit(int(not np.array_equal(crowd.position, wanted.position)))
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    engine.close()


@pytest.mark.parametrize(
    ("wanted", "people", "number"),
    [
        (None, 2 * PEOPLE_PER_THREAD - 1, 1),
        (None, 2 * PEOPLE_PER_THREAD, 2),
        (None, 100 * PEOPLE_PER_THREAD, MOST_BY_DEFAULT),
        (1, 100 * PEOPLE_PER_THREAD, 1),
        (3, 1, 1),
        (3, 3 * PEOPLE_PER_THREAD - 1, 2),
        (9, 100 * PEOPLE_PER_THREAD, 4),
    ],
)
def test_the_size_decides_up_to_the_number_that_is_given(monkeypatch, wanted, people, number):
    monkeypatch.setattr(threads, "cores", lambda: 4)
    assert number_of_threads(wanted, people) == number
    told = unused_threads(wanted, people)
    assert len(told) == (wanted is not None and number < wanted)
    assert all(f"{wanted} given" in line and f"use {number}" in line for line in told)


@pytest.mark.parametrize(("share", "ticks"), [(0, 2), (PEOPLE // 2, 1), (PEOPLE, 0)])
def test_threads_serve_while_enough_people_are_inside(share, ticks, monkeypatch):
    """For each of two threads; two people leave after the first of two ticks."""
    crowd = copy_of(CROWD)
    world = make_world(ROOMS, fields_towards((13.0, 5.0), 2))
    engine = CompiledEngine(world, PEOPLE, [], threads=2, people_per_thread=share)
    model, advance, phases = Dem(), driver.advance, []
    engine.load(model)
    monkeypatch.setattr(driver, "advance", lambda state: phases.append(state.parts.phase) or advance(state))
    for first in (0, 10):
        engine.advance(model, crowd, first, 10, 0.01, False, False)
        crowd.level[:2] = -1
    assert phases.count(conduct.address) == ticks
    assert engine.state.parts.phase == make_alone.address
    engine.close()


def test_no_thread_is_refused():
    with pytest.raises(ScenarioError, match="threads"):
        number_of_threads(0, 10)
