"""Attacks on trajectory files: damaged ones are refused in one line or read to their last whole frame.

`cases` yields cases, `run` runs one and raises AssertionError where it does not do what is promised: reading raises
nothing but a ResultError that names the file; what can be read can be exported too, and is what was written.
"""

import json
import random
import time
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evac.base.change import Change
from evac.base.errors import ResultError
from evac.export.vtk import export_vtk
from evac.folder.records import SEAL, sealed
from evac.trajectory.header import building_to_json
from evac.trajectory.trajectory import Trajectory, read_trajectory
from evac.trajectory.writer import TrajectoryWriter
from tests.three_storeys import crowd_at, three_storeys
from tests.trajectory.parts import Parts, parts_of, places_of, unsealed

#: Greatest time [s] and memory [bytes] that reading a damaged file of a few kB may take.
SECONDS, BYTES = 10.0, 64e6


@dataclass(frozen=True)
class Case:
    """One damage, which a number determines.

    Attributes
    ----------
    damage : str
        Key of `DAMAGES`.
    seed : int
    """

    damage: str
    seed: int

    def __str__(self) -> str:
        return f"{self.damage}-{self.seed}"


def cases(number: int = 350, seed: int = 1) -> Iterator[Case]:
    """Yield `number` cases that the seed determines."""
    generator = random.Random(seed)
    names = list(DAMAGES)
    for k in range(number):
        yield Case(names[k % len(names)], generator.randrange(10**6))


def written(path: Path) -> bytes:
    """Write a trajectory of five people and four frames with a change in the third, and return its bytes."""
    header = {
        "title": "Three storeys",
        "groups": ["even", "odd"],
        "group": [0, 1, 0, 1, 0],
        "radius": [0.2] * 5,
        "height": [1.7] * 5,
        "building": building_to_json(three_storeys()),
    }
    writer = TrajectoryWriter(path, header, np.zeros(2))
    for k in range(4):
        level = np.array([3, 4, 2, 0, 0 if k < 3 else -1])
        position = [[10.5 + 0.5 * k, 3.0], *([1.0 + 0.01 * k, 0.5 + 0.25 * p] for p in range(4))]
        crowd = crowd_at(position, level, velocity=[[1.0, 0.0]] * 5)
        writer.append(0.5 * k, crowd, crowd.velocity, [Change(0.7, "close", "door")] if k == 2 else ())
    writer.close()
    return path.read_bytes()


def run(case: Case, folder: Path) -> str:
    """Run one case in an empty folder; return what came of it: ``refused``, ``shorter``, ``whole`` or ``other``."""
    whole = written(folder / "whole.evac")
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
    assert outcome != "other" or case.damage in SEALED, f"{case}: damage was taken for data"
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
    is_part = is_part and found.changes == whole.changes[: len(found.changes)]
    is_part = is_part and all(np.array_equal(a, b) for a, b in zip(found.records, whole.records, strict=False))
    return ("whole" if n == len(whole) else "shorter") if is_part else "other"


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
    start = generator.choice((b"", data[:4], data[:8], data[:16], b"EVACTRJ2"))
    return start + generator.randbytes(generator.randrange(5000))


def _length(data: bytes, generator: random.Random) -> bytes:
    """Another length in the prefix or the seal of a record."""
    start = generator.choice(places_of(data)[:-1])
    end = start + 8 + int.from_bytes(data[start + 4 : start + 8], "little")
    number = generator.choice((0, 1, len(data), 2**31 - 1, 2**31, 2**32 - 1, generator.randrange(2**32)))
    at = generator.choice((start + 4, end - SEAL))
    return data[:at] + number.to_bytes(4, "little") + data[at + 4 :]


def _message(data: bytes, generator: random.Random) -> bytes:
    """Other bytes in an Arrow message, under a checksum that matches."""
    places = places_of(data)
    k = generator.randrange(len(places) - 1)
    start = places[k]
    message = bytearray(unsealed(data[start : places[k + 1]]))
    for _ in range(generator.choice((1, 1, 2, 8))):
        at = generator.randrange(8, len(message) if k else min(len(message), 1000))
        message[at] = generator.choice((0, 1, 255, message[at] ^ 1 << generator.randrange(8)))
    return data[:start] + sealed(bytes(message), start) + (data[places[k + 1] :] if k else b"")


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
    person = generator.choice(generator.choice(parts.frames).people)
    k = generator.randrange(len(person))
    person[k] = generator.choice((7, 255) if k < 2 else (np.nan, np.inf, -np.inf, 1e30, -1.0, 0.5, 7.0, 2.0**31))


def _odd_time(parts: Parts, generator: random.Random) -> None:
    odd = generator.choice((np.nan, np.inf, -np.inf, -1.0, -5e-324, 0.0, 1e308, 0.5))
    generator.choice(parts.frames).time = odd


def _odd_change(parts: Parts, generator: random.Random) -> None:
    frame = generator.choice(parts.frames)
    change: Json = {"time": frame.time, "kind": "close", "what": "door", "values": {}}
    change[generator.choice(list(change))] = generator.choice(ODD)
    text = json.dumps([change])
    frame.changes = generator.choice((text, text[:-3], f"{text}{text}", "[" * 10**5, "{}", "7", json.dumps(change)))


def _order(parts: Parts, generator: random.Random) -> None:
    """Put frames, or the people of one, in another order; or one of them there twice."""
    if generator.random() < 0.5:
        parts.frames = generator.choices(parts.frames, k=len(parts.frames))
        return
    frame = generator.choice(parts.frames)
    frame.people = generator.choices(frame.people, k=generator.randrange(2 * len(frame.people)))


DAMAGES: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "bits": _bits,
    "cut": _cut,
    "overwritten": _overwritten,
    "removed": _removed,
    "inserted": _inserted,
    "garbage": _garbage,
    "length": _length,
    "message": _message,
    "odd value": _sealed(_odd_value),
    "missing key": _sealed(_missing_key),
    "moved value": _sealed(_moved_value),
    "odd JSON": _sealed(_odd_json),
    "odd number": _sealed(_odd_number),
    "odd time": _sealed(_odd_time),
    "odd change": _sealed(_odd_change),
    "order": _sealed(_order),
}

#: Those whose checksums match, so that not every one can be known for damage.
SEALED = (
    "odd value",
    "missing key",
    "moved value",
    "odd JSON",
    "odd number",
    "odd time",
    "odd change",
    "order",
    "message",
)
