"""The engine: work arrays that are too short grow, and the run goes on as if they had been long enough."""

import signal

import numpy as np
import pytest

from evac.base.errors import PluginError, SimulationError
from evac.jit import kernel
from evac.physics.contact.model import ContactModel, NoParameters, SolvedContactModel
from evac.physics.state import Events, State, allocate, make_crowd, make_lists, make_room_for_contacts
from evac.physics.status import NEEDS_SEPARATION, SEPARATE
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1, Projection, project
from evac_plugins.contact_nsm2 import Nsm2
from evac_plugins.force_social import SocialForce
from tests.physics.scenes import cut_wall, make_building, make_engine, random_crowd, walk

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
            engine.state.lists, engine.state.events = make_lists(n, 1, 1, 1), allocate(Events, 1)
            make_room_for_contacts(engine.state, 1)
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
