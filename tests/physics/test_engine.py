"""The engine: work arrays that are too short grow, and parts that a step needs are loaded, without a change of bits."""

import re
import signal
from types import SimpleNamespace

import numpy as np
import pytest

from evac.base.errors import PluginError, SimulationError
from evac.jit import Struct, kernel
from evac.physics.contact.model import ContactModel, NoParameters, SolvedContactModel
from evac.physics.state import Events, State, allocate, make_crowd, make_lists, make_room_for_contacts
from evac.physics.status import NEEDS_SEPARATION, NEEDS_STRONGER_SOLVER, SEPARATE
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1, Projection, project
from evac_plugins.contact_nsm2 import Nsm2
from evac_plugins.force_social import SocialForce
from tests.physics.scenes import SOLVERS, cut_wall, fields_towards, make_building, make_engine, random_crowd, walk

#: Places and velocities of people, each with what runs out of room last: contacts with walls, with each other, events.
SCENES = {
    "wall": [(-1.5, 0.2, 1.5, -0.5), (-0.5, 0.2, 1.5, -0.5)],
    "row": [(-1.9, 2.0, 1.9, 0.0), (-1.5, 2.0, 1.7, 0.0), (-1.1, 2.0, 1.5, 0.0)],
    "heap": [(-1.5, 0.2, 1.5, -0.5), (-1.1, 0.2, 1.5, -0.5), (-1.3, 0.55, 1.5, -0.5)],
    "exit": [(-0.01, 2.0, 1.5, 0.0), (-0.012, 4.0, 1.5, 0.0), (-0.04, 6.0, 1.5, 0.0), (-0.07, 8.0, 1.5, 0.0)],
}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize(
    ("model", "tick"), [(Dem(), 6), (Nsm1(), 1), (Nsm2(), 1)], ids=["dem", "nsm1", "nsm2"]
)  # within a tick a step that is made again starts its solve cold
def test_room_for_one_gives_the_bits_of_room_for_all(model, tick, scene):
    building = make_building(walls=cut_wall(-3, 0, 3, 0, 60), exits=[(0, (0, -10, 0, 10))])
    start = np.array(SCENES[scene])
    n = len(start)
    found = []
    for is_scarce in (False, True):
        crowd = make_crowd(start[:, :2], start[:, 2:], speed=1.5)
        engine = make_engine(crowd, building, forces=[SocialForce()])
        if is_scarce:
            engine.data.lists, engine.data.events = make_lists(n, 1, 1, 1), allocate(Events, 1)
            make_room_for_contacts(engine.data, 1)
        crossings = []
        for first in range(0, 6, tick):
            events = engine.advance(model, crowd, first, tick, 0.01, True, True)
            columns = (events.row, events.kind, events.link, events.time)
            crossings += [tuple(column[k] for column in columns) for k in range(events.number)]
        report = engine.report()
        if scene == "exit":
            del report["list_builds"]  # a crossing that is undone makes lists stale
        found.append((crowd, crossings, report))
    (wanted, *wanted_counts), (crowd, *counts) = found
    for name in crowd.kinds:
        np.testing.assert_array_equal(getattr(crowd, name), getattr(wanted, name), err_msg=name)
    assert counts == wanted_counts
    assert (len(wanted_counts[0]), wanted_counts[1]["contacts"] > 2) == ((4, False) if scene == "exit" else (0, True))


def test_too_many_walls_at_one_body_say_so():
    crowd = make_crowd([(0.0, 0.1)], radius=0.2)
    building = make_building(walls=cut_wall(-1, 0, 1, 0, 1000))
    with pytest.raises(SimulationError, match=r"t = 0\.000 s: .* 60 walls"):
        walk(Dem(), crowd, 1, building=building)


@kernel
def never_done(state: State, own: NoParameters, h: float) -> int:
    return SEPARATE


@kernel
def never_loaded(state: State, own: NoParameters, h: float) -> int:
    return NEEDS_SEPARATION


class NeverDone(SolvedContactModel):
    """Asks for overlaps to be separated, again and again."""

    name = "never_done"
    law = never_done
    separates = True


class NeverLoaded(SolvedContactModel):
    """Asks for a part that is loaded."""

    name = "never_loaded"
    law = never_loaded


class Unsolved(ContactModel):
    """Solves a contact problem without a solver."""

    name = "unsolved"
    law = project

    def own(self, people, world):
        return Projection(gap_tolerance=1e-4, velocity_tolerance=1e-4, iterations=10)


@pytest.mark.parametrize("model", [NeverDone(), NeverLoaded(), Unsolved()], ids=lambda model: model.name)
def test_a_law_that_cannot_go_on_is_named(model):
    with pytest.raises(PluginError, match=f"{model.name}.* law "):
        walk(model, make_crowd([(0.0, 0.0), (0.39, 0.0)], radius=0.2), 1)


def test_a_model_that_cannot_be_loaded_leaves_nothing_behind():
    models = Nsm1(variant="overdamped", solver="no such solver"), Dem()
    start = [(0.0, 0.0), (0.39, 0.0)]
    wanted, crowd = make_crowd(start, speed=1.5), make_crowd(start, speed=1.5)
    alone, engine = make_engine(wanted), make_engine(crowd)
    for one, people in ((alone, wanted), (engine, crowd)):
        walk(models[1], people, 1, engine=one)
    with pytest.raises(PluginError, match="no such solver"):
        engine.advance(models[0], crowd, 1, 5, 0.01, True, False)
    for one, people in ((alone, wanted), (engine, crowd)):
        one.advance(models[1], people, 1, 5, 0.01, True, False)
    np.testing.assert_array_equal(crowd.position, wanted.position)


class Free(ContactModel):
    """Lets people pass through each other; a signal comes soon after a call."""

    name = "free"
    remembers = False
    is_armed = False

    def step(self, contacts, h):
        if not self.is_armed:
            self.is_armed = True
            signal.setitimer(signal.ITIMER_REAL, 3e-4)
        return contacts.free.copy()


def interrupt(*_):
    raise KeyboardInterrupt


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="the system has no timers")
def test_an_interrupt_between_the_calls_of_a_model_in_numpy_is_not_lost():
    """It comes while the kernels run, which the next Python code notices first."""
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        for _ in range(5):
            crowd = random_crowd(3000, (-30.0, -30.0), (30.0, 30.0), seed=1)
            with pytest.raises(KeyboardInterrupt):
                walk(Free(), crowd, 200, tick=200)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


# Parts that are loaded when a step is found to need them: no bit tells when that was

ROOM = make_building(walls=[(0, 0, 5, 0), (5, 0, 5, 2.1), (5, 2.9, 5, 5), (5, 5, 0, 5), (0, 5, 0, 0)])
GAP = make_building(walls=[(-3, 0, 1, 0), (1, 0.36, -3, 0.36)])
STEPS = 100

#: A solver that does not converge within the iterations that it is given, but for the first steps.
WEAK = {"solver": "uzawa", "iterations": 60, "velocity_tolerance": 1e-3}


def jam(full, **settings):
    """Sixty people press towards a door."""
    crowd = random_crowd(60, (0, 0), (5, 5), seed=8, **settings)
    return crowd, make_engine(crowd, ROOM, fields_towards((6, 2.5)), full=full)


def squeeze(full):
    """Somebody of 0.4 m stands in a gap of 0.36 m: the overlaps that are to be separated cannot be."""
    crowd = make_crowd([(-1.0, 0.18)], speed=1.5, radius=0.2)
    return crowd, make_engine(crowd, GAP, full=full)


#: Scene, contact model, and what is found missing there.
MISSING = {
    "nsm1, unconverged": (jam, Nsm1(**WEAK), [NEEDS_STRONGER_SOLVER]),
    "nsm2, unconverged": (jam, Nsm2(**WEAK), [NEEDS_STRONGER_SOLVER]),
    "nsm1, overlaps": (jam, Nsm1(gap_tolerance=1e-5), [NEEDS_SEPARATION]),
    "nsm2, overlaps": (jam, Nsm2(position_correction=True), [NEEDS_SEPARATION]),
    "nsm1, both": (
        jam,
        Nsm1(gap_tolerance=1.2e-5, **WEAK),
        [NEEDS_SEPARATION, NEEDS_STRONGER_SOLVER],
    ),
    "nsm1, squeezed": (squeeze, Nsm1(), [NEEDS_SEPARATION, NEEDS_STRONGER_SOLVER]),
}


def note_parts(engine):
    """Return a list that gets each status that asks for a part, and the step that is waiting for it."""
    met, load = [], engine._load_part

    def noting(model, status):
        met.append((status, engine.data.clock.now))
        load(model, status)

    engine._load_part = noting
    return met


def advance(engine, model, crowd, first, last):
    for step in range(first, last, 10):
        engine.advance(model, crowd, step, 10, 0.01, False, True)


def assert_same(one, other):
    (crowd, engine), (twin, its_engine) = one, other
    for name in crowd.kinds:
        np.testing.assert_array_equal(getattr(crowd, name), getattr(twin, name), err_msg=name)
    assert engine.report() == its_engine.report()


@pytest.mark.parametrize("name", MISSING)
def test_a_part_loaded_within_a_tick_gives_the_bits_of_one_loaded_before(name):
    scene, model, missing = MISSING[name]
    lean, full = scene(False), scene(True)
    met = note_parts(lean[1])
    advance(lean[1], model, lean[0], 0, STEPS)
    assert [status for status, _ in met] == missing
    if scene is jam:
        assert met[0][1] % 10 > 0  # steps of the tick have been made before
    met = note_parts(full[1])
    full[1].load(model)
    advance(full[1], model, full[0], 0, STEPS)
    assert {step for _, step in met} == {0}  # before the first step
    assert_same(lean, full)


@pytest.mark.parametrize("name", MISSING)
@pytest.mark.parametrize("ticks", [0, 1, 2])
def test_a_run_resumed_beside_the_tick_that_loads_a_part_gives_the_same_bits(name, ticks):
    scene, model, missing = MISSING[name]
    whole = scene(False)
    met = note_parts(whole[1])
    advance(whole[1], model, whole[0], 0, STEPS)
    stop = 10 * (met[0][1] // 10 + ticks)

    begun = scene(False)
    advance(begun[1], model, begun[0], 0, stop)
    saved, crowd = begun[1].state(), begun[0]
    _, engine = scene(False)
    engine.restore(saved)
    again = note_parts(engine)
    advance(engine, model, crowd, stop, STEPS)
    assert_same(whole, (crowd, engine))
    assert [status for status, _ in again] == missing


def test_a_part_that_is_never_needed_is_never_loaded():
    crowd = make_crowd([(0, 0)], speed=1.5)
    engine = walk(Nsm1(), crowd, 100)
    assert (engine.data.parts.stronger.solve, engine.data.parts.separation) == (0, 0)
    assert engine.data.parts.solver.solve == SOLVERS["accelerated_sweeps"].solve.address
    assert [is_in for _, is_in, _ in engine.explain(Nsm1())] == [False, True, False, False]


@pytest.mark.parametrize("separates", [False, True])
def test_everything_forced_in_is_what_the_model_can_ask_for(separates):
    engine = make_engine(make_crowd([(0, 0)]), full=True)
    engine.load(Nsm2(position_correction=separates))
    assert engine.data.parts.stronger.solve != 0
    assert all(is_in for _, is_in, _ in engine.explain(Nsm2(position_correction=separates)))
    assert (engine.data.parts.separation != 0) == separates


class Constants(Struct):
    """What a law reads."""

    stiffness: float


@kernel
def law_of_constants(state: State, own: Constants, h: float) -> int:
    return 0


class Odd(ContactModel):
    """A model whose law does not read what it is given."""

    name = "odd"
    law = law_of_constants


def test_a_law_of_another_struct_than_that_of_the_model_is_refused():
    model = type("Odd", (Odd,), {"own": lambda self, people, world: NoParameters()})()
    with pytest.raises(PluginError, match=r"'odd': law: must be a kernel \(State, NoParameters, float64\)"):
        walk(model, make_crowd([(0, 0)]), 1)


def test_a_law_reads_the_attributes_of_its_model():
    assert type("Even", (Odd,), {"stiffness": 7.0})().own(1, None).stiffness == 7.0
    with pytest.raises(PluginError, match=r"'odd'.*Constants\.stiffness"):
        walk(Odd(), make_crowd([(0, 0)]), 1)


def test_an_unknown_solver_names_the_closest_one():
    with pytest.raises(PluginError, match=r"contact\.nsm1\.solver: .*'uzava'.*'uzawa'"):
        walk(Nsm1(solver="uzava"), make_crowd([(0, 0)]), 1)


class Foreign(ContactModel):
    """A model of a plugin."""

    name = "foreign"


def test_the_person_whose_velocity_a_law_has_lost_is_named():
    nan = np.nan
    free = np.array([[1.0, 0.0], [nan, 0.0], [1.0, 0.0], [1.0, 0.0]])
    solved = np.array([[1.0, 0.0], [nan, 0.0], [nan, 1.0], [nan, nan]])
    bodies = SimpleNamespace(inside=3, free=free, solved=solved, row=np.array([7, 5, 3, 1]))
    error = Foreign().culprit(SimpleNamespace(bodies=bodies))
    assert re.search(r"'foreign': its law sets the velocity \[nan +1\.\] of person 3 \(", str(error))
    bodies.inside = 2  # what was lost before the law is not its fault
    assert Foreign().culprit(SimpleNamespace(bodies=bodies)) is None
    bodies.inside = 3
    assert Nsm2().culprit(SimpleNamespace(bodies=bodies)) is None
