"""evac resume, after kills and signals; and folders that two processes want, or that go away."""

import json
import os
import random
import signal
import subprocess
import sys
import time

import pytest

from evac.cli import main
from evac.folder.files import CHECKPOINT_NAME

#: With --checkpoint 0 the state is kept at every tick, so that kills fall in its writing too.
WORDS = ["run", "square_room", "--checkpoint", "0", "--set", "output.picture=false", "output.every=0.1"]
WORDS += ["simulation.duration=4"]
PEOPLE_LEFT = 3

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals to send")


def heed_interrupts():
    """Undo that a shell lets background jobs, of which the tests may be one, ignore SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(folder, *words):
    command = [sys.executable, "-P", "-m", "evac", *words]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, cwd=folder, preexec_fn=heed_interrupts, **pipes)


def wait_for(path, process):
    deadline = time.monotonic() + 240.0
    while not path.exists() and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.002)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the result of a run that was not stopped."""
    folder = tmp_path_factory.mktemp("whole")
    assert main([*WORDS, "--out", str(folder / "whole")]) == PEOPLE_LEFT
    return folder / "whole"


def assert_same(one, other):
    files = {path.relative_to(one) for path in one.rglob("*.*")}
    assert files == {path.relative_to(other) for path in other.rglob("*.*")}
    assert len(files) > 40
    for name in files:
        if name.name not in ("summary.json", "manifest.jsonl"):
            assert (one / name).read_bytes() == (other / name).read_bytes(), name
    assert [path.name for path in other.parent.iterdir() if path.name.startswith(f"{other.name}.")] == []


def kill_and_resume(folder, name, generator):
    """Kill a run at a random moment, and half of the times also the one that goes on; return how often."""
    process = start(folder, *WORDS, "--out", name)
    wait_for(folder / f"{name}.running" / CHECKPOINT_NAME, process)
    kills = 0
    while True:
        time.sleep(generator.uniform(0.0, 0.8))
        process.kill()
        process.communicate()
        if process.returncode == PEOPLE_LEFT:
            return kills  # it was faster
        if (folder / name).is_dir() and not (folder / name / CHECKPOINT_NAME).exists():
            return finish_pictures(folder / name, kills)
        assert process.returncode == -signal.SIGKILL
        kills += 1
        process = start(folder, "resume", name)
        if generator.random() < 0.5:
            break
        time.sleep(generator.uniform(0.5, 1.0))
    _, err = process.communicate(timeout=240)
    assert process.returncode == PEOPLE_LEFT, err
    return kills


def finish_pictures(result, kills):
    """Compare the tables of a run that was killed while its pictures were drawn with those of another run into it."""
    names = ("people.csv", "egress.csv", "trajectory.evac")
    before = [(result / name).read_bytes() for name in names]
    process = start(result.parent, *WORDS, "--out", result.name)
    _, err = process.communicate(timeout=240)
    assert process.returncode == PEOPLE_LEFT, err
    assert before == [(result / name).read_bytes() for name in names]
    return kills


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_killed_run_goes_on_to_the_same_bits(tmp_path, whole, seed):
    kill_and_resume(tmp_path, "r", random.Random(seed))
    assert_same(whole, tmp_path / "r")


@pytest.mark.slow
def test_thirty_kills_at_random_moments(tmp_path, whole):
    generator, kills, k = random.Random(2), 0, 0
    while kills < 30:
        kills += kill_and_resume(tmp_path, f"r{k}", generator)
        assert_same(whole, tmp_path / f"r{k}")
        k += 1


@pytest.mark.parametrize(
    "name", ["SIGTERM", pytest.param("SIGINT", marks=pytest.mark.slow), pytest.param("SIGHUP", marks=pytest.mark.slow)]
)
def test_a_signal_leaves_tables_and_a_state(evac, tmp_path, capsys, name):
    number = getattr(signal, name)
    words = [word for word in WORDS if word not in ("--checkpoint", "0")]
    process = start(tmp_path, *words, "--out", "r", "--set", "simulation.step=0.0001")
    wait_for(tmp_path / "r.running" / "trajectory.evac", process)
    process.send_signal(number)
    _, err = process.communicate(timeout=240)
    assert process.returncode == 128 + number
    assert "evac resume r" in err
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    assert summary["ended"] == "interrupted"
    assert (tmp_path / "r" / CHECKPOINT_NAME).is_file()
    assert evac("resume", "r") == PEOPLE_LEFT
    shown = capsys.readouterr()
    assert "duration over" in shown.out
    assert f"{summary['simulated_time']:.2f} s" in shown.err
    assert not (tmp_path / "r" / CHECKPOINT_NAME).exists()


def test_a_second_run_into_the_same_folder_is_refused(evac, tmp_path, whole, capsys):
    process = start(tmp_path, *WORDS, "--out", "r")
    wait_for(tmp_path / "r.running" / CHECKPOINT_NAME, process)
    process.send_signal(signal.SIGSTOP)  # so that it is still there
    try:
        for words in (["run", "square_room", "--out", "r"], ["repeat", "square_room", "--out", "r"], ["resume", "r"]):
            assert evac(*words) == 2
            assert f" {process.pid} " in capsys.readouterr().err
    finally:
        process.send_signal(signal.SIGCONT)
    process.communicate(timeout=240)
    assert process.returncode == PEOPLE_LEFT
    assert_same(whole, tmp_path / "r")
