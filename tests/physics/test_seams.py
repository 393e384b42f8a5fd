"""Portals: a seam is invisible, floors above one another are apart, and nobody gets lost."""

import numpy as np
import pytest

from evac.physics.state import copy_of, make_crowd
from evac.physics.world import set_open
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1
from evac_plugins.contact_nsm2 import Nsm2
from evac_plugins.force_social import SocialForce
from tests.physics.scenes import (
    fields_towards,
    make_building,
    make_engine,
    name_of,
    precise_models,
    random_crowd,
    uniform_fields,
    walk,
)

SOCIAL = SocialForce()
LEFT, RIGHT = (0, 0, 5, 4), (5, 0, 10, 4)


def whole_floor():
    """A floor of 10 x 4 m with a door of 0.9 m at (5.4, 2), and an exit at x = 9."""
    walls = [(0, 0, 10, 0), (5.4, 0, 5.4, 1.55), (5.4, 2.45, 5.4, 4), (10, 4, 0, 4), (0, 4, 0, 0)]
    return make_building(((0, 0, 10, 4),), walls, exits=[(0, (9, 0, 9, 4))])


def cut_floor(slant):
    """The same floor cut by a portal from (5 - slant, 0) to (5 + slant, 4)."""
    low, high = 5.0 - slant, 5.0 + slant
    walls = [
        (0, 0, low, 0), (low, 0, 10, 0), (5.4, 0, 5.4, 1.55), (5.4, 2.45, 5.4, 4),
        (10, 4, high, 4), (high, 4, 0, 4), (0, 4, 0, 0),
    ]  # fmt: skip
    level = [0, 1, 1, 1, 1, 0, 0]
    return make_building((LEFT, RIGHT), walls, level, [(0, 1, (low, 0, high, 4))], [(1, (9, 0, 9, 4))])


@pytest.mark.parametrize("slant", [0.0, 0.3], ids=["straight", "slanted"])
@pytest.mark.parametrize("forces", [(), (SOCIAL,)], ids=["alone", "social"])
@pytest.mark.parametrize("model", precise_models(), ids=name_of)
def test_a_cut_floor_is_the_uncut_floor(model, forces, slant):
    """Thirty people cross the seam and jam on it, before a door 0.4 m behind."""
    whole = random_crowd(30, (2.5, 0), (5.3, 4), seed=7)
    cut = copy_of(whole)
    cut.level[:] = whole.position[:, 0] > 5.0 + slant * (whole.position[:, 1] - 2.0) / 2.0
    engines = [
        make_engine(whole, whole_floor(), fields_towards((5.8, 2.0)), forces),
        make_engine(cut, cut_floor(slant), fields_towards((5.8, 2.0), 2), forces),
    ]
    crossed = 0
    for first in range(0, 100, 10):
        for engine, crowd in zip(engines, (whole, cut), strict=True):
            events = engine.advance(model, crowd, first, 10, 0.01, True, True)
        crossed += int(events.number)
        np.testing.assert_allclose(cut.position, whole.position, rtol=0, atol=1e-12)
        seam = 5.0 + slant * (cut.position[:, 1] - 2.0) / 2.0
        np.testing.assert_array_equal(cut.level, cut.position[:, 0] > seam)
    np.testing.assert_allclose(cut.contact_force, whole.contact_force, rtol=1e-9, atol=1e-6)
    assert crossed >= 3
    near = np.linalg.norm(whole.position[:, None] - whole.position, axis=2) - whole.radius - whole.radius[:, None]
    across = cut.level[:, None] != cut.level
    assert (near[across] < 0.05).sum() >= 4  # they touch across the seam


@pytest.mark.parametrize("model", precise_models(), ids=name_of)
def test_floors_above_one_another_do_not_touch(model):
    """Two crowds at the same places of unlinked floors move as each does alone."""
    alone = random_crowd(8, (0, 0), (2, 2), seed=1)
    both = make_crowd(
        np.concatenate([alone.position, alone.position + 0.05]),
        level=np.repeat([0, 1], 8),
        **{name: np.tile(getattr(alone, name), 2) for name in ("radius", "mass", "tau")},
    )
    both.speed[:] = np.tile(alone.speed, (2, 1))
    building = make_building(((-10, -10, 10, 10),) * 2, walls=[(3, -5, 3, 5)], wall_level=[0])
    walk(model, alone, 200, building=building, fields=uniform_fields(2), forces=(SOCIAL,))
    walk(model, both, 200, building=building, fields=uniform_fields(2), forces=(SOCIAL,))
    np.testing.assert_allclose(both.position[:8], alone.position, rtol=0, atol=1e-12)
    assert (alone.position[:, 0] < 3).all()
    assert (both.position[8:, 0] > 3).any()  # the wall of the lower floor is not on the upper one


def test_people_on_both_sides_of_a_wall_between_two_levels_do_not_touch():
    """Linked levels that share a plan line: only what is reached through the portal counts."""
    building = make_building(
        ((0, 0, 4, 2), (0, 2, 4, 4), (4, 0, 6, 4)),
        walls=[(0, 2, 4, 2), (4, 2, 0, 2)],
        wall_level=[0, 1],
        portals=[(0, 2, (4, 0, 4, 2)), (2, 1, (4, 4, 4, 2))],
    )
    crowd = make_crowd([(2.0, 1.8), (2.0, 2.2)], level=[0, 1], radius=0.2)
    engine = walk(Dem(), crowd, 10, building=building, fields=uniform_fields(3), forces=(SOCIAL,))
    np.testing.assert_array_equal(crowd.position, [(2.0, 1.8), (2.0, 2.2)])
    assert engine.report()["greatest_speed"] < 1e-9


def test_people_touch_through_two_portals():
    """A landing 1 m deep between two levels: people of 0.6 m radius on either side of it touch."""
    building = make_building(
        ((0, 0, 4, 2), (4, 0, 5, 2), (5, 0, 9, 2)), portals=[(0, 1, (4, 0, 4, 2)), (1, 2, (5, 0, 5, 2))]
    )
    crowd = make_crowd([(3.95, 1.0), (5.05, 1.0)], level=[0, 2], radius=0.6)
    walk(Dem(), crowd, 1, building=building, fields=uniform_fields(3))
    assert crowd.velocity[0, 0] < 0.0 < crowd.velocity[1, 0]
    np.testing.assert_allclose(crowd.velocity[1, 0], 0.01 * 1.2e5 * 0.1 / 80.0, rtol=1e-12)


@pytest.mark.parametrize("model", [Dem(), Nsm1(), Nsm2()], ids=["dem", "nsm1", "nsm2"])
def test_levels_and_those_out_add_up_to_everybody(model):
    crowd = random_crowd(30, (2.5, 0), (5.3, 4), seed=7)
    crowd.level[:] = crowd.position[:, 0] > 5.0
    engine = make_engine(crowd, cut_floor(0.0), fields_towards((11.0, 2.0), 2))
    out = 0
    for step in range(700):
        before = crowd.level.copy()
        events = engine.advance(model, crowd, step, 1, 0.01, True, False)
        kinds, rows = events.kind[: events.number], events.row[: events.number]
        out += int((kinds == 1).sum())
        assert np.bincount(crowd.level + 1, minlength=3).sum() == 30
        assert (crowd.level == -1).sum() == out
        np.testing.assert_array_equal(np.flatnonzero(crowd.level != before), np.unique(rows))
        times = events.time[: events.number]
        assert ((times >= 0.01 * step - 1e-12) & (times <= 0.01 * (step + 1) + 1e-12)).all()
    assert out > 10


def test_crossing_times_are_interpolated_and_the_position_is_continuous():
    crowd = make_crowd([(4.0, 2.0)], [(1.5, 0.0)], tau=1e30, radius=0.2)
    engine = make_engine(crowd, cut_floor(0.0), uniform_fields(2))
    seen = []
    model = Nsm1()
    for step in range(400):
        events = engine.advance(model, crowd, step, 1, 0.01, True, False)
        if crowd.level[0] >= 0:
            assert crowd.position[0, 0] == pytest.approx(4.0 + 0.015 * (step + 1), abs=1e-10)
        seen += [(int(events.kind[k]), int(events.link[k]), events.time[k]) for k in range(events.number)]
    assert [event[:2] for event in seen] == [(0, 0), (1, 1)]
    np.testing.assert_allclose([event[2] for event in seen], [1 / 1.5, 5 / 1.5], rtol=0, atol=1e-10)


def test_pushed_back_over_a_portal_and_over_it_again():
    crowd = make_crowd([(4.9, 2.0)], [(1.5, 0.0)], tau=1e30, radius=0.2)
    engine = make_engine(crowd, cut_floor(0.0), uniform_fields(2))
    links = []
    model = Nsm1()
    for step in range(60):
        if step % 20 == 0 and step:
            crowd.velocity[0, 0] *= -1.0
        events = engine.advance(model, crowd, step, 1, 0.01, True, False)
        links += list(events.link[: events.number])
        assert crowd.level[0] == (crowd.position[0, 0] > 5.0)
    assert links == [0, 0, 0]


def test_a_closed_portal_lets_nobody_through():
    crowd = make_crowd([(4.0, 2.0)], [(1.5, 0.0)], tau=1e30, radius=0.2)
    engine = make_engine(crowd, cut_floor(0.0), uniform_fields(2))
    engine.data.world.link_open[0] = 0
    walk(Nsm1(), crowd, 200, engine=engine)
    assert crowd.level[0] == 0


@pytest.mark.parametrize("closed", [None, 0, 1])
def test_a_closed_portal_keeps_forces_out(closed):
    """Two people on either side of a landing of 1 m, 1.1 m apart, with a force that reaches 2.3 m."""
    building = make_building(
        ((0, 0, 4, 2), (4, 0, 5, 2), (5, 0, 9, 2)), portals=[(0, 1, (4, 0, 4, 2)), (1, 2, (5, 0, 5, 2))]
    )
    crowd = make_crowd([(3.75, 1.0), (5.25, 1.0)], level=[0, 2], mass=80.0, tau=1e30)
    engine = make_engine(crowd, building, uniform_fields(3), [SocialForce(range=0.3)])
    if closed is not None:
        set_open(engine.data.world, closed, False)
    walk(Nsm1(), crowd, 1, engine=engine)
    gained = 0.01 * 1000.0 * np.exp(-1.1 / 0.3) / 80.0 if closed is None else 0.0
    np.testing.assert_allclose(crowd.velocity, [(-gained, 0.0), (gained, 0.0)], rtol=1e-12)


def strip_of_levels(number):
    """Levels of 2 m one after another, joined over their whole width."""
    bounds = [(2.0 * k, 0.0, 2.0 * k + 2.0, 2.0) for k in range(number)]
    portals = [(k, k + 1, (2.0 * k + 2.0, 0.0, 2.0 * k + 2.0, 2.0)) for k in range(number - 1)]
    return make_building(bounds, portals=portals)


def test_lists_are_kept_through_a_portal_unless_they_reach_across_the_level_behind_it():
    """Both people walk 0.1 m, one of them through a portal; lists of 1.5 m could reach through two more."""
    builds = []
    for force in (SocialForce(), SocialForce(range=0.4)):
        crowd = make_crowd([[1.95, 1.0], [4.5, 1.0]], [[1.0, 0.0]] * 2, level=[0, 2], speed=1.0)
        engine = make_engine(crowd, strip_of_levels(4), forces=[force])
        walk(Dem(), crowd, 10, engine=engine)
        assert crowd.level[0] == 1
        builds.append((engine.data.lists.pair_reach > 1.0, engine.report()["list_builds"]))
    assert builds == [(False, 1), (True, 2)]


@pytest.mark.parametrize("seed", range(3))
def test_lists_that_are_kept_through_portals_change_no_result(seed):
    crowds = []
    for tick in (50, 1):
        crowd = random_crowd(40, (0.1, 0.1), (9.0, 1.9), seed, contact_radius=0.15)
        crowd.level[:] = np.floor(crowd.position[:, 0] / 2.0)
        crowds.append(crowd)
        engine = make_engine(crowd, strip_of_levels(6), fields=uniform_fields(6))
        walk(Dem(), crowd, 100, engine=engine, tick=tick)
    np.testing.assert_array_equal(crowds[0].level, crowds[1].level)
    np.testing.assert_allclose(crowds[0].position, crowds[1].position, atol=1e-9)
