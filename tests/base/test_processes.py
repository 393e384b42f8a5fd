"""Worker processes that die, print, fail, or lose the process that started them."""

import builtins
import math
import operator
import os
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import BrokenExecutor
from pathlib import Path

import numpy as np
import pytest

from evac.base.errors import ScenarioError
from evac.base.processes import Pool
from evac.case.loading import load_case


@pytest.fixture
def pool():
    pool = Pool(2)
    yield pool
    pool.close(at_once=True)


def test_a_process_that_dies_breaks_its_task_alone(pool):
    slow, dying = pool.submit(time.sleep, 0.3), pool.submit(os._exit, 0)
    with pytest.raises(BrokenExecutor):
        dying.result()
    assert slow.result() is None
    assert [one.result() for one in [pool.submit(math.factorial, k) for k in range(4)]] == [1, 1, 2, 6]


def test_processes_that_died_are_replaced(pool):
    dying = [pool.submit(os._exit, 0) for _ in range(2)]
    left = [pool.submit(math.factorial, k) for k in range(4)]
    for one in dying:
        with pytest.raises(BrokenExecutor):
            one.result()
    assert [one.result() for one in left] == [1, 1, 2, 6]


def test_every_process_makes_the_first_call_once():
    """Also one that replaces another one."""
    with Pool(1, (sys.setrecursionlimit, (1234,))) as pool:
        assert pool.submit(sys.getrecursionlimit).result() == 1234
        with pytest.raises(BrokenExecutor):
            pool.submit(os._exit, 0).result()
        assert pool.submit(sys.getrecursionlimit).result() == 1234


@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_arrive_whole_and_can_be_changed(pool, order):
    sent = (
        np.asfortranarray(np.arange(600_000.0).reshape(2, -1)) if order == "F" else np.arange(600_000.0).reshape(2, -1)
    )
    found = pool.submit(np.negative, sent).result()
    np.testing.assert_array_equal(found, -sent)
    found[0, 0] = 1.0
    assert pool.submit(np.sum, np.empty(0)).result() == 0.0


def test_what_cannot_be_pickled_is_an_error_of_its_task(pool):
    with pytest.raises((AttributeError, TypeError), match="pickle"):
        pool.submit(print, threading.Lock()).result()
    assert pool.submit(math.factorial, 3).result() == 6


def test_what_a_task_prints_or_reads_is_not_an_answer(pool, capfd):
    assert pool.submit(builtins.print, "spoken").result() is None
    with pytest.raises(EOFError):
        pool.submit(builtins.input).result()
    assert "spoken" in capfd.readouterr().err


def test_exceptions_come_with_their_notes_or_their_place(pool):
    with pytest.raises(ScenarioError, match="nowhere"):
        pool.submit(load_case, "nowhere").result()
    with pytest.raises(ZeroDivisionError) as caught:
        pool.submit(operator.truediv, 1, 0).result()
    assert "processes.py" in caught.value.__notes__[0]
    with pytest.raises(TypeError, match="pickle"):
        pool.submit(threading.Lock).result()


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="looks for processes in /proc")
def test_workers_end_with_the_process_that_started_them():
    script = """
        import sys, time
        from evac.base.processes import Pool
        pool = Pool(2)
        print(pool.submit(__import__("os").getpid).result(), flush=True)
        pool.submit(time.sleep, 60)
        pool.submit(time.sleep, 60)
        time.sleep(60)
    """
    words = [sys.executable, "-c", textwrap.dedent(script)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        worker = Path("/proc") / process.stdout.readline().strip()
        assert worker.exists()
        process.kill()
    for _ in range(200):
        if not worker.exists() or (worker / "stat").read_text().rpartition(")")[2].split()[0] == "Z":
            break
        time.sleep(0.05)
    else:
        pytest.fail("the worker still runs")
