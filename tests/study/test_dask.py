"""A real Dask scheduler with two worker processes, of which one is killed: the study is that of one machine."""

import os
import signal
import subprocess
import sys

import pytest

import evac

distributed = pytest.importorskip("distributed")

from evac.study.execute import dask_executor  # noqa: E402

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows cannot kill a process with SIGKILL")


@pytest.fixture
def cluster(tmp_path):
    """Start a scheduler and two workers as processes; yield the scheduler's file and the workers."""
    file = tmp_path / "scheduler.json"
    module = [sys.executable, "-P", "-m"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = [*module, "distributed.cli.dask_scheduler", "--port", "0", "--host", "127.0.0.1", "--no-dashboard"]
    worker = [*module, "distributed.cli.dask_worker", "--no-nanny", "--nthreads", "1", "--no-dashboard"]
    processes = [subprocess.Popen([*scheduler, "--scheduler-file", file], **quiet)]
    try:
        for k in range(2):
            place = tmp_path / f"worker-{k}"
            processes.append(subprocess.Popen([*worker, "--scheduler-file", file, "--local-directory", place], **quiet))
        with distributed.Client(scheduler_file=str(file), set_as_default=False) as client:
            client.wait_for_workers(2, timeout=120)
        yield file, processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.mark.slow  # test_study kills processes of this machine, and a study on Dask is made in tests/docs
@pytest.mark.filterwarnings("ignore")
def test_a_worker_that_is_killed_changes_no_row(cluster, tmp_path):
    file, (_, *workers) = cluster
    case = evac.load("square_room", {"people.people.number": 8, "output.picture": False})
    killed = []

    def progress(state):
        if state.done == 5 and not killed:
            os.kill(workers[0].pid, signal.SIGKILL)
            killed.append(state.done)

    with dask_executor(str(file)) as executor:
        study = evac.repeat(case, 16, folder=tmp_path / "dask", executor=executor, progress=progress)
    assert killed == [5]
    local = evac.repeat(case, 16, folder=tmp_path / "local", workers=1)
    assert study.table().equals(local.table())
    for name in ("summary.json", "statistics.csv"):
        assert (tmp_path / "dask" / name).read_bytes() == (tmp_path / "local" / name).read_bytes()
