"""How a run ends: with everybody out, when its duration is over, or when nobody makes progress towards an exit."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import BoolArray, IntArray
from evac.base.saved import Bounds, Saved
from evac.directions.fields import Fields
from evac.physics.state import Crowd

if TYPE_CHECKING:
    from collections.abc import Sequence

    from evac.case.schema import SimulationSettings

EVERYBODY_OUT = "everybody out"
EVERYBODY_SAFE = "everybody out or at a safe place"
EVERYBODY_ABLE_OUT = "everybody out who can move"
DURATION_OVER = "duration over"
NO_PROGRESS = "no progress"
INTERRUPTED = "interrupted"

#: Reason in the tables of a run that failed.
FAILED = "failed"

#: A person makes progress when its least remaining travel time has fallen by this much since its last progress [s].
PROGRESS = 0.25

#: People inside when a run ends who have made no progress for this long are stuck [s].
STANDING = 10.0

#: Simulated time between two checks of the progress [s].
PROGRESS_EVERY = 1.0


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

    def begin_anew(self, rows: "Sequence[int] | slice" = slice(None)) -> None:
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

    def bounds(self) -> dict[str, Bounds]:
        """Return that all saved times are 0 s or more."""
        return dict.fromkeys(self.saved, Bounds(0.0, np.inf))

    def _is_stuck(self, time: float, crowd: Crowd, fields: Fields) -> bool:
        """Return whether nobody has made progress or left for `no_progress`."""
        inside = np.flatnonzero((crowd.level >= 0) & self._leaves & ~self._arrived & ~self._stopped)
        if not len(inside):
            return False
        place = crowd.route[inside], inside
        remaining = fields.travel_time_at(
            crowd.level[inside], crowd.position.take(inside, 0), crowd.route[inside], crowd.contact_radius[inside]
        )
        waits = crowd.start_time[inside] > time
        with np.errstate(invalid="ignore"):  # inf - inf where no exit can be reached: no gain
            gain = np.fmax(self._least[place] - remaining, 0.0)
        gained = np.maximum(self._gained[inside] - self._decay, 0.0) + gain
        progresses = waits | (gained > PROGRESS)
        self._least[place] = np.where(waits, remaining, np.minimum(self._least[place], remaining))
        self._gained[inside] = np.where(progresses, 0.0, gained)
        self._progress_at[inside[progresses]] = time
        latest = max(self._progress_at.max(), np.nanmax(crowd.exit_time, initial=0.0))
        return bool(time - latest >= self._settings.no_progress)
