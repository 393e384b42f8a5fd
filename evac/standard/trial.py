"""Parts of a standard test: its name, who walks, the runs that it makes, and values compared with a criterion."""

import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from shapely import box

from evac.base.arrays import FloatArray
from evac.base.errors import RunWarning
from evac.building.plan.plan import Plan
from evac.case.case import Case
from evac.case.loading import load_case
from evac.contract.hooks import DEFAULT_MOVEMENT
from evac.results.results import Results
from evac.simulation.running import run
from evac.standard.plans import Row
from evac.study.statistics import estimate
from evac.trajectory.trajectory import Trajectory, read_trajectory

Measure = TypeVar("Measure", bound=Callable[..., Iterable["Check"]])

CONTACT_MODEL = "nsm2"  #: Contact model where none is set, that of new cases.
DURATION, EVERY = 900.0, 0.1  #: Longest run [s], and the time between two recorded states [s].
SELDOM = {"every": 1.0}  #: Output of runs with many people, of which exit times alone are measured.


@dataclass(frozen=True)
class StandardTest:
    """A test of one or several standards; `names` such as RiMEA-1, of which the first one names its folder."""

    names: tuple[str, ...]
    title: str
    measure: "Callable[[Trial], Iterable[Check]] | None" = None  # yields the checks of a trial; None if it is not run
    runs: int = 1  # number of seeds; 1 where nothing is drawn
    why: str = ""  # why it is not run, which begins with `NOT_APPLICABLE`
    by_design: str = ""  # why the default movement fails it; empty if it should pass

    @property
    def name(self) -> str:
        """The first name."""
        return self.names[0]


MADE: list[StandardTest] = []  #: The tests that are run, in the order of their functions.


def standard_test(
    names: str, title: str, runs: int = 1, by_design: str = "", **given: Any
) -> Callable[[Measure], Measure]:
    """Add the test that a function measures with the given arguments; `names` are separated by spaces."""

    def add(measure: Measure) -> Measure:
        MADE.append(StandardTest(tuple(names.split()), title, partial(measure, **given), runs, by_design=by_design))
        return measure

    return add


@dataclass(frozen=True)
class Check:
    """A quantity, the range in which its mean over the runs must lie, and the values found; open ends are infinite."""

    quantity: str  # with its unit
    source: str  # of the range
    values: tuple[float, ...]  # one per run; NaN for a run in which people are left
    low: float = -np.inf
    high: float = np.inf

    @property
    def band(self) -> str:
        """The range in words."""
        if self.low == self.high:
            return f"{self.low:g}"
        if not np.isfinite(self.low):
            return f"at most {self.high:.4g}" if np.isfinite(self.high) else "-"
        return f"{self.low:.4g} to {self.high:.4g}" if np.isfinite(self.high) else f"at least {self.low:.4g}"

    @cached_property
    def finite(self) -> FloatArray:
        """The values of the runs that did not block."""
        return np.array([value for value in self.values if not np.isnan(value)])

    @property
    def blocked(self) -> int:
        """Number of runs that blocked."""
        return len(self.values) - len(self.finite)

    @property
    def mean(self) -> float | None:
        """Mean of the values; None if every run blocked."""
        return float(self.finite.mean()) if len(self.finite) else None

    @property
    def interval(self) -> tuple[float, float] | None:
        """Interval of the mean, as in studies; None if the values do not determine one."""
        mean = estimate("mean", self.finite)
        return (mean.low, mean.high) if mean.has_interval else None

    @property
    def is_passed(self) -> bool:
        """Whether no run blocked and the mean lies in the band."""
        return not self.blocked and self.mean is not None and self.low <= self.mean <= self.high

    @property
    def is_certain(self) -> bool:
        """Whether no bound lies inside the interval of the mean, which is all numbers if there is none of several."""
        low, high = self.interval or ((0.0, 0.0) if len(self.finite) < 2 else (-np.inf, np.inf))
        return not any(low < bound < high for bound in (self.low, self.high))

    @property
    def verdict(self) -> str:
        """Whether the criterion is met, and if not, the deviation."""
        if self.is_passed:
            return "yes" if self.is_certain else f"yes, not certain: {self.mean:.3g}"
        if self.mean is None or self.blocked:
            return f"NO: {self.blocked} of {len(self.values)} runs block"
        bound = self.high if self.mean > self.high else self.low
        times = f", {self.mean / bound:.3g} times the bound" if bound not in (0.0, 1.0) else ""
        return f"NO{'' if self.is_certain else ', not certain'}: {self.mean:.3g}{times}"


def check(quantity: str, source: str, values: Iterable[float], low: float = -np.inf, high: float = np.inf) -> Check:
    """Return the check of a quantity with one value per run."""
    return Check(quantity, source, tuple(float(value) for value in values), float(low), float(high))


@dataclass(frozen=True)
class Outcome:
    """The results of a run and its trajectory."""

    results: Results
    trajectory: Trajectory

    @property
    def exit_time(self) -> FloatArray:
        """Exit time of each person [s]; NaN for those who are left."""
        return self.results.crowd.exit_time

    @property
    def is_blocked(self) -> bool:
        """Whether people are left."""
        return self.results.evacuated < self.results.number_of_people

    def last_out(self, group: int | None = None) -> float:
        """Return when the last one of a group, or of all, left [s]; NaN if people are left."""
        times = self.exit_time if group is None else self.exit_time[self.results.groups[group].rows]
        return float("nan") if self.is_blocked else float(times.max())

    @property
    def response_time(self) -> FloatArray:
        """Response time of each person [s]."""
        return self.results.crowd.start_time

    def out_by(self, name: str) -> NDArray[np.bool_]:
        """Return who left by the exit of a name, (people,)."""
        index = next(exit_.index for exit_ in self.results.building.exits if exit_.name == name)
        return np.asarray(self.results.crowd.exit_used == index)

    def passing_times(self, axis: int, line: float) -> FloatArray:
        """Return when each person first passes a line towards larger coordinates, (people,) [s]; NaN if it never does.

        Times are interpolated between recorded states; those who are out have passed.
        """
        time, place = self.trajectory.time, self.trajectory.position[..., axis]
        beyond = np.isnan(place) | (place >= line)
        frame = beyond.argmax(axis=0)
        person = np.arange(place.shape[1])
        before, after = place[np.maximum(frame - 1, 0), person], place[frame, person]
        share = np.ones(len(person))
        np.divide(line - before, after - before, where=np.isfinite(after) & (frame > 0), out=share)
        times = time[np.maximum(frame - 1, 0)] + share * (time[frame] - time[np.maximum(frame - 1, 0)])
        first: FloatArray = np.where(beyond.any(axis=0) & (frame > 0), times, np.nan)
        return first

    def densities(self, x1: float, y1: float, x2: float, y2: float) -> FloatArray:
        """Return the number of people in a rectangle over its area in each recorded state, (states,) [1/m2]."""
        x, y = np.moveaxis(self.trajectory.position, 2, 0)
        inside = (x >= x1) & (x < x2) & (y >= y1) & (y < y2)
        density: FloatArray = inside.sum(axis=1) / ((x2 - x1) * (y2 - y1))
        return density


@dataclass(frozen=True)
class Trial:
    """Who walks in the standard tests, and where their result folders are left."""

    folder: Path  # each run has a result folder in it
    seeds: tuple[int, ...] = (1,)
    settings: tuple[str, ...] = ()  # keys of all cases to change, as KEY=VALUE
    plugin_files: tuple[Path, ...] = ()
    is_paper: bool = False  # whether people walk as in the paper, without a behaviour that keeps distances

    def case(self, plan: Plan, people: Iterable[Row], title: str = "", **sections: Any) -> Case:
        """Return the case of people in a building; groups without name are numbered; `sections` are others of it."""
        content = {
            "title": title,
            "building": plan,
            "people": [{"name": f"group {number:02d}", **group} for number, group in enumerate(people)],
            "contact": {"model": CONTACT_MODEL},
            "behaviours": {},
            **sections,
            "simulation": {"duration": DURATION, **sections.get("simulation", {})},
            "output": {"every": EVERY, **sections.get("output", {})},
        }
        return self.changed(load_case(content, plugin_files=self.plugin_files))

    def changed(self, case: Case) -> Case:
        """Return a case in which people walk as this trial has them walk."""
        own: dict[str, Any] = {} if self.is_paper else {f"behaviours.{DEFAULT_MOVEMENT}": {}}
        return case.change({**own, "output.picture": False}).change(self.settings)

    def runs(self, plan: Plan, people: Iterable[Row], label: str = "run", **sections: Any) -> list[Outcome]:
        """Run people in a building with each seed, into the folders LABEL-SEED."""
        return self.run_case(self.case(plan, people, f"{self.folder.name}, {label}", **sections), label)

    def run_case(self, case: Case, label: str) -> list[Outcome]:
        """Run a case with each seed."""
        return [self._run(case.change({"simulation.seed": seed}), f"{label}-{seed}") for seed in self.seeds]

    def _run(self, case: Case, name: str) -> Outcome:
        place = self.folder / name.replace(" ", "-")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RunWarning)  # the criteria judge the results
            results = run(case, place, progress=False)
        return Outcome(results, read_trajectory(place))


def probe(trial: Trial) -> Case:
    """Return a case as small as any, which shows whether the settings and plugin files of a trial are valid."""
    plan = Plan()
    plan.storey("floor", box(0, 0, 2, 2))
    plan.exit("end", "floor", [(2, 0), (2, 2)])
    return trial.case(plan, [{"positions": [[1.0, 1.0]], "z": 0.0}])
