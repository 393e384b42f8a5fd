"""Parts of the step loop that are loaded when a step is found to need them: no bit tells when that was."""

import numpy as np
import pytest

from evac.base.errors import PluginError
from evac.jit import Struct, kernel
from evac.physics.contact.model import ContactModel
from evac.physics.state import State, make_crowd
from evac.physics.status import NEEDS_SEPARATION, NEEDS_STRONGER_SOLVER
from evac_plugins.contact_nsm1 import Nsm1
from evac_plugins.contact_nsm2 import Nsm2
from tests.physics.scenes import SOLVERS, fields_towards, make_building, make_engine, random_crowd, walk

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
SCENES = {
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
        met.append((status, engine.state.clock.now))
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


@pytest.mark.parametrize("name", SCENES)
def test_a_part_loaded_within_a_tick_gives_the_bits_of_one_loaded_before(name):
    scene, model, missing = SCENES[name]
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


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("ticks", [0, 1, 2])
def test_a_run_resumed_beside_the_tick_that_loads_a_part_gives_the_same_bits(name, ticks):
    scene, model, missing = SCENES[name]
    whole = scene(False)
    met = note_parts(whole[1])
    advance(whole[1], model, whole[0], 0, STEPS)
    stop = 10 * (met[0][1] // 10 + ticks)

    begun = scene(False)
    advance(begun[1], model, begun[0], 0, stop)
    saved, crowd = begun[1].snapshot(), begun[0]
    _, engine = scene(False)
    engine.restore(saved)
    again = note_parts(engine)
    advance(engine, model, crowd, stop, STEPS)
    assert_same(whole, (crowd, engine))
    assert [status for status, _ in again] == missing


def test_a_part_that_is_never_needed_is_never_loaded():
    crowd = make_crowd([(0, 0)], speed=1.5)
    engine = walk(Nsm1(), crowd, 100)
    assert (engine.state.parts.stronger.solve, engine.state.parts.separation) == (0, 0)
    assert engine.state.parts.solver.solve == SOLVERS["accelerated_sweeps"].solve.address


@pytest.mark.parametrize("separates", [False, True])
def test_everything_forced_in_is_what_the_model_can_ask_for(separates):
    engine = make_engine(make_crowd([(0, 0)]), full=True)
    engine.load(Nsm2(position_correction=separates))
    assert engine.state.parts.stronger.solve != 0
    assert (engine.state.parts.separation != 0) == separates


# What is refused before a kernel is called with other arguments than it takes


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


def test_a_law_reads_the_attributes_of_its_model():
    assert type("Even", (Odd,), {"stiffness": 7.0})().own(1, None).stiffness == 7.0
    with pytest.raises(PluginError, match=r"'odd'.*Constants\.stiffness"):
        walk(Odd(), make_crowd([(0, 0)]), 1)
