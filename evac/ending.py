"""How a run ends: with everybody out, when its duration is over, or when nobody gets nearer to an exit any more."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evac.directions.fields import Fields
from evac.physics.bundles import Crowd

if TYPE_CHECKING:
    from evac.scenario.schema import SimulationSettings

EVERYBODY_OUT = "everybody out"
DURATION_OVER = "duration over"
NO_PROGRESS = "no progress"
INTERRUPTED = "interrupted"

#: Of a run that could not go on, in the tables that it leaves.
FAILED = "failed"

#: A person makes progress when its remaining travel time falls by this much below what it was at its last progress [s].
PROGRESS = 0.25

#: Who is inside when a run ends, and has made no progress for so long, is stuck [s].
STANDING = 10.0

#: How often progress is looked at [s].
PROGRESS_EVERY = 1.0


class Ending:
    """Decides after each tick whether it was the last one; notes when each person last made progress.

    Progress is progress towards an exit: the remaining travel time falls more than `PROGRESS` below the least one
    at which the same person made progress on the same route. Being pushed back, and returning, is none. What was
    reached on a route is remembered while a person follows another one, so that alternating between routes is no
    progress either. People who have yet to set off count as making progress, and are measured from where they set off.

    Parameters
    ----------
    settings : SimulationSettings
    people, routes : int
    """

    def __init__(self, settings: "SimulationSettings", people: int, routes: int) -> None:
        self._settings = settings
        self._steps_per_look = max(1, round(PROGRESS_EVERY / settings.tick)) * settings.steps_per_tick
        self._least = np.full((routes, people), np.inf)  # remaining travel time at the last progress on each route [s]
        self._progress_at = np.zeros(people)  # time of the last progress [s]

    def reason(self, step: int, crowd: Crowd, fields: Fields) -> str:
        """Return how the run ends with this tick; nothing where it goes on.

        Parameters
        ----------
        step : int
            Steps made.
        crowd : Crowd
        fields : Fields

        Returns
        -------
        str
            `EVERYBODY_OUT`, `DURATION_OVER`, `NO_PROGRESS` or nothing.
        """
        if not (crowd.level >= 0).any():
            return EVERYBODY_OUT
        if step >= self._settings.last_step:
            return DURATION_OVER
        if step % self._steps_per_look == 0 and self._is_stuck(step * self._settings.step, crowd, fields):
            return NO_PROGRESS
        return ""

    def stuck(self, step: int, crowd: Crowd) -> NDArray[np.intp]:
        """Return the rows of who is inside after `step` steps and has made no progress for `STANDING` or `no_progress`.

        Who has yet to set off is not stuck.
        """
        time = step * self._settings.step
        standing = time - self._progress_at >= min(STANDING, self._settings.no_progress)
        return np.flatnonzero(standing & (crowd.level >= 0) & (crowd.start_time <= time))

    def state(self) -> NDArray[np.float64]:
        """Return what the next answer depends on, (routes + 1, people) [s]."""
        return np.concatenate([self._least, self._progress_at[None]])

    def restore(self, state: NDArray[np.float64]) -> None:
        """Restore what `state` returned."""
        self._least[:], self._progress_at[:] = state[:-1], state[-1]

    def _is_stuck(self, time: float, crowd: Crowd, fields: Fields) -> bool:
        """Say whether nobody has made progress or got out for `no_progress`."""
        inside = np.flatnonzero(crowd.level >= 0)
        route = crowd.route[inside]
        remaining = fields.travel_time_at(crowd.level[inside], crowd.position[inside], route)
        progresses = remaining < self._least[route, inside] - PROGRESS
        progresses |= crowd.start_time[inside] > time
        self._least[route[progresses], inside[progresses]] = remaining[progresses]
        self._progress_at[inside[progresses]] = time
        latest = max(self._progress_at[inside].max(), np.nanmax(crowd.exit_time, initial=0.0))
        return bool(time - latest >= self._settings.no_progress)
