"""Accuracy, part e: the flow out of the square room over the step, with its standard error and its cost."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from evac.errors import ScenarioError
from evac.evidence.accuracy_data import add_data
from evac.evidence.models import MODELS, make_model
from evac.evidence.report import MODEL_COLOURS, Evidence, new_figure
from evac.evidence.square_room import crowd_at, exit_times, start_positions
from evac.physics.bundles import FloatArray
from evac.physics.contact_model import BorderScene

#: Step [s] and number of runs: small steps cost. The same crowds are run at every step, so differences are paired.
QUICK = ((1e-1, 4), (1e-2, 4))
FULL = ((1e-1, 100), (5e-2, 100), (2e-2, 100), (1e-2, 100), (1e-3, 20), (1e-4, 4))

#: Runs per position set.
PER_SET = 10


def run(evidence: Evidence) -> None:
    """Compute part e and add it to the page."""
    plan = QUICK if evidence.quick else FULL
    evidence.heading("e. Egress: flow of the square room over the step")
    evidence.text(
        """The flow of one run is the slope of the linear regression of the number out on time. The same crowds (start
        positions, radii, masses, speeds) are run at every step. Standard errors are those of the mean over runs;
        the difference is that of the same crowds to h = 0.01 s. Blocked runs, in which nobody gets out for 10 s,
        are counted and left out of the mean. DEM refuses steps beyond its stability limit."""
    )
    runs: list[dict[str, Any]] = []
    for model in MODELS:
        for step, number in plan:
            runs += measure(model, step, number, evidence.seed)
    rows = summary(runs, plan)
    evidence.table("egress", rows, "Mean flow [people per minute], its standard error, and the cost of a run.")
    evidence.plot("egress", draw(rows), "Flow over the step with two standard errors, and the cost of a run.")
    add_data(evidence, "egress_runs", runs, "All runs")


def measure(model: str, step: float, number: int, seed: int) -> list[dict[str, Any]]:
    """Return a row per run; none where the model refuses the step."""
    rows = []
    for run_number in range(number):
        position_set, place = divmod(run_number, PER_SET)
        crowd = crowd_at(start_positions(seed, position_set), seed, position_set, place)
        scene = BorderScene(step, False, crowd.radius, crowd.mass, crowd.tau, float(crowd.speed.max()))
        try:
            make_model(model).check_scene(scene)
        except ScenarioError:
            continue
        start = time.perf_counter()
        times = exit_times(model, crowd, step)
        rows.append(
            {
                "model": model,
                "h [s]": step,
                "run": run_number,
                "flow [1/min]": flow_of(times),
                "last out [s]": float(np.nanmax(times)) if np.isfinite(times).any() else None,
                "time [s]": time.perf_counter() - start,
            }
        )
    return rows


def flow_of(times: FloatArray) -> float | None:
    """Return the flow [people per minute] of one run; None if it was blocked."""
    if not np.all(np.isfinite(times)):
        return None
    return 60.0 * float(np.polyfit(np.sort(times), np.arange(1, len(times) + 1), 1)[0])


def summary(runs: Sequence[dict[str, Any]], plan: Sequence[tuple[float, int]]) -> list[dict[str, Any]]:
    """Return a row per model and step."""
    rows = []
    for model in dict.fromkeys(run["model"] for run in runs):
        base = {r["run"]: r["flow [1/min]"] for r in runs if r["model"] == model and r["h [s]"] == 1e-2}
        for step, _ in plan:
            here = [r for r in runs if r["model"] == model and r["h [s]"] == step]
            flows = np.array([r["flow [1/min]"] for r in here if r["flow [1/min]"] is not None])
            if not len(flows):
                continue
            paired = np.array(
                [
                    r["flow [1/min]"] - base[r["run"]]
                    for r in here
                    if r["flow [1/min]"] is not None and base.get(r["run"]) is not None
                ]
            )
            is_base = step == 1e-2
            rows.append(
                {
                    "model": model,
                    "h [s]": step,
                    "runs": len(here),
                    "blocked": len(here) - len(flows),
                    "flow [1/min]": float(flows.mean()),
                    "standard error": _standard_error(flows),
                    "difference to h = 0.01": None if is_base or not len(paired) else float(paired.mean()),
                    "its standard error": None if is_base else _standard_error(paired),
                    "time of a run [s]": float(np.median([r["time [s]"] for r in here])),
                }
            )
    return rows


def _standard_error(values: FloatArray) -> float | None:
    """Return the standard error of a mean; None of fewer than two values."""
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else None


def draw(rows: Sequence[dict[str, Any]]) -> Any:
    """Draw flow and cost over the step."""
    figure, (left, right) = new_figure(10.0, 4.2, 1, 2)
    for model in dict.fromkeys(row["model"] for row in rows):
        line = [row for row in rows if row["model"] == model]
        steps = [row["h [s]"] for row in line]
        spread = [2.0 * (row["standard error"] or 0.0) for row in line]
        colour = MODEL_COLOURS[model]
        flows = [row["flow [1/min]"] for row in line]
        left.errorbar(steps, flows, spread, marker="o", capsize=3, color=colour, label=model)
        right.loglog(steps, [r["time of a run [s]"] for r in line], "o-", color=colour)
    left.set_xscale("log")
    left.set_ylabel("flow [people per minute]")
    right.set_ylabel("time of a run [s]")
    for axis in (left, right):
        axis.set_xlabel("h [s]")
    left.legend(fontsize=8)
    return figure
