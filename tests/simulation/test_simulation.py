"""The loop: what is left out changes no bit, a run goes on where it stopped, it ends for a reason."""

import itertools
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from evac.base.errors import ScenarioError
from evac.case.loading import load_case
from evac.results.ending import DURATION_OVER, EVERYBODY_OUT, NO_PROGRESS
from evac.results.reading import read_results
from evac.simulation.simulation import Simulation
from evac.trajectory.trajectory import read_trajectory
from tests.runs import MODELS, SQUEEZED, assert_same_bits, in_the_room, model_of, run_ticks


@pytest.mark.parametrize("model", MODELS)
def test_square_room_empties(model):
    simulation = Simulation(load_case("square_room", model_of(model)))
    results = simulation.run()
    assert simulation.ended == EVERYBODY_OUT
    assert simulation.time == simulation.step * 0.01
    assert results.number_of_people == 20
    crowd = simulation.population.crowd
    assert (crowd.level == -1).all()
    assert (crowd.exit_used == 0).all()
    assert ((crowd.exit_time > 0) & (crowd.exit_time <= simulation.time)).all()
    assert results.report["unconverged_steps"] == 0
    assert results.report["wall_crossings_prevented"] == 0


def test_a_simulation_takes_the_name_of_a_case_and_of_a_folder(tmp_path):
    results = Simulation("square_room", str(tmp_path / "walk")).run()
    assert len(read_trajectory(tmp_path / "walk")) > 0
    results.write(str(tmp_path / "walk"))
    assert read_results(tmp_path / "walk").last_out == results.last_out


@pytest.mark.parametrize("model", MODELS)
def test_same_seed_same_bits(model):
    one, other = (run_ticks(Simulation(load_case("square_room", model_of(model))), 60) for _ in range(2))
    assert_same_bits(one, other)
    third = run_ticks(Simulation(load_case("square_room", model_of(model) | {"simulation.seed": 2})), 60)
    assert not np.array_equal(one.population.crowd.position, third.population.crowd.position)


SCENES = {
    "used": {
        "forces.social.strength": 2000.0,
        "behaviours.response_time.time": {"uniform": [0.0, 3.0]},
        "behaviours.route_choice": {},
    },
    "unused": {
        "forces.social.strength": 0.0,
        "behaviours.response_time.time": {"constant": 0.0},
        "behaviours.teacher_following.lag": 5.0,
    },
}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("model", MODELS)
def test_leaving_out_changes_no_bit_in_the_square_room(model, scene):
    case = load_case("square_room", model_of(model) | SCENES[scene])
    lean, full = (run_ticks(Simulation(case, full=full), 60) for full in (False, True))
    assert_same_bits(lean, full)
    assert np.isfinite(lean.population.crowd.exit_time).any()


def test_leaving_out_changes_no_bit_in_the_school():
    """After 20 s the stairs are full, and some people are out."""
    case = load_case("primary_school", {"directions.spacing": 0.2})
    lean, full = (run_ticks(Simulation(case, full=full), 200) for full in (False, True))
    assert_same_bits(lean, full)
    assert len(lean.population.crossings[0]) > 50


def write_answers(folder):
    """Write positions and velocities of few people after some steps of each model."""
    changes = {
        **{"people.people.number": 12, "forces.social.strength": 2000.0, "directions.spacing": 0.4},
        "behaviours.response_time.time": {"uniform": [0.0, 0.5]},
    }
    for model in MODELS:
        simulation = run_ticks(Simulation(load_case("square_room", changes | model_of(model))), 20)
        report, crowd = simulation.engine.report(), simulation.population.crowd
        assert report["contacts"] + report["solves"] > 3
        np.save(f"{folder}/{model}.npy", np.column_stack([crowd.position, crowd.velocity]))


def test_the_same_answers_without_compilation(tmp_path):
    compiled, plain = tmp_path / "compiled", tmp_path / "plain"
    compiled.mkdir()
    plain.mkdir()
    write_answers(compiled)
    script = f"from tests.simulation.test_simulation import write_answers; write_answers({str(plain)!r})"
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    checkout = Path(__file__).parents[2]
    subprocess.run([sys.executable, "-c", script], env=environment, check=True, timeout=600, cwd=checkout)
    for model in MODELS:
        one, other = (np.load(folder / f"{model}.npy") for folder in (compiled, plain))
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)


def test_ends_when_the_duration_is_over():
    simulation = Simulation(load_case("square_room", {"simulation.duration": 2.05, "people.people.speed": 0.1}))
    results = simulation.run()
    assert simulation.ended == DURATION_OVER
    assert (simulation.step, simulation.time) == (205, pytest.approx(2.05))
    assert results.number_of_people - results.evacuated == 20


def test_ends_when_nobody_gets_on():
    changes = {"people.people.speed": 1e-6, "simulation.no_progress": 3.0, "simulation.duration": 50.0}
    simulation = Simulation(load_case("square_room", changes))
    results = simulation.run()
    assert simulation.ended == NO_PROGRESS
    assert simulation.time == pytest.approx(4.0, abs=1.01)
    assert len(results.stuck) == 20


def test_who_stands_is_stuck_however_the_run_ends():
    """Ten seconds without progress, after the response time."""
    changes = {"people.people.speed": 1e-6, "simulation.duration": 12.0}
    results = Simulation(load_case("square_room", changes)).run()
    assert (results.ended, len(results.stuck)) == (DURATION_OVER, 20)
    short = Simulation(load_case("square_room", changes | {"simulation.duration": 9.0})).run()
    assert (short.ended, len(short.stuck)) == (DURATION_OVER, 0)
    late = {"behaviours.response_time.time": {"constant": 60.0}}
    assert len(Simulation(load_case("square_room", changes | late)).run().stuck) == 0


def test_waiting_for_the_response_time_is_no_lack_of_progress():
    changes = {"behaviours.response_time.time": {"constant": 8.0}, "simulation.no_progress": 3.0}
    simulation = Simulation(load_case("square_room", changes | model_of("dem")))
    simulation.run()
    assert simulation.ended == EVERYBODY_OUT
    assert np.min(simulation.population.crowd.exit_time) > 8.0


def test_somebody_who_got_out_is_progress():
    """Two people: one cannot move, the other gets out after 8 s and more."""
    changes = {
        "people.people.number": 2,
        "people.people.speed": {"list": [1.5, 1e-6]},
        "behaviours.response_time.time": {"constant": 0.0},
        "simulation.no_progress": 6.0,
        "simulation.duration": 60.0,
    }
    simulation = Simulation(load_case("square_room", changes))
    simulation.population.crowd.start_time[0] = 8.0
    simulation.run()
    assert simulation.ended == NO_PROGRESS
    assert simulation.time >= simulation.population.crowd.exit_time[0] + 6.0 - 1.0


def test_the_tick_does_not_change_the_physics():
    ends = []
    for tick in (0.01, 0.1, 0.5):
        changes = {"simulation.tick": tick, "output.every": 0.5, "people.people.number": 1}
        ends.append(Simulation(load_case("square_room", changes)).run().crowd.exit_time[0])
    assert ends[0] == ends[1] == ends[2]


def test_progress_is_shown_once_a_tick():
    seen = []
    Simulation(load_case("square_room")).run(seen.append)
    assert [state.time for state in seen] == pytest.approx([0.1 * (k + 1) for k in range(len(seen))])
    assert [state.out for state in seen] == sorted(state.out for state in seen)
    assert seen[-1].out == seen[-1].people == 20


@pytest.mark.parametrize("model", MODELS)
def test_the_last_frame_has_contact_forces(model):
    changes = {"simulation.duration": 2.3, "output.every": 0.5, **model_of(model)}
    crowd = Simulation(load_case("square_room", changes)).run().crowd
    assert crowd.contact_force[crowd.level >= 0].max() > 0.0


@pytest.mark.parametrize("model", MODELS)
def test_a_start_half_a_micrometre_beyond_the_exit_is_a_start_at_it(model, tmp_path):
    case = in_the_room(tmp_path, SQUEEZED, [[5.0000005, 2.5], [3.0, 2.5]], **model_of(model))
    results = Simulation(case).run()
    assert results.ended == EVERYBODY_OUT
    assert results.crowd.exit_time[0] < 0.1


@pytest.mark.parametrize("model", MODELS)
def test_the_distance_ends_at_the_exit(model, tmp_path):
    changes = {"simulation.step": 0.05, "simulation.tick": 0.15, "output.every": 0.15, **model_of(model)}
    if model == "dem":
        changes |= {"simulation.step": 0.005, "simulation.tick": 0.1, "output.every": 0.1}
    crowd = Simulation(in_the_room(tmp_path, SQUEEZED, [[2.0, 2.5]], **changes)).run().crowd
    assert crowd.distance[0] == pytest.approx(3.0, abs=1e-6)


def test_results_do_not_change_with_the_run():
    simulation = run_ticks(Simulation(load_case("square_room")), 20)
    results = simulation.results()
    out = results.evacuated
    simulation.run()
    assert results.evacuated == out < 20
    assert "overlap_sum" not in results.report


def test_warnings_are_those_of_the_start(tmp_path):
    case = in_the_room(tmp_path, SQUEEZED, [[2.0, 2.5], [2.0, 2.7]]).change({"people.people.speed": 3.5})
    simulation = Simulation(case)
    warnings = simulation.warnings()
    assert any("people.people.speed is" in line for line in warnings)
    assert any(line.startswith("1 pair ") for line in warnings)
    simulation.run()
    assert simulation.warnings() == warnings
    simulation = Simulation(load_case("square_room", {"people.people.radius": 0.6, "people.people.number": 2}))
    door, stopped = (one for one in simulation.findings if one.place is not None)
    assert (door.item, door.storey, door.place) == ("exits.door", "room", (5.0, 2.5))
    assert (stopped.item, stopped.place) == ("people.people", pytest.approx((4.56, 2.5), abs=0.005))
    assert {str(door), str(stopped)} < set(simulation.warnings())


def test_the_border_of_the_explicit_drive_is_that_of_the_people():
    changes = {"simulation.driving": "explicit", "people.people.tau": 0.004, **model_of("nsm1")}
    with pytest.raises(ScenarioError, match=r"tau of 0\.004 s; .* 0\.008 s"):
        Simulation(load_case("square_room", changes))


def test_the_mean_overlap_is_over_all_overlaps():
    simulation = run_ticks(Simulation(load_case("square_room", model_of("dem"))), 30)
    added, report = simulation.engine.report(), simulation.results().report
    assert added["overlaps"] > 10
    assert report["mean_overlap"] == added["overlap_sum"] / added["overlaps"]


def test_ticks_charge_their_phases(monkeypatch):
    """By a clock that goes on by one whenever it is looked at, each time that a phase is entered counts one."""
    monkeypatch.setattr("evac.base.progress.time", SimpleNamespace(perf_counter=itertools.count(0.0).__next__))
    simulation = Simulation(load_case("square_room"))
    before = simulation.phases.seconds()
    run_ticks(simulation, 3)
    spent = {name: seconds - before[name] for name, seconds in simulation.phases.seconds().items()}
    ticks = {"kernels": 1.0, "behaviours": 3.0, "physics": 3.0, "recording": 4.0}
    assert spent == dict.fromkeys(spent, 0.0) | ticks


def test_people_who_overlap_on_a_soft_spring_are_told():
    """Those whose overlap exceeds half the smallest radius in some tick, from the first such tick to the last."""
    changes = {"contact.model": "dem", "contact.dem.stiffness": 2e4, "simulation.duration": 4.0}
    simulation = Simulation(load_case("square_room", changes))
    crowd, tick, deep, times = simulation.population.crowd, simulation.case.simulation.tick, set(), []
    limit = 0.5 * crowd.radius.min()
    while not simulation.ended:
        simulation.advance_tick()
        if len(now := np.flatnonzero((crowd.overlap > limit) & (crowd.level >= 0))):
            deep.update(now.tolist())
            times.append(simulation.time)
    (line,) = (one for one in simulation.results().quality_warnings if one.startswith("large overlaps"))
    period = f"t = {times[0] - tick:.1f} and {times[-1]:.1f} s {len(deep)} people overlapped by more than the"
    assert f"{period} {1000 * limit:.3g} mm" in line
    assert "set behaviours.walking={}" in line
    assert "contact.dem.stiffness" in line
    assert "set contact.model=nsm1" in line
