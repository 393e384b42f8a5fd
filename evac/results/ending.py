"""The end of a run and its reason, and checks of velocities, forces, overlaps and densities during the run."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import BoolArray, FloatArray, IntArray
from evac.base.saved import Saved
from evac.directions.fields import Fields
from evac.jit import Bytes, FloatGrid, Floats, Longs, Pairs, Struct, kernel
from evac.physics.state import Crowd

if TYPE_CHECKING:
    from evac.case.schema import SimulationSettings

SPAN = 2.0  #: Time over which the speeds of each person are averaged [s].

#: Time over which contact forces, which vary from step to step, are averaged [s]. They are sampled at the recorded
#: times, and the mean is over at least this number of samples.
FORCE_SPAN = 5.0
FEWEST_FRAMES = 10

#: Contacts chatter if the magnitude of the contact model's velocity is more than this factor times the speed of the
#: displacement, and exceeds it by more than this [m/s].
CHATTER_RATIO = 2.0
CHATTER_EXCESS = 0.2

#: Forces in fatal accidents: per person [N], and per metre of a body's width [N/m].
CRUSHING_FORCE = 6000.0
CRUSHING_LOAD = 4500.0


#: Number of people per square metre that is exceeded for this time [s] in a dense crowd, and the time between samples.
DENSITY = 6.0
DENSITY_SPAN = 10.0
DENSITY_EVERY = 1.0


@dataclass(frozen=True)
class Observation:
    """People for whom a quantity exceeded its limit, with the time and place of its greatest value."""

    people: int  # number of different people
    since: float  # start of the first averaging interval in which the limit was exceeded [s]
    until: float  # end of the last one [s]
    begin: float  # the averaging interval with the greatest value [s]
    end: float
    person: int  # with the greatest value
    level: int
    x: float  # position of that person at `end` [m]
    y: float
    # Means over that interval. For chatter: magnitudes of the contact model's velocity and of the displacement
    # velocity [m/s]; for crushing: contact force through the body [N], and per metre of its width [N/m]. For overlaps:
    # the greatest in that tick [m], and as a share of the radius. For density: the mean number of people on the
    # square metre around the person, which was above the limit at each sample.
    values: tuple[float, float]


class Watch(Saved):
    """Averages speeds and contact forces of each person over intervals, and records values above the limits.

    The force through a body is half the sum of its contact forces, since a person who is pressed from one side is
    supported from the other; its width is its diameter. People who leave within an interval are excluded from it.
    Radii (n,) are in metres, as is the overlap that the contact model promises; `tick` and `every` are the times
    between two samples of velocities, and of forces [s].
    """

    saved = ("_speeds", "_forces", "_densities", "_chatter", "_crushing", "_overlaps", "_dense")

    def __init__(self, radius: FloatArray, tick: float, every: float, promised: float = np.inf) -> None:
        self._width, self._tick, self.promised = 2.0 * radius, tick, promised
        self._speeds = _Means(len(radius), max(1, round(SPAN / tick)))
        self._forces = _Means(len(radius), max(FEWEST_FRAMES, round(FORCE_SPAN / every)))
        velocity = np.zeros((len(radius), 2))
        self._moved = Moved(velocity=velocity, sums=self._speeds.sums, inside=self._speeds.inside)
        self._ticks = max(1, round(DENSITY_EVERY / tick))
        self._densities = _Means(len(radius), round(DENSITY_SPAN / DENSITY_EVERY))
        notes = (_Notes(len(radius)) for _ in range(4))
        self._chatter, self._crushing, self._overlaps, self._dense = notes

    def look(self, time: float, crowd: Crowd, displacement_velocity: FloatArray, is_recorded: bool = True) -> None:
        """Look at the people at the end of a tick [s], with displacements divided by its length (n, 2) [m/s].

        Contact forces are sampled only if this state is recorded.
        """
        self._moved.velocity[:] = displacement_velocity
        deepest = add_speeds(crowd, self._moved)
        if self._speeds.count(time):
            begin, stayed, (velocity, displacement) = self._speeds.take()
            excess = velocity - displacement
            noticed = stayed & (excess > CHATTER_EXCESS) & (velocity > CHATTER_RATIO * displacement)
            self._chatter.note(noticed, excess, (velocity, displacement), begin, time, crowd)
        if deepest > self.promised:
            values, begin = (crowd.overlap, 2.0 * crowd.overlap / self._width), max(time - self._tick, 0.0)
            noticed = (crowd.overlap > self.promised) & (crowd.level >= 0)
            self._overlaps.note(noticed, crowd.overlap, values, begin, time, crowd)
        if is_recorded:
            self._look_at_forces(time, crowd)
        if round(time / self._tick) % self._ticks == 0:
            density = densities(crowd)
            if self._densities.add(time, crowd, density, density > DENSITY):
                begin, stayed, (density, share) = self._densities.take()
                self._dense.note(stayed & (share == 1.0), density, (density, density), begin, time, crowd)

    def _look_at_forces(self, time: float, crowd: Crowd) -> None:
        """Add a sample of the contact forces."""
        force = 0.5 * crowd.contact_force
        if self._forces.add(time, crowd, force, force / self._width):
            begin, stayed, (force, load) = self._forces.take()
            noticed = stayed & ((force > CRUSHING_FORCE) | (load > CRUSHING_LOAD))
            self._crushing.note(noticed, load, (force, load), begin, time, crowd)

    def observations(self) -> dict[str, Observation]:
        """Return what exceeded its limit so far, as "chatter", "crushing", "overlaps" and "dense"."""
        notes = {name: getattr(self, f"_{name}").observation() for name in ("chatter", "crushing", "overlaps", "dense")}
        return {name: seen for name, seen in notes.items() if seen is not None}


def densities(crowd: Crowd) -> FloatArray:
    """Return the number of people inside on the disc of one square metre around each person, (n,) [1/m2]."""
    density, inside = np.zeros(len(crowd.level)), np.flatnonzero(crowd.level >= 0)
    order = inside[np.lexsort((crowd.position[inside, 0], crowd.level[inside]))]
    count_near(crowd, order, math.sqrt(1.0 / math.pi), density)
    return density


@kernel
def count_near(crowd: Crowd, order: Longs, radius: float, number: Floats) -> None:
    """Count the people within a radius [m] of each of those in `order`, by level and x, each included."""
    for i in range(len(order)):
        p = order[i]
        number[p] += 1.0
        for k in range(i + 1, len(order)):
            q = order[k]
            x = crowd.position[q, 0] - crowd.position[p, 0]
            if crowd.level[q] != crowd.level[p] or x > radius:
                break
            y = crowd.position[q, 1] - crowd.position[p, 1]
            if math.sqrt(x * x + y * y) <= radius:
                number[p] += 1.0
                number[q] += 1.0


class Moved(Struct):
    """The displacement of people in a tick, and the sums of their speeds over the ticks of an interval."""

    velocity: Pairs  # (n, 2) displacement divided by the length of the tick [m/s]
    sums: FloatGrid  # (2, n) of the velocities of the contact model, and of these [m/s]
    inside: Bytes  # (n,) 1: at every tick


@kernel
def add_speeds(crowd: Crowd, moved: Moved) -> float:
    """Add the speeds of people in a tick, and note who is not inside; return the greatest overlap [m]."""
    deepest = 0.0
    for p in range(len(crowd.level)):
        x, y = crowd.velocity[p, 0], crowd.velocity[p, 1]
        moved.sums[0, p] += math.sqrt(x * x + y * y)
        x, y = moved.velocity[p, 0], moved.velocity[p, 1]
        moved.sums[1, p] += math.sqrt(x * x + y * y)
        if crowd.level[p] < 0:
            moved.inside[p] = 0
        deepest = max(deepest, crowd.overlap[p])
    return deepest


class _Means(Saved):
    """Means of two quantities of each person over intervals of `length` samples."""

    saved = ("sums", "inside", "looks", "times")

    def __init__(self, people: int, length: int) -> None:
        self.sums = np.zeros((2, people))
        self.inside = np.ones(people, np.uint8)  # 1: at every sample of the interval so far
        self.looks = np.array([0, length])  # number of samples in this interval so far, and in a complete one
        self.times = np.zeros(2)  # last sample of the previous interval and of this one [s]

    def add(self, time: float, crowd: Crowd, first: FloatArray, second: FloatArray | BoolArray) -> bool:
        """Add one sample; return whether the interval is complete."""
        self.sums[0] += first
        self.sums[1] += second
        self.inside[:] &= crowd.level >= 0
        return self.count(time)

    def count(self, time: float) -> bool:
        """Count a sample that has been added; return whether the interval is complete."""
        self.looks[0] += 1
        self.times[1] = time
        return bool(self.looks[0] == self.looks[1])

    def take(self) -> tuple[float, BoolArray, FloatArray]:
        """Return the start of the interval [s], who was always inside, and means (2, n); begin the next interval."""
        begin, inside, means = float(self.times[0]), self.inside.astype(bool), self.sums / self.looks[0]
        self.sums[:] = 0.0
        self.inside[:] = 1
        self.looks[0] = 0
        self.times[0] = self.times[1]
        return begin, inside, means


class _Notes(Saved):
    """Accumulated observations of all intervals."""

    saved = ("concerned", "between", "greatest", "of_whom", "values")

    def __init__(self, people: int) -> None:
        self.concerned = np.zeros(people, np.uint8)
        self.between = np.zeros(2)  # since, until [s]
        self.greatest = np.zeros(1)
        self.of_whom = np.zeros(2, np.int64)  # person, level
        self.values = np.zeros(6)  # begin, end [s], x, y [m], the two means

    def note(
        self,
        noticed: BoolArray,
        measure: FloatArray,
        means: tuple[FloatArray, FloatArray],
        begin: float,
        end: float,
        crowd: Crowd,
    ) -> None:
        """Add the people `noticed` in the interval from `begin` to `end` [s], and keep the greatest `measure`."""
        if not noticed.any():
            return
        if not self.concerned.any():
            self.between[0] = begin
        self.between[1] = end
        self.concerned[noticed] = 1
        p = int(np.argmax(np.where(noticed, measure, -np.inf)))
        if measure[p] > self.greatest[0]:
            self.greatest[0] = measure[p]
            self.of_whom[:] = p, crowd.level[p]
            self.values[:] = begin, end, *crowd.position[p], means[0][p], means[1][p]

    def observation(self) -> Observation | None:
        """Return the observation, or None if there is none."""
        people = int(self.concerned.sum())
        if not people:
            return None
        (since, until), (person, level) = self.between.tolist(), self.of_whom.tolist()
        begin, end, x, y, first, second = self.values.tolist()
        return Observation(people, since, until, begin, end, person, level, x, y, (first, second))


EVERYBODY_OUT = "everybody out"
EVERYBODY_SAFE = "everybody out or at a safe place"
EVERYBODY_ABLE_OUT = "everybody out who can move"
DURATION_OVER = "duration over"
NO_PROGRESS = "no progress"
INTERRUPTED = "interrupted"

FAILED = "failed"  #: Reason in the tables of a run that failed.

#: A person makes progress when its least remaining travel time has fallen by this much since its last progress [s].
PROGRESS = 0.25

STANDING = 10.0  #: People inside when a run ends who have made no progress for this long are stuck [s].
PROGRESS_EVERY = 1.0  #: Simulated time between two checks of the progress [s].


class Stopped(KeyboardInterrupt):
    """Raised by a progress display to end the run at this tick, with its results."""


class Ending(Saved):
    """Decides after each tick whether it was the last one; records when each person last made progress.

    Progress means progress towards an exit: the least remaining travel time that a person has reached on its route
    decreases, so that being pushed back and returning is not progress. Each route has its own least time, which is
    kept while another route is followed, so that alternating between routes counts only until each has been tried.
    Decreases of the least time are added up, and the sum counts once it exceeds `PROGRESS`; `PROGRESS` is subtracted
    from the sum in every `no_progress` (or `STANDING`, if that is longer), so that the creep of a blocked crowd does
    not count. People who have not started count as making progress, and so does everybody for whom a way is left when
    the scene changes, see `begin_anew`. For the end of a run, those who have arrived at a place (people,), who do not
    leave (rows), whom gases or heat have stopped (people,), and who come only if they are added (people,) do not count;
    the owners change these arrays.
    """

    saved = ("_least", "_gained", "_progress_at")

    def __init__(
        self,
        settings: "SimulationSettings",
        people: int,
        routes: int,
        arrived: NDArray[np.bool_] | None = None,
        staying: IntArray | None = None,
        stopped: BoolArray | None = None,
        reserve: BoolArray | None = None,
    ) -> None:
        self._leaves = np.ones(people, np.bool_)
        if staying is not None:
            self._leaves[staying] = False
        self._settings = settings
        self._stopped = np.zeros(people, np.bool_) if stopped is None else stopped
        self._arrived = np.zeros(people, np.bool_) if arrived is None else arrived
        self._reserve = np.zeros(people, np.bool_) if reserve is None else reserve
        self._steps_per_check = max(1, round(PROGRESS_EVERY / settings.tick)) * settings.steps_per_tick
        seconds_per_check = self._steps_per_check * settings.step
        self._decay = PROGRESS * seconds_per_check / max(settings.no_progress, STANDING)  # of the gain, per check [s]
        self._least = np.full((routes, people), np.inf)  # least remaining travel time on each route [s]
        self._gained = np.zeros(people)  # below the least remaining travel time, since the last progress [s]
        self._progress_at = np.zeros(people)  # time of the last progress [s]
        self._seen = -1  # somebody who was on the way at the last look

    def begin_anew(self, rows: Sequence[int] | slice = slice(None)) -> None:
        """Forget the least travel times of people, for whom other ways may be longer now; by default of everybody."""
        self._least[:, rows] = np.inf

    def reason(self, step: int, crowd: Crowd, fields: Fields, can_grow: bool = False) -> str:
        """Return why the run ends with this tick; an empty string if it continues, as it does while doses can grow."""
        over = self.over(step, crowd, can_grow)
        if over:
            return over
        is_checked = step % self._steps_per_check == 0
        is_stuck = is_checked and self._is_stuck(step * self._settings.step, crowd, fields)
        return NO_PROGRESS if is_stuck else ""

    def over(self, step: int, crowd: Crowd, can_grow: bool = False) -> str:
        """Return why no step is left, as `reason` but without the check of progress; an empty string if one is left."""
        is_last, seen = step >= self._settings.last_step, self._seen
        if seen < 0 or crowd.level[seen] < 0 or self._arrived[seen] or self._stopped[seen]:
            inside = (crowd.level >= 0) & self._leaves
            on_the_way = np.flatnonzero(inside & ~self._arrived & ~self._stopped)
            self._seen = int(on_the_way[-1]) if len(on_the_way) else -1
            is_over = self._seen < 0 and not (np.isnan(crowd.arrival_time) & ~self._reserve).any()
            if is_over and (is_last or not can_grow):
                if ((crowd.level >= 0) & self._stopped).any():
                    return EVERYBODY_ABLE_OUT
                return EVERYBODY_SAFE if inside.any() else EVERYBODY_OUT
        return DURATION_OVER if is_last else ""

    def stuck(self, step: int, crowd: Crowd) -> NDArray[np.intp]:
        """Return the rows of people inside who have made no progress for `STANDING`, or `no_progress` if that is less.

        People who have not started are not stuck.
        """
        time = step * self._settings.step
        standing = time - np.fmax(self._progress_at, crowd.arrival_time) >= min(STANDING, self._settings.no_progress)
        standing &= (crowd.level >= 0) & ~self._arrived & ~self._stopped
        return np.flatnonzero(standing & (crowd.start_time <= time))

    def _is_stuck(self, time: float, crowd: Crowd, fields: Fields) -> bool:
        """Return whether nobody has made progress or left for `no_progress`."""
        inside = np.flatnonzero((crowd.level >= 0) & self._leaves & ~self._arrived & ~self._stopped)
        if not len(inside):
            return False
        route, start = crowd.route.take(inside), crowd.start_time.take(inside)
        remaining = fields.travel_time_at(
            crowd.level.take(inside), crowd.position.take(inside, 0), route, crowd.contact_radius.take(inside)
        )
        least = self._least[route, inside]
        waits = start > time
        with np.errstate(invalid="ignore"):  # inf - inf where no exit can be reached: no gain
            gain = np.fmax(least - remaining, 0.0)
        gained = np.maximum(self._gained.take(inside) - self._decay, 0.0) + gain
        progresses = waits | (gained > PROGRESS)
        self._least[route, inside] = np.where(waits, remaining, np.minimum(least, remaining))
        self._gained[inside] = np.where(progresses, 0.0, gained)
        self._progress_at[inside[progresses]] = time
        latest = max(self._progress_at.max(), np.nanmax(crowd.exit_time, initial=0.0))
        return bool(time - latest >= self._settings.no_progress)
