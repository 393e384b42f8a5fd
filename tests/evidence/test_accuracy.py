"""The parts of the accuracy page: what they compute, on small problems."""

import csv

import numpy as np
import pytest

from evac.evidence.accuracy import targets
from evac.evidence.accuracy.fields import _fields, plain_directions
from evac.evidence.accuracy.orders import order_of
from evac.evidence.accuracy.plans import l_corner
from evac.evidence.accuracy.problems import LAWS, contact_problem, snapshots, velocity_error
from evac.evidence.accuracy.solvers import TOLERANCES, factor_rows, measure, time_to
from evac.evidence.accuracy.trajectories import LARGEST, PHASES, PROBLEMS, SPEED, SPREAD, VARIANTS, shifts_of, walked
from evac.evidence.evidence import Evidence
from evac.evidence.scenes import plugins

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


def test_people_in_rows_touch_and_every_solver_is_timed_on_them(tmp_path, monkeypatch):
    """Some of the contacts push, and every solver is timed or said to have been given its time."""
    monkeypatch.setattr(targets, "LAWS", LAWS[:2])
    evidence = Evidence("accuracy", tmp_path, quick=True)
    targets.run_rows(evidence)
    with (tmp_path / "solvers_rows.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["to"] for row in rows] == ["0.0001 m", "1e-06 m", "0.0001 m/s", "1e-06 m/s"]
    for row in rows:
        assert int(row["contacts"]) > 200  # of 100 people
        times = {solver: float(row[solver].lstrip("> ")) for solver in SOLVERS}
        assert 0.0 < times[row["first"]] == min(times.values())  # two can be equal to three digits


def test_the_warm_start_is_nearer_to_the_solution_of_a_settled_crowd(crowds):
    problem = contact_problem(crowds["settled"], LAWS[0])
    first = {}
    for is_warm in (False, True):
        problem.start(is_warm)
        _, first[is_warm] = problem.solve("gauss_seidel", 0.0, 1)
    assert first[True] < 0.5 * first[False]


def test_the_contact_problem_is_the_one_that_the_model_solved(crowds):
    """The percussions that the model left in its contacts satisfy the problem's law to the model's tolerance."""
    problem = contact_problem(crowds["settled"], LAWS[0])
    held = problem.state.contacts.percussion[: problem.size].copy()
    problem.start(False)
    problem.state.contacts.percussion[: problem.size] = held
    _, found = problem.solve("gauss_seidel", 1e300, 1)
    assert found <= 1.001 * LAWS[0].make().values()["velocity_tolerance"]


def test_measured_solves_reach_their_tolerance_and_stop_where_they_do_not(crowds):
    problem = contact_problem(crowds["settled"], LAWS[1])
    truth = np.zeros_like(problem.free)
    rows = list(measure(problem, truth, "accelerated_sweeps", False, 0.05))
    assert all(row["residual"] <= row["tolerance"] for row in rows[:-1])
    assert [row["tolerance"] for row in rows] == list(TOLERANCES[: len(rows)])
    slow = list(measure(problem, truth, "uzawa", False, 0.0))
    assert slow[-1]["residual"] > slow[-1]["tolerance"]


def test_times_to_a_goal_count_only_what_reached_it():
    head = {"people": 10, "crowd": "settled", "law": "NSM1", "start": "cold"}
    rows = [
        head | {"solver": "accelerated_sweeps", "residual": 5e-7, "time [s]": 0.01},
        head | {"solver": "uzawa", "residual": 5e-4, "time [s]": 0.5},
    ]
    assert time_to(rows, 1e-6, solver="accelerated_sweeps") == 0.01
    assert time_to(rows, 1e-6, solver="uzawa") is None


def test_the_error_is_compared_with_the_residual_where_the_reference_can_tell():
    row = {"people": 10, "crowd": "settled", "law": "NSM1", "solver": "uzawa", "start": "cold"}
    rows = [row | {"residual": 1e-4, "error": 3e-4}, row | {"residual": 1e-5, "error": 2e-4}]
    rows.append(row | {"residual": 1e-12, "error": 5e-11})
    (found,) = factor_rows(rows, {"NSM1": 0.01})
    assert (found["solves"], found["least"], found["greatest"]) == pytest.approx((2, 3.0, 20.0))


@pytest.mark.parametrize("problem", PROBLEMS, ids=lambda problem: problem.name)
def test_every_problem_can_be_walked(problem):
    before = problem.scene(0.0).crowd.position
    after, _ = walked(problem, plugins().get("contact_model", "nsm1")(), 0.0, 0.05, "exponential")
    assert np.isfinite(after).all()
    assert np.abs(after - before).max() > 1e-3


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


def test_places_of_starts_fall_everywhere_in_a_step_whatever_the_step():
    """Not all into the same part of it, as places at whole parts of a distance do."""
    shifts = np.array(shifts_of(PHASES[1]))
    assert 0.0 <= shifts.min() < shifts.max() <= SPREAD
    for k in range(7):
        path = SPEED * LARGEST / 2**k
        filled, _ = np.histogram(shifts % path / path, bins=8, range=(0.0, 1.0))
        assert filled.min() > 0


def test_order_of_a_power_law():
    steps = [0.1, 0.05, 0.025]
    assert order_of(steps, [3.0 * h**2 for h in steps]) == pytest.approx(2.0)


def test_plain_gradients_point_straight_where_no_wall_is_near():
    plan = l_corner(60, np.random.default_rng(0))
    fields = _fields(plan, 0.1, 2)
    clear = (plan.points[:, 0] > 3.0) & (plan.wall_distance > 0.5)
    assert clear.any()
    assert plain_directions(fields, plan)[clear, 0] == pytest.approx(1.0, abs=0.01)
