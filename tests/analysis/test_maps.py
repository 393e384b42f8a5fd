"""Maps against what is known of one person who stands or walks."""

from types import SimpleNamespace

import numpy as np
import pytest
from shapely.geometry import Polygon, box

from evac.analysis.cells import Densities, Grid
from evac.analysis.maps import QUANTITIES, level_maps
from evac.trajectory.trajectory import read_trajectory

R = 0.5


def integral(maps, name):
    return np.nansum(maps.array(name)) * maps.spacing**2


@pytest.fixture
def standing(written):
    """One person at the centre of floor 0 for 10 s, pressed by 100 N."""
    return written(np.full((11, 1, 2), [5.05, 3.05]), force=100.0, radius=0.23).maps(
        ["floor 0"], spacing=0.1, kernel_radius=R
    )


@pytest.fixture
def walking(written):
    """One person who walks along x at 2 m/s, from 1 m to 9 m, recorded once a second; then out."""
    position = [[[1.0 + 2.0 * k, 3.05]] for k in range(6)]
    level = [[0]] * 5 + [[-1]]
    return written(position, level).maps(["floor 0"], spacing=0.1, kernel_radius=R)["floor 0"]


def test_density_is_the_kernel_and_its_integral_the_number_of_people(standing):
    maps = standing["floor 0"]
    assert integral(maps, "density") == pytest.approx(1.0, rel=1e-3)
    assert np.nanmax(maps.density) == pytest.approx(1.0 / (np.pi * R**2), rel=0.02)
    distance = np.hypot(*np.meshgrid(maps.x - 5.05, maps.y - 3.05))
    np.testing.assert_allclose(maps.density, np.exp(-((distance / R) ** 2)) / (np.pi * R**2), atol=0.02)
    np.testing.assert_allclose(maps.max_density, maps.density)


def test_who_stands_waits_and_covers_the_disc_of_the_body(standing):
    maps = standing["floor 0"]
    assert integral(maps, "waiting") == pytest.approx(10.0, rel=1e-3)
    covered = np.hypot(*np.meshgrid(maps.x - 5.05, maps.y - 3.05)) <= 0.23
    np.testing.assert_array_equal(maps.usage, covered)
    np.testing.assert_array_equal(maps.time_to_clear, np.where(covered, np.inf, np.nan))
    np.testing.assert_allclose(maps.contact_pressure, np.where(covered, 100.0 / (2.0 * np.pi * 0.23), 0.0), rtol=1e-6)
    assert np.nanmax(maps.flow) == np.nanmax(maps.speed) == 0.0


def test_a_body_covers_cells_whose_centres_are_on_its_edge(written):
    maps = written(np.full((2, 1, 2), [5.25, 3.25]), radius=0.5).maps(["floor 0"], spacing=0.5)
    assert np.nansum(maps["floor 0"].usage) == 5.0


def test_a_walk_has_no_gaps_between_recorded_times(walking):
    """Frames are 2 m apart, cells 0.1 m."""
    x, y = np.meshgrid(walking.x, walking.y)
    path = (np.abs(y - 3.05) < 0.12) & (x > 0.9) & (x < 9.1)
    assert (walking.usage[path] == 1.0).all()
    assert (walking.usage[np.abs(y - 3.05) > 0.25] == 0.0).all()
    inner = (np.abs(y - 3.05) < 0.01) & (x > 1.0) & (x < 8.7)
    # The body has left a place when its centre is one radius further, to the way walked in one piece of a second.
    np.testing.assert_allclose(walking.time_to_clear[inner], (x[inner] + 0.2 - 1.0) / 2.0, atol=0.06)
    assert np.isnan(walking.time_to_clear[np.abs(y - 3.05) > 0.25]).all()


def test_speed_and_flow_of_a_walk(walking):
    assert np.nanmin(walking.speed) == pytest.approx(2.0, rel=1e-5)
    assert np.nanmax(walking.speed) == pytest.approx(2.0, rel=1e-5)
    # Inside for 4 of the 5 s, by the trapezoidal rule 4.5: the last frame with somebody counts for 1 s.
    assert integral(walking, "density") == pytest.approx(4.5 / 5.0, rel=1e-3)
    assert integral(walking, "flow") == pytest.approx(2.0 * 4.5 / 5.0, rel=1e-3)
    assert integral(walking, "waiting") == 0.0


def test_beside_walls_nobody_is_lost(written):
    maps = written([[[0.1, 0.1]], [[0.1, 0.1]]]).maps(["floor 0"], kernel_radius=1.0, spacing=0.05)["floor 0"]
    assert integral(maps, "density") == pytest.approx(1.0, abs=0.02)
    assert integral(maps, "waiting") == pytest.approx(1.0, abs=0.02)


def test_opposite_flows_cancel(written):
    crossing = [[[4.0 + 0.1 * k, 3.0], [4.4 - 0.1 * k, 3.0]] for k in range(5)]
    maps = written(crossing, interval=0.1).maps(["floor 0"])["floor 0"]
    assert np.nanmax(maps.speed) == pytest.approx(1.0, rel=1e-5)
    assert integral(maps, "flow") < 0.3


def test_two_people_are_counted_and_one_who_returns_is_not_counted_twice(written):
    there_and_back = [[[3.0, 3.0], [4.0, 3.0]], [[4.0, 3.0], [3.0, 3.0]], [[3.0, 3.0], [4.0, 3.0]]]
    maps = written(there_and_back).maps(["floor 0"])["floor 0"]
    column, row = int(3.5 / maps.spacing), int(3.0 / maps.spacing)
    assert maps.usage[row, column] == 2.0


def test_a_window_of_one_frame_is_the_state_at_that_time(written):
    trajectory = written([[[1.0, 1.0]], [[5.0, 3.0]], [[9.0, 5.0]]])
    maps = level_maps(trajectory, [0], start=1.0, end=1.0)["floor 0"]
    row, column = np.unravel_index(np.nanargmax(maps.density), maps.shape)
    assert (maps.x[column], maps.y[row]) == (pytest.approx(5.0, abs=0.2), pytest.approx(3.0, abs=0.2))
    assert integral(maps, "density") == pytest.approx(1.0, rel=1e-3)
    assert (maps.start, maps.end) == (1.0, 1.0)
    assert np.nansum(maps.waiting) == 0.0


def test_outside_the_floor_is_nan_and_rows_rise_with_y(descent):
    maps = read_trajectory(descent(people=6, frames=5, shift=(0.1, -3.05)).path).maps(spacing=0.2)
    assert list(maps) == ["floor 0", "flight 1", "floor 1", "flight 2", "floor 2"]
    flight = maps["flight 2"]
    assert flight.extent == pytest.approx((10.0, 14.2, -1.2, 1.0))
    assert flight.shape == (11, 21)
    assert np.diff(flight.y).min() > 0
    for name in QUANTITIES:
        outside = np.isnan(flight.density)
        assert np.isnan(flight.array(name)[outside]).all()
    np.testing.assert_array_equal(np.isnan(flight.density)[0], True)  # its centre is below the floor
    assert not np.isnan(flight.density)[2:-2, 2:-2].any()


def test_the_greatest_density_is_that_of_the_smoothed_floor_at_any_time():
    grid = Grid(SimpleNamespace(polygon=box(0.0, 0.0, 30.0, 12.0)), 0.2, 0.7)
    frame, position = np.array([0, 0, 3]), np.array([[7.1, 0.1], [7.9, 2.0], [8.4, 11.9]])
    densities = Densities(grid, np.arange(4.0))
    densities.add(frame, position)
    single = [
        grid.smoothed(grid.gathered(here, np.ones(len(here))))[0]
        for here in (position[frame == 0], position[frame == 3])
    ]
    np.testing.assert_allclose(densities.greatest, np.maximum(*single).ravel(), rtol=1e-12)


def test_holes_are_not_floor():
    floor = Polygon(box(0.0, 0.0, 4.0, 4.0).exterior, [box(1.0, 1.0, 3.0, 3.0).exterior])
    grid = Grid(SimpleNamespace(polygon=floor), 0.5, 0.7)
    assert grid.on_floor.sum() == 64 - 16
    assert grid.smoothed(grid.gathered(np.array([[0.5, 2.0]]), np.ones(1))).sum() * 0.25 == pytest.approx(1.0, abs=0.05)
