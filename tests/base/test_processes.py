"""The pool of worker processes: what breaks it, what its processes print, and when they end."""

import math
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import BrokenExecutor, CancelledError
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import pytest

from evac.base.errors import ScenarioError
from evac.base.processes import Pool
from evac.case.loading import load_case


def test_every_process_makes_the_first_call_once(started):
    with Pool(2, sys.setrecursionlimit, (1234,)) as pool:
        assert [one.result() for one in [pool.submit(sys.getrecursionlimit) for _ in range(4)]] == [1234] * 4
        np.testing.assert_array_equal(pool.submit(np.negative, np.arange(1e6)).result(), -np.arange(1e6))
        with pytest.raises(ScenarioError, match="nowhere"):
            pool.submit(load_case, "nowhere").result()
    assert 1 <= len(started) <= 2
    assert all(process.exitcode is not None for process in started)
    if hasattr(signal, "pthread_sigmask"):  # Ctrl-C reaches this process as before
        assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_a_process_that_dies_breaks_the_pool():
    with Pool(2) as pool, pytest.raises(BrokenExecutor):
        pool.submit(os._exit, 0).result()


def test_a_pool_ends_its_processes_in_the_midst_of_a_task(started):
    begin = time.monotonic()
    with Pool(1) as pool:
        assert pool.submit(math.factorial, 3).result() == 6
        task = pool.submit(time.sleep, 60)
    assert time.monotonic() - begin < 30
    assert started[0].exitcode is not None
    with pytest.raises((BrokenExecutor, CancelledError)):
        task.result()


def test_a_pool_ends_in_the_midst_of_a_result(monkeypatch):
    """Python waits for the end of a message as long as the pipe has a writer, which this process would be."""
    receive, begun = Connection._recv, threading.Event()

    def received(connection, size, *more):
        if size > 1_000_000:
            begun.set()
        return receive(connection, size, *more)

    monkeypatch.setattr(Connection, "_recv", received)
    with Pool(1) as pool:
        pool.submit(bytes, 500_000_000)
        assert begun.wait(60)
        ending = threading.Thread(target=pool.kill, daemon=True)
        ending.start()
        ending.join(20)
        assert not ending.is_alive()


def test_what_a_quiet_worker_prints_is_not_shown(capfd):
    for is_quiet in (False, True):
        with Pool(1, is_quiet=is_quiet) as pool:
            pool.submit(os.system, f"echo quiet: {is_quiet}; echo quiet: {is_quiet} >&2").result()
    assert [text.split() for text in capfd.readouterr()] == [["quiet:", "False"]] * 2


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="looks for processes in /proc")
def test_workers_end_with_the_process_that_started_them():
    script = """
        import time
        from evac.base.processes import Pool
        pool = Pool(2)
        print(pool.submit(__import__("os").getpid).result(), flush=True)
        pool.submit(time.sleep, 60)
        pool.submit(time.sleep, 60)
        time.sleep(60)
    """
    words = [sys.executable, "-c", textwrap.dedent(script)]
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdout=pipe, stderr=pipe, text=True) as process:
        worker = Path("/proc") / process.stdout.readline().strip()
        assert worker.exists()
        process.kill()
        process.communicate()
    for _ in range(200):
        if not worker.exists() or (worker / "stat").read_text().rpartition(")")[2].split()[0] == "Z":
            break
        time.sleep(0.05)
    else:
        pytest.fail("the worker still runs")
