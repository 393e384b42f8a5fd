"""Attacks on trajectory files: damaged ones are refused in one line or read to their last whole frame.

`cases` yields cases, `run` runs one and raises AssertionError where it does not do what is promised: reading raises
nothing but a ResultError that names the file; what can be read can be exported too, and is what was written.
"""

import json
import random
import struct
import time
import tracemalloc
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evac.base.errors import ResultError
from evac.export.vtk import export_vtk
from evac.trajectory.layout import FRAME_HEAD_BYTES, FRAME_HEAD_BYTES_1, RECORD_BYTES
from evac.trajectory.trajectory import Trajectory, read_trajectory

#: Greatest time [s] and memory [bytes] that reading a damaged file of a few kB may take.
SECONDS, BYTES = 10.0, 64e6

FORMAT_1 = Path(__file__).parents[1] / "trajectory" / "format_1.evac"


@dataclass(frozen=True)
class Case:
    """One damage, which a number determines.

    Attributes
    ----------
    damage : str
        Key of `DAMAGES`.
    form : int
        Format of the file, 1 or 2.
    seed : int
    """

    damage: str
    form: int
    seed: int

    def __str__(self) -> str:
        return f"{self.damage}-format{self.form}-{self.seed}"


#: Cases that once raised what they must not.
CRASHERS = (
    Case("moved value", 1, 637919),  # triangles without an area
    Case("moved value", 1, 124978),
    Case("moved value", 2, 489045),
)


def cases(number: int = 350, seed: int = 1) -> Iterator[Case]:
    """Yield the crashers, then `number` cases that the seed determines."""
    yield from CRASHERS
    generator = random.Random(seed)
    names = list(DAMAGES)
    for k in range(number):
        yield Case(names[k % len(names)], 1 + k // len(names) % 2, generator.randrange(10**6))


def run(case: Case, folder: Path) -> str:
    """Run one case in an empty folder; return what came of it: ``refused``, ``shorter``, ``whole`` or ``other``."""
    whole = FORMAT_1.read_bytes() if case.form == 1 else as_format_2(FORMAT_1.read_bytes())
    (folder / "whole.evac").write_bytes(whole)
    path = folder / "damaged.evac"
    path.write_bytes(DAMAGES[case.damage](whole, random.Random(f"{case}")))
    started = time.perf_counter()
    tracemalloc.start()
    try:
        found = _read(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert time.perf_counter() - started < SECONDS, case
    assert peak < BYTES, (case, peak)
    if found is None:
        return "refused"
    _use(found, folder)
    outcome = _compare(found, read_trajectory(folder / "whole.evac"))
    is_believed = case.form == 2 and case.damage not in SEALED
    assert outcome != "other" or not is_believed, f"{case}: damage was taken for data"
    return outcome


def _read(path: Path) -> Trajectory | None:
    try:
        return read_trajectory(path)
    except ResultError as error:
        said = str(error)
    assert path.name in said, said
    assert "\n" not in said, said
    assert len(said) < 1500, said
    return None


def _use(found: Trajectory, folder: Path) -> None:
    """Do with a trajectory what the commands do."""
    if len(found):
        export_vtk(found, folder / "vtk")
    for name in ("position", "z", "velocity", "speed", "level", "crowd_pressure"):
        assert len(getattr(found, name)) == len(found)


def _compare(found: Trajectory, whole: Trajectory) -> str:
    """Return whether a trajectory is the whole one, its first frames, or another."""
    n = len(found)
    is_part = found.header == whole.header and n <= len(whole)
    is_part = is_part and found.time.tolist() == whole.time[:n].tolist()
    is_part = is_part and all(np.array_equal(a, b) for a, b in zip(found.records, whole.records, strict=False))
    return ("whole" if n == len(whole) else "shorter") if is_part else "other"


# The files as their parts


@dataclass
class Parts:
    """A trajectory file in parts, each of which can be changed on its own."""

    form: int
    header: Any
    frames: list[tuple[float, bytes]]

    def seal(self) -> bytes:
        """Return the file, with checksums that match."""
        text = self.header if isinstance(self.header, bytes) else json.dumps(self.header).encode()
        start = b"EVACTRJ%d" % self.form + struct.pack("<I", len(text))
        check = b"" if self.form == 1 else struct.pack("<I", zlib.crc32(start + text))
        return start + check + text + b"".join(self._frame(*given) for given in enumerate(self.frames))

    def _frame(self, number: int, frame: tuple[float, bytes]) -> bytes:
        seconds, records = frame
        count = len(records) // RECORD_BYTES
        if self.form == 1:
            head = struct.pack("<dI", seconds, count)
            return head + struct.pack("<I", zlib.crc32(head + records)) + records
        head = struct.pack("<dII", seconds, number, count)
        return head + struct.pack("<II", zlib.crc32(head), zlib.crc32(records)) + records


def parts_of(data: bytes) -> Parts:
    """Take a file apart."""
    form = data[7] - ord("0")
    at = 12 if form == 1 else 16
    end = at + struct.unpack_from("<I", data, 8)[0]
    header, frames = json.loads(data[at:end]), []
    while end < len(data):
        first = end + (FRAME_HEAD_BYTES_1 if form == 1 else FRAME_HEAD_BYTES)
        seconds, *_, count = struct.unpack_from("<dI" if form == 1 else "<dII", data, end)
        end = first + RECORD_BYTES * count
        frames.append((seconds, data[first:end]))
    return Parts(form, header, frames)


def as_format_2(data: bytes) -> bytes:
    """Return a file of format 1 in format 2."""
    parts = parts_of(data)
    parts.form, parts.header["format"] = 2, 2
    return parts.seal()


# Damages of bytes, which checksums find


def _bits(data: bytes, generator: random.Random) -> bytes:
    wrong = bytearray(data)
    for _ in range(generator.choice((1, 1, 1, 2, 8, 100))):
        wrong[generator.randrange(len(wrong))] ^= 1 << generator.randrange(8)
    return bytes(wrong)


def _cut(data: bytes, generator: random.Random) -> bytes:
    return data[: generator.randrange(len(data) + 1)]


def _overwritten(data: bytes, generator: random.Random) -> bytes:
    first = generator.randrange(len(data))
    length = generator.choice((1, 4, 64, 512, 4096))
    filling = generator.choice((bytes(length), b"\xff" * length, generator.randbytes(length)))
    return data[:first] + filling[: len(data) - first] + data[first + length :]


def _removed(data: bytes, generator: random.Random) -> bytes:
    first = generator.randrange(len(data))
    return data[:first] + data[first + generator.choice((1, 4, 28, 512)) :]


def _inserted(data: bytes, generator: random.Random) -> bytes:
    first = generator.randrange(len(data))
    return data[:first] + generator.randbytes(generator.choice((1, 4, 28, 512))) + data[first:]


def _garbage(data: bytes, generator: random.Random) -> bytes:
    start = generator.choice((b"", data[:8], data[:12], data[:16]))
    return start + generator.randbytes(generator.randrange(5000))


def _length(data: bytes, generator: random.Random) -> bytes:
    number = generator.choice((0, 1, len(data), 2**31 - 1, 2**31, 2**32 - 1, generator.randrange(2**32)))
    return data[:8] + struct.pack("<I", number) + data[12:]


def _count(data: bytes, generator: random.Random) -> bytes:
    """Another number of records, in one of the frames."""
    parts = parts_of(data)
    sizes = [len(parts.seal())]
    for k in reversed(range(len(parts.frames))):
        sizes.insert(0, len(Parts(parts.form, parts.header, parts.frames[:k]).seal()))
    at = generator.choice(sizes[:-1]) + (8 if parts.form == 1 else 12)
    number = generator.choice((0, 1, 3, 5, 6, 2**31, 2**32 - 1))
    return data[:at] + struct.pack("<I", number) + data[at + 4 :]


# Damages under checksums that match, as by another program that writes such files

Json = Any


def _sealed(change: Callable[[Parts, random.Random], None]) -> Callable[[bytes, random.Random], bytes]:
    def damage(data: bytes, generator: random.Random) -> bytes:
        parts = parts_of(data)
        change(parts, generator)
        return parts.seal()

    return damage


#: Values for keys of the header.
ODD = (
    *(None, True, -1, 0, 1, 10**30, 1.5, -1e308, 1e308, 5e-324, "", "floor", "\x00", "\ud800", "é" * 5000),
    *([], {}, [[]], [None], [0], [[0, 1, 2]], [[1e308] * 4], [[0] * 4] * 3, ["a"], {"a": [0]}, {"": None}),
    *({"type": "Polygon", "coordinates": []}, {"type": "Polygon", "coordinates": [[[0, 0], [1, 1], [0, 0]]]}),
    {"type": "MultiPolygon", "coordinates": [[[[0, 0], [1, 0], [1, 1], [0, 0]]]]},
    {"type": "GeometryCollection", "geometries": []},
)


def _places(value: Json, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the place of everything in a header."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield (*place, key)
        yield from _places(item, (*place, key))


def _table(header: Json, place: tuple[Any, ...]) -> Json:
    for key in place[:-1]:
        header = header[key]
    return header


def _odd_value(parts: Parts, generator: random.Random) -> None:
    # Shallow places are as likely as the many deep ones.
    depth = generator.randrange(1, 6)
    place = generator.choice([place for place in _places(parts.header) if len(place) <= depth])
    _table(parts.header, place)[place[-1]] = generator.choice(ODD)


def _missing_key(parts: Parts, generator: random.Random) -> None:
    depth = generator.randrange(1, 5)
    place = generator.choice([place for place in _places(parts.header) if len(place) <= depth])
    del _table(parts.header, place)[place[-1]]


def _moved_value(parts: Parts, generator: random.Random) -> None:
    """Put a value of the header where another one is."""
    places = list(_places(parts.header))
    source, target = generator.choice(places), generator.choice(places)
    value = json.loads(json.dumps(_table(parts.header, source)[source[-1]]))
    _table(parts.header, target)[target[-1]] = value


def _odd_json(parts: Parts, generator: random.Random) -> None:
    text = json.dumps(parts.header)
    parts.header = generator.choice(
        (
            b"[" * 10**5,
            b'{"a":' * 10**5,
            text.replace("0.2", "NaN", 1).encode(),
            text.replace("0.2", "-Infinity", 1).encode(),
            text.replace("0.2", "9" * 5000, 1).encode(),
            text.replace("0.2", "1e999", 1).encode(),
            text.encode("utf-16"),
            b"\xef\xbb\xbf" + text.encode(),
            text.encode() + b"{}",
            b"",
            b"null",
        )
    )


def _odd_number(parts: Parts, generator: random.Random) -> None:
    """Put an impossible number into a record."""
    k = generator.randrange(len(parts.frames))
    seconds, records = parts.frames[k]
    rows = np.frombuffer(records, "<f4").copy()
    rows[generator.randrange(rows.size)] = generator.choice((np.nan, np.inf, -np.inf, 1e30, -1.0, 0.5, 7.0, 2.0**31))
    parts.frames[k] = seconds, rows.tobytes()


def _odd_time(parts: Parts, generator: random.Random) -> None:
    k = generator.randrange(len(parts.frames))
    odd = generator.choice((np.nan, np.inf, -np.inf, -1.0, -5e-324, 0.0, 1e308, 0.5))
    parts.frames[k] = odd, parts.frames[k][1]


def _order(parts: Parts, generator: random.Random) -> None:
    """Put frames, or the records of one, in another order; or one of them there twice."""
    if generator.random() < 0.5:
        parts.frames = generator.choices(parts.frames, k=len(parts.frames))
        return
    k = generator.randrange(len(parts.frames))
    seconds, records = parts.frames[k]
    rows = np.frombuffer(records, "<f4").reshape(-1, 7)
    chosen = [generator.randrange(len(rows)) for _ in range(generator.randrange(2 * len(rows)))]
    parts.frames[k] = seconds, rows[chosen].tobytes()


DAMAGES: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "bits": _bits,
    "cut": _cut,
    "overwritten": _overwritten,
    "removed": _removed,
    "inserted": _inserted,
    "garbage": _garbage,
    "length": _length,
    "count": _count,
    "odd value": _sealed(_odd_value),
    "missing key": _sealed(_missing_key),
    "moved value": _sealed(_moved_value),
    "odd JSON": _sealed(_odd_json),
    "odd number": _sealed(_odd_number),
    "odd time": _sealed(_odd_time),
    "order": _sealed(_order),
}

#: Those whose checksums match, so that not every one can be known for damage.
SEALED = ("odd value", "missing key", "moved value", "odd JSON", "odd number", "odd time", "order")
