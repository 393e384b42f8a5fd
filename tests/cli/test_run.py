"""evac run."""

import csv
import json
import re
import signal
import subprocess
import sys
import time
from urllib.request import urlopen

import numpy as np

from evac.folder.files import TRAJECTORY_NAME
from evac.trajectory.trajectory import read_trajectory

FILES = {
    "summary.json",
    "egress.csv",
    "flows.csv",
    "people.csv",
    "egress.png",
    "trajectory.evac",
    "animation.pvd",
    "building",
    "building.vtm",
    "frames",
    "replay.html",
    "manifest.jsonl",
}

QUIET = [f"output.{name}=false" for name in ("picture", "animation", "replay")]

#: Without picture and animation.
BARE = {"manifest.jsonl", "summary.json", "egress.csv", "flows.csv", "people.csv", "replay.html"}


def test_writes_a_result_folder(result):
    assert {path.name for path in result.iterdir()} == FILES
    summary = json.loads((result / "summary.json").read_text())
    assert (summary["people"], summary["evacuated"], summary["exit_status"]) == (20, 20, 0)
    assert summary["wall_time"]["output"] > 0.0
    with (result / "egress.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert int(rows[-1]["number_out"]) == 20
    assert float(rows[-1]["time"]) == summary["last_out"]
    assert len(list((result / "frames").iterdir())) == len(read_trajectory(result))


def test_people_who_are_left_are_told_once(evac, capsys):
    words = ("simulation.duration=1.0", "output.picture=false", "output.animation=false")
    assert evac("run", "square_room", "--set", *words) == 3
    assert capsys.readouterr().err.count("still inside") == 1


def test_a_watched_run_is_shown_on_a_page(evac, capsys, monkeypatch):
    pages = []

    class Page(subprocess.Popen):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            pages.append(self)

    monkeypatch.setenv("BROWSER", sys.executable)  # which ends at once
    monkeypatch.setattr(subprocess, "Popen", Page)
    assert evac("run", "square_room", "--watch", "--set", "simulation.duration=1.0", "output.replay=false") == 3
    address = re.search(r"http://127\.0\.0\.1:\d+/\S+", capsys.readouterr().err)[0]
    with urlopen(f"{address}document") as answer:
        shown = json.load(answer)
    assert (shown["file"], shown["is_drawn"]) == ("case.toml", False)
    with urlopen(f"{address}events") as events:
        while not (line := events.readline()).startswith(b'data: {"phase": "ended"'):
            assert line
    pages[0].kill()
    pages[0].wait()


PLUGIN = """
from evac import Behaviour, hookimpl

evac_interface = 3


class Idle(Behaviour):
    \"\"\"Does nothing.\"\"\"

    name = "idle"
    def prepare(self, scene):
        pass


@hookimpl
def evac_behaviours():
    return [Idle]
"""


def test_seed_and_set_change_the_case(evac, tmp_path):
    evac("run", "square_room", "--out", "a", "--seed", 5, "--set", *QUIET)
    evac("run", "square_room", "--out", "b", "--set", "simulation.seed=5", "contact.model=nsm2", *QUIET)
    evac("run", "square_room", "--out", "c", "--set", "simulation.seed=5", *QUIET, "--set", "contact.model=nsm1")
    summaries = [json.loads((tmp_path / name / "summary.json").read_text()) for name in "abc"]
    assert [summary["seed"] for summary in summaries] == [5, 5, 5]
    assert [summary["contact"]["model"] for summary in summaries] == ["nsm2", "nsm2", "nsm1"]
    a, b, c = (read_trajectory(tmp_path / name) for name in "abc")
    np.testing.assert_array_equal(a.position, b.position)
    assert a.position.shape != c.position.shape or not np.array_equal(a.position, c.position, equal_nan=True)


def test_bad_input_leaves_earlier_results_alone(evac, tmp_path):
    evac("run", "square_room", "--out", "r", "--set", *QUIET)
    before = (tmp_path / "r" / "summary.json").read_bytes()
    assert evac("run", "square_room", "--out", "r", "--set", "people.people.number=5000") == 2
    assert (tmp_path / "r" / "summary.json").read_bytes() == before


def _heed_interrupts():
    """Undo that a shell lets background jobs, of which the tests may be one, ignore SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _start_long_run(folder):
    """Start a run of many minutes and return it when it has written some frames."""
    words = [sys.executable, "-m", "evac", "run", "square_room", "--out", str(folder), "--set", "output.every=0.1"]
    words += ["simulation.step=0.0001", "simulation.duration=3600", "simulation.no_progress=inf"]
    words += ["people.people.speed=0"]
    process = subprocess.Popen(
        words, cwd=folder.parent, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=_heed_interrupts
    )
    path = folder.with_name(f"{folder.name}.running") / TRAJECTORY_NAME
    deadline = time.monotonic() + 240.0
    while time.monotonic() < deadline and process.poll() is None:
        if path.is_file() and path.stat().st_size > 8_000:
            return process
        time.sleep(0.05)
    process.kill()
    raise AssertionError(f"the run wrote no frames: {process.communicate()}")


def test_a_killed_run_can_be_exported_and_drawn(evac, tmp_path, capsys):
    process = _start_long_run(tmp_path / "r")
    process.kill()
    assert process.wait() == -signal.SIGKILL
    process.communicate()
    assert {path.name for path in (tmp_path / "r.running").iterdir()} == {TRAJECTORY_NAME, "manifest.jsonl"}
    frames = len(read_trajectory(tmp_path / "r.running"))
    assert frames >= 3
    assert evac("export", "r") == 0
    shown = capsys.readouterr()
    assert f"{frames} frames" in shown.err
    assert "r.running" in shown.err
    assert len(list((tmp_path / "r.running" / "frames").iterdir())) == frames
    assert evac("render", "r", "--out", "picture.png", "--view", "plan") == 0
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")
    assert evac("run", "square_room", "--out", "r", "--set", *QUIET) == 0
    assert not (tmp_path / "r.running").exists()
