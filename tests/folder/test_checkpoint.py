"""Checkpoints come back bit by bit, or are refused by name."""

import hashlib
import io
import math
import os

import numpy as np
import pytest

from evac.base.errors import ResultError
from evac.simulation.checkpoints import read_checkpoint, write_checkpoint

ARRAYS = {
    "floats": np.array([[0.1, -0.0], [np.nan, np.inf]]),
    "numbers": np.arange(5, dtype=np.int32)[::2],
    "flags": np.array([True, False]),
    "none": np.zeros((0, 3)),
    "scalar": np.array(7, np.uint64),
}


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "checkpoint.evac"
    write_checkpoint(path, {"time": 1.5, "stiffness": math.inf, "list": np.arange(2)}, ARRAYS)
    return path


def test_comes_back_bit_by_bit(path):
    header, arrays = read_checkpoint(path)
    assert (header["time"], header["stiffness"], header["list"]) == (1.5, math.inf, [0, 1])
    assert arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert arrays[name].dtype == array.dtype
        assert arrays[name].shape == array.shape
        assert arrays[name].tobytes() == array.tobytes()
        assert arrays[name].flags.writeable


@pytest.mark.parametrize("seed", range(3))
def test_any_damage_is_noticed(path, seed):
    data, generator = path.read_bytes(), np.random.default_rng(seed)
    for _ in range(100):
        damaged = bytearray(data)
        if generator.random() < 0.5:
            damaged[generator.integers(len(data))] ^= 1 << generator.integers(8)
        else:
            del damaged[generator.integers(len(data)) :]
        path.write_bytes(damaged)
        with pytest.raises(ResultError, match=r"checkpoint\.evac"):
            read_checkpoint(path)


def archive(header=b'{"format": 3}', **arrays):
    """Return an archive of some arrays with a right checksum."""
    file = io.BytesIO()
    np.savez(file, header=np.frombuffer(header, np.uint8), **arrays)
    return file.getvalue() + hashlib.sha256(file.getvalue()).digest()


def test_an_archive_of_other_programs_is_read(path):
    path.write_bytes(archive(a=np.arange(3.0)))
    assert read_checkpoint(path)[1]["a"].tolist() == [0.0, 1.0, 2.0]
    assert np.load(path)["a"].tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize(
    "data",
    [archive(b'{"format": 2}'), archive(b"{}"), archive(b"no json"), archive(a=np.array([print])), b"PK", b"EVAC", b""],
)
def test_what_is_no_checkpoint_is_refused_and_not_executed(path, data):
    path.write_bytes(data)
    with pytest.raises(ResultError, match=r"checkpoint\.evac") as error:
        read_checkpoint(path)
    assert "\n" not in str(error.value)


def test_the_last_one_stays_until_the_next_is_on_the_disk(path, monkeypatch):
    before = path.read_bytes()

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ResultError, match="No space left"):
        write_checkpoint(path, {}, ARRAYS)
    assert path.read_bytes() == before


def test_objects_are_refused(tmp_path):
    with pytest.raises(ResultError, match="'odd'"):
        write_checkpoint(tmp_path / "c", {}, {"odd": np.array([object()])})
    with pytest.raises(ResultError, match="plain numbers"):
        write_checkpoint(tmp_path / "c", {"odd": object()}, {})
    assert not list(tmp_path.iterdir())
