"""Parts of a validation test: the tested model, its runs, and values compared with a criterion."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.case.case import Case
from evac.evidence.models import model_overrides
from evac.evidence.validation.buildings import Face, Segment, write_case
from evac.results.results import Results
from evac.simulation.running import run
from evac.study.statistics import estimate
from evac.trajectory.trajectory import Trajectory, read_trajectory


@dataclass(frozen=True)
class Criterion:
    """The criterion of a test: a quantity, the range in which it must lie, and the source."""

    test: str  # common name of the test, such as "RiMEA 2"
    quantity: str  # the measured quantity, with its unit
    source: str  # source of the range
    low: float = -np.inf  # the range; infinite if it is open
    high: float = np.inf  # the range; infinite if it is open

    @property
    def band(self) -> str:
        """The band in words."""
        if self.low == self.high:
            return f"{self.low:g}"
        if not np.isfinite(self.low):
            return f"at most {self.high:.4g}"
        if not np.isfinite(self.high):
            return f"at least {self.low:.4g}"
        return f"{self.low:.4g} to {self.high:.4g}"

    def holds(self, value: float) -> bool:
        """Return whether a value lies in the range."""
        return self.low <= value <= self.high

    @property
    def reference(self) -> float:
        """The middle of the band, or its one bound."""
        bounds = [bound for bound in (self.low, self.high) if np.isfinite(bound)]
        return float(np.mean(bounds))


@dataclass(frozen=True)
class Check:
    """The result of the trial `name` for a criterion: one value per run, NaN for a blocked run."""

    criterion: Criterion
    model: str
    values: tuple[float, ...]

    @cached_property
    def found(self) -> FloatArray:
        """The values of the runs that did not block."""
        return np.array([value for value in self.values if not np.isnan(value)])

    @property
    def blocked(self) -> int:
        """Number of runs that blocked."""
        return len(self.values) - len(self.found)

    @property
    def mean(self) -> float | None:
        """Mean of the values; None if every run blocked."""
        return float(self.found.mean()) if len(self.found) else None

    @property
    def interval(self) -> tuple[float, float] | None:
        """Interval of the mean; None if the values do not determine one."""
        return mean_interval(self.found)

    @property
    def is_passed(self) -> bool:
        """Whether no run blocked and the mean lies in the band."""
        return not self.blocked and self.mean is not None and self.criterion.holds(self.mean)

    @property
    def is_certain(self) -> bool:
        """Whether no bound lies inside the interval of the mean, which is all numbers if there is none of several."""
        low, high = self.interval or ((0.0, 0.0) if len(self.found) < 2 else (-np.inf, np.inf))
        return not any(low < bound < high for bound in (self.criterion.low, self.criterion.high))

    @property
    def verdict(self) -> str:
        """Whether the criterion is met, and if not, the deviation."""
        if self.is_passed:
            return "yes" if self.is_certain else f"yes, not certain: {self.mean:.3g}"
        if self.mean is None or self.blocked:
            return f"NO: {self.blocked} of {len(self.values)} runs block"
        bound = self.criterion.high if self.mean > self.criterion.high else self.criterion.low
        times = f", {self.mean / bound:.3g} times the bound" if bound not in (0.0, 1.0) else ""
        return f"NO{'' if self.is_certain else ', not certain'}: {self.mean:.3g}{times}"


@dataclass(frozen=True)
class Outcome:
    """The results of a run and its trajectory."""

    results: Results
    trajectory: Trajectory

    def numbers(self, column: str) -> FloatArray:
        """Return a column of `Results.people`, (people,); NaN where it is empty."""
        return np.array(self.results.people[column], np.float64)

    @property
    def exit_times(self) -> FloatArray:
        """Exit times in ascending order, of those who are out [s]."""
        times = self.numbers("exit_time")
        return np.sort(times[np.isfinite(times)])

    @property
    def is_blocked(self) -> bool:
        """Whether people are left."""
        return self.results.evacuated < self.results.number_of_people

    @property
    def last_out(self) -> float:
        """Time at which the last one left [s]; NaN if people are left."""
        return float("nan") if self.is_blocked else float(self.exit_times[-1])

    def first_times(self, is_counted: NDArray[np.bool_]) -> FloatArray:
        """Return when each person first made one of the moves `is_counted` (m,), in ascending order [s]."""
        moves = self.results.moves
        _, first = np.unique(moves.row[is_counted], return_index=True)  # moves are in order of time
        return np.sort(moves.time[is_counted][first])


@dataclass(frozen=True)
class Trial:
    """A contact model under test, by its name in the evidence, and the seeds of the runs that a test makes.

    With `headway` the behaviour of that name is in use, with its defaults.
    """

    model: str
    seeds: tuple[int, ...]
    headway: bool = False

    @property
    def name(self) -> str:
        """Name in tables and plots."""
        return f"{self.model}, headway" if self.headway else self.model

    @property
    def overrides(self) -> dict[str, Any]:
        """Overrides of a case for this trial; headway is appended to the behaviours of the case."""
        return model_overrides(self.model) | ({"behaviours.headway": {}} if self.headway else {})

    def runs(
        self,
        faces: Iterable[Face],
        exits: Iterable[tuple[str, Segment, float]],
        people: Iterable[Mapping[str, Any]],
        areas: Iterable[tuple[str, Sequence[float], float]] = (),
        **sections: Any,
    ) -> list[Outcome]:
        """Write a building and its case to a temporary folder and run it with each seed; see `write_case`."""
        with TemporaryDirectory() as folder:
            case = write_case(Path(folder), faces, exits, people, areas, {**sections, **self.overrides})
            return self.run_case(case)

    def run_case(self, case: Case) -> list[Outcome]:
        """Run a case with each seed, through its result folder."""
        quiet = {"output.picture": False, "output.animation": False, **self.overrides}
        return [conduct(case.change({**quiet, "simulation.seed": seed})) for seed in self.seeds]

    def check(self, criterion: Criterion, values: Iterable[float]) -> Check:
        """Compare one value of each run with a criterion."""
        return Check(criterion, self.name, tuple(float(value) for value in values))


def conduct(case: Case) -> Outcome:
    """Run a case with a result folder and read the folder."""
    with TemporaryDirectory() as place:
        results = run(case, place)
        return Outcome(results, read_trajectory(place))


def mean_interval(values: FloatArray) -> tuple[float, float] | None:
    """Return the interval of the mean of values, as in studies; None if they do not determine one."""
    found = estimate("mean", values)
    return (found.low, found.high) if found.has_interval else None
