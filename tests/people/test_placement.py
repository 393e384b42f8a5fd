import re
import time

import numpy as np
import pytest
import shapely
from scipy.spatial import cKDTree

from evac.base.distributions import generator_for
from evac.base.errors import ScenarioError
from evac.people.placement import clearance, place

NOBODY = np.empty((0, 3))


def sides(polygon):
    corners = shapely.get_coordinates(polygon.exterior)
    return np.column_stack((corners[:-1], corners[1:]))


def least_gap(position, radius):
    """Least gap between two discs, by a tree of centres."""
    pairs = cKDTree(position).query_pairs(2 * radius.max(), output_type="ndarray")
    first, second = pairs.T
    distance = np.linalg.norm(position[first] - position[second], axis=1)
    return (distance - radius[first] - radius[second]).min(initial=np.inf)


def placed(polygon, radius, *, occupied=NOBODY, seed=1, walls=None):
    walls = sides(polygon) if walls is None else walls
    return place(
        polygon, radius, walls, occupied, generator_for(seed, "position"), "hall", lambda points: points[:, 0] < 1e9
    )


@pytest.mark.parametrize("n", [1, 40, 85])
def test_bodies_overlap_neither_each_other_nor_walls(n):
    room = shapely.box(2, 3, 7, 8)
    radius = np.random.default_rng(0).uniform(0.2, 0.25, n)
    position = placed(room, radius)
    assert least_gap(position, radius) >= 0
    assert (shapely.distance(room.exterior, shapely.points(position)) >= radius).all()
    assert shapely.contains_xy(room, *position.T).all()


def test_a_bent_area_with_an_obstacle_in_it():
    room = shapely.Polygon([(0, 0), (6, 0), (6, 2), (2, 2), (2, 6), (0, 6)])
    desk = shapely.box(0.8, 0.8, 1.2, 1.2)
    radius = np.full(40, 0.2)
    position = placed(room, radius, walls=np.concatenate([sides(room), sides(desk)]))
    assert least_gap(position, radius) >= 0
    points = shapely.points(position)
    assert (shapely.distance(desk, points) >= 0.2).all()
    assert (shapely.distance(room.exterior, points) >= 0.2).all()


def test_people_already_there_are_kept_clear_of_whatever_their_size():
    room = shapely.box(0, 0, 5, 5)
    occupied = np.array([[2.5, 2.5, 1.5], [5.1, 1.0, 0.3]])
    radius = np.full(20, 0.2)
    position = placed(room, radius, occupied=occupied)
    distance = np.linalg.norm(position[:, None] - occupied[None, :, :2], axis=2)
    assert (distance >= 0.2 + occupied[:, 2]).all()


def test_somebody_just_outside_the_area_is_kept_clear_of_too():
    area, neighbour = shapely.box(0, 0, 0.5, 1), np.array([[-0.25, 0.5, 0.3]])
    for seed in range(20):
        position = placed(area, np.array([0.25]), occupied=neighbour, seed=seed, walls=np.empty((0, 4)))
        assert np.hypot(*(position[0] - neighbour[0, :2])) >= 0.55


def test_without_walls_centres_may_stand_at_the_edge_of_the_area():
    area = shapely.box(0, 0, 0.1, 3)
    position = placed(area, np.full(5, 0.25), walls=np.empty((0, 4)))
    assert least_gap(position, np.full(5, 0.25)) >= 0


def test_the_same_seed_gives_the_same_places_and_another_seed_others():
    room, radius = shapely.box(0, 0, 5, 5), np.full(30, 0.22)
    assert np.array_equal(placed(room, radius, seed=4), placed(room, radius, seed=4))
    assert not np.array_equal(placed(room, radius, seed=4), placed(room, radius, seed=5))


def test_random_places_cover_the_area_evenly():
    position = placed(shapely.box(0, 0, 100, 100), np.full(4000, 0.2))
    counts = np.histogram2d(*position.T, bins=4, range=[[0, 100], [0, 100]])[0]
    assert abs(counts - 250).max() < 4 * np.sqrt(250)


def test_more_than_fit_are_refused_with_the_number_that_would():
    with pytest.raises(ScenarioError) as caught:
        placed(shapely.box(0, 0, 5, 5), np.full(200, 0.25))
    words = r"^hall: 200 people .* 0.25 m .* 25.0 m2, about (\d+) "
    found = re.match(words, str(caught.value))
    assert found
    n_fitting = int(found[1])
    position = placed(shapely.box(0, 0, 5, 5), np.full(n_fitting, 0.25))
    assert least_gap(position, np.full(n_fitting, 0.25)) >= 0
    assert n_fitting > 0.75 * 25 / (np.pi * 0.25**2)


def test_ten_thousand_people_are_placed_in_a_second():
    radius = np.random.default_rng(0).uniform(0.2, 0.25, 10_000)
    placed(shapely.box(0, 0, 2, 2), radius[:14])
    start = time.process_time()
    for side in (100, 50):
        placed(shapely.box(0, 0, side, side), radius)
    assert time.process_time() - start < 2.0


def test_clearance_is_the_distance_to_the_nearest_segment():
    points = np.random.default_rng(1).uniform(-2, 2, (50, 2))
    segments = np.random.default_rng(2).uniform(-2, 2, (7, 4))
    lines = shapely.MultiLineString(segments.reshape(-1, 2, 2).tolist())
    expected = shapely.distance(lines, shapely.points(points))
    assert np.abs(clearance(points, segments) - expected).max() < 1e-12
    assert clearance(points, np.empty((0, 4))).tolist() == [np.inf] * 50
