"""What a run counts about its own work: lists built, solves that fail, and how far off they end."""

import math

import numpy as np
import pytest

from evac.physics.state import make_crowd
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1
from evac_plugins.contact_nsm2 import Nsm2
from tests.physics.scenes import fields_towards, make_building, make_engine, name_of, uniform_fields, walk

#: One iteration of Uzawa's method, one of the stronger one, and a tolerance that they do not reach.
HOPELESS = {"solver": "uzawa", "iterations": 1, "velocity_tolerance": 1e-14}
GAP = make_building(walls=[(-1, 0, 1, 0), (1, 0.36, -1, 0.36)])


@pytest.mark.parametrize(
    "model", [Nsm1(**HOPELESS), Nsm1(variant="overdamped", **HOPELESS), Nsm2(**HOPELESS)], ids=name_of
)
def test_every_step_that_does_not_converge_is_counted_with_what_it_leaves(model):
    """Twenty people of very different masses, who touch each other, press towards a point of a wall."""
    places = [(-0.2 - 0.3464 * row, 0.4 * (column + 0.5 * (row % 2))) for row in range(4) for column in range(5)]
    crowd = make_crowd(places, radius=0.2, mass=[30.0 + 17.0 * (k % 7) for k in range(20)], tau=0.2, speed=1.5)
    building = make_building(walls=[(0, -3, 0, 5)])
    report = walk(model, crowd, 4, building=building, fields=fields_towards((0.0, 0.9))).report()
    assert report["unconverged_steps"] == 4
    assert report["solves"] == report["retried_solves"] == 4 + report["repeated_searches"]
    assert report["iterations"] == report["solves"] * (1 + 1)
    assert 1e-14 < report["greatest_residual"] < 1.5


def test_a_fall_back_from_the_elastic_law_counts_its_solves():
    """Ten iterations of the elastic problem, which has no solution, and those of the one in its place."""
    crowd = make_crowd([(0, 0.18)], [(0.0, -1.0)], radius=0.2, speed=1.0)
    model = Nsm2(normal_dissipation=float("inf"), **HOPELESS | {"iterations": 10})
    report = walk(model, crowd, 1, building=GAP, fields=uniform_fields(1, (0.0, -1.0))).report()
    assert report["elastic_fallbacks"] == report["solves"] == report["retried_solves"] == 1
    assert report["iterations"] > 10
    assert report["greatest_residual"] < 0.1  # of the second problem, not of the first


@pytest.mark.parametrize("model", [Nsm1(), Nsm2(position_correction=True)], ids=name_of)
def test_overlaps_that_cannot_be_parted_are_counted_once_a_tick(model):
    """A body of 0.4 m in a gap of 0.36 m."""
    crowd = make_crowd([(0, 0.18)], radius=0.2)
    report = walk(model, crowd, 30, building=GAP).report()
    assert report["failed_position_corrections"] == 3
    assert report["position_corrections"] == 0


@pytest.mark.parametrize("model", [Dem(), Nsm1(), Nsm2()], ids=name_of)
def test_the_greatest_overlap_is_known_by_time_and_place(model):
    """Two people start in one another and part; a third stands at the same place on another level."""
    building = make_building(bounds=((-10, -10, 10, 10), (-10, -10, 10, 10)))
    crowd = make_crowd([(0, 0), (0, 0), (0.39, 0)], [(0, 0), (0, 0), (3, 0)], level=[0, 1, 1], radius=0.2, tau=1e12)
    engine = make_engine(crowd, building)
    assert engine.contact_report(model)["greatest_overlap_at"] is None
    engine.advance(model, crowd, 40, 10, 0.01, True, False)
    assert engine.report()["greatest_overlap"] == pytest.approx(0.01, abs=1e-12)
    place = {"time": 0.4, "person": 2, "level": 1, "x": 0.39, "y": 0.0}
    assert engine.contact_report(model)["greatest_overlap_at"] == place


def test_the_greatest_overlap_of_an_impact_is_where_the_body_turns():
    """A quarter of the spring's period after it has met the wall, v sqrt(m / k) deep."""
    step, mass, stiffness = 1e-3, 80.0, 8e4
    crowd = make_crowd([(-1.0, 0.3), (-0.25, 0.0)], [(0, 0), (1.0, 0.0)], radius=0.2, mass=mass, tau=1e12)
    building = make_building(walls=[(0, -2, 0, 2)])
    model, inverse_frequency = Dem(stiffness=stiffness), math.sqrt(mass / stiffness)
    engine = walk(model, crowd, 200, h=step, building=building)
    found = engine.contact_report(model)["greatest_overlap_at"]
    assert (found["person"], found["y"]) == (1, 0.0)
    assert found["time"] == pytest.approx(0.05 + 0.5 * math.pi * inverse_frequency, abs=2.0 * step)
    assert found["x"] == pytest.approx(-0.2 + 1.0 * inverse_frequency, abs=1e-4)


@pytest.mark.parametrize("model", [Dem(), Nsm1(), Nsm2()], ids=name_of)
def test_lists_are_built_once_a_tick_and_when_somebody_has_moved_by_half_the_skin(model):
    standing = make_crowd([(0, 0)])
    assert walk(model, standing, 30).report()["list_builds"] == 3
    walking = make_crowd([(0, 0)], [(1.55, 0.0)], tau=1e30)  # 0.1 s for 0.155 m, more than half of 0.3 m
    engine = make_engine(walking)
    engine.advance(model, walking, 0, 15, 0.01, True, False)
    assert engine.report()["list_builds"] == 2


def test_each_person_has_the_greatest_overlap_of_the_last_tick():
    """Of a tick of one step, that of its start: with people and with walls, as computed from the positions."""
    places = [(-0.19, 0.0), (-0.54, 0.1), (-0.6, 0.4), (-3.0, 0.0)]
    crowd = make_crowd(places, radius=[0.2, 0.22, 0.18, 0.2], speed=1.5, tau=0.2)
    engine = make_engine(crowd, make_building(walls=[(0, -3, 0, 3)]), uniform_fields(1, (1.0, 0.0)))
    for step in range(100):
        apart = np.linalg.norm(crowd.position[:, None] - crowd.position[None], axis=2)
        overlap = crowd.radius[:, None] + crowd.radius - np.where(np.eye(4, dtype=bool), np.inf, apart)
        expected = np.maximum(overlap.max(axis=1), crowd.radius + crowd.position[:, 0])
        engine.advance(Dem(), crowd, step, 1, 0.01, False, False)
        np.testing.assert_allclose(crowd.overlap, np.maximum(expected, 0.0), rtol=0, atol=1e-12)
