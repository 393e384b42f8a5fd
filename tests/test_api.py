"""evac from Python: load, change, run, get arrays."""

import copy
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import evac
from tests import typed_script


def test_ten_lines(tmp_path):
    case = evac.load("square_room", ["simulation.seed=3"])
    case = case.change({"people.people.number": 12, "contact.model": "dem"})
    results = evac.run(case, tmp_path / "result")
    assert results.evacuated == results.number_of_people == 12
    time, number_out = results.egress()
    np.testing.assert_array_equal(number_out, np.arange(13))
    trajectory = evac.read_trajectory(tmp_path / "result")
    assert trajectory.position.shape == (len(trajectory.time), 12, 2)
    np.testing.assert_allclose(trajectory.position[0], results.start_position, rtol=0, atol=1e-6)
    out_after = trajectory.time[:, None] >= results.crowd.exit_time
    np.testing.assert_array_equal(np.isnan(trajectory.position[:, :, 0]), out_after)
    assert time[-1] == results.last_out


def test_a_run_without_a_folder_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ticks = []
    results = evac.run(evac.load("square_room"), progress=ticks.append)
    assert list(tmp_path.iterdir()) == []
    assert ticks[-1] == evac.Progress(results.time, 60.0, 20, 20)
    assert len(ticks) == round(results.time / 0.1)


def test_the_run_with_a_folder_is_the_same(tmp_path):
    one = evac.run(evac.load("square_room"))
    other = evac.run(evac.load("square_room"), str(tmp_path / "r"), full=True)
    np.testing.assert_array_equal(one.crowd.exit_time, other.crowd.exit_time)
    assert one.time % 0.5 > 0.0  # the last state is no frame of the output times
    for name in ("time", "position", "contact_force"):
        np.testing.assert_array_equal(getattr(one.trajectory, name), getattr(other.trajectory, name))
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(one)).trajectory.position, one.trajectory.position)
    assert (
        evac.run(evac.load("square_room", {"output.trajectory": False, "output.animation": False})).trajectory is None
    )
    assert "output" in other.phases


def test_what_runs_return_can_be_copied_and_pickled(tmp_path):
    case = evac.load("square_room", {"people.people.number": 3, "output.picture": False, "output.replay": False})
    results = evac.run(case, tmp_path / "result")
    study = evac.repeat(case, 2, workers=1)
    trajectory = evac.read_trajectory(tmp_path / "result")
    for made in (lambda one: pickle.loads(pickle.dumps(one)), copy.copy, copy.deepcopy):
        assert made(case).to_dict() == case.to_dict()
        assert made(results).summary() == results.summary()
        np.testing.assert_array_equal(made(trajectory).position, trajectory.position)
        assert str(made(study).statistics) == str(study.statistics)
        assert [row["last_out"] for row in made(study).rows()] == [row["last_out"] for row in study.rows()]
        assert str(made(evac.compare(study, study))) == str(evac.compare(study, study))


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("workers", lambda case: evac.repeat(case, 2, workers="a")),
        ("runs", lambda case: evac.repeat(case, 2.5)),
        ("folder", lambda case: evac.run(case, 5)),
        ("progress", lambda case: evac.run(case, progress=5)),
        ("checkpoint", lambda case: evac.run(case, checkpoint="a")),
        ("full", lambda case: evac.run(case, full="a")),
        ("source", lambda case: evac.load(None)),
        ("registry", lambda case: evac.load("square_room", registry=evac.Registry)),
        ("plugin_files", lambda case: evac.load("square_room", plugin_files="a.py")),
        ("key", lambda case: case.change({5: 5})),
        ("parameters", lambda case: evac.sweep(case, 5, 2)),
        ("design", lambda case: evac.compare(case, 5)),
        ("files", lambda case: evac.import_building(5, "x")),
        ("in_memory", lambda case: evac.Simulation(case, in_memory=1)),
        ("5 is", lambda case: evac.read_results(5)),
        ("5 is", lambda case: evac.read_building(5)),
    ],
)
def test_arguments_of_a_wrong_type_are_told_by_name(name, call):
    with pytest.raises(evac.EvacError, match=f"^{name}.* of type "):
        call(evac.load("square_room"))


def test_every_public_name_is_there():
    for name in evac.__all__:
        assert getattr(evac, name) is not None
        assert name in dir(evac)
    assert evac.__version__.count(".") == 2
    with pytest.raises(AttributeError, match="no attribute 'simulate'"):
        evac.simulate  # noqa: B018


def test_a_script_that_type_checkers_pass_names_everything_and_runs(tmp_path):
    names = set(re.findall(r"\bevac\.(\w+)", Path(typed_script.__file__).read_text()))
    assert names - {"__all__", "people", "physics"} == set(evac.__all__)
    typed_script.main(tmp_path)


def test_importing_is_fast():
    code = "import time; t = time.perf_counter(); import evac; print(time.perf_counter() - t)"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(process.stdout) < 0.5
