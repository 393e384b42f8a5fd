"""The parts of the accuracy page: what they compute, on small problems."""

import math

import numpy as np
import pytest
import shapely

from evac.directions.build import BEND
from evac.evidence.accuracy import siconos
from evac.evidence.accuracy.problems import LAWS, contact_problem, snapshots, velocity_error
from evac.evidence.accuracy.reference import (
    ContactLaw,
    _directions,
    clean_ways,
    geodesics,
    gradient_matrix,
    refracted,
    solve_contact_qp,
    sweep,
    wall_distances,
)
from evac.evidence.accuracy.trajectories import (
    PROBLEMS,
    VARIANTS,
    walked,
)
from evac.evidence.directions.page import angles_between, l_corner
from evac.evidence.scenes import plugins

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


SOLVERS = tuple(plugins().solvers)


@pytest.fixture(scope="module")
def crowds():
    return snapshots(40, 1)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.label)
@pytest.mark.parametrize("solver", SOLVERS)
def test_solvers_agree_with_the_independent_reference(crowds, law, solver):
    pytest.importorskip("clarabel")
    problem = contact_problem(crowds["settled"], law)
    truth = problem.reference()
    problem.start(False)
    _, found = problem.solve(solver, 1e-9, 500_000)
    assert found <= 1e-9
    assert velocity_error(problem, truth) < 1e-6
    assert problem.size > 40


def test_the_contact_problem_is_the_one_that_the_model_solved(crowds):
    """The percussions that the model left in its contacts satisfy the problem's law to the model's tolerance."""
    problem = contact_problem(crowds["settled"], LAWS[0])
    held = problem.state.contacts.percussion[: problem.size].copy()
    problem.start(False)
    problem.state.contacts.percussion[: problem.size] = held
    _, found = problem.solve("gauss_seidel", 1e300, 1)
    assert found <= 1.001 * LAWS[0].make().values()["velocity_tolerance"]


@pytest.mark.parametrize("problem", [p for p in PROBLEMS if p.exact], ids=lambda problem: problem.name)
@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant[0])
def test_exact_solutions_are_what_small_steps_tend_to(problem, variant):
    _, plugin, parameters = variant
    model = plugins().get("contact_model", plugin)(**parameters)
    errors = []
    for step in (0.004, 0.001):
        found, _ = walked(problem, model, 0.0, step, "exponential")
        errors.append(float(np.abs(found - problem.exact(plugin, parameters, 0.0)).max()))
    assert errors[1] < 2e-3
    assert errors[1] < max(0.9 * errors[0], 1e-9)


@pytest.mark.parametrize("name", siconos.METHODS)
def test_siconos_is_given_the_problem_of_evac(name):
    """Percussions of evac have the residual that it states; those of siconos, if installed, solve the problem."""
    method, problem = siconos.METHODS[name], contact_problem(snapshots(60, 1)["settled"], LAWS[0])
    problem.start(False)
    _, stated = problem.solve("gauss_seidel", 1e-3, 10_000)
    contacts = problem.state.contacts
    scaled = (contacts.percussion * np.sqrt(contacts.omega))[: problem.size]
    assert siconos.residual(problem, scaled) == pytest.approx(stated, rel=1e-6)
    matrix, vector = siconos.delassus(problem, method.unknowns)
    assert matrix.diagonal() == pytest.approx(1.0)
    if siconos.library() is not None:
        found = np.zeros(len(vector))
        siconos.solve(siconos.store(matrix, method), method, vector, found, 1e-12)
        assert siconos.residual(problem, found[:: method.unknowns]) < 1e-9


def test_sweeping_from_a_line_over_a_seam_of_slowness_is_exact():
    cost = np.full((40, 7), np.inf)
    cost[0] = 0.0
    slowness = np.ones_like(cost)
    slowness[21:] = 3.0
    slowness[:, 3] = np.where(np.arange(40) == 30, np.inf, slowness[:, 3])
    sweep(cost, slowness, 0.1)
    assert cost[20] == pytest.approx(2.0)
    assert cost[25] == pytest.approx(2.0 + 3.0 * 0.5)
    assert cost[30, 3] == np.inf


def test_sweeping_from_a_point_is_of_first_order():
    errors = []
    for number in (41, 81):
        axis = np.linspace(-1.0, 1.0, number)
        distance = np.hypot(*np.meshgrid(axis, axis, indexing="ij"))
        cost = np.where(distance < 0.3, distance, np.inf)
        sweep(cost, np.ones_like(cost), axis[1] - axis[0])
        errors.append(np.abs(cost - distance).max())
    assert errors[1] < 0.65 * errors[0] < 0.03


def test_distances_to_walls_are_those_of_the_library():
    walls = np.array([[0.2, 0.1, 1.4, 0.9], [1.0, 1.5, 1.0, 0.2]])
    x, y = np.meshgrid(np.arange(0.0, 2.0, 0.05), np.arange(0.0, 1.8, 0.05), indexing="ij")
    exact = shapely.distance(shapely.multilinestrings(walls.reshape(-1, 2, 2)), shapely.points(x, y))
    assert wall_distances(walls, x, y, 0.3) == pytest.approx(np.minimum(exact, 0.3))


def test_ways_in_the_middle_go_straight_and_beside_a_wall_lead_away_from_it_as_refraction_says():
    """Along a straight corridor the cost to go grows by 1 per metre, so that across it is sqrt(s^2 - 1)."""
    plan = l_corner(10, np.random.default_rng(0))
    places = np.array([[5.0, 1.0], [4.5, 0.1], [4.5, 1.9]])
    ways = clean_ways(plan.building, places, 0.25, 0.0125)
    slowness = 1.0 + BEND * (1.0 - 0.1 / 0.25) ** 2
    across = np.sqrt(1.0 - 1.0 / slowness**2)
    exact = np.array([[1.0, 0.0], [1.0 / slowness, across], [1.0 / slowness, -across]])
    assert angles_between(ways.direction, exact) == pytest.approx(0.0, abs=2.0)


def test_places_where_two_ways_meet_are_known():
    """Exits on both sides: in the middle neither way is better."""
    cost = np.tile(np.minimum(np.arange(41), 40 - np.arange(41))[:, None] * 0.1, (1, 11))
    cost = np.pad(cost, 1, constant_values=np.inf)
    ways = _directions(cost, np.ones_like(cost), np.array([[9.0, 6.0], [18.0, 6.0], [24.0, 6.0]]), 0.1)
    assert ways.direction == pytest.approx(np.array([[-1.0, 0.0], [-1.0, 0.0], [1.0, 0.0]]))
    assert ways.to_meeting == pytest.approx([1.2, 0.3, 0.3])
