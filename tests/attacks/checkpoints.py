"""Attacks on checkpoints: a valid checksum, and content that evac did not write.

`cases` yields cases, `run` runs one and raises AssertionError where it does not do what is promised: the run goes on to
its end, or it is refused in one line that names the checkpoint, and nothing in the folder has changed.
"""

import json
import math
import random
import shutil
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import evac
from evac.base.errors import EvacError, ScenarioError, SimulationError
from evac.folder.checkpoint import read_checkpoint, write_checkpoint
from evac.folder.files import CHECKPOINT_NAME
from tests.attacks.seeded import Case

Json = Any
Arrays = dict[str, NDArray[Any]]

#: Ten people with every behaviour and directions that follow the crowd, so that a checkpoint has all arrays.
HALL: dict[str, Any] = {
    "building": {
        "exits": [
            {"name": "front", "segment": [[5.0, 1.0], [5.0, 2.5]], "z": 0.0},
            {"name": "back", "segment": [[0.0, 1.0], [0.0, 2.5]], "z": 0.0},
        ],
        "areas": [{"name": "all", "polygon": [[0.5, 0.5], [4.5, 0.5], [4.5, 3.5], [0.5, 3.5]], "z": 0.0}],
    },
    "contact": {"model": "nsm2"},
    "behaviours": {
        "headway": {},
        "walking": {},
        "response_time": {"time": {"uniform": [0.0, 0.3]}},
        "route_choice": {"every": 0.5, "exits": ["front", "back"]},
        "teacher_following": {},
    },
    "directions": {"quickest": {"period": 0.3}},
    "simulation": {"duration": 1.4},
    "output": {"picture": False, "animation": False, "every": 0.2},
    "people": [
        {"name": "teacher", "number": 1, "area": "all", "strategy": "quickest"},
        {"name": "class", "number": 9, "area": "all", "behaviours": {"teacher_following": {"teacher": "teacher"}}},
    ],
}

#: Time at which the run was killed [s].
KILLED = 1.0


def cases(number: int = 700, seed: int = 1) -> Iterator[Case]:
    """Yield every kind of change once, then `number` cases that the seed determines."""
    generator = random.Random(seed)
    for change in CHANGES:
        yield Case(change, 0)
    for k in range(number):
        yield Case(list(CHANGES)[k % len(CHANGES)], generator.randrange(1, 10**6))


def run(case: Case, folder: Path) -> str:
    """Run one case in an empty folder; return ``refused``, ``went on`` or ``failed later``."""
    result = folder / "r.running"
    shutil.copytree(_interrupted() / "r.running", result)
    path = result / CHECKPOINT_NAME
    header, arrays = read_checkpoint(path)
    CHANGES[case.kind](header, arrays, random.Random(f"{case}"))
    write_checkpoint(path, header, arrays)
    before = _content(folder)
    refusal: EvacError | None = None
    try:
        results = evac.resume(folder / "r", progress=False)
    except EvacError as error:
        refusal = error
    if isinstance(refusal, SimulationError):  # a state that a run could have, and that cannot go on
        return "failed later"
    if refusal is not None:
        assert "correct the plugin" not in str(refusal), refusal
        # Faults of a case and differences of versions and files are one line each; all else is one line.
        is_list = isinstance(refusal, ScenarioError) or "--allow-differences" in str(refusal)
        assert is_list or "\n" not in str(refusal), refusal
        assert max(map(len, str(refusal).split("\n"))) < 6000, refusal
        assert _content(folder) == before, f"{case}: refused, but the folder has changed: {refusal}"
        return "refused"
    assert results.time <= max(results.case.simulation.duration, KILLED) + 1e-9  # a shorter run is over at once
    return "went on"


@cache
def _interrupted() -> Path:
    """Return a folder with a run that was killed after a second."""
    folder = Path(tempfile.mkdtemp(prefix="evac-attack-base-"))
    mesh = folder / "hall.obj"
    mesh.write_text("v 0 0 0\nv 5 0 0\nv 5 4 0\nv 0 4 0\nf 1 2 3 4\n", encoding="utf-8")

    class Killed(BaseException):
        pass

    def look(progress: Any) -> None:
        if progress.time >= KILLED - 1e-9:
            raise Killed

    try:
        building = {**HALL["building"], "mesh": str(mesh)}
        evac.run({**HALL, "building": building}, folder / "r", checkpoint=0.0, progress=look)
    except Killed:
        return folder
    raise AssertionError("the run ended before it was killed")


def _content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


# Changes of arrays

ODD_NUMBERS = (
    *(-1, 0, 1, 2, 7, 100, -(2**31), 2**31 - 1, 2**31, 2**62, 0.5, -0.5, 1e-300, 1e30, -1e30, 1e300, 1e308),
    *(math.nan, math.inf, -math.inf),
)
KINDS = ("<i4", "<i8", "<f4", "<f8", "|b1", "|u1", "<u8", "<i2", "<f2")


def _one(arrays: Arrays, generator: random.Random) -> str:
    """Return the name of an array; parts with few arrays are as likely as those with many."""
    part = generator.choice(sorted({".".join(name.split(".")[:2]) for name in arrays}))
    return generator.choice([name for name in arrays if name.startswith(part)])


def _value(header: Json, arrays: Arrays, generator: random.Random) -> None:
    name = _one(arrays, generator)
    array = arrays[name]
    if array.size:
        with np.errstate(all="ignore"):
            array.reshape(-1)[generator.randrange(array.size)] = np.array(generator.choice(ODD_NUMBERS)).astype(
                array.dtype
            )


def _values(header: Json, arrays: Arrays, generator: random.Random) -> None:
    name = _one(arrays, generator)
    with np.errstate(all="ignore"):
        arrays[name] = np.full_like(arrays[name], np.array(generator.choice(ODD_NUMBERS)).astype(arrays[name].dtype))


def _bytes(header: Json, arrays: Arrays, generator: random.Random) -> None:
    name = _one(arrays, generator)
    array = arrays[name]
    arrays[name] = np.frombuffer(generator.randbytes(array.nbytes), array.dtype).reshape(array.shape).copy()


def _shape(header: Json, arrays: Arrays, generator: random.Random) -> None:
    name = _one(arrays, generator)
    array = arrays[name]
    flat = array.reshape(-1)
    shapes = [flat, flat[:1], flat[:0], array[None], array.T.copy(), np.concatenate([flat, flat]), np.zeros((3, 3))]
    arrays[name] = generator.choice(shapes)


def _kind(header: Json, arrays: Arrays, generator: random.Random) -> None:
    name = _one(arrays, generator)
    with np.errstate(all="ignore"):
        arrays[name] = arrays[name].astype(generator.choice(KINDS))


def _missing(header: Json, arrays: Arrays, generator: random.Random) -> None:
    del arrays[_one(arrays, generator)]


def _swapped(header: Json, arrays: Arrays, generator: random.Random) -> None:
    one, other = _one(arrays, generator), _one(arrays, generator)
    arrays[one], arrays[other] = arrays[other], arrays[one]


def _additional(header: Json, arrays: Arrays, generator: random.Random) -> None:
    arrays[generator.choice(("simulation.x", "", "recorder.replay.x", "é"))] = np.zeros(generator.randrange(5))


# Changes of the header

ODD = (
    *(None, True, -1, 0, 1, 10**30, 1.5, -1e308, 1e308, math.nan, math.inf, "", "x", "\x00", "é" * 5000, "../x", "/"),
    *([], {}, [[]], [None], ["a"], {"a": [0]}, {"": None}, [{}], {"length": 0, "sha256": "0" * 64}),
)


def places(value: Json, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the place of everything in JSON data."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield (*place, key)
        yield from places(item, (*place, key))


def table(header: Json, place: tuple[Any, ...]) -> Json:
    """Return the table or list that contains a place."""
    for key in place[:-1]:
        header = header[key]
    return header


def _some_place(header: Json, generator: random.Random) -> tuple[Any, ...]:
    depth = generator.randrange(1, 7)  # shallow places are as likely as the many deep ones
    return generator.choice([place for place in places(header) if len(place) <= depth])


def _header_value(header: Json, arrays: Arrays, generator: random.Random) -> None:
    place = _some_place(header, generator)
    table(header, place)[place[-1]] = generator.choice(ODD)


def _header_missing(header: Json, arrays: Arrays, generator: random.Random) -> None:
    place = _some_place(header, generator)
    del table(header, place)[place[-1]]


def _header_moved(header: Json, arrays: Arrays, generator: random.Random) -> None:
    source, target = _some_place(header, generator), _some_place(header, generator)
    value = json.loads(json.dumps(table(header, source)[source[-1]]))
    table(header, target)[target[-1]] = value


def _file(header: Json, arrays: Arrays, generator: random.Random) -> None:
    """Change what the checkpoint says about the files of the recorders."""
    files = header["files"]
    given = files.pop("trajectory.evac")
    length = generator.choice((0, 1, given["length"] - 1, given["length"] + 1, 10**12))
    other = {"length": length, "sha256": given["sha256"]}
    name = generator.choice(("trajectory.evac", CHECKPOINT_NAME, "../hall.obj", "./trajectory.evac", "a/b", "x.html"))
    files |= generator.choice(({}, {name: other}, {name: given}, {"trajectory.evac": given, name: other}))


CHANGES: dict[str, Callable[[Json, Arrays, random.Random], None]] = {
    "value": _value,
    "values": _values,
    "bytes": _bytes,
    "shape": _shape,
    "kind": _kind,
    "missing": _missing,
    "swapped": _swapped,
    "additional": _additional,
    "header value": _header_value,
    "header missing": _header_missing,
    "header moved": _header_moved,
    "file": _file,
}
