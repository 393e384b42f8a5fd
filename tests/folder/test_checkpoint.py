"""Checkpoints come back bit by bit, or are refused by name."""

import hashlib
import io
import math
import os
import zipfile

import numpy as np
import pytest

from evac.base.errors import ResultError
from evac.folder.checkpoint import read_checkpoint, write_checkpoint

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


def archive(header=b'{"format": 3}', method=zipfile.ZIP_STORED, **members):
    """Return an archive of some members with a right checksum."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as made:
        for name, data in {"header": npy(np.frombuffer(header, np.uint8)), **members}.items():
            made.writestr(f"{name}.npy", data)
    return file.getvalue() + hashlib.sha256(file.getvalue()).digest()


def npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def pickled():
    file = io.BytesIO()
    np.save(file, np.array([print]), allow_pickle=True)
    return file.getvalue()


def broken(data):
    """Return an archive whose first member, if it is compressed, cannot be decompressed."""
    start = 30 + len("header.npy")
    data = data[:start] + b"\xff" * 12 + data[start + 12 : -32]
    return data + hashlib.sha256(data).digest()


def test_an_archive_of_other_programs_is_read(path):
    path.write_bytes(archive(a=npy(np.arange(3.0))))
    assert read_checkpoint(path)[1]["a"].tolist() == [0.0, 1.0, 2.0]
    assert np.load(path)["a"].tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize(
    "data",
    [
        archive(b'{"format": 2}'),
        archive(b"{}"),
        archive(b"[]"),
        archive(b"no json"),
        archive(b"[" * 100_000),
        archive(a=pickled()),
        archive(a=npy(np.array(["text"]))),
        archive(a=npy(np.arange(3.0))[:-1]),
        archive(a=npy(np.arange(3.0)).replace(b"(3,)", b"(9" + b"0" * 18 + b",)")),
        archive(a=npy(np.arange(3.0)).replace(b"(3,), }", b"(3,    ")),
        archive(a=b"no array"),
        archive(method=zipfile.ZIP_DEFLATED, a=npy(np.zeros(10**6))),
        broken(archive(method=zipfile.ZIP_DEFLATED)),
        broken(archive(method=zipfile.ZIP_LZMA)),
        broken(archive(method=zipfile.ZIP_BZIP2)),
        archive().replace(b"header", b"hea\xffer"),
        b"PK",
        b"EVACCHK1",
        b"",
    ],
)
def test_a_file_with_a_right_checksum_and_a_wrong_header_is_refused(path, data):
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
