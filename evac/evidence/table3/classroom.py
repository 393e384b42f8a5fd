"""Runs of the classroom (paper, section 4.2): escape time of every desk, share of runs that block."""

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.ending import EVERYBODY_OUT
from evac.evidence.models import MODELS, model_overrides
from evac.evidence.report import MODEL_COLOURS, Evidence, new_figure
from evac.scenario.loading import load_case
from evac.simulation import Simulation

FloatArray = NDArray[np.float64]

#: Rows of desks in a column, as the case lists its pupils.
ROWS = 6

#: Pupils out are counted at these times [s].
MOMENTS = (5.0, 10.0, 15.0, 20.0)

#: Confidence of the intervals of shares.
CONFIDENCE = 0.95


@dataclass(frozen=True)
class ClassTask:
    """Some runs of one model: a task of one process."""

    model: str
    seeds: tuple[int, ...]


def run_class(task: ClassTask) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return exit times (runs, pupils) [s], NaN for who stayed inside, and whether each run blocked (runs,)."""
    case = load_case("classroom", model_overrides(task.model))
    times, blocked = [], []
    for seed in task.seeds:
        results = Simulation(case.change({"simulation.seed": seed})).run()
        times.append(results.crowd.exit_time)
        blocked.append(results.ended != EVERYBODY_OUT)
    return np.array(times), np.array(blocked)


def report_classroom(evidence: Evidence) -> None:
    """Add the classroom to the page."""
    runs = 6 if evidence.quick else 50
    seeds = [evidence.seed + run for run in range(runs)]
    tasks = [ClassTask(name, tuple(part)) for name in MODELS for part in (seeds[::2], seeds[1::2])]
    parts = evidence.map(run_class, tasks)
    times = {name: np.concatenate([parts[2 * k][0], parts[2 * k + 1][0]]) for k, name in enumerate(MODELS)}
    blocked = {name: np.concatenate([parts[2 * k][1], parts[2 * k + 1][1]]) for k, name in enumerate(MODELS)}
    evidence.heading("The classroom: who blocks, and escape times per desk (section 4.2)")
    shares = [_share_row(name, blocked[name], times[name]) for name in MODELS]
    order = ", ".join(f"{row['model']} {row['blocked']} of {row['runs']}" for row in shares)
    evidence.text(
        f"""{runs} runs of each model with the seeds {seeds[0]} to {seeds[-1]}, the same people for every model. Blocked
        for good were: {order}. The paper reports that DEM and NSM2 evacuate without problem and that NSM1 often blocks,
        and gives no shares; our door stands in the corner (buildings/classroom/README.md says why, and that it
        matters)."""
    )
    evidence.table("classroom_blocked", shares, "Runs that end with people left: share with Clopper-Pearson interval.")
    _report_without_selection(evidence, times)
    _report_desks(evidence, times, blocked)


def _report_without_selection(evidence: Evidence, times: dict[str, FloatArray]) -> None:
    """Add what compares the models on all runs, blocked ones included."""
    rows = []
    for name, all_times in times.items():
        row: dict[str, Any] = {"model": name, "runs": len(all_times), "last out, median [s]": None}
        if math.isfinite(middle := median_last(all_times)):
            row["last out, median [s]"] = middle
        for moment in MOMENTS:
            out = (all_times <= moment).sum(axis=1)
            row |= {f"out by {moment:g} s": float(out.mean()), f"+- by {moment:g} s": _standard_error(out)}
        rows.append(row)
    pupils = next(iter(times.values())).shape[1]
    endless = [row["model"] for row in rows if row["last out, median [s]"] is None]
    evidence.text(
        f"""Times to leave exist only for runs that did not block, and which runs block depends on the model: to compare
        models by the times at the desks below is to compare different selections of runs. Without a selection, over
        all runs, compare the number of the {pupils} pupils who are out by a given time, and the median of the last
        exit, where a blocked run counts as endless
        ({"it is endless for " + ", ".join(endless) if endless else "it is finite for every model"})."""
    )
    caption = (
        "All runs, blocked ones included: pupils out by a time, mean with standard error; a dash for an endless median."
    )
    evidence.table("classroom_all", rows, caption)


def median_last(times: FloatArray) -> float:
    """Return the median over runs (runs, pupils) of the last exit time [s]; a run with people left is endless."""
    return float(np.median(np.nan_to_num(times, nan=np.inf).max(axis=1)))


def share_interval(count: int, runs: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the Clopper-Pearson interval of a share of which `count` of `runs` were seen."""
    from scipy.stats import beta

    tail = 0.5 * (1.0 - confidence)
    low = float(beta.ppf(tail, count, runs - count + 1)) if count else 0.0
    high = float(beta.ppf(1.0 - tail, count + 1, runs - count)) if count < runs else 1.0
    return low, high


def _share_row(name: str, blocked: NDArray[np.bool_], times: FloatArray) -> dict[str, Any]:
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


def _report_desks(evidence: Evidence, times: dict[str, FloatArray], blocked: dict[str, NDArray[np.bool_]]) -> None:
    """Add the table of desks, what it says about distance, and the plan."""
    case = load_case("classroom")
    simulation = Simulation(case)
    place = simulation.population.crowd.position
    way = simulation.fields.travel_time_at(0, place, 0)
    column = len(place) // ROWS - np.arange(len(place)) // ROWS
    rows: list[dict[str, Any]] = []
    means = {name: times[name][~blocked[name]] for name in MODELS if not blocked[name].all()}
    for desk in np.lexsort((place[:, 1], column)):
        row: dict[str, Any] = {
            "column": int(column[desk]),
            "row": int(desk % ROWS + 1),
            "x [m]": place[desk, 0],
            "y [m]": place[desk, 1],
            "way to the door [m]": way[desk],
        }
        for name in MODELS:
            values = means[name][:, desk] if name in means else np.zeros(0)
            row[f"{name} [s]"] = float(values.mean()) if len(values) else None
            row[f"{name} +- [s]"] = _standard_error(values)
        rows.append(row)
    falls = {
        name: sum(
            near[f"{name} [s]"] > far[f"{name} [s]"]
            for near, far in itertools.pairwise(rows)
            if near["column"] == far["column"]
        )
        for name in means
    }
    steps = len(rows) - len(rows) // ROWS
    fallen = ", ".join(f"{count} ({name})" for name, count in falls.items())
    evidence.text(
        f"""The times per desk are means over the runs that did not block: {_selected(blocked)}. Within a column the
        mean escape time should grow from each desk to the one behind it, farther from the door;
        of {steps} such steps it falls in {fallen}. Experimental times per desk are printed in a figure that is not
        available, so no fit is claimed."""
    )
    caption = (
        f"Mean escape time of each desk over the runs that did not block ({_selected(blocked)}), with its standard "
        "error; columns counted from the door, rows from the back. The way is the length of the shortest path of a "
        "point."
    )
    evidence.table("classroom_desks", rows, caption, {"x [m]": ".3f", "y [m]": ".3f", "way to the door [m]": ".2f"})
    _plot_desks(evidence, simulation, rows, blocked)


def _selected(blocked: dict[str, NDArray[np.bool_]]) -> str:
    """Return how many runs of each model did not block."""
    return ", ".join(f"{name} {int((~one).sum())} of {len(one)}" for name, one in blocked.items())


def _standard_error(values: NDArray[Any]) -> float | None:
    """Return the standard error of a mean, None of fewer than two values."""
    return float(values.std(ddof=1) / math.sqrt(len(values))) if len(values) > 1 else None


def _plot_desks(
    evidence: Evidence, simulation: Simulation, rows: list[dict[str, Any]], blocked: dict[str, NDArray[np.bool_]]
) -> None:
    """Draw the plan with the mean escape times of three models at each desk, as figure 6 of the paper."""
    figure, axis = new_figure(7.0, 7.6)
    for x1, y1, x2, y2 in simulation.building.walls:
        axis.plot([x1, x2], [y1, y2], color="0.35", linewidth=1.5)
    for way_out in simulation.building.exits:
        for x1, y1, x2, y2 in way_out.segments:
            axis.plot([x1, x2], [y1, y2], color="#CC79A7", linewidth=4.0)
    shown = ("DEM", "NSM1 inertial", "NSM2")
    for row in rows:
        for k, name in enumerate(shown):
            mean = row[f"{name} [s]"]
            text = "-" if mean is None else f"{mean:.1f}"
            axis.text(
                row["x [m]"],
                row["y [m]"] + 0.15 * (1 - k),
                text,
                ha="center",
                va="center",
                fontsize=8,
                color=MODEL_COLOURS[name],
            )
    for name in shown:
        counted = int((~blocked[name]).sum())
        label = f"{name}, {counted} of {len(blocked[name])} runs"
        axis.plot([], [], "s", color=MODEL_COLOURS[name], label=label)
    figure.legend(loc="outside upper center", ncols=len(shown), frameon=False)
    axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axis.grid(False)
    caption = (
        "Mean escape times [s] at the desks (figure 6 of the paper): DEM, NSM1 inertial, NSM2 from top to bottom, each "
        "over its runs that did not block."
    )
    evidence.plot("classroom_desks", figure, caption)
