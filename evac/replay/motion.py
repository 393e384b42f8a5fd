"""The motion of all people for the replay page: quantised, as differences, compressed frame by frame.

The page decodes the streams (page/run/motion.js). All numbers are little-endian:

- ``times``: float64, the time of each frame [s].
- ``events``: int32. For each frame the number of people who came, left or changed the level, their indices and their
  levels, -1 of those who left; the number of people for whom it has changed whether their response time is over, and
  their indices.
- ``steps``: bytes. For each frame x, then y, of everybody inside by ascending person: how far the position in
  centimetres, rounded down, to which the page adds half a centimetre, is from where the velocities of this frame and of
  the one before lead, half of the time each; of a person's first frame the position itself.
- ``heights``: bytes. For each frame, of everybody on an uneven level, the height above the level's plane [cm].
- ``speeds``, ``waited``, ``forces``: bytes. For each frame, of everybody inside, the change since the person's last
  frame of the speed [cm/s], of the time that the person has waited [0.01 s], and of the code of the contact force,
  which has two significant digits: 0 below 10 N, 1 to 90 for 10 to 99 N, 91 to 180 for 100 to 990 N, and so
  on. `evac.analysis.measures` defines all three.
- ``doses``: the same of the dose [0.001], at most 10; empty in a case without doses.
- ``headings``: bytes, as they are. For each frame, of everybody inside whose speed is not 0, the change of the
  direction in plan since the person's last one, in parts of a circle of 256, modulo 256: a multiple of 4.
- ``smoke``: bytes, as they are. For each frame 0 if smoke is as in the previous one, otherwise 1, and the changes of
  the codes of all cells of the field, modulo 256. The code of an extinction coefficient K [1/m] is
  255 (1 - exp(-K `DEPTH`)), at most 254. Empty without a field of smoke.
- ``wide``: int32. Numbers that do not fit in a byte.

A byte b of the others encodes the number b / 2 if b is even and -(b + 1) / 2 if it is odd; 255 encodes the next number
of ``wide``.
"""

import zlib

import numpy as np
from numpy.typing import NDArray

from evac.analysis.measures import Measuring
from evac.base.arrays import FloatArray, IntArray
from evac.base.defaults import CONTRAST
from evac.building.model.building import Building, Level
from evac.building.model.cells import LevelField
from evac.building.model.elevation import PLANE
from evac.pictures.palette import DEPTH
from evac.trajectory.trajectory import Frame

GRAIN = 0.01  #: Resolution of positions [m].
MOMENT, PACE = 0.01, 0.01  #: Resolution of times that people have waited [s], and of speeds [m/s].
PART, MOST_DOSE = 0.001, 10.0  #: Resolution of doses, and the greatest one that is stored.

#: Number of directions, and 1000 times the unit vector of each, as whole numbers that the page computes alike.
DIRECTIONS = 64
TOWARD = np.rint(1000.0 * np.exp(2j * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)[:, None].view(np.float64))

ESCAPE = 255

STREAMS = ("times", "events", "steps", "heights", "speeds", "waited", "forces", "doses", "headings", "smoke", "wide")

REPEATING = ("events", "waited", "doses", "smoke")  #: Streams in which sequences repeat.


class _Stream:
    """A byte stream that is compressed incrementally."""

    def __init__(self, name: str) -> None:
        # Where sequences rarely repeat, some bytes are much more frequent than others.
        strategy = zlib.Z_DEFAULT_STRATEGY if name in REPEATING else zlib.Z_RLE
        self._compressor = zlib.compressobj(9, strategy=strategy)
        self._ready = bytearray()

    def write(self, data: bytes) -> None:
        self._ready += self._compressor.compress(data)

    def packed(self) -> bytes:
        """Return all data, compressed; nothing can be written then."""
        return bytes(self._ready) + self._compressor.flush()


class MotionPacker:
    """Encodes and compresses one frame after the other, with positions in plan relative to `origin` (2,) [m]."""

    def __init__(
        self, people: int, building: Building, smoke: LevelField | None = None, contrast: float = CONTRAST
    ) -> None:
        corners = building.vertices[:, :2]
        self.frames, self.building, self.field, self.contrast = 0, building, smoke, contrast
        self._smoke = np.zeros(0 if smoke is None else smoke.size, np.uint8)  # in the previous frame
        self.origin: FloatArray = np.round(0.5 * (corners.min(axis=0) + corners.max(axis=0)))
        self._planes = [level_plane(building, level) for level in building.levels]
        self._uneven = np.array([not is_even(building, level) or level.kind == "car" for level in building.levels])
        self._level, self._first_level = np.full((2, people), -1, np.int32)  # in the previous frame, and in the first
        # Positions in the person's last frame, and in the first one of the run; velocities of the last frame.
        self._last, self._first, self._velocity = np.zeros((3, people, 2), np.int64)
        self._is_new, self._time = np.ones(people, np.bool_), 0.0
        self.times: list[float] = []
        self._started = np.zeros(people, np.int32)  # 1 of those whose response time was over
        # In each person's last frame.
        self._speeds, self._waited, self._forces, self._doses, self._headings = np.zeros((5, people), np.int64)
        self._measuring = Measuring(people)
        self._streams = {name: _Stream(name) for name in STREAMS}

    def add(self, frame: Frame, is_shown: bool = True, has_dose: bool = False, smoke: FloatArray | None = None) -> None:
        """Add a frame, which is later than the previous one.

        `is_shown`: otherwise, people are only measured; `has_dose`: whether there are doses, in every frame or in none;
        `smoke` (m,): values of the field of smoke [1/m].
        """
        person, level, position, started = frame["person"], frame["level"], frame["position"], frame["started"]
        measures = self._measuring.add(frame["time"], person, frame["speed"], started, frame["contact_force"])
        if not is_shown:
            return
        self.frames += 1
        self.times.append(frame["time"])
        self._write("times", np.array([frame["time"]], "<f8"))
        self._write("events", self._events(person, level, started))
        at = np.floor((position - self.origin) / GRAIN).astype(np.int64)  # so that nobody is in another cell of maps
        if self.frames == 1:
            self._first_level[person], self._first[person] = level, at
        codes = {
            "speeds": np.rint(measures.speed / PACE).astype(np.int64),
            "waited": np.rint(measures.waited / MOMENT).astype(np.int64),
            "forces": force_codes(measures.contact_force),
        }
        if has_dose:
            codes["doses"] = np.rint(np.minimum(frame["dose"], MOST_DOSE) / PART).astype(np.int64)
        if smoke is not None:
            before = self._smoke
            self._smoke = np.minimum(np.rint(-255.0 * np.expm1(-DEPTH * smoke)), 254.0).astype(np.uint8)
            change = self._smoke - before  # modulo 256
            self._write("smoke", np.append(np.uint8(1), change) if change.any() else np.zeros(1, np.uint8))
        for name, values in codes.items():
            last = getattr(self, f"_{name}")
            self._numbers(name, values - last[person])
            last[person] = values
        walks, velocity = codes["speeds"] > 0, self._velocity[person]
        angle = np.arctan2(*frame["velocity"][walks, 1::-1].T)
        heading = np.rint(angle * 0.5 * DIRECTIONS / np.pi).astype(np.int64) % DIRECTIONS
        turn = 256 // DIRECTIONS * (heading - self._headings[person[walks]])
        self._write("headings", (turn % 256).astype(np.uint8))
        self._headings[person[walks]] = heading
        self._velocity[person] = codes["speeds"][:, None] * TOWARD[self._headings[person]]
        way = (frame["time"] - self._time) * (PACE / GRAIN / 2000.0) * (velocity + self._velocity[person])
        expected = np.where(self._is_new[person, None], 0, self._last[person] + np.floor(way + 0.5).astype(np.int64))
        self._numbers("steps", (at - expected).T.ravel())
        self._last[person], self._is_new[person], self._time = at, False, frame["time"]
        uneven = np.flatnonzero(self._uneven[level])
        if uneven.size:
            plane = np.array(self._planes)[level[uneven]]
            height = plane[:, 0] + (plane[:, 1:] * position[uneven]).sum(axis=1)
            off = frame["z"][uneven] - height
            self._numbers("heights", np.rint(off / GRAIN).astype(np.int64))

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
