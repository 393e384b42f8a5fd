"""The motion of all people for the replay page: quantised, as second differences, compressed frame by frame.

The page decodes the streams (page/run/motion.js). All numbers are little-endian:

- ``times``: float64, the time of each frame [s].
- ``events``: int32. For each frame the number of people who came, left or changed the level, their indices and their
  levels, -1 of those who left; the number of people for whom it has changed whether their response time is over, and
  their indices.
- ``steps``: bytes. For each frame x, then y, of everybody inside by ascending person: second differences in
  centimetres of the position rounded down, to which the page adds half a centimetre. Before a person's first frame its
  positions count as zero, for its second frame as the first one.
- ``heights``: bytes. For each frame, of everybody on an uneven level, the height above the level's plane [cm].
- ``speeds``, ``waited``, ``forces``: bytes. For each frame, of everybody inside, the change since the person's last
  frame of the speed [cm/s], of the time that the person has waited [0.01 s], and of the code of the contact force,
  which has two significant digits: 0 below 10 N, 1 to 90 for 10 to 99 N, 91 to 180 for 100 to 990 N, and so
  on. `evac.analysis.measures` defines all three.
- ``doses``: the same of the dose [0.001], at most 10; empty in a case without doses.
- ``headings``: bytes, as they are. For each frame, of everybody inside whose speed is not 0, the change of the
  direction in plan since the person's last one, in parts of a circle of 256, modulo 256.
- ``smoke``: bytes, as they are. For each frame 0 if smoke is as in the previous one, otherwise 1, and the changes of
  the codes of all cells of the field, modulo 256. The code of an extinction coefficient K [1/m] is
  255 (1 - exp(-K `DEPTH`)), at most 254. Empty without a field of smoke.
- ``wide``: int32. Numbers that do not fit in a byte.

A byte b of the others encodes the number b / 2 if b is even and -(b + 1) / 2 if it is odd; 255 encodes the next number
of ``wide``.
"""

import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.analysis.measures import Measuring
from evac.base.arrays import FloatArray, IntArray
from evac.base.defaults import CONTRAST
from evac.base.saved import SavedError, part_of, taken
from evac.building.model.building import Building, Level
from evac.building.model.cells import LevelField
from evac.building.model.elevation import PLANE, elevation
from evac.pictures.palette import DEPTH

#: Resolution of positions [m].
GRAIN = 0.01

#: Resolution of times that people have waited [s], and of speeds [m/s].
MOMENT, PACE = 0.01, 0.01

#: Resolution of doses, and the greatest one that is stored.
PART, MOST_DOSE = 0.001, 10.0

ESCAPE = 255
#: Largest numbers in a saved state, so that differences do not overflow.
MOST_FRAMES = 2**31 - 1
MOST_CODE = 2**40
#: Greatest number of bytes of a stream for a frame, and in addition for each person.
LARGEST_FRAME, LARGEST_RECORD = 21, 33
#: Arrays that encoding of the next frame depends on.
_STATE = (
    *("level", "started", "seen", "last", "before", "speeds", "waited", "forces", "doses", "headings", "smoke"),
    *("first_level", "first"),
)

STREAMS = ("times", "events", "steps", "heights", "speeds", "waited", "forces", "doses", "headings", "smoke", "wide")


class _Stream:
    """A byte stream that is compressed incrementally."""

    def __init__(self, data: bytes = b"") -> None:
        # Sequences rarely repeat, but some bytes are much more frequent than others.
        self._compressor = zlib.compressobj(9, strategy=zlib.Z_FILTERED)
        self._ready = bytearray()
        self.write(data)

    def write(self, data: bytes) -> None:
        self._ready += self._compressor.compress(data)

    def packed(self) -> bytes:
        """Return all data written so far, compressed; writing can continue."""
        return bytes(self._ready) + self._compressor.copy().flush()


class MotionPacker:
    """Encodes and compresses one frame after the other, so that little memory is needed.

    Attributes
    ----------
    frames : int
        Number of frames so far.
    origin : (2,) float64 [m]
        Origin of positions in plan.
    """

    def __init__(
        self, people: int, building: Building, smoke: LevelField | None = None, contrast: float = CONTRAST
    ) -> None:
        corners = building.vertices[:, :2]
        self.frames, self.building, self.field, self.contrast = 0, building, smoke, contrast
        self._smoke = np.zeros(0 if smoke is None else smoke.size, np.uint8)  # in the previous frame
        self.origin: FloatArray = np.round(0.5 * (corners.min(axis=0) + corners.max(axis=0)))
        self._planes = [level_plane(building, level) for level in building.levels]
        self._uneven = np.array([not is_even(building, level) for level in building.levels])
        self._level, self._first_level = np.full((2, people), -1, np.int32)  # in the previous frame, and in the first
        self._seen = np.zeros(people, np.int32)  # frames of each person so far
        # Positions in the last two frames, and in the first one of the run.
        self._last, self._before, self._first = np.zeros((3, people, 2), np.int64)
        self._started = np.zeros(people, np.int32)  # 1 of those whose response time was over
        # In each person's last frame.
        self._speeds, self._waited, self._forces, self._doses, self._headings = np.zeros((5, people), np.int64)
        self._measuring = Measuring(people)
        self._streams = {name: _Stream() for name in STREAMS}

    def add(
        self,
        time: float,
        person: IntArray,
        level: IntArray,
        position: FloatArray,
        velocity: FloatArray,
        started: NDArray[np.bool_],
        contact_force: FloatArray,
        is_shown: bool = True,
        dose: FloatArray | None = None,
        smoke: FloatArray | None = None,
    ) -> None:
        """Add a frame with all people who are inside at one time.

        `time` [s]: later than that of the previous frame; `person` (c,): ascending indices; `level` (c,); `position`
        (c, 2) [m]; `velocity` (c, 3) [m/s]: in space; `started` (c,); `contact_force` (c,) [N]; `is_shown`: otherwise,
        people are only measured; `dose` (c,): greater ones of the doses of gases and heat, in every frame or in none;
        `smoke` (m,): values of the field of smoke [1/m].
        """
        speed = np.linalg.norm(velocity, axis=1)
        found = self._measuring.add(time, person, speed, started, contact_force)
        if not is_shown:
            return
        self.frames += 1
        self._write("times", np.array([time], "<f8"))
        self._write("events", self._events(person, level, started))
        at = np.floor((position - self.origin) / GRAIN).astype(np.int64)  # so that nobody is in another cell of maps
        if self.frames == 1:
            self._first_level[person], self._first[person] = level, at
        expected = np.where(self._seen[person, None] > 1, 2 * self._last[person] - self._before[person], 0)
        expected = np.where(self._seen[person, None] == 1, self._last[person], expected)
        self._numbers("steps", (at - expected).T.ravel())
        self._before[person], self._last[person] = self._last[person], at
        self._seen[person] += 1
        uneven = np.flatnonzero(self._uneven[level])
        if uneven.size:
            plane = np.array(self._planes)[level[uneven]]
            height = plane[:, 0] + (plane[:, 1:] * position[uneven]).sum(axis=1)
            off = elevation(self.building, level[uneven], position[uneven]) - height
            self._numbers("heights", np.rint(off / GRAIN).astype(np.int64))
        codes = {
            "speeds": np.rint(found.speed / PACE).astype(np.int64),
            "waited": np.rint(found.waited / MOMENT).astype(np.int64),
            "forces": force_codes(found.contact_force),
        }
        if dose is not None:
            codes["doses"] = np.rint(np.minimum(dose, MOST_DOSE) / PART).astype(np.int64)
        if smoke is not None:
            before = self._smoke
            self._smoke = np.minimum(np.rint(-255.0 * np.expm1(-DEPTH * smoke)), 254.0).astype(np.uint8)
            change = self._smoke - before  # modulo 256
            self._write("smoke", np.append(np.uint8(1), change) if change.any() else np.zeros(1, np.uint8))
        for name, values in codes.items():
            last = getattr(self, f"_{name}")
            self._numbers(name, values - last[person])
            last[person] = values
        walks = codes["speeds"] > 0
        heading = np.rint(np.arctan2(velocity[walks, 1], velocity[walks, 0]) * 128.0 / np.pi).astype(np.int64)
        self._write("headings", ((heading - self._headings[person[walks]]) % 256).astype(np.uint8))
        self._headings[person[walks]] = heading

    @property
    def longest_wait(self) -> float:
        """Greatest time that a person has waited so far [s]."""
        return float(self._measuring.waited.max(initial=0.0))

    def first_state(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Return person, level and position (n, 2) [m] of everybody in the first frame."""
        person = np.flatnonzero(self._first_level >= 0).astype(np.int32)
        return person, self._first_level[person], GRAIN * (self._first[person] + 0.5) + self.origin

    def streams(self) -> dict[str, bytes]:
        """Return the compressed streams by name."""
        return {name: stream.packed() for name, stream in self._streams.items()}

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of all data needed to continue with the same bytes."""
        state: dict[str, NDArray[Any]] = {name: getattr(self, f"_{name}").copy() for name in _STATE}
        state["frames"] = np.array([self.frames])
        state |= {f"measures.{name}": array for name, array in self._measuring.state().items()}
        return state | {f"stream.{name}": np.frombuffer(data, np.uint8) for name, data in self.streams().items()}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Restore the arrays that `state` returned in a packer for the same people and building."""
        self.frames = int(taken(state, "frames", np.int64, (1,), 0, MOST_FRAMES)[0])
        bounds = {"seen": (0, self.frames), "started": (0, 1), "smoke": (0, 255)}
        bounds |= dict.fromkeys(("level", "first_level"), (-1, len(self._planes) - 1))
        for name in _STATE:
            array = getattr(self, f"_{name}")
            array[:] = taken(state, name, array.dtype, array.shape, *bounds.get(name, (-MOST_CODE, MOST_CODE)))
        with part_of(state, "measures.") as measures:
            self._measuring.restore(measures)
        self._streams = {name: self._restored(state, name) for name in STREAMS}

    def _restored(self, state: Mapping[str, NDArray[Any]], name: str) -> _Stream:
        """Return a stream with its saved bytes, which are bounded by the number of frames."""
        key = f"stream.{name}"
        most = self.frames * (LARGEST_FRAME + LARGEST_RECORD * len(self._level) + len(self._smoke))
        decompressor = zlib.decompressobj()
        try:
            data = decompressor.decompress(taken(state, key, np.uint8, (None,), 0, 255).tobytes(), most + 1)
        except zlib.error as error:
            raise SavedError(f"{key}: {error}") from error
        if len(data) > most or not decompressor.eof or (name == "times" and len(data) != 8 * self.frames):
            raise SavedError(f"{key}: its length does not match {self.frames} frames")
        return _Stream(data)

    def _events(self, person: IntArray, level: IntArray, started: NDArray[np.bool_]) -> NDArray[np.int32]:
        """Return the people who came, left, changed the level or started since the previous frame."""
        now = np.full(len(self._level), -1, np.int32)
        now[person] = level
        changed = np.flatnonzero(self._level != now)
        self._level[:] = now
        begun = person[started != self._started[person]]
        self._started[person] = started
        return np.concatenate([[changed.size], changed, now[changed], [begun.size], begun]).astype("<i4")

    def _numbers(self, name: str, values: NDArray[np.int64]) -> None:
        """Write whole numbers as bytes, and those that do not fit to ``wide``."""
        folded = np.where(values < 0, -2 * values - 1, 2 * values)
        self._write(name, np.minimum(folded, ESCAPE).astype(np.uint8))
        self._write("wide", values[folded >= ESCAPE].astype("<i4"))

    def _write(self, name: str, values: NDArray[np.generic]) -> None:
        self._streams[name].write(values.tobytes())


def force_codes(force: FloatArray) -> NDArray[np.int64]:
    """Return the codes of contact forces [N], see above."""
    power = np.floor(np.log10(np.maximum(force, 1.0)))
    digits = np.rint(force / 10.0 ** (power - 1.0))  # from 10 to 100
    power, digits = np.where(digits == 100.0, power + 1.0, power), np.where(digits == 100.0, 10.0, digits)
    codes: NDArray[np.int64] = np.where(power < 1.0, 0.0, 90.0 * (power - 1.0) + digits - 9.0).astype(np.int64)
    return codes


def level_plane(building: Building, level: Level) -> tuple[float, float, float]:
    """Return c, a, b of a level's plane z = c + a x + b y [m], through one of its vertices."""
    x, y, z = building.vertices[level.triangles[0, 0]]
    a, b = np.tan(level.slope) * level.uphill
    return float(z - a * x - b * y), float(a), float(b)


def is_even(building: Building, level: Level) -> bool:
    """Return whether a level is a plane up to rounding errors of heights."""
    own = building.vertices[np.unique(level.triangles)]
    c, a, b = level_plane(building, level)
    return bool(np.abs(own[:, 2] - c - own[:, :2] @ [a, b]).max() <= max(PLANE, 0.5 * GRAIN))
