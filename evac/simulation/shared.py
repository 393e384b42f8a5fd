"""Building and directions, computed once for all runs that share them, and read by processes without copies.

A `Ground` is written to a file that every process maps into memory: its arrays one after another, and behind them the
rest, pickled without the arrays. The digest of the pickle is part of each task, so that a process unpickles only what
was written by the process that submitted the task. A process that cannot read the file, for example on another machine,
computes the ground itself.
"""

import hashlib
import mmap
import pickle
from collections import OrderedDict
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.simulation.assembly import make_shared
from evac.simulation.identity import ground_key
from evac.simulation.scene import Ground
from evac.simulation.simulation import Simulation

if TYPE_CHECKING:
    from evac.case.case import Case

#: Number of most recently used grounds that a process keeps.
MOST_GROUNDS = 8

#: Alignment of the arrays [bytes].
ALIGNMENT = 64


@dataclass(frozen=True)
class GroundFile:
    """Location of a ground on disk."""

    path: str
    digest: str  # of the pickle
    spans: tuple[tuple[int, int], ...]  # first byte and length of each array, and of the pickle behind them


def write_ground(ground: Ground, folder: Path) -> GroundFile:
    """Write a ground to a folder, to which other users must not have write access."""
    buffers: list[pickle.PickleBuffer] = []
    frame = pickle.dumps(ground, protocol=5, buffer_callback=buffers.append)
    digest = hashlib.sha256(frame).hexdigest()
    path, spans = folder / f"{digest}.ground", []
    with path.open("wb") as stream:
        for part in (*(buffer.raw() for buffer in buffers), memoryview(frame)):
            stream.seek(-(-stream.tell() // ALIGNMENT) * ALIGNMENT)
            spans.append((stream.tell(), len(part)))
            stream.write(part)
    return GroundFile(str(path), digest, tuple(spans))


def read_ground(file: GroundFile) -> Ground:
    """Return a ground with arrays that are mapped read-only from the file."""
    with Path(file.path).open("rb") as stream:
        mapped = memoryview(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
    *arrays, rest = (mapped[start : start + length] for start, length in file.spans)
    frame = bytes(rest)
    if hashlib.sha256(frame).hexdigest() != file.digest:
        raise OSError(f"{file.path}: changed since it was written")
    ground: Ground = pickle.loads(frame, buffers=arrays)
    return ground


#: The grounds that this process has used last, by key.
GROUNDS: OrderedDict[str, Ground] = OrderedDict()


def _kept(key: str, file: GroundFile | None) -> Ground | None:
    """Return a cached ground, or else that of a file if it can be read, or else None."""
    if key not in GROUNDS and file is not None:
        with suppress(OSError):
            return _keep(key, read_ground(file))
    return _keep(key, GROUNDS[key]) if key in GROUNDS else None


def _keep(key: str, ground: Ground) -> Ground:
    """Cache a ground as the one used last; discard the one whose use is the longest ago if there are too many."""
    GROUNDS[key] = ground
    GROUNDS.move_to_end(key)
    while len(GROUNDS) > MOST_GROUNDS:
        GROUNDS.popitem(last=False)
    return ground


def shared_ground(case: "Case", key: str, file: GroundFile | None = None) -> Ground:
    """Return the ground of a case, from the cache or the file, or computed and cached; errors as `make_shared`."""
    return _kept(key, file) or _keep(key, make_shared(case))


def simulation_of(case: "Case", key: str = "", file: GroundFile | None = None, **options: Any) -> Simulation:
    """Return a simulation of a case; its ground is taken from the cache or the file, or computed and cached."""
    key = key or ground_key(case)
    ground = _kept(key, file)
    simulation = Simulation(case, ground=ground, **options)
    if ground is None:
        _keep(key, simulation.scene.ground)
    return simulation
