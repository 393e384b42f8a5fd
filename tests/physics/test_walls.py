"""Walls: where they are cut does not matter, and nobody passes through."""

from dataclasses import replace

import numpy as np
import pytest

from evac.base.errors import SimulationError
from evac.building.model.building import Door
from evac.physics.state import copy_of, make_crowd
from evac.physics.world import set_open
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1
from evac_plugins.contact_nsm2 import Nsm2
from evac_plugins.force_social import SocialForce
from tests.physics.scenes import (
    cut_wall,
    fields_towards,
    make_building,
    make_engine,
    name_of,
    precise_models,
    random_crowd,
    uniform_fields,
    walk,
)

FREE = 1e30

#: What a contact of DEM takes up to an overlap of r = 0.2 m [J].
ENERGY_AT_RADIUS = 1.2e5 * 0.2**2 / 2.0


@pytest.mark.parametrize("forces", [(), (SocialForce(),)], ids=["alone", "social"])
@pytest.mark.parametrize("model", precise_models(), ids=name_of)
def test_a_wall_cut_every_tenth_of_a_metre_is_the_uncut_wall(model, forces):
    """A group that runs into the wall at a slant and along it."""
    walls = [(-8, 0, 8, 0)]
    fields = uniform_fields(1, (0.8, -0.6))
    whole = random_crowd(6, (-3, 0.05), (-1, 1.2), seed=2)
    start, cut = copy_of(whole), copy_of(whole)
    walk(model, whole, 150, building=make_building(walls=walls), fields=fields, forces=forces)
    walk(model, cut, 150, building=make_building(walls=cut_wall(*walls[0], 160)), fields=fields, forces=forces)
    np.testing.assert_allclose(cut.position, whole.position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(cut.velocity, whole.velocity, rtol=0, atol=1e-11)
    assert (whole.position - start.position)[:, 0].min() > 1.0  # they ran along it
    assert (whole.position[:, 1] - whole.radius).min() < 0.03


@pytest.mark.parametrize("model", precise_models(), ids=name_of)
def test_one_person_along_a_cut_wall_is_not_thrown_sideways(model):
    crowd = make_crowd([(-5, 0.2)], speed=1.5, tau=0.2)
    fields = uniform_fields(1, (0.8, -0.6))
    engine = make_engine(crowd, make_building(walls=cut_wall(-8, 0, 8, 0, 160)), fields)
    for step in range(300):
        engine.advance(model, crowd, step, 1, 0.01, True, False)
        if step > 150:
            assert abs(crowd.velocity[0, 1]) < (0.01 if model.name == "dem" else 1e-9)  # a spring settles slowly
            assert crowd.velocity[0, 0] == pytest.approx(1.2, abs=1e-3)


@pytest.mark.parametrize("model", precise_models(), ids=name_of)
def test_a_diagonal_wall_cut_in_pieces_is_the_uncut_wall(model):
    walls = [(-4, -3, 4, 3)]
    fields = uniform_fields(1, (1.0, 0.0))
    whole = make_crowd([(-2, 0), (-2.5, 0.5), (-3, -1.2)], radius=[0.2, 0.22, 0.25], speed=1.5, tau=0.3)
    cut = copy_of(whole)
    walk(model, whole, 150, building=make_building(walls=walls), fields=fields)
    walk(model, cut, 150, building=make_building(walls=cut_wall(*walls[0], 100)), fields=fields)
    np.testing.assert_allclose(cut.position, whole.position, rtol=0, atol=1e-12)


@pytest.mark.parametrize("model", precise_models(), ids=name_of)
def test_an_inner_corner_holds_on_both_sides(model):
    """A person pressed into a corner of 90 degrees rests against both walls."""
    crowd = make_crowd([(1.0, 1.2)], radius=0.2, mass=80.0, tau=0.1, speed=1.0)
    building = make_building(walls=[(0, 0, 4, 0), (0, 4, 0, 0)])
    walk(model, crowd, 600, building=building, fields=uniform_fields(1, (-0.6, -0.8)))
    overlap = np.array([0.6, 0.8]) * 80.0 * 1.0 / 0.1 / 1.2e5 if model.name == "dem" else np.zeros(2)
    rebound = 0.1 if model.name == "nsm2" and model.normal_dissipation else 1e-6
    np.testing.assert_allclose(crowd.velocity, 0.0, atol=rebound)
    np.testing.assert_allclose(crowd.position[0], 0.2 - overlap, atol=0.006 if model.name == "nsm2" else 1e-6)


@pytest.mark.parametrize("model", [Dem(), Nsm1(), Nsm2()], ids=["dem", "nsm1", "nsm2"])
@pytest.mark.parametrize("speed", [5.0, 20.0, 60.0])
def test_a_fast_body_does_not_pass_a_thin_wall_in_a_long_step(model, speed):
    crowd = make_crowd([(-1.0, 0.1)], [(speed, 0.0)], radius=0.2, tau=FREE)
    engine = make_engine(crowd, make_building(walls=[(0, -3, 0, 3)]))
    if model.name == "dem" and 0.5 * 80.0 * speed**2 > ENERGY_AT_RADIUS:
        with pytest.raises(SimulationError, match=r"person 0 at .* wall"):
            walk(model, crowd, 20, h=0.1, tick=1, engine=engine)
    else:
        walk(model, crowd, 20, h=0.1, tick=1, engine=engine)
    assert crowd.position[0, 0] < 0.0
    if model.name != "nsm1":
        assert engine.report()["too_fast_steps"] > 0


def test_a_crossing_that_a_model_cannot_prevent_cuts_the_step():
    """A spring far too soft for the wall: the body is stopped by cut steps, or the run by an error."""
    crowd = make_crowd([(-0.15, 0.0)], [(1.0, 0.0)], radius=0.2, tau=0.1, speed=2.0)
    engine = make_engine(crowd, make_building(walls=[(0, -3, 0, 3)]))
    with pytest.raises(SimulationError, match=r"person 0 at \(-0\.\d+, 0\.00\) on level 0 .* wall"):
        walk(Dem(stiffness=1e-3), crowd, 200, engine=engine)
    assert crowd.position[0, 0] < 0.0
    assert engine.report()["wall_crossings_prevented"] > 0


@pytest.mark.parametrize("model", precise_models(), ids=name_of)
def test_a_jam_at_a_door_stays_inside_its_walls(model):
    walls = [(0, 0, 4, 0), (4, 0, 4, 1.2), (4, 1.8, 4, 3), (4, 3, 0, 3), (0, 3, 0, 0)]
    crowd = random_crowd(25, (0, 0), (4, 3), seed=5)
    start = copy_of(crowd)
    engine = make_engine(crowd, make_building(walls=walls), fields_towards((4.5, 1.5)))
    for first in range(0, 300, 10):
        engine.advance(model, crowd, first, 10, 0.01, True, False)
        x, y = crowd.position.T
        inside = (x > 0) & (x < 4) & (y > 0) & (y < 3)
        assert (inside | ((x >= 4) & (abs(y - 1.5) < 3.0))).all()
    assert not np.array_equal(crowd.position, start.position)
    assert engine.report()["contacts"] > 100


def test_an_open_wall_is_not_there():
    crowd = make_crowd([(-1.0, 0.0)], radius=0.2, tau=0.2, speed=1.5)
    engine = make_engine(crowd, make_building(walls=[(0, -3, 0, 3)]))
    engine.data.world.wall_open[0] = 1
    walk(Nsm1(), crowd, 200, engine=engine)
    assert crowd.position[0, 0] > 1.0
    engine.data.world.wall_open[0] = 0
    crowd.position[0, 0] = -1.0
    walk(Nsm1(), crowd, 200, engine=engine)
    assert crowd.position[0, 0] == pytest.approx(-0.2, abs=2e-4)


def test_a_closed_link_is_the_wall_at_its_own_place():
    bounds = ((0, 0, 2, 2), (2, 0, 4, 2))
    places = [(2, 0, 2, 2), (0, 0.5, 0, 1.5), (4, 0, 4, 1), (3, 0, 3, 1), (3, 1, 3, 2)]
    building = make_building(bounds, [(0, 0, 2, 0)], None, [(0, 1, places[0])], [(0, places[1]), (1, places[2])])
    doors = [Door(k, f"door {k}", 1, np.array(places[3 + k], float), 1.0) for k in range(2)]
    world = make_engine(make_crowd([(1.0, 1.0)]), replace(building, doors=tuple(doors))).data.world
    for link, place in enumerate(places):
        before = world.wall_open.copy()
        set_open(world, link, 0)
        changed = np.flatnonzero(world.wall_open != before)
        assert changed.size
        for wall in np.sort(world.wall[changed].reshape(-1, 2, 2), axis=1):
            np.testing.assert_array_equal(wall, np.sort(np.reshape(place, (2, 2)), axis=0))
        set_open(world, link, 1)
        np.testing.assert_array_equal(world.wall_open, before)
