"""Designs compared: differences of runs with the same seeds, curves, maps of differences, and their page."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from evac.analysis.maps import LevelMaps, level_maps
from evac.base.arrays import FloatArray
from evac.base.errors import ResultError, counted
from evac.base.parameters import PATH, check_types
from evac.building.model.building import Building
from evac.pictures.pictures import designs_figure
from evac.report import figures
from evac.report.pages import BADGES, Cell, fixed, rendered
from evac.results.reading import read_results
from evac.results.results import Results
from evac.results.verdict import MOST, Verdict, time_of_share
from evac.study.maps import SPACING
from evac.study.outputs import out_over_runs
from evac.study.statistics import Estimate, difference
from evac.study.study import Study, read_study

if TYPE_CHECKING:
    from pandas import DataFrame

#: Maps of which differences are drawn.
MAPS = ("max_density", "waiting")

#: Points of a curve.
SAMPLES = 400


#: Columns of the differences, on the page and in notebooks.
HEAD = ("design", "measure", "first [s]", "design [s]", "difference [s]", "interval [s]", "pairs", "verdict")


@dataclass(frozen=True)
class Design:
    """A design that is compared: one run, or the runs of a study at one point."""

    label: str
    seeds: tuple[tuple[int, int], ...]  # seed and population seed of each run
    # of the people in each run; of those who left, if everybody did who is to leave, else NaN for the others [s]
    exit_times: tuple[FloatArray, ...] = field(repr=False)
    is_complete: tuple[bool, ...] = field(repr=False)  # whether nobody was left in each run
    verdict: Verdict
    building: Building | None = field(repr=False)
    maps: Callable[[], Mapping[str, LevelMaps]] = field(repr=False)  # of a run, or means over runs; may be none

    def measures(self) -> dict[str, FloatArray]:
        """Return the measures that are compared, by name: (runs,) [s], infinite where people are left."""

        def most(times: FloatArray) -> float:
            time = time_of_share(times, MOST) if times.size else None
            return math.inf if time is None else time

        whole = list(zip(self.exit_times, self.is_complete, strict=True))
        return {
            "evacuation time": np.array([most_of(times) if ok else math.inf for times, ok in whole]),
            f"time of {MOST:g} %": np.array([most(times) for times, _ in whole]),
            "mean time of people": np.array([float(times.mean()) if ok else math.inf for times, ok in whole]),
        }


def most_of(times: FloatArray) -> float:
    """Return the greatest time; 0 without people."""
    return float(times.max(initial=0.0))


@dataclass(frozen=True)
class Difference:
    """What one measure of a design differs in from the first design."""

    design: str
    measure: str
    # means of the first design and of this one, over pairs of runs with the same seeds in which nobody is left [s]
    before: float
    after: float
    change: Estimate  # mean of ``after - before`` with its interval

    @property
    def verdict(self) -> str:
        """Longer, shorter, or not certain: the interval contains zero, or there is none; or that there is no pair."""
        if not self.change.runs:
            return "no pair"
        low, high = self.change.low, self.change.high
        return "longer" if low > 0.0 else "shorter" if high < 0.0 else "not certain"


@dataclass(frozen=True)
class Comparison:
    """Designs compared with the first of them."""

    designs: tuple[Design, ...]

    @cached_property
    def differences(self) -> tuple[Difference, ...]:
        """The differences of all measures, for each design but the first."""
        first, *others = self.designs
        return tuple(change for other in others for change in _differences(first, other))

    def to_pandas(self) -> "DataFrame":
        """Return the differences as a data frame: a row for each design and measure."""
        from pandas import DataFrame

        of_change = {"difference": "value", "low": "low", "high": "high", "pairs": "runs"}
        return DataFrame(
            {"design": change.design, "measure": change.measure, "before": change.before, "after": change.after}
            | {name: getattr(change.change, key) for name, key in of_change.items()}
            | {"verdict": change.verdict}
            for change in self.differences
        )

    def plot(self) -> Figure:
        """Return the curves of people out over time, means and bands over the runs of each design, as a figure."""
        return designs_figure("", self.people, self.curves())

    @property
    def people(self) -> int:
        """Greatest number of people of all runs."""
        return max(len(times) for design in self.designs for times in design.exit_times)

    def curves(self) -> dict[str, dict[str, FloatArray]]:
        """Return the time, and the mean and percentiles over runs of the people out by then, of each design."""
        end = max(most_of(times[np.isfinite(times)]) for design in self.designs for times in design.exit_times)
        time = np.linspace(0.0, 1.02 * max(end, 1e-9), SAMPLES)
        return {design.label: out_over_runs(time, design.exit_times) for design in self.designs}

    def page(self) -> str:
        """Return the comparison as a page of HTML, which needs no other file."""
        caption = "People out over time; of several runs, the mean over runs, and a band from 5 to 95 % of them."
        return rendered(
            "comparison.html",
            title="Designs compared",
            kind=f"Differences from {self.designs[0].label}",
            designs=[
                (
                    *(design.label, len(design.seeds), sum(design.is_complete), _seeds(design.seeds)),
                    Cell(design.verdict["text"], BADGES[design.verdict["status"]]),
                )
                for design in self.designs
            ],
            head=HEAD,
            differences=self._table(),
            curve=figures.drawing(self.plot(), caption, "egress curves of the designs"),
            maps=list(self._maps()),
        )

    def _repr_html_(self) -> str:
        """Return the differences as a table, and the curves, for notebooks."""
        from evac.pictures.notebook import figure_html, table_html

        table = table_html(HEAD, self._table())
        return table + figure_html(self.plot(), "egress curves")

    def _table(self) -> list[tuple[Any, ...]]:
        """Return the cells below `HEAD`."""
        return [
            (
                change.design,
                change.measure,
                *(fixed(time, 2) for time in (change.before, change.after, change.change.value)),
                change.change.bounds() if change.change.has_interval else "",
                change.change.runs,
                f"{change.verdict} ({change.change.note})" if change.change.note else change.verdict,
            )
            for change in self.differences
        ]

    def _maps(self) -> Iterator[figures.Picture]:
        """Yield the maps of differences of designs that have maps: recorded runs, and studies with maps."""
        mapped = [(of.label, of.building, maps) for of in self.designs if of.building and (maps := of.maps())]
        for label, _, others in mapped[1:]:
            _, building, maps = mapped[0]
            for quantity in MAPS if maps.keys() & others.keys() else ():
                yield figures.difference_picture(building, maps, others, quantity, label)


def compare(*what: "str | Path | Results | Study | tuple[Study, int]") -> Comparison:
    """Compare designs with the first of them, by runs with the same seeds.

    Parameters
    ----------
    *what : str, Path, Results, Study or (Study, int)
        Result folders of runs, folders of studies, or results read from them. Each point of a study is a design;
        a pair selects one point.

    Returns
    -------
    Comparison

    Raises
    ------
    ResultError
        There are fewer than two designs, or two of them have no seed in common.

    Examples
    --------
    >>> evac.compare("narrow-runs", "wide-runs").to_pandas()  # doctest: +SKIP
    """
    designs = [design for source in what for design in _designs(source)]
    if len(designs) < 2:
        raise ResultError(f"compare: {counted(len(designs), 'design')}; name two or more runs, studies or points")
    for other in designs[1:]:
        if not {*designs[0].seeds} & {*other.seeds}:
            raise ResultError(
                f"{designs[0].label} and {other.label} have no seed in common, so their differences would be those of"
                " chance; run both with the same simulation.seed"
            )
    return Comparison(tuple(designs))


def _differences(first: Design, other: Design) -> Iterator[Difference]:
    common = [seeds for seeds in first.seeds if seeds in other.seeds]
    rows = [first.seeds.index(seeds) for seeds in common], [other.seeds.index(seeds) for seeds in common]
    populations = [population for _, population in common]
    measures, others = first.measures(), other.measures()
    for name in measures:
        before, after = measures[name][rows[0]], others[name][rows[1]]
        pairs = np.isfinite(before) & np.isfinite(after)
        means = [float(values[pairs].mean()) if pairs.any() else math.nan for values in (before, after)]
        yield Difference(other.label, name, means[0], means[1], difference(before, after, populations))


def _designs(what: Any) -> Iterator[Design]:
    if isinstance(what, str | Path):
        folder = Path(what)
        what = read_study(folder) if (folder / "study.json").is_file() else read_results(folder)
    if isinstance(what, Results):
        times = what.crowd.exit_time[what.leaving]
        seeds = what.seed, int(what.settings["simulation"].get("population_seed") or what.seed)
        label = what.folder.name if what.folder is not None else what.title
        maps = partial(level_maps, what.trajectory, spacing=SPACING) if what.trajectory else dict
        yield Design(label, (seeds,), (times,), (what.is_complete,), what.verdict, what.building_or_none, maps)
        return
    study, point = what if isinstance(what, tuple) and len(what) == 2 else (what, None)
    check_types(design=(study, PATH | Results | Study))
    for chosen in study.points if point is None else (study.points[point],):
        yield _of_point(study, chosen.index)


def _of_point(study: Study, point: int) -> Design:
    rows = list(study.rows(point, ("seed", "population_seed", "blocked", "exit_time")))
    label = study.points[point].label
    times = [np.asarray(row["exit_time"], np.float64) for row in rows]
    return Design(
        f"{study.folder.name}: {label}" if label else study.folder.name,
        tuple((row["seed"], row["seed"] if row["population_seed"] is None else row["population_seed"]) for row in rows),
        tuple(own if row["blocked"] else own[np.isfinite(own)] for own, row in zip(times, rows, strict=True)),
        tuple(not row["blocked"] for row in rows),
        study.verdict_at(point),
        study.building(point),
        partial(study.maps, point),
    )


def _seeds(seeds: Sequence[tuple[int, int]]) -> str:
    numbers = sorted({seed for seed, _ in seeds})
    return f"{numbers[0]}" if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]}"
