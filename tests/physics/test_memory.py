"""What contacts remember: over sub-steps, ticks, changes of order, cuts, portals and checkpoints."""

import numpy as np
import pytest

from evac.base.parameters import Parameter
from evac.base.saved import SavedError
from evac.jit import pair_friction
from evac.physics.contact.model import ContactModel
from evac.physics.contact.pair_contact import PairContact
from evac.physics.engine import rows_by_place
from evac.physics.state import Events, allocate, copy_of, make_crowd, make_room_for_contacts
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1
from tests.physics.scenes import (
    cut_wall,
    fields_towards,
    kinetic_energy,
    make_building,
    make_engine,
    random_crowd,
    walk,
)

FREE = 1e30


@pair_friction
def count(gap, closing_speed, sliding_speed, reduced_mass, elapsed, memory, parameters):
    memory[0] += 1.0
    memory[1] += elapsed
    return -parameters[0] * gap, 0.0


class Counting(PairContact):
    """A spring that counts its sub-steps and how long it has been pressed."""

    name = "counting"
    pair = count
    memory = ("calls", "time")
    stiffness = Parameter(1.2e5, "k", unit="kg/s2")


@pair_friction
def stick(gap, closing_speed, sliding_speed, reduced_mass, elapsed, memory, parameters):
    force = max(-parameters[0] * gap + 500.0 * closing_speed, 0.0)
    longest = parameters[2] * force / parameters[1]
    memory[0] = min(max(memory[0] + elapsed * sliding_speed, -longest), longest)
    return force, -parameters[1] * memory[0]


class Sticking(PairContact):
    """Springs along the normal and the tangent; the latter slips."""

    name = "sticking"
    pair = stick
    memory = ("stretch",)
    stiffness = Parameter(1.2e5, "k", unit="kg/s2")
    tangential = Parameter(8e4, "k_t", unit="kg/s2")
    friction = Parameter(0.5, "mu")


class StickingNumpy(ContactModel):
    """The same written with numpy, without cuts for stiffness."""

    name = "sticking_numpy"
    memory = ("stretch",)

    def step(self, contacts, h):
        i, j, two = contacts.body, contacts.other, contacts.other >= 0
        tangent = np.column_stack([-contacts.normal[:, 1], contacts.normal[:, 0]])
        relative = contacts.velocity[i] - np.where(two[:, None], contacts.velocity[j], 0.0)
        closing, slide = -(relative * contacts.normal).sum(axis=1), (relative * tangent).sum(axis=1)
        overlap = -np.minimum(contacts.gap, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            elapsed = np.where(overlap < self.before * closing, overlap / closing, self.before)
        self.before = h
        force = np.maximum(1.2e5 * overlap + 500.0 * closing, 0.0)
        longest = 0.5 * force / 8e4
        contacts.memory[:, 0] = np.clip(contacts.memory[:, 0] + elapsed * slide, -longest, longest)
        contacts.percussion[:] = h * force
        total = contacts.percussion[:, None] * contacts.normal - h * 8e4 * contacts.memory * tangent
        velocity = contacts.free.copy()
        np.add.at(velocity, i, total / contacts.mass[i, None])
        np.subtract.at(velocity, j[two], total[two] / contacts.mass[j[two], None])
        return velocity


def remembered(engine):
    """Return what is kept after a tick, pairs and numbers."""
    return engine.memory["pairs"].tolist(), engine.memory["numbers"]


def pressed_together(model, steps, h=0.01, tick=10, engine=None, **scene):
    """Two people who begin at rest with an overlap, slightly aslant, and a wall beside one of them."""
    crowd = make_crowd([(0.0, 0.0), (0.38, 0.05)], radius=0.2, mass=[60.0, 100.0], tau=FREE)
    building = make_building(walls=[(-0.19, -5, -0.19, 5)])
    return crowd, walk(model, crowd, steps, h, engine, tick=tick, building=building, **scene)


@pytest.mark.parametrize("tick", [1, 3, 10])
def test_what_is_kept_lasts_over_ticks(tick):
    """Ten steps pressed, of which nine come after a step: 9 h; pairs are persons, or a person and wall - walls."""
    crowd, engine = pressed_together(Counting(stiffness=100.0), 10, 1e-3, tick)
    pairs, numbers = remembered(engine)
    assert pairs == [[0, -1], [0, 1]]
    np.testing.assert_allclose(numbers, [[10, 9e-3], [10, 9e-3]], rtol=1e-12)
    np.testing.assert_array_equal(crowd.position, pressed_together(Counting(stiffness=100.0), 10, 1e-3)[0].position)


def test_what_is_kept_is_lost_when_the_contact_opens():
    """A disc flies to and fro between two walls, half a period pi sqrt(m/k) at each: it remembers one touch at most."""
    crowd = make_crowd([(0.0, 0.0)], [(2.0, 0.0)], radius=0.2, mass=80.0, tau=FREE)
    engine = make_engine(crowd, make_building(walls=[(-0.3, -5, -0.3, 5), (0.3, -5, 0.3, 5)]))
    touch, most, spells = np.pi * np.sqrt(80.0 / 1.2e5), 0.0, 0
    was_kept, model = False, Counting()
    for step in range(1200):
        engine.advance(model, crowd, step, 1, 5e-4, True, False)
        pairs, numbers = remembered(engine)
        spells += bool(pairs) and not was_kept
        was_kept = bool(pairs)
        most = max(most, numbers[:, 1].max(initial=0.0))
        assert len(pairs) <= 1
    assert spells == 4
    assert most == pytest.approx(touch, rel=1e-2)


class FarCounting(Counting):
    """Counts contacts that are open, too."""

    name = "far_counting"
    reach_share = 50.0


def test_an_open_contact_that_a_law_still_sees_begins_anew_in_every_step():
    crowd = make_crowd([(-0.19, 0.0)], [(-2.0, 0.0)], radius=0.2, mass=80.0, tau=FREE)
    model, engine = FarCounting(stiffness=100.0), make_engine(crowd, make_building(walls=[(0, -5, 0, 5)]))
    calls = []
    for step in range(20):
        engine.advance(model, crowd, step, 1, 1e-3, True, False)
        calls.append(remembered(engine)[1][0, 0])
    assert calls == [1, 2, 3, 4, 5] + [1] * 15


def test_a_contact_that_begins_has_been_pressed_since_its_gap_closed():
    crowd = make_crowd([(-0.235, 0.0)], [(2.0, 0.0)], radius=0.2, mass=80.0, tau=FREE)
    model, engine = Counting(), make_engine(crowd, make_building(walls=[(0, -5, 0, 5)]))
    walk(model, crowd, 2, engine=engine)
    assert remembered(engine)[0] == []
    walk(model, crowd, 1, engine=engine)
    np.testing.assert_allclose(remembered(engine)[1], [[1, 0.005 / 2.0]], rtol=1e-12)


@pytest.mark.parametrize("is_scarce", [False, True])
@pytest.mark.parametrize(
    ("stiffness", "speed", "reason"), [(1.8e6, 1.5, "too_stiff_steps"), (100.0, 15.0, "too_fast_steps")]
)
def test_steps_that_are_made_again_count_once(stiffness, speed, reason, is_scarce):
    """Two people are pressed together while others leave, too fast for whole steps, or the contact is too stiff.

    There may be no room for the others' crossings, which is found after a sub-step, and more room for contacts.
    """
    position = [(0.0, 0.0), (0.399, 0.0), (2.999, 5.0), (2.999, 6.0)]
    velocity = [(0.25, 0.0), (-0.25, 0.0), (speed, 0.0), (1.5, 0.0)]
    crowd = make_crowd(position, velocity, radius=0.2, mass=80.0, tau=FREE)
    model, engine = Counting(stiffness=stiffness), make_engine(crowd, make_building(exits=[(0, (3, -10, 3, 10))]))
    crowd.velocity[2:], late = 0.0, crowd.velocity[2:].copy()
    engine.advance(model, crowd, 0, 1, 1e-3, True, False)
    assert remembered(engine)[1].tolist() == [[engine.report()["sub_steps"], 0.0]]
    crowd.velocity[2:] = late
    if is_scarce:
        make_room_for_contacts(engine.data, 2 * len(engine.data.contacts.body))
        engine.data.events = allocate(Events, 1)
    engine.advance(model, crowd, 1, 1, 0.01, True, False)
    report, (pairs, numbers) = engine.report(), remembered(engine)
    assert report[reason] > 0
    assert (crowd.level < 0).tolist() == [False, False, True, True]
    assert pairs == [[0, 1]]
    assert numbers[0, 0] == report["sub_steps"] > 2
    last = 0.01 / (report["sub_steps"] - 1)
    assert numbers[0, 1] == pytest.approx(1e-3 + 0.01 - last, rel=1e-12)


def test_a_contact_that_began_in_a_step_that_is_undone_begins_anew():
    """Two pairs touch; one is taken apart and put together again in a step that is made twice."""
    position = [(0.0, 0.0), (0.39, 0.0), (0.0, 2.0), (0.39, 2.0), (2.9999, 5.0), (2.9999, 6.0)]
    crowd = make_crowd(position, radius=0.2, mass=80.0, tau=FREE)
    model, engine = Counting(stiffness=100.0), make_engine(crowd, make_building(exits=[(0, (3, -10, 3, 10))]))
    engine.advance(model, crowd, 0, 1, 1e-3, True, False)
    assert remembered(engine)[0] == [[0, 1], [2, 3]]
    crowd.position[3, 0] = 1.0
    engine.advance(model, crowd, 1, 1, 1e-3, True, False)
    assert remembered(engine)[0] == [[0, 1]]
    crowd.position[3, 0], crowd.velocity[4:, 0] = 0.39, 1.0
    engine.data.events = allocate(Events, 1)
    engine.advance(model, crowd, 2, 1, 1e-3, True, False)
    assert len(engine.data.events.row) == 2
    assert remembered(engine)[0] == [[0, 1], [2, 3]]
    assert remembered(engine)[1][:, 0].tolist() == [3.0, 1.0]


def crowd_at_a_door(shift=0.0, order=None):
    """Thirty people of whom some stick at a door, and the scene; all moved by `shift`, in another order of persons."""
    walls = np.array([(0, 0, 5, 0), (5, 0, 5, 1.6), (5, 2.4, 5, 4), (5, 4, 0, 4), *cut_wall(0, 4, 0, 0, 4)])
    building = make_building(((-2, -2, 12, 12),), walls + shift, exits=[(0, tuple(np.array((5.5, 0, 5.5, 4)) + shift))])
    crowd = random_crowd(30, (2, 0), (4.9, 4), seed=3)
    crowd.position[:] += shift
    if order is not None:
        crowd = type(crowd)(**{name: array[order].copy() for name, array in crowd.values().items()})
    return crowd, make_engine(crowd, building, fields_towards((6.5 + shift, 2.0 + shift), extent=24.0))


def walk_to_the_door(model, crowd, engine, ticks=30, first=0):
    for tick in range(first, ticks):
        engine.advance(model, crowd, 10 * tick, 10, 0.01, False, True)
    return crowd


def test_a_law_in_numpy_remembers_as_a_compiled_one():
    crowd, engine = crowd_at_a_door()
    numpy = StickingNumpy()
    numpy.before = 0.0
    np.testing.assert_allclose(
        walk_to_the_door(numpy, crowd, engine).position,
        walk_to_the_door(Sticking(), *crowd_at_a_door()).position,
        rtol=0,
        atol=1e-11,
    )
    assert np.abs(crowd.position - walk_to_the_door(Sticking(friction=0.0), *crowd_at_a_door()).position).max() > 0.01


def test_another_order_of_people_changes_no_bit():
    order = np.random.default_rng(5).permutation(30)
    wanted, found = (walk_to_the_door(Sticking(), *crowd_at_a_door(order=each)) for each in (None, order))
    for name in ("position", "velocity", "level", "distance", "contact_force"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name)[order])


def test_what_is_kept_follows_the_people_when_bodies_change_places():
    """A pair that sticks, carried along: at some places the bodies are in the other order, with the same stretch."""
    found, model = [], Sticking(stiffness=100.0, friction=1e4)
    for shift in (0.1, 0.97, 1.4, 1.98):
        velocity = [(1.2, 1.0), (1.0, 1.0)]
        crowd = make_crowd([(shift, 0.0), (shift, 0.37)], velocity, radius=0.2, mass=80.0, tau=FREE)
        engine, order = make_engine(crowd), set()
        for step in range(60):
            engine.advance(model, crowd, step, 1, 0.001, True, False)
            order.add(tuple(rows_by_place(crowd)))
        assert remembered(engine)[0] == [[0, 1]]
        found.append((remembered(engine)[1][0, 0], *(crowd.position - (shift, 0.0)).ravel(), len(order)))
    changes = {orders for *_, orders in found}
    assert changes == {1, 2}
    np.testing.assert_allclose([one[:-1] for one in found], [found[0][:-1]] * 4, rtol=0, atol=1e-12)


@pytest.mark.parametrize("slant", [0.0, 0.3])
def test_what_is_kept_crosses_portals(slant):
    """A cut floor is the uncut floor; people stick to others on the other side of the portal."""
    walls = [(0, 0, 10, 0), (5.4, 0, 5.4, 1.55), (5.4, 2.45, 5.4, 4), (10, 4, 0, 4), (0, 4, 0, 0)]
    low, high = 5.0 - slant, 5.0 + slant
    cut_walls = [(0, 0, low, 0), (low, 0, 10, 0), *walls[1:3], (10, 4, high, 4), (high, 4, 0, 4), walls[4]]
    exit_line = (9, 0, 9, 4)
    sides, portal = ((0, 0, 5, 4), (5, 0, 10, 4)), (0, 1, (low, 0, high, 4))
    cut_floor = make_building(sides, cut_walls, [0, 1, 1, 1, 1, 0, 0], [portal], [(1, exit_line)])
    whole = random_crowd(30, (2.5, 0), (5.3, 4), seed=7)
    cut = copy_of(whole)
    cut.level[:] = whole.position[:, 0] > 5.0 + slant * (whole.position[:, 1] - 2.0) / 2.0
    engines = [
        make_engine(whole, make_building(((0, 0, 10, 4),), walls, exits=[(0, exit_line)]), fields_towards((5.8, 2.0))),
        make_engine(cut, cut_floor, fields_towards((5.8, 2.0), 2)),
    ]
    across = 0
    for first in range(0, 150, 10):
        for engine, crowd in zip(engines, (whole, cut), strict=True):
            engine.advance(Sticking(), crowd, first, 10, 0.01, True, True)
        found, wanted = remembered(engines[1]), remembered(engines[0])
        assert [pair for pair in found[0] if pair[1] >= 0] == [pair for pair in wanted[0] if pair[1] >= 0]
        across += sum(cut.level[i] != cut.level[j] for i, j in found[0] if j >= 0)
    np.testing.assert_allclose(cut.position, whole.position, rtol=0, atol=1e-9)
    assert across > 10


def half_way():
    """Return the crowd and what the engine saves in the middle of a walk."""
    crowd, engine = crowd_at_a_door()
    walk_to_the_door(Sticking(), crowd, engine, 15)
    return crowd, engine.state()


def test_a_resumed_walk_goes_on_to_the_bit():
    crowd, saved = half_way()
    assert len(saved["memory.pairs"]) > 10
    _, engine = crowd_at_a_door()
    engine.load(Sticking())
    with pytest.raises(SavedError, match=r"memory\.numbers"):
        engine.restore({key: value for key, value in saved.items() if key != "memory.numbers"})
    model = Sticking()
    engine.load(model)
    engine.restore(saved)
    walk_to_the_door(model, crowd, engine, 30, 15)
    wanted, whole = crowd_at_a_door()
    walk_to_the_door(model, wanted, whole)
    for name in ("position", "velocity", "level", "distance"):
        np.testing.assert_array_equal(getattr(crowd, name), getattr(wanted, name))
    for key, array in whole.state().items():
        np.testing.assert_array_equal(engine.state()[key], array)


def test_friction_counts_in_the_energy():
    """Two people who hit each other aslant stick and slip, and part; each loses what percussions account for."""
    crowd = make_crowd([(-0.21, 0.0), (0.21, 0.12)], [(1.5, 0.0), (-1.0, 0.3)], mass=[60.0, 100.0], tau=FREE)
    before, report = kinetic_energy(crowd), walk(Sticking(), crowd, 400, h=1e-3).report()
    taken = report["contact_dissipation"] - report["contact_creation"]
    assert before - kinetic_energy(crowd) == pytest.approx(taken, rel=1e-9)
    assert taken > 10.0


@pytest.mark.parametrize("model", [Dem(), Nsm1()])
def test_models_that_declare_nothing_have_no_memory(model):
    crowd, engine = crowd_at_a_door()
    walk_to_the_door(model, crowd, engine, 2)
    assert engine.data.contacts.memory.size == engine.data.memory.value.size == engine.data.memory.body.size == 0
    assert engine.data.parts.recall == engine.data.parts.retain == 0
    assert not {"recall", "retain"} & {entry.title for entry in engine.entries(model)}
    assert {"recall", "retain"} <= {entry.title for entry in engine.entries(Sticking())}
    assert not [key for key in engine.state() if key.startswith("memory")]


@pytest.mark.parametrize("fault", ["width", "kind", "numbers"])
def test_a_saved_memory_that_cannot_be_is_refused(fault):
    _, saved = half_way()
    pairs, numbers = saved["memory.pairs"], saved["memory.numbers"]
    faults = {
        "width": pairs[:, :1],
        "kind": pairs.astype(np.int32),
        "numbers": numbers.ravel(),
    }
    key = "numbers" if fault == "numbers" else "pairs"
    saved[f"memory.{key}"] = faults[fault]
    _, engine = crowd_at_a_door()
    engine.load(Sticking())
    with pytest.raises(SavedError, match=r"memory\."):
        engine.restore(saved)


def test_what_is_kept_lasts_when_contacts_need_more_room_within_a_tick():
    """Two people are pressed for 20 steps; others, of whom there are more than there is room for, touch after 10."""
    others = [(0.0, 2.0 + row) for row in range(6)] + [(0.42, 2.0 + row) for row in range(6)]
    position = [(0.0, 0.0), (0.39, 0.0), *others]
    velocity = [(0.0, 0.0)] * 8 + [(-2.0, 0.0)] * 6
    crowd = make_crowd(position, velocity, radius=0.2, mass=80.0, tau=FREE)
    model, engine = Counting(stiffness=100.0), make_engine(crowd, make_building())
    make_room_for_contacts(engine.data, 2)
    engine.advance(model, crowd, 0, 20, 1e-3, True, False)
    pairs, numbers = remembered(engine)
    assert len(engine.data.contacts.body) > 2
    assert len(pairs) == 7
    assert numbers[pairs.index([0, 1])].tolist() == pytest.approx([20, 19e-3])
