"""Halls of any size, and where the time of a step goes."""

import math

import numpy as np
import pytest

from evac import Simulation, load
from evac.evidence.scaling import commands
from evac.evidence.scaling.halls import DOOR, RADIUS, doors_along, make_hall, nearest_door
from evac.evidence.scaling.minimal import make_minimal, walk_minimal
from evac.evidence.scaling.page import STEP
from evac.evidence.scaling.walks import Walk, make_variant
from evac.physics.state import SKIN, copy_of


def gaps(crowd):
    apart = np.linalg.norm(crowd.position[:, None] - crowd.position[None], axis=2)
    apart -= crowd.radius[:, None] + crowd.radius[None]
    return apart[np.triu_indices(len(crowd.radius), 1)]


@pytest.mark.parametrize("density", [2.0, 5.0])
@pytest.mark.parametrize("people", [20, 400])
def test_hall_holds_its_people_without_overlap(people, density):
    hall = make_hall(people, density, seed=1)
    crowd = hall.crowd
    assert len(crowd.level) == people
    assert gaps(crowd).min() >= 0.0
    assert (crowd.position > crowd.radius[:, None]).all()
    assert (crowd.position < np.array([hall.depth, hall.length]) - crowd.radius[:, None]).all()
    assert crowd.radius.min() >= RADIUS[0]
    assert np.isfinite(hall.fields.travel_time_at(0, crowd.position, 0)).all()


def test_walls_and_doors_close_the_hall():
    hall = make_hall(2000, 2.0, seed=1)
    walls = sum(math.dist(wall[:2], wall[2:]) for wall in hall.building.walls)
    doors = sum(exit_.width for exit_ in hall.building.exits)
    assert len(hall.building.exits) == 3
    assert doors == pytest.approx(3 * DOOR)
    assert hall.depth == hall.length
    assert walls + doors == pytest.approx(4.0 * hall.length)


def test_the_nearest_door_is_that_whose_middle_is_nearest_along_the_wall():
    low, high = doors_along(40.0)
    assert len(low) == 4
    np.testing.assert_allclose(0.5 * (low + high), [5.0, 15.0, 25.0, 35.0])
    places = np.array([0.0, 9.9, 10.1, 24.0, 29.9, 40.0])
    assert nearest_door(40.0, places).tolist() == [0, 0, 1, 2, 2, 3]


def in_the_middle(hall, reach):
    """Return the crowd of a hall without those who may touch a wall or reach a door soon."""
    crowd = copy_of(hall.crowd)
    crowd.level[(np.abs(crowd.position - 0.5 * hall.length) > reach).any(axis=1)] = -1
    return crowd


@pytest.mark.parametrize("density", [2.0, 5.0])
def test_the_minimal_kernel_walks_as_dem_does_away_from_walls(density):
    hall = make_hall(400, density, 1)
    walk = Walk(hall._replace(crowd=in_the_middle(hall, 2.5)), STEP)
    minimal = make_minimal(walk.crowd, hall.fields.packed, STEP)
    people = nearest(walk.crowd.position, minimal.position)
    before = walk.crowd.position[people].copy()
    walk.advance(make_variant("DEM", STEP).model, 8)
    walk_minimal(minimal, 8 * walk.per_tick, STEP)
    assert np.linalg.norm(minimal.position - before, axis=1).mean() > 0.5
    np.testing.assert_allclose(minimal.position, walk.crowd.position[people], atol=1e-9)
    np.testing.assert_allclose(minimal.velocity, walk.crowd.velocity[people], atol=1e-7)
    report = walk.engine.report()
    assert report["overlaps"] > 0
    assert report["sub_steps"] == report["steps"]


def nearest(positions, places):
    return np.linalg.norm(positions[:, None] - places[None], axis=2).argmin(axis=0)


def test_the_lists_of_the_minimal_kernel_have_each_pair_once():
    hall = make_hall(300, 5.0, 1)
    minimal = make_minimal(hall.crowd, hall.fields.packed, STEP)
    walk_minimal(minimal, 1, STEP)
    place, radius = minimal.listed_position, minimal.radius
    apart = np.linalg.norm(place[:, None] - place[None], axis=2) - radius[:, None] - radius[None]
    expected = {(i, j) for i, j in np.argwhere(apart < SKIN).tolist() if i < j}
    found = [
        (i, j)
        for i in range(len(radius))
        for j in minimal.pair_body[minimal.pair_start[i] : minimal.pair_start[i + 1]].tolist()
    ]
    assert len(found) == len(expected) > 300
    assert {tuple(sorted(pair)) for pair in found} == expected


def test_towers_of_whole_commands_are_without_findings_and_everybody_gets_out():
    simulation = Simulation(load(commands.tower_case(3, 30, {"walking": {}})))
    building = simulation.building
    assert building.findings == ()
    assert {"west", "east"} <= set(building.shafts)
    assert len(building.doors) == 2 * 12
    assert simulation.run().ended == "everybody out"
