"""Accuracy, part e: the flow out of the square room over the step, with its standard error and its cost."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from evac.arrays import FloatArray
from evac.errors import ScenarioError
from evac.evidence.accuracy.data import add_data
from evac.evidence.models import MODELS, make_model
from evac.evidence.report import MODEL_COLOURS, Evidence, new_figure
from evac.evidence.square_room import crowd_at, exit_times, start_positions
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


def run(evidence: Evidence) -> None:
    """Compute part e and add it to the page."""
    steps, number = QUICK if evidence.quick else FULL
    evidence.heading("e. Egress: flow of the square room over the step")
    evidence.text(
        f"""The flow of one run is the slope of the linear regression of the number out on time. The same crowds (start
        positions, radii, masses, speeds) are run at every step. Standard errors are those of the mean over runs;
        the difference is that of the same crowds to h = {DEFAULT:g} s, the default. Blocked runs, in which nobody gets
        out for 10 s, are counted and left out of the mean. DEM refuses steps beyond its stability limit."""
    )
    runs: list[dict[str, Any]] = []
    for model in MODELS:
        for step in steps:
            runs += measure(model, step, number, evidence.seed)
    rows = summary(runs, steps)
    evidence.table("egress", rows, "Mean flow [people per minute], its standard error, and the cost of a run.")
    evidence.plot(
        "egress",
        draw(rows),
        "Flow over the step with its interval of 95 %, and the cost of a"
        " run; models are drawn a little beside each other.",
    )
    evidence.text(biases_in_words(runs, min(steps)))
    add_data(evidence, "egress_runs", runs, "All runs")


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


def biases_in_words(runs: Sequence[dict[str, Any]], finest: float) -> str:
    """Say by how much each model's flow at the default step differs from that at the finest, and what follows."""
    told, justified, beyond, unknown = [], [], [], []
    for model in dict.fromkeys(run["model"] for run in runs):
        flows: dict[float, dict[int, float]] = {DEFAULT: {}, finest: {}}
        for run in runs:
            if run["model"] == model and run["h [s]"] in flows and run["flow [1/min]"] is not None:
                flows[run["h [s]"]][run["run"]] = run["flow [1/min]"]
        both = sorted(flows[DEFAULT].keys() & flows[finest].keys())
        if len(both) < 2:
            continue
        fine = np.array([flows[finest][run] for run in both])
        change = (np.array([flows[DEFAULT][run] for run in both]) - fine) / fine.mean()
        bias, half = float(change.mean()), INTERVAL * float(change.std(ddof=1) / np.sqrt(len(both)))
        told.append(f"{model} {100.0 * bias:+.1f} % ({100.0 * (bias - half):+.1f} to {100.0 * (bias + half):+.1f} %)")
        if abs(bias) + half <= LITTLE:
            justified.append(model)
        elif abs(bias) - half > LITTLE:
            beyond.append(model)
        else:
            unknown.append(model)
    words = (
        f"The bias of h = {DEFAULT:g} s, its flow over that of the same crowds at h = {finest:g} s, with its"
        f" interval of 95 %: {', '.join(told)}."
    )
    for models, verdict in (
        (justified, f"That it is below {100.0 * LITTLE:g} % is shown, and the default step justified, for"),
        (beyond, f"It is beyond {100.0 * LITTLE:g} %, and for flows a smaller step is needed, for"),
        (unknown, f"Whether it is below {100.0 * LITTLE:g} % these runs do not decide for"),
    ):
        words += f" {verdict} {', '.join(models)}." if models else ""
    return words


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
