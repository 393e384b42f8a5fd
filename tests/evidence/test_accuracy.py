"""The parts of the accuracy page: what they compute, on small problems."""

import csv
import math

import numpy as np
import pytest

from evac.evidence import accuracy_asked
from evac.evidence.accuracy_data import add_data, order_of
from evac.evidence.accuracy_egress import flow_of
from evac.evidence.accuracy_fields import _fields, plain_directions
from evac.evidence.accuracy_plans import l_corner
from evac.evidence.accuracy_problems import LAWS, contact_problem, snapshots, velocity_error
from evac.evidence.accuracy_solvers import ASKED, default_rows, measure, time_to
from evac.evidence.accuracy_trajectories import PROBLEMS, VARIANTS, walked
from evac.evidence.report import Evidence
from evac.physics.solvers import SOLVERS
from evac.registry import Registry


@pytest.fixture(scope="module")
def registry():
    return Registry()


@pytest.fixture(scope="module")
def crowds(registry):
    return snapshots(40, 1, registry)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.label)
@pytest.mark.parametrize("solver", SOLVERS)
def test_solvers_agree_with_the_independent_reference(crowds, registry, law, solver):
    pytest.importorskip("clarabel")
    problem = contact_problem(crowds["settled"], law, registry)
    truth = problem.reference()
    problem.start(False)
    _, found = problem.solve(solver, 1e-9, 500_000)
    assert found <= 1e-9
    assert velocity_error(problem, truth) < 1e-6
    assert problem.size > 40


def test_what_was_asked_is_told_as_it_is_over_several_crowds(monkeypatch, tmp_path):
    """Seconds by solver and crowd, made up: the default takes 1 s, Gauss-Seidel 20 to 40, Uzawa 70."""
    seconds = {"accelerated_sweeps": 1.0, "uzawa": 70.0}
    crowds = iter(np.repeat([20.0, 25.0, 31.0, 35.0, 40.0], 5))
    monkeypatch.setattr(accuracy_asked, "snapshots", lambda people, seed, registry: {"settled": 0, "arriving": 0})
    monkeypatch.setattr(accuracy_asked, "contact_problem", lambda crowd, law, registry: law)
    monkeypatch.setattr(accuracy_asked, "seconds_to", lambda problem, solver, goal: seconds.get(solver) or next(crowds))
    evidence = Evidence("accuracy", tmp_path)
    accuracy_asked.run(evidence)
    with (tmp_path / "solvers_asked.csv").open() as file:
        rows = list(csv.DictReader(file))
    first, second, *others, last = rows
    assert first["what"] == "settled, NSM1, to 1e-06 m: gauss_seidel / accelerated_sweeps"
    assert (first["measured"], first["least"], first["greatest"], first["met"]) == ("31.0", "20.0", "40.0", "yes")
    assert (second["measured"], second["met"]) == ("70.0", "yes")
    assert [float(row["asked"].split()[-1]) for row in others] == [10.0, 30.0, 30.0, 30.0]
    assert (last["asked"], last["measured"], last["met"]) == ("at most 300", "1000.0", "no")


def test_the_warm_start_is_nearer_to_the_solution_of_a_settled_crowd(crowds, registry):
    problem = contact_problem(crowds["settled"], LAWS[0], registry)
    first = {}
    for is_warm in (False, True):
        problem.start(is_warm)
        _, first[is_warm] = problem.solve("gauss_seidel", 0.0, 1)
    assert first[True] < 0.5 * first[False]


def test_the_contact_problem_is_the_one_that_the_model_solved(crowds, registry):
    """The percussions that the model left in its contacts satisfy the problem's law to the model's tolerance."""
    problem = contact_problem(crowds["settled"], LAWS[0], registry)
    held = problem.contacts.impulse[: problem.size].copy()
    problem.start(False)
    problem.contacts.impulse[: problem.size] = held
    _, found = problem.solve("gauss_seidel", 1e300, 1)
    assert found <= 1.001 * LAWS[0].make(registry).values()["velocity_tolerance"]


def test_opening_the_door_leaves_the_settled_crowd_as_it_was(crowds):
    settled, opened = crowds["settled"], crowds["opened"]
    assert settled.engine.world.link_open[0] == 0
    assert opened.engine.world.link_open[0] == 1
    assert opened.step == settled.step + 5
    assert not np.array_equal(settled.crowd.position, opened.crowd.position)


def test_measured_solves_reach_what_is_asked_and_stop_where_they_do_not(crowds, registry):
    problem = contact_problem(crowds["settled"], LAWS[1], registry)
    truth = np.zeros_like(problem.free)
    rows = measure(problem, truth, SOLVERS[-1], False, 0.05)
    assert all(row["residual"] <= row["asked"] for row in rows[:-1])
    assert [row["asked"] for row in rows] == list(ASKED[: len(rows)])
    slow = measure(problem, truth, "uzawa", False, 0.0)
    assert slow[-1]["residual"] > slow[-1]["asked"]


def test_times_to_a_goal_count_only_what_reached_it():
    head = {"people": 10, "crowd": "settled", "law": "NSM1", "start": "cold"}
    rows = [
        head | {"solver": "accelerated", "asked": 1e-6, "residual": 5e-7, "time [s]": 0.01},
        head | {"solver": "uzawa", "asked": 1e-6, "residual": 5e-4, "time [s]": 0.5},
        head | {"solver": "clarabel", "asked": None, "residual": None, "time [s]": 0.2},
    ]
    assert time_to(rows, 1e-6, solver="accelerated") == 0.01
    assert time_to(rows, 1e-6, solver="uzawa") is None
    others = [head | {"solver": s, "asked": 1e-6, "residual": 1.0, "time [s]": 0.5} for s in SOLVERS]
    table = default_rows([*rows, *others], "accelerated")
    assert table[0]["uzawa / accelerated"] == "> 50"
    assert table[0]["clarabel / accelerated"] == "20"


@pytest.mark.parametrize("problem", PROBLEMS, ids=lambda problem: problem.name)
def test_every_problem_can_be_walked(registry, problem):
    before = problem.scene(0.0).crowd.position
    after, _ = walked(problem, registry.get("contact_model", "nsm1")(), 0.0, 0.05, "exponential")
    assert np.isfinite(after).all()
    assert np.abs(after - before).max() > 1e-3


@pytest.mark.parametrize("problem", [p for p in PROBLEMS if p.exact], ids=lambda problem: problem.name)
@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant[0])
def test_exact_solutions_are_what_small_steps_tend_to(registry, problem, variant):
    _, plugin, parameters = variant
    model = registry.get("contact_model", plugin)(**parameters)
    errors = []
    for step in (0.004, 0.001):
        found, _ = walked(problem, model, 0.0, step, "exponential")
        errors.append(float(np.abs(found - problem.exact(plugin, parameters, 0.0)).max()))
    assert errors[1] < 2e-3
    assert errors[1] < max(0.9 * errors[0], 1e-9)


def test_order_of_a_power_law():
    steps = [0.1, 0.05, 0.025]
    assert order_of(steps, [3.0 * h**2 for h in steps]) == pytest.approx(2.0)


def test_flow_of_evenly_spaced_exits_and_of_a_blocked_run():
    assert flow_of(np.array([3.0, 1.0, 2.0, 4.0])) == pytest.approx(60.0)
    assert flow_of(np.array([1.0, math.nan, 2.0])) is None


def test_plain_gradients_point_straight_where_no_wall_is_near():
    plan = l_corner(60, np.random.default_rng(0))
    fields = _fields(plan, 0.1, 2)
    clear = (plan.points[:, 0] > 3.0) & (plan.wall_distance > 0.5)
    assert clear.any()
    assert plain_directions(fields, plan)[clear, 0] == pytest.approx(1.0, abs=0.01)


def test_data_is_written_with_full_precision(tmp_path):
    evidence = Evidence("accuracy", tmp_path, quick=True)
    add_data(evidence, "numbers", [{"x [m]": 1 / 3}], "A third")
    assert (tmp_path / "numbers.csv").read_text() == f"x [m]\n{1 / 3!r}\n"
