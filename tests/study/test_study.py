"""Studies as a whole: the runs are those of their seeds whoever makes them; going on; failures."""

import concurrent.futures
import csv
import json
import textwrap
from dataclasses import replace

import numpy as np
import pytest

import evac
from evac.base.errors import PluginError, ResultError, ScenarioError, SimulationError
from evac.folder.files import RUNS_STREAM_NAME
from evac.study.outputs import remarks_of, statistics_table, write_replays
from evac.study.store import read_identity, write_identity
from evac.study.study import Study


@pytest.fixture(scope="module")
def case():
    return evac.load(
        "square_room",
        {"people.people.number": 5, "simulation.seed": 5, "output.every": 0.5, "output.picture": False},
    )


def stopping_after(count):
    def progress(state):
        if state.row is not None and state.done >= count:
            raise KeyboardInterrupt

    return progress


def test_runs_are_those_of_their_seeds(case):
    study = evac.repeat(case, 3, workers=2)
    rows = list(study.rows())
    assert [row["seed"] for row in rows] == [5, 6, 7]
    for row in rows:
        alone = evac.run(study.case_of(0, row["run"]))
        assert alone.crowd.exit_time.tobytes() == row["exit_time"].tobytes()
        assert row["exits"][0]["people"] == 5
    assert len({row["exit_time"].tobytes() for row in rows}) == 3


def test_tables_do_not_depend_on_who_makes_the_runs(case, tmp_path, monkeypatch):
    monkeypatch.setattr("evac.study.execute.JOINING", 0.0)  # processes join for the least work
    with concurrent.futures.ThreadPoolExecutor(2) as executor:
        studies = [
            evac.repeat(case, 4, folder=tmp_path / "1", workers=1),
            evac.repeat(case, 4, folder=tmp_path / "2", workers=2),
            evac.repeat(case, 4, folder=tmp_path / "3", executor=executor),
        ]
    for name in ("runs.csv", "statistics.csv", "egress.csv", "summary.json"):
        assert len({(study.folder / name).read_bytes() for study in studies}) == 1, name
    assert all(study.table().equals(studies[0].table()) for study in studies)


def test_buildings_are_made_once(case, monkeypatch):
    from evac.simulation import assembly, shared

    made = []
    make_building = assembly.make_building
    monkeypatch.setattr(assembly, "make_building", lambda case: made.append(case) or make_building(case))
    monkeypatch.setattr(shared, "SCENES", type(shared.SCENES)())
    evac.sweep(case, {"contact.model": ["nsm2", "dem"], "directions.spacing": [0.1, 0.12]}, 2, workers=1)
    assert len(made) == 2


def test_a_damaged_study_goes_on_to_the_same_tables(case, tmp_path):
    whole = evac.repeat(case, 4, folder=tmp_path / "whole", workers=1)
    with pytest.raises(KeyboardInterrupt) as caught:
        evac.repeat(case, 4, folder=tmp_path / "r", workers=1, progress=stopping_after(3))
    assert "r.running has 3 runs; --resume" in caught.value.__notes__[0]
    path, generator = tmp_path / "r.running" / RUNS_STREAM_NAME, np.random.default_rng(1)
    data = bytearray(path.read_bytes())
    data[int(generator.integers(len(data) // 2, len(data)))] ^= 4
    path.write_bytes(data)
    again = evac.repeat(case, 4, folder=tmp_path / "r", workers=1, resume=True)
    assert again.table().equals(whole.table())
    assert (tmp_path / "r" / "summary.json").read_bytes() == (whole.folder / "summary.json").read_bytes()


def test_a_complete_study_takes_more_runs(case, tmp_path):
    evac.repeat(case, 2, folder=tmp_path / "r", workers=1)
    made = []
    evac.repeat(case, 4, folder=tmp_path / "r", workers=1, resume=True, progress=lambda state: made.append(state.row))
    assert [row and row.run for row in made] == [None, 2, 3]
    fewer = evac.repeat(case, 3, folder=tmp_path / "r", workers=1, resume=True)
    assert fewer.statistics[0].runs == 3
    assert fewer.table().num_rows == 4  # what has been made is kept


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"people.people.number": 6}, "case.people.0.number"),
        ({"simulation.seed": 6}, "first_seed"),
    ],
)
def test_a_changed_case_does_not_go_on(case, tmp_path, changes, key):
    evac.repeat(case.change({"contact.model": "nsm2"}), 1, folder=tmp_path / "r", workers=1)
    with pytest.raises(ResultError) as caught:
        evac.repeat(case.change({"contact.model": "nsm2", **changes}), 2, folder=tmp_path / "r", resume=True)
    assert [line.split()[0] for line in str(caught.value).splitlines()[1:-1]] == [key]


def test_a_changed_building_or_plugin_does_not_go_on(case, tmp_path):
    mesh = tmp_path / "room.msh"
    mesh.write_text(case.mesh.read_text())
    own = case.change({"building.mesh": str(mesh)})
    evac.repeat(own, 1, folder=tmp_path / "r", workers=1)
    mesh.write_text(case.mesh.read_text() + "\n")
    with pytest.raises(ResultError, match="building"):
        evac.repeat(own, 2, folder=tmp_path / "r", resume=True)


def test_rows_of_a_stopped_study_are_not_overwritten(case, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        evac.repeat(case, 3, folder=tmp_path / "r", workers=1, progress=stopping_after(1))
    with pytest.raises(ResultError, match="--resume"):
        evac.repeat(case, 3, folder=tmp_path / "r", workers=1)
    with pytest.raises(ResultError, match="no study"):
        evac.repeat(case, 3, folder=tmp_path / "none", resume=True)


def test_a_study_stops_when_it_knows_enough(case):
    study = evac.repeat(case, until=0.2, least=8, most=30, workers=1)
    assert study.rule.is_known(study.times(0), study.populations(0))
    assert 8 <= study.runs_of(0) <= 30
    assert study.table().num_rows == study.runs_of(0)
    names = [name for name, *_ in statistics_table(study, 0)]
    assert len(names) == len({*names})
    assert study.rule.statistic in names
    narrow = evac.repeat(case, until=0.001, least=2, most=4, workers=1)
    assert narrow.runs_of(0) == 4
    assert not narrow.rule.is_known(narrow.times(0), narrow.populations(0))


def test_blocked_runs_are_told(case, tmp_path):
    study = evac.repeat(case.change({"simulation.duration": 3.0}), 6, folder=tmp_path / "r", workers=1)
    blocked = [row["blocked"] for row in study.rows(columns=["blocked"])]
    assert 0 < sum(blocked) == study.statistics[0].blocked
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    assert summary["blocked"] == sum(blocked)
    with (tmp_path / "r" / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["last_out"] == "" for row in rows] == blocked
    with (tmp_path / "r" / "statistics.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert row["greatest"] == "inf"


def test_curves_of_the_folder(case, tmp_path):
    study = evac.repeat(case, 3, folder=tmp_path / "r", workers=1)
    with (tmp_path / "r" / "egress.csv").open() as file:
        rows = list(csv.DictReader(file))
    end = max(float(row["time"]) for row in study.rows(columns=["time"]))
    assert float(rows[-2]["time"]) < end <= float(rows[-1]["time"])
    assert float(rows[-1]["mean_over_runs"]) == 5.0
    at = float(rows[4]["time"])
    out = [np.sum(row["exit_time"] <= at) for row in study.rows(columns=["exit_time"])]
    assert float(rows[4]["mean_over_runs"]) == pytest.approx(np.mean(out))


def test_a_study_is_opened_again_from_its_folder(case, tmp_path):
    values = {"simulation.driving": ["explicit"], "people.people.tau": [0.3, 0.005], "people.people.number": [3]}
    study = evac.sweep(case, values, 3, folder=tmp_path / "r", workers=1)
    again = evac.read_study(tmp_path / "r")
    assert repr(again.statistics) == repr(study.statistics)
    assert [point.parameters for point in again.points] == [point.parameters for point in study.points]
    assert again.table().equals(study.table())
    results = again.run_again(0, 2)
    assert results.crowd.exit_time.tobytes() == list(again.rows(0))[2]["exit_time"].tobytes()
    more = evac.repeat(case, until=0.2, least=4, most=9, folder=tmp_path / "until", workers=1)
    assert evac.read_study(tmp_path / "until").runs_of(0) == more.runs_of(0)


def test_an_interrupted_study_is_opened_with_the_runs_that_there_are(case, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        evac.repeat(case, 6, folder=tmp_path / "r", workers=1, repetitions=2, progress=stopping_after(5))
    found = evac.read_study(tmp_path / "r.running")
    assert (found.statistics[0].runs, len(found.table())) == (4, 5)  # whole populations


def test_opening_a_study_needs_neither_its_case_nor_its_plugins_and_runs_none(tmp_path):
    case = with_plugin(tmp_path, "pass")
    evac.repeat(case, 2, folder=tmp_path / "r", workers=1)
    plugin = tmp_path / "odd.py"
    plugin.write_text(f"from pathlib import Path\nPath({str(tmp_path / 'ran')!r}).touch()\n")
    study = evac.read_study(tmp_path / "r")
    assert study.statistics[0].runs == 2
    with pytest.raises(ResultError, match=r"odd\.py.*plugin_files"):
        study.run_again(0, 0)
    assert not (tmp_path / "ran").exists()


def test_a_forged_study_runs_no_plugin_file_that_was_not_given(case, tmp_path):
    evac.repeat(case, 1, folder=tmp_path / "r", workers=1)
    identity, definition = read_identity(tmp_path / "r")
    (tmp_path / "evil.py").write_text(f"from pathlib import Path\nPath({str(tmp_path / 'ran')!r}).touch()\n")
    definition["cases"][0]["table"]["plugins"] = {"files": ["evil.py"]}
    definition["cases"][0]["source"] = str(tmp_path / "case.toml")
    write_identity(tmp_path / "r", identity, definition)
    with pytest.raises(ResultError, match=r"evil\.py"):
        evac.read_study(tmp_path / "r").run_again(0, 0)
    assert not (tmp_path / "ran").exists()


def test_runs_with_half_the_step_are_paired_with_the_others(case, tmp_path, monkeypatch):
    study = evac.repeat(case, 4, folder=tmp_path / "r", workers=1, check_step=True)
    times = [[evac.run(study.case_of(point, run)).last_out for run in range(4)] for point in (0, 1)]
    assert [study.case_of(point, 0).simulation.step for point in (0, 1)] == [0.01, 0.005]
    change = study.step_change
    assert (change.runs, change.value) == (4, pytest.approx(np.mean(np.subtract(times[1], times[0]))))
    assert change.value != 0.0
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    assert summary["step_change"]["value"] == change.value
    assert evac.read_study(tmp_path / "r").step_change == change
    for low, high, told in ((0.0, 0.0, False), (-0.1, 0.0, False), (0.1, 0.2, True), (-0.2, -0.1, True)):
        monkeypatch.setattr(Study, "step_change", replace(change, low=low, high=high))
        assert any("the time step changes the mean" in line for line in remarks_of(study)) == told
    monkeypatch.undo()
    other = evac.sweep(case, {"simulation.step": [0.01, 0.02]}, 2, workers=1)
    assert other.step_change is None
    assert other.difference(0, 1).runs == 2
    assert other.plot().axes[0].get_legend_handles_labels()[1] == [point.label for point in other.points]


def test_replays_are_those_of_the_median_and_of_the_worst_run(case, tmp_path):
    study = evac.repeat(case, 4, folder=tmp_path / "r", workers=1)
    write_replays(study)
    times = [row["last_out"] for row in study.rows(0, ["last_out"])]
    ranked = sorted(range(4), key=times.__getitem__)
    for rank, run in (("median", ranked[1]), ("worst", ranked[3])):
        page = (tmp_path / "r" / f"replay-{rank}.html").read_text(encoding="utf-8")
        seed = study.case_of(0, run).simulation.seed
        assert f"<title>{rank.capitalize()} of 4 runs, seed {seed}: " in page


def test_a_script_is_told_what_the_command_tells():
    late = {"behaviours.response_time": {"time": {"lognormal": [60, 20]}}, "simulation.duration": 1.0}
    case = evac.load("square_room", {"people.people.number": 3, **late})
    for make in (lambda: evac.repeat(case, 2, workers=1), lambda: evac.sweep(case, {"contact.model": ["dem"]}, 2)):
        with pytest.warns(evac.RunWarning) as told:
            make()
        assert "2 of 2 runs" in str(told[-1].message)
        assert {one.filename for one in told} == {__file__}


FAILING = """
    from evac import Behaviour, hookimpl
    evac_interface = 3

    class Odd(Behaviour):
        '''Fails or kills its process.'''
        name = "odd"
        reads = ("mass",)

        def act(self, crowd, time):
            {act}

    @hookimpl
    def evac_behaviours():
        return [Odd]
"""


def with_plugin(tmp_path, act, **changes):
    path = tmp_path / "odd.py"
    path.write_text(textwrap.dedent(FAILING).format(act=act))
    few = {"people.people.number": 3, "behaviours.odd": {}, "output.picture": False}
    return evac.load("square_room", few | changes, plugin_files=[path])


#: With this drive the seeds are refused that draw a relaxation time of at most half a step.
QUICK = {"simulation.driving": "explicit", "people.people.tau": {"uniform": [0.002, 0.06]}}


def refused_seeds(case, seeds):
    refused = []
    for seed in seeds:
        try:
            evac.Simulation(case.change({"simulation.seed": seed}))
        except ScenarioError:
            refused.append(seed)
    return refused


def test_refused_seeds_are_told_and_the_others_finish(case, tmp_path):
    quick = case.change(QUICK)
    refused = refused_seeds(quick, range(5, 15))
    assert 0 < len(refused) < 10
    study = evac.repeat(quick, 10, folder=tmp_path / "r", workers=1)
    rows = list(study.rows(failed=True))
    assert [row["seed"] for row in rows if row["ended"] == "failed"] == refused
    assert all("smallest tau" in row["error"] for row in rows if row["ended"] == "failed")
    found = study.statistics[0]
    assert (found.runs, found.failed) == (10 - len(refused), len(refused))
    alone = [evac.run(quick.change({"simulation.seed": seed})) for seed in range(5, 15) if seed not in refused]
    assert found.mean.value == pytest.approx(np.mean([one.last_out for one in alone]))
    with (tmp_path / "r" / "runs.csv").open() as file:
        assert [int(row["seed"]) for row in csv.DictReader(file) if row["error"]] == refused


def test_a_study_with_failed_runs_goes_on_and_makes_them_again(case, tmp_path):
    quick = case.change(QUICK)
    refused = refused_seeds(quick, range(5, 15))
    whole = evac.repeat(quick, 10, folder=tmp_path / "whole", workers=1)
    with pytest.raises(KeyboardInterrupt):
        evac.repeat(quick, 10, folder=tmp_path / "r", workers=1, progress=stopping_after(8))
    made, options = [], {"resume": True, "progress": lambda state: made.append(state.row)}
    again = evac.repeat(quick, 10, folder=tmp_path / "r", workers=1, **options)
    before = [seed for seed in range(5, 13) if seed not in refused]
    assert [row.seed for row in made[1:]] == [seed for seed in range(5, 15) if seed not in before]
    assert again.table().equals(whole.table())
    for name in ("runs.csv", "summary.json"):
        assert (tmp_path / "r" / name).read_bytes() == (whole.folder / name).read_bytes()


def test_a_run_that_fails_on_its_way_is_a_row(tmp_path, monkeypatch):
    monkeypatch.setattr("evac.study.execute.JOINING", 0.0)
    act = "assert crowd.mass[0] != self.heaviest, 'too heavy'"
    case = with_plugin(tmp_path, act)
    masses = [evac.Simulation(case.change({"simulation.seed": seed})).population.crowd.mass[0] for seed in (1, 2, 3, 4)]
    case = with_plugin(tmp_path, act.replace("self.heaviest", repr(float(masses[2]))))
    study = evac.repeat(case, 4, workers=2)
    assert [row["ended"] for row in study.rows(columns=["ended"], failed=True)][2] == "failed"
    assert "too heavy" in list(study.rows(columns=["error"], failed=True))[2]["error"]
    assert study.statistics[0].runs == 3


def test_a_process_that_dies_once_loses_no_run_and_one_that_dies_again_only_its_own(tmp_path, monkeypatch, started):
    monkeypatch.setattr("evac.study.execute.JOINING", 0.0)
    case = with_plugin(tmp_path, "pass")
    whole = evac.repeat(case, 8, workers=1).table()
    masses = [evac.Simulation(case.change({"simulation.seed": seed})).population.crowd.mass[0] for seed in (2, 5)]
    dies_once = f"crowd.mass[0] == {float(masses[0])!r} and not mark.exists()"
    act = f"import os, pathlib; mark = pathlib.Path({str(tmp_path / 'mark')!r}); "
    act += f"({dies_once} or crowd.mass[0] == {float(masses[1])!r}) and (mark.touch(), os.kill(os.getpid(), 9))"
    study = evac.repeat(with_plugin(tmp_path, act), 8, workers=2)
    rows = list(study.rows(failed=True))
    assert [row["seed"] for row in rows if row["ended"] == "failed"] == [5]
    assert "twice" in rows[4]["error"]
    assert study.table().filter([k != 4 for k in range(8)]).equals(whole.filter([k != 4 for k in range(8)]))
    assert len(started) >= 4  # the pool is made again after each of three deaths
    assert all(process.exitcode is not None for process in started)


def test_a_worker_that_cannot_load_the_case_ends_the_study(case):
    class Executor(concurrent.futures.Executor):
        def submit(self, *task):
            future = concurrent.futures.Future()
            future.set_exception(PluginError("no such plugin here"))
            return future

    with pytest.raises(PluginError, match="here"):
        evac.repeat(case, 3, executor=Executor())


def test_no_more_runs_than_wanted_are_with_an_executor(case, monkeypatch):
    monkeypatch.setattr("evac.study.execute.IN_FLIGHT", 2)
    submitted, done = [], [0]

    class Executor(concurrent.futures.Executor):
        def submit(self, function, /, *arguments, **options):
            submitted.append(len(submitted) + 1 - done[-1])
            future = concurrent.futures.Future()
            future.set_result(function(*arguments, **options))
            return future

    evac.repeat(case, 6, executor=Executor(), progress=lambda state: done.append(state.done))
    assert (len(submitted), max(submitted)) == (6, 2)


@pytest.mark.parametrize(("error", "words"), [(MemoryError("no room"), "no room"), (None, "given up")])
def test_a_task_that_an_executor_does_not_execute_ends_the_study(case, error, words):
    class Executor(concurrent.futures.Executor):
        def submit(self, *task):
            future = concurrent.futures.Future()
            if error is not None:
                future.set_exception(error)
            else:
                future.cancel()
                future.set_running_or_notify_cancel()
            return future

    with pytest.raises(SimulationError, match=rf"simulation.seed = \d.*{words}.*--resume"):
        evac.repeat(case, 3, executor=Executor())


@pytest.mark.parametrize("study", [evac.repeat, lambda case, **options: evac.sweep(case, {}, **options)])
def test_an_unknown_argument_is_told_with_what_is_like_it(case, study):
    with pytest.raises(ScenarioError, match=r"workrs.*'workers'"):
        study(case, workrs=1)
