"""Building and directions, made once for all runs that have them in common, and read by processes without copies.

A `Ground` goes to a folder as two files: its arrays, one behind another, which every process maps into its memory; and
what remains of it, pickled without them. Both are found by the digest of the second, which travels with a task, so
that nothing is unpickled but what the process that gave the task has written. Where a process cannot read the files,
on another machine, it makes the ground itself.
"""

import hashlib
import mmap
import pickle
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.assembly import ground_key
from evac.scene import Ground
from evac.simulation import Simulation

if TYPE_CHECKING:
    from evac.scenario.case import Case

#: Grounds that a process keeps, those used last.
MOST_GROUNDS = 8

#: Arrays begin at multiples of so many bytes.
ALIGNMENT = 64


@dataclass(frozen=True)
class GroundFile:
    """Where a ground is to be read.

    Attributes
    ----------
    folder : str
    digest : str
        Of the file without the arrays, which it is named by.
    spans : tuple of (int, int)
        First byte and length of each array.
    """

    folder: str
    digest: str
    spans: tuple[tuple[int, int], ...]

    @property
    def frame(self) -> Path:
        """The file of everything but the arrays."""
        return Path(self.folder) / f"{self.digest}.frame"

    @property
    def arrays(self) -> Path:
        """The file of the arrays."""
        return Path(self.folder) / f"{self.digest}.arrays"


def write_ground(ground: Ground, folder: Path) -> GroundFile:
    """Write a ground to a folder that no other user can write to."""
    buffers: list[pickle.PickleBuffer] = []
    frame = pickle.dumps(ground, protocol=5, buffer_callback=buffers.append)
    digest = hashlib.sha256(frame).hexdigest()
    spans, end = [], 0
    for buffer in buffers:
        start = -(-end // ALIGNMENT) * ALIGNMENT
        end = start + buffer.raw().nbytes
        spans.append((start, end - start))
    file = GroundFile(str(folder), digest, tuple(spans))
    with file.arrays.open("wb") as stream:
        for buffer, (start, _) in zip(buffers, spans, strict=True):
            stream.seek(start)
            stream.write(buffer.raw())
        stream.truncate(max(end, 1))  # an empty file cannot be mapped
    file.frame.write_bytes(frame)
    return file


def read_ground(file: GroundFile) -> Ground:
    """Return a ground whose arrays are those of the file, mapped and read-only.

    Raises
    ------
    OSError
        The files cannot be read, or are not those that were written.
    """
    frame = file.frame.read_bytes()
    if hashlib.sha256(frame).hexdigest() != file.digest:
        raise OSError(f"{file.frame}: changed since it was written")
    with file.arrays.open("rb") as stream:
        mapped = memoryview(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
    ground: Ground = pickle.loads(frame, buffers=[mapped[start : start + length] for start, length in file.spans])
    return ground


class Grounds:
    """The grounds that this process has, by key."""

    def __init__(self) -> None:
        self._kept: OrderedDict[str, Ground] = OrderedDict()

    def get(self, key: str, file: GroundFile | None = None) -> Ground | None:
        """Return a ground that was kept, or the one in a file that can be read here, or None."""
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        if file is not None:
            with suppress(OSError):
                return self.keep(key, read_ground(file))
        return None

    def keep(self, key: str, ground: Ground) -> Ground:
        """Keep a ground, and let go of the one that was used longest ago."""
        self._kept[key] = ground
        while len(self._kept) > MOST_GROUNDS:
            self._kept.popitem(last=False)
        return ground


GROUNDS = Grounds()


def simulation_of(
    case: "Case",
    key: str = "",
    file: GroundFile | None = None,
    compiling: Callable[[int, int], None] | None = None,
    **options: Any,
) -> Simulation:
    """Return a simulation of a case on a ground that this process has, can read, or makes now and keeps.

    Parameters
    ----------
    case : Case
    key : str
        That of `evac.assembly.ground_key`, where it is known.
    file : GroundFile, optional
    compiling : callable, optional
        As for `Simulation`.
    **options
        More for `Simulation`.
    """
    key = key or ground_key(case)
    ground = GROUNDS.get(key, file)
    simulation = Simulation(case, ground=ground, compiling=compiling, **options)
    if ground is None:
        GROUNDS.keep(key, simulation.scene.ground)
    return simulation
