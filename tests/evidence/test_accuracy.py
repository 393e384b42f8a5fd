"""The parts of the accuracy page: what they compute, on small problems."""

import csv

import numpy as np
import pytest

from evac.evidence.accuracy import targets
from evac.evidence.accuracy.fields import _fields, plain_directions
from evac.evidence.accuracy.orders import EXACT, order_of, order_rows, orders_off
from evac.evidence.accuracy.orders import draw as draw_orders
from evac.evidence.accuracy.overlap import FINISHED, cheapest_rows
from evac.evidence.accuracy.overlap import draw as draw_overlap
from evac.evidence.accuracy.plans import l_corner
from evac.evidence.accuracy.problems import LAWS, contact_problem, snapshots, velocity_error
from evac.evidence.accuracy.solvers import TOLERANCES, factor_rows, measure, race_rows, time_to, win_rows
from evac.evidence.accuracy.trajectories import LARGEST, PHASES, PROBLEMS, SPEED, SPREAD, VARIANTS, shifts_of, walked
from evac.evidence.evidence import Evidence
from evac.evidence.scenes import plugins
from evac.evidence.verdicts import MET

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


def test_targets_are_told_under_every_law_as_medians_over_several_crowds(monkeypatch, tmp_path):
    """Seconds by solver and crowd, made up: the default takes 1 s, Gauss-Seidel 20 to 40, Uzawa 50."""
    seconds = {"accelerated_sweeps": 1.0, "uzawa": 50.0}
    crowds = iter(np.repeat([20.0, 25.0, 31.0, 35.0, 40.0], 2 * len(LAWS)))
    monkeypatch.setattr(targets, "snapshots", lambda people, seed: {"settled": 0, "arriving": 0})
    monkeypatch.setattr(targets, "contact_problem", lambda crowd, law: law)
    monkeypatch.setattr(targets, "seconds_to", lambda problem, solver, goal: seconds.get(solver) or next(crowds))
    evidence = Evidence("accuracy", tmp_path)
    targets.run(evidence)
    with (tmp_path / "solvers_targets.csv").open() as file:
        rows = list(csv.DictReader(file))
    first, second, third, fourth = rows[:4]
    assert len(rows) == 4 * len(LAWS)
    assert first["what"] == "settled, NSM1, to 1e-06 m: gauss_seidel / accelerated_sweeps"
    assert [first[key] for key in ("measured", "least", "greatest", "verdict")] == ["31.0", "20.0", "40.0", MET]
    assert (second["wanted"], second["measured"], second["verdict"] == MET) == ("at least 60", "50.0", False)
    assert third["what"] == "arriving, NSM1, to 0.0001 m: gauss_seidel / accelerated_sweeps"
    assert (fourth["wanted"], fourth["measured"], fourth["verdict"] == MET) == ("at most 300", "1000.0", False)
    assert rows[-1]["what"] == "settled, NSM2, K_N = 1e5, to 1e-10 m/s: accelerated_sweeps [ms]"
    assert sum(row["verdict"] == MET for row in rows) == 2 * len(LAWS)


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


def test_opening_the_door_leaves_the_settled_crowd_as_it_was(crowds):
    settled, opened = crowds["settled"], crowds["opened"]
    assert settled.engine.state.world.link_open[0] == 0
    assert opened.engine.state.world.link_open[0] == 1
    assert opened.step == settled.step + 5
    assert not np.array_equal(settled.crowd.position, opened.crowd.position)


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


def test_who_overshoots_a_goal_is_told_the_time_at_which_it_passed_it():
    """Error falls as time^-2: 1 s for 1e-2, 100 s for 1e-6; on the way it is 1e-4 at 10 s."""
    rows = [{"time [s]": 1.0, "error": 1e-2}, {"time [s]": 100.0, "error": 1e-6}]
    assert time_to(rows, 1e-4, "error") == pytest.approx(10.0)
    assert time_to(rows, 1e-6, "error") == pytest.approx(100.0)
    assert time_to(rows, 1e-7, "error") is None


def made_up_solves():
    """Solves in which the default is the first by residual, from a cold start, and conjugate_faces by error, warm."""
    rows = []
    for start in ("cold", "warm"):
        for solver in SOLVERS:
            span = {"accelerated_sweeps": 1.0, "conjugate_faces": 2.0 if start == "cold" else 0.25}.get(solver, 8.0)
            head = {"people": 10, "crowd": "settled", "law": "NSM1", "contacts": 20, "solver": solver, "start": start}
            error = 1e-7 if (solver, start) == ("accelerated_sweeps", "warm") else 1e-9
            rows.append(head | {"time [s]": span, "residual": 1e-9, "error": error})
    return rows


def test_wins_are_told_where_another_solver_has_them():
    rows = made_up_solves()
    races = list(race_rows(rows, "accelerated_sweeps"))
    wins = {(row["start"], row["by"], row["to"]): row for row in win_rows(races, SOLVERS, "accelerated_sweeps")}
    assert wins["cold", "error", "1e-06"]["accelerated_sweeps"] == 1
    assert wins["warm", "residual", "1e-06"]["conjugate_faces"] == 1
    assert wins["warm", "residual", "1e-06"]["greatest"] == pytest.approx(4.0)
    assert wins["warm", "error", "1e-08"]["never there"] == 1


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


def test_measured_orders_are_told_with_those_that_are_not_the_theoretical_ones():
    head = {"problem": "wall hit", "drive": "explicit", "error / (v h)": 0.1, "theory": 1}
    steps = [0.04 / 2**k for k in range(6)]
    rows = [{**head, "model": "DEM", "h [s]": h, "error [m]": 3.0 * h**2} for h in steps]
    rows += [{**head, "model": "NSM2, K_N = 0", "h [s]": h, "error [m]": 2.0 * h} for h in steps]
    rows += [{**head, "model": "NSM1 inertial", "h [s]": h, "error [m]": 1e-12} for h in steps]
    first, second, third = order_rows(rows)
    assert (first["measured order"], second["measured order"]) == pytest.approx((2.0, 1.0))
    assert third["measured order"] is None
    assert orders_off([first, second, third]) == [first]
    figure = draw_orders(rows, "h [s]")
    drawn = np.concatenate([line.get_ydata() for line in figure.axes[0].lines])
    assert min(drawn) >= EXACT
    assert "exact: NSM1 inertial" in {text.get_text() for text in figure.axes[0].texts}


def test_a_run_that_stopped_is_never_the_cheapest_and_stands_apart():
    runs = [
        ("DEM", 1e4, 5.0, 0.01, "stopped: through a wall"),
        ("DEM", 1e5, 5.0, 0.4, FINISHED),
        ("NSM1 inertial", 1e-3, 0.5, 0.2, FINISHED),
    ]
    keys = ("model", "value", "greatest overlap [mm]", "time per simulated second [s]", "outcome")
    rows = [{"varied": "k", **dict(zip(keys, run, strict=True))} for run in runs]
    table = {row["overlap allowed [mm]"]: row for row in cheapest_rows(rows)}
    assert (table["10"]["cheapest here"], table["10"]["setting"]) == ("NSM1 inertial", "k = 0.001")
    assert table["10"]["DEM / cheapest"] == pytest.approx(2.0)
    assert table["0.1"]["cheapest here"] is None
    assert table["3"]["DEM / cheapest"] is None
    (axis,) = draw_overlap(rows, 3).axes
    joined = {line.get_label(): len(line.get_xdata()) for line in axis.lines}
    assert joined["DEM: k"] == joined["DEM: stopped with an error"] == 1


def test_order_of_a_power_law():
    steps = [0.1, 0.05, 0.025]
    assert order_of(steps, [3.0 * h**2 for h in steps]) == pytest.approx(2.0)


def test_plain_gradients_point_straight_where_no_wall_is_near():
    plan = l_corner(60, np.random.default_rng(0))
    fields = _fields(plan, 0.1, 2)
    clear = (plan.points[:, 0] > 3.0) & (plan.wall_distance > 0.5)
    assert clear.any()
    assert plain_directions(fields, plan)[clear, 0] == pytest.approx(1.0, abs=0.01)
