"""Runs of the primary school (paper, section 4.3): egress curves with and without following a teacher."""

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.case.loading import load_case
from evac.evidence.evidence import Evidence, Row, new_figure
from evac.evidence.verdicts import reported
from evac.simulation.simulation import Simulation

#: The two variants, and their changes of the shipped case.
VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "following a teacher": {},
    "everybody alone": {"behaviours.teacher_following": False},
}
COLOURS = {"following a teacher": "#0072B2", "everybody alone": "#D55E00"}

#: Times between which the curve of the exercise stalled, according to the paper [s].
STALL = (38.0, 48.0)


class SchoolRuns(NamedTuple):
    """Exit times (runs, people) [s], NaN for people left inside, and the storey of each (people,)."""

    times: FloatArray
    storey: NDArray[np.int64]


def school_runs(evidence: Evidence, name: str, runs: int) -> SchoolRuns:
    """Return the runs of a variant."""
    case = load_case("primary_school", VARIANTS[name])
    simulation = Simulation(case, will_run=False)
    height = np.array([simulation.building.levels[level].z_min for level in simulation.population.crowd.level])
    return SchoolRuns(evidence.exit_times(case, runs), np.unique(height, return_inverse=True)[1])


def report_school(evidence: Evidence) -> None:
    """Add the school to the page."""
    runs = 6 if evidence.quick else 100

    @cache
    def measured() -> dict[str, SchoolRuns]:
        return {name: school_runs(evidence, name, runs) for name in VARIANTS}

    rows = evidence.measured("school", lambda: [school_row(name, measured()[name]) for name in VARIANTS])
    section = "The primary school: egress curves (section 4.3)"
    text = "; ".join(
        f"{row['last out, mean [s]']:.1f} s, {row['longest pause, mean [s]']:.1f} s ({row['variant']})" for row in rows
    )
    stall = f"pause of the exercise: {STALL[1] - STALL[0]:.0f} s"
    evidence.verdict(reported("School: last out, longest pause between exits, means", text, stall, section))
    curves = evidence.measured("school_egress", lambda: _curve_rows(measured()))
    tables = {"rows": rows, "curves": curves, "draw": lambda: _draw(measured())}
    evidence.show("school", __name__, section=section, runs=runs, seed=evidence.seed, **tables)


def curve(times: FloatArray, grid: FloatArray) -> FloatArray:
    """Return how many are out (runs, k) at the times `grid` (k,) in each run."""
    return np.array([np.searchsorted(np.sort(run[np.isfinite(run)]), grid, side="right") for run in times], dtype=float)


def longest_pause(times: FloatArray) -> FloatArray:
    """Return the longest time between two exits (runs,) [s], the first and the last tenth of the people left out."""
    tenth = times.shape[1] // 10
    middle = np.sort(times, axis=1)[:, tenth : times.shape[1] - tenth]
    pause: FloatArray = np.nanmax(np.diff(middle, axis=1), axis=1)
    return pause


def school_row(name: str, runs: SchoolRuns) -> Row:
    """Return means and extremes over runs; the time of a run with people left is infinite."""
    times = np.nan_to_num(runs.times, nan=np.inf)  # infinite for people left inside
    last = times.max(axis=1)
    row: dict[str, Any] = {
        "variant": name,
        "runs": len(last),
        "runs with people left": int(np.isnan(runs.times).any(axis=1).sum()),
        "half are out, mean [s]": float(np.median(times, axis=1).mean()),
        "last out, mean [s]": float(last.mean()),
        "least [s]": float(last.min()),
        "greatest [s]": float(last.max()),
        "longest pause, mean [s]": float(longest_pause(runs.times).mean()),
    }
    for storey in np.unique(runs.storey):
        of_storey = times[:, runs.storey == storey].max(axis=1)
        row[f"storey {storey} empty, mean [s]"] = float(of_storey.mean())
    return row


def _grid(variants: Mapping[str, SchoolRuns]) -> FloatArray:
    end = max(float(np.nanmax(runs.times)) for runs in variants.values())
    return np.arange(0.0, np.ceil(end) + 0.5, 0.5)


def _curve_rows(variants: Mapping[str, SchoolRuns]) -> list[Row]:
    rows: list[Row] = [{"time [s]": float(time)} for time in _grid(variants)]
    for name, runs in variants.items():
        out = curve(runs.times, _grid(variants))
        for row, mean, low, high in zip(rows, out.mean(axis=0), out.min(axis=0), out.max(axis=0), strict=True):
            row |= {f"{name}, mean": float(mean), f"{name}, least": float(low), f"{name}, greatest": float(high)}
    return rows


def _draw(variants: Mapping[str, SchoolRuns]) -> Any:
    grid = _grid(variants)
    figure, axes = new_figure(9.0, 4.2, 1, 2, sharex=True, sharey=True)
    for axis, (name, runs) in zip(axes, variants.items(), strict=True):
        out = curve(runs.times, grid)
        for line in out:
            axis.plot(grid, line, color=COLOURS[name], alpha=0.15 if len(out) > 20 else 0.4, linewidth=0.7)
        axis.plot(grid, out.mean(axis=0), color="black", linewidth=2.0, label=f"mean of {len(out)} runs")
        axis.axvspan(*STALL, color="0.92", zorder=0, label="stall of the exercise")
        axis.set(title=name, xlabel="t [s]")
        axis.legend(frameon=False, loc="upper left")
    axes[0].set(ylabel="people out")
    return figure
