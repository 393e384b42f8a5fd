"""Accuracy, part e: the flow out of the square room over the step, with its standard error and its cost."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from evac.errors import ScenarioError
from evac.evidence.models import MODELS, make_model
from evac.evidence.report import MODEL_COLOURS, Evidence, new_figure
from evac.evidence.square_room import crowd_at, exit_times, start_positions
from evac.evidence.verdicts import surely_at_most
from evac.physics.bundles import FloatArray
from evac.physics.contact_model import border_scene
from evac.scenario.schema import SimulationSettings

#: Steps [s] and the number of runs at each. The same crowds are run at every step, so differences are paired.
QUICK = (1e-1, 1e-2, 5e-3), 4
FULL = (1e-1, 5e-2, 2e-2, 1e-2, 1e-3, 1e-4), 200

#: The default step [s] counts as justified where its flow is shown to differ by less than this share.
DEFAULT = SimulationSettings().step
LITTLE = 0.05

#: Half a confidence interval of 95 %, in standard errors.
INTERVAL = 1.96

#: Models are drawn beside each other: by this factor of the step, with a marker each.
ASIDE = 1.06
MARKERS = ("o", "s", "^", "D")

#: Runs per position set.
PER_SET = 10


SECTION = "e. Egress: flow of the square room over the step"


def run(evidence: Evidence) -> None:
    """Add part e to the page."""
    steps, number = QUICK if evidence.quick else FULL
    runs = evidence.measured(
        "egress_runs",
        lambda: [row for model in MODELS for step in steps for row in measure(model, step, number, evidence.seed)],
    )
    rows = summary(runs, steps)
    for model, (bias, half) in biases(runs, min(steps)).items():
        question = f"{model}: flow at h = {DEFAULT:g} s over that at {min(steps):g} s"
        evidence.verdict(surely_at_most(question, 100.0 * bias, 100.0 * half, 100.0 * LITTLE, "%", SECTION))
    evidence.heading(SECTION)
    evidence.text(
        f"""The flow of one run is the slope of the linear regression of the number out on time. The same crowds are
        run at every step, and differences are those of the same crowds to h = {DEFAULT:g} s, the default. Blocked
        runs, in which nobody gets out for 10 s, are left out of the mean. DEM refuses steps beyond its stability
        limit."""
    )
    evidence.table("egress", rows, "Mean flow [people per minute], its standard error, and the cost of a run.")
    evidence.plot(
        "egress",
        lambda: draw(rows),
        "Flow over the step with its interval of 95 %, and the cost of a run; models are drawn a little beside each"
        " other.",
    )
    evidence.data("egress_runs", runs, "All runs")


def measure(model: str, step: float, number: int, seed: int) -> list[dict[str, Any]]:
    """Return a row per run; none where the model refuses the step."""
    rows = []
    for run_number in range(number):
        position_set, place = divmod(run_number, PER_SET)
        crowd = crowd_at(start_positions(seed, position_set), seed, position_set, place)
        try:
            make_model(model).check_scene(border_scene(crowd, step, False))
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


def summary(runs: Sequence[dict[str, Any]], steps: Sequence[float]) -> list[dict[str, Any]]:
    """Return a row per model and step."""
    rows = []
    for model in dict.fromkeys(run["model"] for run in runs):
        base = {r["run"]: r["flow [1/min]"] for r in runs if r["model"] == model and r["h [s]"] == DEFAULT}
        for step in steps:
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
            is_base = step == DEFAULT
            rows.append(
                {
                    "model": model,
                    "h [s]": step,
                    "runs": len(here),
                    "blocked": len(here) - len(flows),
                    "flow [1/min]": float(flows.mean()),
                    "standard error": _standard_error(flows),
                    f"difference to h = {DEFAULT:g}": None if is_base or not len(paired) else float(paired.mean()),
                    "its standard error": None if is_base else _standard_error(paired),
                    "time of a run [s]": float(np.median([r["time [s]"] for r in here])),
                }
            )
    return rows


def _standard_error(values: FloatArray) -> float | None:
    """Return the standard error of a mean; None of fewer than two values."""
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else None


def biases(runs: Sequence[dict[str, Any]], finest: float) -> dict[str, tuple[float, float]]:
    """Return, by model, the share by which the flow at the default step differs from that at the finest.

    The second number is half its interval of 95 %, over the crowds that both steps have.
    """
    found = {}
    for model in dict.fromkeys(run["model"] for run in runs):
        flows: dict[float, dict[int, float]] = {DEFAULT: {}, finest: {}}
        for run in runs:
            if run["model"] == model and run["h [s]"] in flows and run["flow [1/min]"] is not None:
                flows[run["h [s]"]][run["run"]] = run["flow [1/min]"]
        both = sorted(flows[DEFAULT].keys() & flows[finest].keys())
        if len(both) > 1:
            fine = np.array([flows[finest][run] for run in both])
            change = (np.array([flows[DEFAULT][run] for run in both]) - fine) / fine.mean()
            found[model] = float(change.mean()), INTERVAL * float(change.std(ddof=1) / np.sqrt(len(both)))
    return found


def draw(rows: Sequence[dict[str, Any]]) -> Any:
    """Draw flow and cost over the step."""
    figure, (left, right) = new_figure(10.0, 4.6, 1, 2)
    models = list(dict.fromkeys(row["model"] for row in rows))
    for k, (model, marker) in enumerate(zip(models, MARKERS, strict=False)):
        line = [row for row in rows if row["model"] == model]
        steps = [row["h [s]"] * ASIDE ** (k - 0.5 * (len(models) - 1)) for row in line]
        spread = [INTERVAL * (row["standard error"] or 0.0) for row in line]
        style = {"marker": marker, "color": MODEL_COLOURS[model], "markerfacecolor": "none"}
        flows = [row["flow [1/min]"] for row in line]
        left.errorbar(steps, flows, spread, capsize=3, label=model, **style)
        right.loglog(steps, [r["time of a run [s]"] for r in line], **style)
    left.set_xscale("log")
    left.set_ylabel("flow [people per minute]")
    right.set_ylabel("time of a run [s]")
    for axis in (left, right):
        axis.set_xlabel("h [s]")
    figure.legend(loc="outside lower center", ncols=len(models), fontsize=8)
    return figure
