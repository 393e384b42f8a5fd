"""A result folder has one owner: what happens to it during a run, and what a failed run leaves alone."""

import json
import os

import numpy as np
import pytest

import evac
from evac.base.errors import PluginError, ResultError
from evac.results.ending import Stopped


@pytest.fixture
def case():
    return evac.load("square_room", {"output.picture": False, "output.animation": False})


def test_a_folder_that_is_removed_during_the_run_ends_it(tmp_path, case):
    earlier = tmp_path / "r"
    evac.run(case, earlier)
    before = (earlier / "summary.json").read_bytes()

    def remove(progress):
        if 0.95 < progress.time < 1.05:
            for path in (tmp_path / "r.running").iterdir():
                path.unlink()
            (tmp_path / "r.running").rmdir()
        assert progress.time < 1.2

    with pytest.raises(ResultError, match=r"r\.running: .*removed"):
        evac.run(case, earlier, progress=remove)
    assert (earlier / "summary.json").read_bytes() == before


@pytest.mark.parametrize("cut", [True, False])
def test_a_trajectory_that_is_cut_or_removed_during_the_run_is_noticed(tmp_path, case, cut):
    def damage(progress):
        if 0.95 < progress.time < 1.05:
            path = tmp_path / "r.running" / "trajectory.evac"
            path.write_bytes(b"") if cut else path.unlink()

    with pytest.raises(ResultError, match=r"trajectory\.evac"):
        evac.run(case, tmp_path / "r", progress=damage)


def test_a_failed_run_leaves_an_earlier_result_alone(tmp_path, case):
    evac.run(case, tmp_path / "r")
    before = (tmp_path / "r" / "summary.json").read_bytes()

    def fail(progress):
        if progress.time > 1.0:
            raise PluginError("odd")

    with pytest.raises(PluginError, match="odd") as caught:
        evac.run(case, tmp_path / "r", progress=fail)
    assert any("r.running" in note for note in caught.value.__notes__)
    assert (tmp_path / "r" / "summary.json").read_bytes() == before
    assert json.loads((tmp_path / "r.running" / "summary.json").read_text())["ended"] == "failed"


def test_two_runs_into_one_folder_are_kept_apart(tmp_path, case):
    def second(progress):
        with pytest.raises(ResultError, match=f"r: .* {os.getpid()} "):
            evac.run(case, tmp_path / "r")
        raise Stopped

    evac.run(case, tmp_path / "r", progress=second)
    assert len(np.loadtxt(tmp_path / "r" / "people.csv", delimiter=",", skiprows=1, usecols=0)) == 20
