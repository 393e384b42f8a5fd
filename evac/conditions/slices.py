"""Slice files of FDS: the list of them in a Smokeview file (.smv), and their values (.sf).

Both are written by FDS; docs/fire_data.md describes what is read. Nothing in the folder is executed or unpickled, and
values are read for the two times around that of the run only.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.errors import ScenarioError, check_regular
from evac.conditions.source import gap_in

#: Records of a slice file before the first time: three texts of 30 characters and six indices, each with its length
#: before and after it. A time has a record with itself and one with the values.
HEADER = np.dtype(
    [(f"{part}{k}", kind) for k in range(3) for part, kind in (("a", "<i4"), ("text", "S30"), ("b", "<i4"))]
    + [("c", "<i4"), ("bounds", "<i4", (6,)), ("d", "<i4")]
)


_SLICE = re.compile(r"SLC([FC])\s+(\d+)\b.*?&((?:\s+\d{1,9}){6})(?:\s|$)")


@dataclass(frozen=True)
class Block:
    """The values of a quantity on a part of a plane or volume in one mesh."""

    path: Path  # the slice file
    quantity: str  # as FDS writes it
    axes: tuple[FloatArray, FloatArray, FloatArray]  # coordinates of the values along x, y and z, (n,) each [m]
    # (3, 2) [m]: where it begins and ends; within half a cell, values at the centres of cells are continued
    ends: FloatArray
    times: FloatArray  # (f,) [s]
    unit: str  # as FDS writes it
    shape: tuple[int, int, int]  # of the values in the file, along z, y and x
    is_centred: bool
    _frames: dict[int, FloatArray] = field(default_factory=dict, repr=False)

    @property
    def place(self) -> tuple[bytes, ...]:
        """What is equal for blocks whose values are at the same places."""
        return tuple(axis.tobytes() for axis in (*self.axes, self.ends))

    @property
    def is_plane(self) -> bool:
        """Whether it is a horizontal plane."""
        return len(self.axes[2]) == 1

    @property
    def is_vertical(self) -> bool:
        """Whether it is a vertical plane."""
        return 1 in self.shape[1:]

    def frame(self, index: int) -> FloatArray:
        """Return the values (z, y, x) of a time; two of them are kept."""
        if index not in self._frames:
            size = int(np.prod(self.shape))
            kind = _frame_of(size)
            try:
                read = np.fromfile(self.path, kind, 1, offset=HEADER.itemsize + index * kind.itemsize)
            except OSError as error:
                raise ScenarioError(f"{self.path}: cannot be read: {error.strerror}; check the file") from error
            values = read["values"].reshape(-1).astype(np.float64) if len(read) else np.empty(0)
            if len(values) < size or not np.isfinite(values).all():
                raise ScenarioError(
                    f"{self.path}: t = {self.times[index]:g} s: values are missing, or not finite; run FDS again"
                )
            values = values.reshape(self.shape)
            if self.is_centred:
                values = values[tuple(slice(min(1, n - 1), None) for n in self.shape)]
            while len(self._frames) > 1:
                del self._frames[next(iter(self._frames))]
            self._frames[index] = np.ascontiguousarray(values)
        return self._frames[index]

    def at(self, time: float, nodes: NDArray[np.int64], weights: FloatArray) -> FloatArray:
        """Return weighted sums (n,) of the values of nodes (k, n), at a time [s] between those of the file."""
        last = len(self.times) - 1
        before = min(max(int(np.searchsorted(self.times, time, side="right")) - 1, 0), last)
        values: FloatArray = (self.frame(before).reshape(-1)[nodes] * weights).sum(axis=0)
        if before < last and time > self.times[before]:
            share = (time - self.times[before]) / (self.times[before + 1] - self.times[before])
            after = (self.frame(before + 1).reshape(-1)[nodes] * weights).sum(axis=0)
            values += share * (after - values)
        return values

    def weigh(self, points: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
        """Return the nodes (k, n) around points (3, n), and their weights: linear along each axis."""
        nodes, weights = np.zeros((1, points.shape[1]), np.int64), np.ones((1, points.shape[1]))
        for axis, values in zip(reversed(self.axes), points[::-1], strict=True):
            nodes *= len(axis)
            if len(axis) == 1:
                continue
            low = np.clip(np.searchsorted(axis, values, side="right") - 1, 0, len(axis) - 2)
            share = np.clip((values - axis[low]) / (axis[low + 1] - axis[low]), 0.0, 1.0)
            nodes = np.concatenate([nodes + low, nodes + low + 1])
            weights = np.concatenate([weights * (1.0 - share), weights * share])
        return nodes, weights


def _frame_of(size: int) -> np.dtype[np.void]:
    """Return the layout of a time with a number of values."""
    head = [("a", "<i4"), ("time", "<f4"), ("b", "<i4"), ("c", "<i4")]
    return np.dtype([*head, ("values", "<f4", (size,)), ("d", "<i4")])


def read_slices(
    path: Path, quantities: frozenset[str], shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> list[Block]:
    """Return the planes and volumes of some quantities that a Smokeview file lists, shifted by (3,) [m].

    Slices along terrain are left out.
    """
    try:
        check_regular(path)
        lines = path.read_text(encoding="latin-1").splitlines()
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}; check the file") from error
    nodes, blocks = [[axis + by for axis, by in zip(mesh, shift, strict=True)] for mesh in _nodes_in(path, lines)], []
    for number, line in enumerate(lines):
        if not line.startswith(("SLCF", "SLCC")):
            continue
        names = [line.strip() for line in lines[number + 1 : number + 5]]
        if len(names) < 4:
            raise _damaged(path, number, "the slice has fewer than four lines after it")
        if names[1] not in quantities:
            continue
        match = _SLICE.match(line)
        if match is None:
            raise _damaged(path, number, f"{line.strip()!r:.80} is not a slice with a mesh and six indices")
        mesh, bounds = int(match[2]) - 1, np.array(match[3].split(), np.int64).reshape(3, 2)
        if mesh not in range(len(nodes)):
            raise _damaged(path, number, f"there is no mesh {mesh + 1}")
        counts = np.array([len(axis) for axis in nodes[mesh]])
        if (bounds[:, 0] > bounds[:, 1]).any() or (bounds[:, 1] >= counts).any():
            raise _damaged(path, number, f"indices {bounds.ravel().tolist()} lie outside of mesh {mesh + 1}")
        file = (path.parent / names[0]).resolve()
        if not file.is_relative_to(path.parent.resolve()):
            raise _damaged(path, number + 1, f"{names[0]!r:.80} is outside of its folder")
        blocks.append(_block_of(file, (names[1], names[3]), nodes[mesh], bounds, match[1] == "C"))
    return blocks


def _nodes_in(path: Path, lines: list[str]) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Return the coordinates of the nodes along x, y and z of each mesh."""
    counts: list[list[int]] = []
    axes: dict[str, list[FloatArray]] = {"TRNX": [], "TRNY": [], "TRNZ": []}
    for number, line in enumerate(lines):
        word = line[:4]
        try:
            if word == "GRID":
                counts.append([int(word) + 1 for word in lines[number + 1].split()[:3]])
                if len(counts[-1]) < 3 or min(counts[-1]) < 2:
                    raise ValueError(f"{lines[number + 1].strip()!r:.80} are not three numbers of cells")
            elif word in axes and line.strip() == word:
                size = counts[len(axes[word])]["XYZ".index(word[3])]
                first = number + 2 + int(lines[number + 1])
                own = np.array([float(row.split()[1]) for row in lines[first : first + size]])
                if len(own) < size or not np.isfinite(own).all() or (np.diff(own) <= 0.0).any():
                    raise ValueError(f"needs {size} coordinates that increase")
                axes[word].append(own)
        except (ValueError, IndexError) as error:
            raise _damaged(path, number, f"{word}: {error}") from error
    if not counts or any(len(own) != len(counts) for own in axes.values()):
        raise ScenarioError(
            f"{path}: has {len(counts)} meshes (GRID), but not TRNX, TRNY and TRNZ of each; run FDS again"
        )
    return list(zip(axes["TRNX"], axes["TRNY"], axes["TRNZ"], strict=True))


def _block_of(
    path: Path, labels: tuple[str, str], nodes: Sequence[FloatArray], bounds: NDArray[np.int64], is_centred: bool
) -> Block:
    """Return the block of a slice file with its quantity and unit, whose times are read."""
    axes, ends = [], np.empty((3, 2))
    for k, (own, (first, last)) in enumerate(zip(nodes, bounds.tolist(), strict=True)):
        part = own[first : last + 1]
        if is_centred:  # of a plane, the cell below the node
            part = own[max(first - 1, 0) : max(last, 1) + 1] if first == last else part
            axes.append(0.5 * (part[1:] + part[:-1]))
        else:
            axes.append(part)
        ends[k] = part[0], part[-1]
    shape = tuple((bounds[::-1, 1] - bounds[::-1, 0] + 1).tolist())
    times = _times_in(path, bounds, int(np.prod(shape)))
    return Block(path, labels[0], (axes[0], axes[1], axes[2]), ends, times, labels[1], shape, is_centred)


def _times_in(path: Path, bounds: NDArray[np.int64], size: int) -> FloatArray:
    """Return the times of a slice file; a last one that is not complete is left out."""
    try:
        check_regular(path)
        head = np.fromfile(path, HEADER, 1)
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}; check the folder of the results") from error
    if not len(head):
        raise ScenarioError(f"{path}: contains no values; run FDS again, or remove its slice from the Smokeview file")
    lengths = [int(head[f"{part}{k}"][0]) for k in range(3) for part in "ab"] + [int(head[part][0]) for part in "cd"]
    if lengths != [30] * 6 + [24] * 2:
        raise ScenarioError(
            f"{path}: does not begin as a slice file of FDS (lengths of records {lengths}); run FDS again"
        )
    if (head["bounds"][0] != bounds.ravel()).any():
        raise ScenarioError(
            f"{path}: has the indices {head['bounds'][0].tolist()}, but the Smokeview file {bounds.ravel().tolist()}; "
            "the files are not of one calculation"
        )
    kind = _frame_of(size)
    number = (path.stat().st_size - HEADER.itemsize) // kind.itemsize
    if number == 0:
        raise ScenarioError(f"{path}: has no complete time; run FDS again, or remove its slice from the Smokeview file")
    frames = np.memmap(path, kind, "r", HEADER.itemsize, (number,))
    marks = np.stack([frames[mark] for mark in "abcd"])
    wrong = (marks != np.array([[4], [4], [4 * size], [4 * size]])).any(axis=0)
    if wrong.any():
        frame = int(np.argmax(wrong))
        raise ScenarioError(f"{path}: time {frame + 1}: its records have wrong lengths; run FDS again")
    times = frames["time"].astype(np.float64)
    if not np.isfinite(times).all() or (np.diff(times) <= 0.0).any():
        frame = int(np.argmax(~(np.diff(times, prepend=-np.inf) > 0.0)))
        raise ScenarioError(
            f"{path}: time {frame + 1}, {times[frame]:g} s, is not later than the one before; run FDS again"
        )
    if gap := gap_in(times):
        raise ScenarioError(f"{path}: {gap}; run FDS again with one DT_SLCF, or copy all of the file")
    return times


def _damaged(path: Path, line: int, what: str) -> ScenarioError:
    return ScenarioError(f"{path}: line {line + 1}: {what}; run FDS again, or copy the file as it was written")
