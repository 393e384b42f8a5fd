"""References against exact answers and against each other."""

import math

import numpy as np
import pytest
import shapely

from evac.evidence.accuracy.fields import angles_between
from evac.evidence.accuracy.reference import ContactLaw, geodesics, gradient_matrix, refracted, solve_contact_qp

L_PLAN = shapely.Polygon([(0, 0), (8, 0), (8, 2), (2, 2), (2, 7), (0, 7)])
EXIT = np.array([8.0, 0.0, 8.0, 2.0])


def line_of_three(dissipation, mass=1.0):
    """Three discs touching in line, the first walks into the others at 1 m/s."""
    normal = np.array([[-1.0, 0.0], [-1.0, 0.0]])
    gradient = gradient_matrix(np.array([0, 1], np.int32), np.array([1, 2], np.int32), normal, 3)
    free = np.array([1.0, 0, 0, 0, 0, 0])
    law = ContactLaw(gradient, np.full(6, mass), free, np.zeros(2), gradient @ free, dissipation)
    return solve_contact_qp(law)[::2]


def test_qp_gives_the_known_velocities_of_three_in_line():
    pytest.importorskip("clarabel")
    assert line_of_three(0.0) == pytest.approx([1 / 3, 1 / 3, 1 / 3], abs=1e-10)
    assert line_of_three(10.0) == pytest.approx([-0.176471, 0.588235, 0.588235], abs=1e-6)


def test_qp_keeps_a_gap_open_no_more_than_needed():
    pytest.importorskip("clarabel")
    gradient = gradient_matrix(np.array([0], np.int32), np.array([-1], np.int32), np.array([[0.0, 1.0]]), 1)
    found = solve_contact_qp(
        ContactLaw(gradient, np.full(2, 80.0), np.array([1.0, -2.0]), np.array([0.5]), np.array([-2.0]), 0.0)
    )
    assert found == pytest.approx([1.0, -0.5], abs=1e-10)


def test_law_residual_sees_a_wrong_velocity_and_a_wrong_percussion():
    gradient = gradient_matrix(np.array([0], np.int32), np.array([-1], np.int32), np.array([[0.0, 1.0]]), 1)
    known = gradient, np.full(2, 80.0), np.array([0.0, -2.0]), np.zeros(1), np.array([-2.0]), 0.0
    assert ContactLaw(*known).residual(np.zeros(2), np.array([160.0])) == pytest.approx(0.0, abs=1e-12)
    assert ContactLaw(*known).residual(np.array([0.0, 0.1]), np.array([168.0])) == pytest.approx(0.1)
    assert ContactLaw(*known).residual(np.array([0.0, -0.1]), np.array([152.0])) == pytest.approx(0.1)


def test_geodesics_are_straight_where_the_exit_is_seen():
    length, direction, _ = geodesics(L_PLAN, EXIT, np.array([[3.0, 1.0], [0.5, 0.5]]))
    assert length == pytest.approx([5.0, 7.5])
    assert direction == pytest.approx(np.array([[1.0, 0.0], [1.0, 0.0]]))


def test_geodesics_turn_round_the_corner():
    point = np.array([1.0, 6.0])
    length, direction, lead = geodesics(L_PLAN, EXIT, point[None])
    to_corner = np.array([2.0, 2.0]) - point
    assert length[0] == pytest.approx(np.hypot(*to_corner) + 6.0, abs=1e-9)
    assert direction[0] == pytest.approx(to_corner / np.hypot(*to_corner))
    assert lead[0] == np.inf


def test_geodesics_know_the_second_best_way_round_a_pillar():
    plan = shapely.box(0, 0, 8, 6) - shapely.box(3, 2, 5, 4)
    points = np.array([[1.0, 3.0], [1.0, 2.9]])
    length, direction, lead = geodesics(plan, np.array([8.0, 2.9, 8.0, 3.1]), points)
    by = math.hypot(2.0, 1.0) + 2.0
    assert length[0] == pytest.approx(by + math.hypot(3.0, 0.9), abs=1e-9)
    assert lead[0] == pytest.approx(0.0, abs=1e-9)
    assert direction[1, 1] < 0.0 < lead[1]


def test_refraction_obeys_snell_and_equals_a_straight_line_at_equal_speeds():
    seam, door = np.array([4.0, 0.0, 4.0, 5.0]), np.array([7.0, 1.0, 7.0, 1.0 + 1e-9])
    point = np.array([[0.0, 4.0]])
    time, direction = refracted(point, [seam, door], [1.0, 1.0])
    assert time[0] == pytest.approx(math.hypot(7.0, 3.0), abs=1e-7)
    assert direction[0] == pytest.approx(np.array([7.0, -3.0]) / math.hypot(7.0, 3.0), abs=1e-4)
    shares = np.linspace(0.0, 5.0, 200_001)
    scanned = np.hypot(4.0, shares - 4.0) + 1.2 * np.hypot(3.0, shares - 1.0)
    time, direction = refracted(point, [seam, door], [1.0, 1.2])
    assert time[0] == pytest.approx(scanned.min(), abs=1e-7)
    crossing = np.array([4.0, shares[scanned.argmin()]])
    assert direction[0] == pytest.approx((crossing - point[0]) / np.hypot(*(crossing - point[0])), abs=1e-4)
    beyond = np.array([7.0, 1.0]) - crossing
    assert direction[0, 1] == pytest.approx(1.2 * beyond[1] / np.hypot(*beyond), abs=1e-4)


def test_no_direction_counts_as_the_opposite_one():
    one = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
    other = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    assert angles_between(one, other) == pytest.approx([90.0, 180.0, 0.0])
