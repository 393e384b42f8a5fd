"""Studies killed at random moments: no row that was told of is lost or made again, the tables are the same."""

import os
import random
import signal
import subprocess
import sys
import time

import pytest

import evac

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows has no process groups to kill")

CHANGES, POINTS = {"people.people.number": 8, "output.picture": False}, {"contact.model": ["nsm2", "dem"]}

SCRIPT = (
    f"CHANGES, POINTS = {CHANGES!r}, {POINTS!r}"
    + """
import sys
from contextlib import nullcontext

import evac
from evac.study import execute
from evac.study.execute import dask_executor

execute.JOINING = 0.0  # other processes join at once


def told(progress):
    if progress.row is not None:
        print(progress.row.point, progress.row.run, flush=True)


if __name__ == "__main__":
    folder, resume, runs, scheduler = sys.argv[1], sys.argv[2] == "resume", int(sys.argv[3]), sys.argv[4]
    case = evac.load("square_room", CHANGES)
    with dask_executor(scheduler) if scheduler else nullcontext() as executor:
        evac.sweep(case, POINTS, runs, folder=folder, workers=2, executor=executor, resume=resume, progress=told)
    print("complete", flush=True)
"""
)


def started(script, place, runs, scheduler):
    is_begun = any((folder / "study.json").is_file() for folder in (place, place.with_name(f"{place.name}.running")))
    resume = "resume" if is_begun else "begin"
    words = [sys.executable, "-P", str(script), str(place), resume, str(runs), scheduler]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)


def interrupted(process, rng, rows):
    """Wait for a random moment, kill, and return what the process told; True if it was killed."""
    lines = []
    if rng.random() < 0.5:
        time.sleep(rng.uniform(0.0, 5.0))
    else:
        stop_at = rng.randrange(rows)
        for line in process.stdout:
            lines.append(line)
            if len(lines) > stop_at:
                break
    is_killed = process.poll() is None
    if is_killed:
        os.killpg(process.pid, signal.SIGKILL)
    rest, errors = process.communicate()
    assert is_killed or process.returncode == 0, errors
    return [*lines, *rest.splitlines(keepends=True)], is_killed


def kill_studies(folder, kills, runs, scheduler="", seed=1):
    script = folder / "script.py"
    script.write_text(SCRIPT)
    rng = random.Random(seed)
    wanted = evac.sweep(evac.load("square_room", CHANGES), POINTS, runs, workers=1).table()
    killed = studies = 0
    while killed < kills:
        place, seen, is_complete = folder / f"study-{studies}", set(), False
        studies += 1
        while not is_complete:
            process = started(script, place, runs, scheduler)
            if killed < kills:
                lines, is_killed = interrupted(process, rng, runs)
                killed += is_killed
            else:
                lines = process.communicate()[0].splitlines()
            rows = {tuple(line.split()) for line in lines if len(line.split()) == 2}
            assert not rows & seen  # what has been told of is not made again
            seen |= rows
            is_complete = any("complete" in line for line in lines)
        assert evac.read_study(place).table().equals(wanted)


def test_a_study_that_is_killed_a_few_times_loses_nothing(tmp_path):
    kill_studies(tmp_path, 2, 6, seed=333)  # after three rows, and after two seconds


def test_the_processes_of_a_study_end_with_the_one_that_started_it(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    process = started(script, tmp_path / "r", 500, "")
    for _ in range(4):  # others have joined by then
        process.stdout.readline()
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    until = time.monotonic() + 30.0
    try:
        while time.monotonic() < until:
            os.killpg(process.pid, 0)
            time.sleep(0.1)
    except ProcessLookupError:  # nobody is left
        process.communicate()
        return
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    pytest.fail("processes are left")


@pytest.mark.slow
def test_studies_that_are_killed_at_30_random_moments_lose_nothing(tmp_path):
    kill_studies(tmp_path, 30, 40)


@pytest.mark.slow
def test_studies_on_dask_that_are_killed_at_30_random_moments_lose_nothing(tmp_path):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        kill_studies(tmp_path, 30, 40, cluster.scheduler_address)
