"""Runs of the classroom (paper, section 4.2): escape time of every desk, share of runs that block."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.case.loading import load_case
from evac.evidence.evidence import MODEL_COLOURS, Evidence, Row, new_figure
from evac.evidence.scenes import MODELS, model_overrides
from evac.evidence.verdicts import reported
from evac.simulation.simulation import Simulation
from evac.study.statistics import share_interval

#: Rows of desks in a column, as the case lists its pupils.
ROWS = 6

#: Pupils out are counted at these times [s].
MOMENTS = (5.0, 10.0, 15.0, 20.0)

#: Statements of the paper on each model, without numbers.
PUBLISHED: Mapping[str, str] = {
    "DEM": "not blocked",
    "NSM1 inertial": "often blocked",
    "NSM1 overdamped": "often blocked",
    "NSM2": "not blocked",
}

#: Exit times (runs, pupils) [s] by model; NaN for pupils left inside, whose run is blocked.
ClassTimes = Mapping[str, FloatArray]


def report_classroom(evidence: Evidence) -> None:
    """Add the classroom to the page."""
    runs = 6 if evidence.quick else 50

    @cache
    def measured() -> ClassTimes:
        return {name: evidence.exit_times(load_case("classroom", model_overrides(name)), runs) for name in MODELS}

    blocked = evidence.measured("classroom_blocked", lambda: [_share_row(*own) for own in measured().items()])
    everybody = evidence.measured("classroom_all", lambda: _all_rows(measured()))
    desks = evidence.measured("classroom_desks", lambda: _desk_rows(measured()))
    section = "The classroom: blocked runs and escape times per desk (section 4.2)"
    for row in blocked:
        text = f"{row['blocked']} of {row['runs']} ({row['from [%]']:.0f} to {row['to [%]']:.0f} %)"
        evidence.verdict(reported(f"Classroom, {row['model']}: blocked runs", text, PUBLISHED[row["model"]], section))
    rows = {"blocked": blocked, "everybody": everybody, "desks": desks}
    falls = [f"{falls_of(desks, name)} ({name})" for name in MODELS]
    evidence.show("classroom", __name__, section=section, runs=runs, seed=evidence.seed, falls=falls, **rows)


def falls_of(desks: Sequence[Row], model: str) -> int:
    """Return how often the mean time decreases from a desk to the one behind it in its column."""
    return sum(
        near["column"] == far["column"] and (near[f"{model} [s]"] or 0.0) > (far[f"{model} [s]"] or np.inf)
        for near, far in itertools.pairwise(desks)
    )


def _all_rows(runs: ClassTimes) -> Iterator[Row]:
    for name, times in runs.items():
        middle = median_last(times)
        row: Row = {"model": name, "runs": len(times)}
        row["last out, median [s]"] = middle if math.isfinite(middle) else None
        for moment in MOMENTS:
            out = (times <= moment).sum(axis=1)
            row |= {f"out by {moment:g} s": float(out.mean()), f"+- by {moment:g} s": _standard_error(out)}
        yield row


def median_last(times: FloatArray) -> float:
    """Return the median over runs (runs, pupils) of the last exit time [s]; infinite for a run with people left."""
    return float(np.median(np.nan_to_num(times, nan=np.inf).max(axis=1)))


def _is_blocked(times: FloatArray) -> NDArray[np.bool_]:
    return np.asarray(np.isnan(times).any(axis=1))


def _share_row(name: str, times: FloatArray) -> Row:
    blocked = _is_blocked(times)
    count, runs = int(blocked.sum()), len(blocked)
    low, high = share_interval(count, runs)
    return {
        "model": name,
        "runs": runs,
        "blocked": count,
        "share [%]": 100.0 * count / runs,
        "from [%]": 100.0 * low,
        "to [%]": 100.0 * high,
        "runs not blocked": runs - count,
        "last out, mean of these [s]": float(times[~blocked].max(axis=1).mean()) if count < runs else None,
    }


def _desk_rows(runs: ClassTimes) -> Iterator[Row]:
    """Return the mean escape times of every desk over the runs that did not block, from the door back."""
    simulation = Simulation(load_case("classroom"))
    place = simulation.population.crowd.position
    way = simulation.fields.travel_time_at(0, place, 0)
    column = len(place) // ROWS - np.arange(len(place)) // ROWS
    for desk in np.lexsort((place[:, 1], column)):
        row: Row = {
            "column": int(column[desk]),
            "row": int(desk % ROWS + 1),
            "x [m]": place[desk, 0],
            "y [m]": place[desk, 1],
            "way to the door [m]": way[desk],
        }
        for name, times in runs.items():
            values = times[~_is_blocked(times), desk]
            row[f"{name} [s]"] = float(values.mean()) if len(values) else None
            row[f"{name} +- [s]"] = _standard_error(values)
        yield row


def _standard_error(values: NDArray[Any]) -> float | None:
    return float(values.std(ddof=1) / math.sqrt(len(values))) if len(values) > 1 else None


def _draw_desks(desks: Sequence[Row], blocked: Sequence[Row]) -> Any:
    building = Simulation(load_case("classroom")).building
    figure, axis = new_figure(7.0, 7.6)
    for x1, y1, x2, y2 in building.walls:
        axis.plot([x1, x2], [y1, y2], color="0.35", linewidth=1.5)
    for way_out in building.exits:
        for x1, y1, x2, y2 in way_out.segments:
            axis.plot([x1, x2], [y1, y2], color="#CC79A7", linewidth=4.0)
    shown = [row for row in blocked if row["model"] in ("DEM", "NSM1 inertial", "NSM2")]
    for k, runs in enumerate(shown):
        name, colour = runs["model"], MODEL_COLOURS[runs["model"]]
        for row in desks:
            text = "-" if row[f"{name} [s]"] is None else f"{row[f'{name} [s]']:.1f}"
            place = row["x [m]"], row["y [m]"] + 0.15 * (1 - k)
            axis.text(*place, text, ha="center", va="center", fontsize=8, color=colour)
        axis.plot([], [], "s", color=colour, label=f"{name}, {runs['runs not blocked']} of {runs['runs']} runs")
    figure.legend(loc="outside upper center", ncols=len(shown), frameon=False)
    axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axis.grid(False)
    return figure
