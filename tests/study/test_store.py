"""Rows on disk: what a kill leaves, what is read back, and in which order."""

import math
import os

import numpy as np
import pyarrow as pa
import pytest

import evac
from evac.base.errors import ResultError
from evac.folder.files import RUNS_STREAM_NAME
from evac.study.execute import Row
from evac.study.points import grid
from evac.study.store import RowStore


@pytest.fixture(scope="module")
def points():
    return grid(evac.load("square_room"), {"people.people.number": [3, 4], "contact.model": ["dem"]})


def row(point, run, people=3):
    times = np.arange(1.0, people + 1.0) + run
    blocked = run == 2
    if blocked:
        times[-1] = np.nan
    ended = "no progress" if blocked else "everybody out"
    return Row(
        point=point,
        run=run,
        seed=run + 1,
        population_seed=None,
        ended=ended,
        time=10.0,
        last_out=math.inf if blocked else float(times[-1]),
        exits=(("door", people, 3.0), ("hatch", 0, None)),
        exit_time=times,
        exit_used=np.zeros(people, np.int16),
        quality_warnings=("deep",) * run,
    )


def filled(folder, points, keys):
    store = RowStore(folder, points)
    for key in keys:
        store.append(row(*key))
    return store


def test_rows_are_read_as_they_were_written_in_the_order_wanted(tmp_path, points):
    store = filled(tmp_path, points, [(1, 0), (0, 2), (0, 0)])
    rows = list(store.rows([(0, 0), (0, 2), (1, 0)]))
    assert [(one["point"], one["run"]) for one in rows] == [(0, 0), (0, 2), (1, 0)]
    assert [one["people.people.number"] for one in rows] == [3, 3, 4]
    assert rows[1]["last_out"] is None
    assert rows[1]["blocked"]
    assert rows[1]["quality_warnings"] == ["deep", "deep"]
    assert rows[0]["exits"][1] == {"name": "hatch", "people": 0, "last_out": None}
    np.testing.assert_array_equal(rows[1]["exit_time"], [3.0, 4.0, np.nan])
    assert store.entries[0, 2].last_out == math.inf
    store.close()


def test_a_file_that_was_cut_anywhere_keeps_its_complete_rows(tmp_path, points):
    """As a kill leaves it, at every length; a row that is appended then is read after those."""
    path = tmp_path / RUNS_STREAM_NAME
    store = RowStore(tmp_path, points)
    ends = []
    for run in range(3):
        store.append(row(0, run))
        ends.append(path.stat().st_size)
    store.close()
    whole = path.read_bytes()
    for length in [0, 1, 7, 8, *range(9, len(whole), 211), *(end - 1 for end in ends), *ends]:
        path.write_bytes(whole[:length])
        again = RowStore(tmp_path, points)
        complete = [(0, run) for run, end in enumerate(ends) if end <= length]
        assert list(again.entries) == complete
        again.append(row(1, 0))
        again.close()
        last = RowStore(tmp_path, points)
        assert [one["run"] for one in last.rows([*complete, (1, 0)])] == [*range(len(complete)), 0]


def damaged(data, generator):
    """Return data with changed bytes, a part overwritten, removed or repeated, or its end cut off."""
    found, place = bytearray(data), int(generator.integers(len(data)))
    length = int(generator.integers(1, 200))
    kind = generator.integers(5)
    if kind == 0:
        found[place] ^= 1 << int(generator.integers(8))
    elif kind == 1:
        found[place : place + length] = generator.integers(0, 256, length, np.uint8).tobytes()
    elif kind == 2:
        del found[place : place + length]
    elif kind == 3:
        found[place:place] = found[place : place + length]
    else:
        del found[place:]
    return bytes(found)


def test_damage_anywhere_leaves_only_rows_as_they_were_written(tmp_path, points):
    path, keys, generator = tmp_path / RUNS_STREAM_NAME, [(0, 0), (1, 3), (0, 1)], np.random.default_rng(1)
    filled(tmp_path, points, keys).close()
    whole, written = path.read_bytes(), list(RowStore(tmp_path, points).rows(sorted(keys)))
    written = {(row["point"], row["run"]): repr(row) for row in written}
    for _ in range(120):
        path.write_bytes(damaged(whole, generator))
        store = RowStore(tmp_path, points)
        assert list(store.entries) == keys[: len(store.entries)]
        for one in store.rows(sorted(store.entries)):
            assert repr(one) == written[one["point"], one["run"]]


def test_rows_are_forced_to_disk_in_batches(tmp_path, points, monkeypatch):
    now, synced = [100.0], []
    monkeypatch.setattr("evac.study.store.time.monotonic", lambda: now[0])
    monkeypatch.setattr("os.fsync", lambda descriptor: synced.append(now[0]))
    store = RowStore(tmp_path, points)
    for run in range(10):
        now[0] += 0.3
        store.append(row(0, run))
    assert 2 <= len(synced) <= 4
    store.close()
    assert len(synced) <= 5
    assert synced[-1] == now[0]


def test_reading_changes_no_file(tmp_path, points):
    filled(tmp_path, points, [(0, 0)]).close()
    path = tmp_path / RUNS_STREAM_NAME
    path.write_bytes(path.read_bytes() + b"half a row")
    RowStore(tmp_path, points)
    assert path.read_bytes().endswith(b"half a row")


def test_what_follows_the_last_whole_row_is_removed_when_a_study_is_complete(tmp_path, points):
    filled(tmp_path, points, [(0, 0)]).close()
    path = tmp_path / RUNS_STREAM_NAME
    whole = path.read_bytes()
    path.write_bytes(whole + b"half a row")
    RowStore(tmp_path, points).complete()
    assert path.read_bytes() == whole


def test_the_table_is_sorted_whatever_the_order_of_runs_was(tmp_path, points):
    keys = [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1)]
    store = filled(tmp_path, points, [*keys[::-1], (0, 1)])  # a run that was made again
    store.close()
    table = RowStore(tmp_path, points).table()
    assert table.column("run").to_pylist() == [0, 1, 2, 0, 1]
    assert table.column("seed").to_pylist() == [1, 2, 3, 1, 2]
    assert table.column("exit_time").to_pylist()[1] == [2.0, 3.0, 4.0]
    with pa.ipc.open_stream(tmp_path / RUNS_STREAM_NAME) as stream:  # as other programs read it
        assert stream.read_all().column("run").to_pylist() == [1, 0, 2, 1, 0, 1]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no pipes that are files")
def test_rows_are_not_written_to_a_pipe_that_nobody_reads(tmp_path, points):
    os.mkfifo(tmp_path / RUNS_STREAM_NAME)
    with pytest.raises(ResultError, match=r"runs\.arrows: cannot write the rows"):
        filled(tmp_path, points, [(0, 0)])
