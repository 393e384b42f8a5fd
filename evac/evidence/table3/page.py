"""Table 3 of the paper and the figures around it: flow of the square room, figures 2 and 3, classroom, school."""

from collections.abc import Mapping
from typing import Any

from evac.evidence.models import MODELS
from evac.evidence.report import MODEL_COLOURS, Evidence, new_figure
from evac.evidence.square_room import CONFIDENCE, GAP, RESAMPLES, Flow, SetTask, change, flow, run_set
from evac.evidence.table3.classroom import report_classroom
from evac.evidence.table3.figures import draw_figure_2, draw_figure_3
from evac.evidence.table3.school import report_school

#: Table 3 as published, h [s] -> people per minute. Its NSM1 is compared with both variants.
PUBLISHED: Mapping[str, Mapping[float, int]] = {
    "DEM": {1e-2: 182, 1e-3: 182, 1e-4: 181},
    "NSM1 inertial": {1e-2: 279, 1e-3: 276, 1e-4: 278},
    "NSM1 overdamped": {1e-2: 279, 1e-3: 276, 1e-4: 278},
    "NSM2": {1e-2: 156, 1e-3: 154, 1e-4: 155},
}

#: The real exercise of the table [people per minute].
EXERCISE = 160

#: By model and step [s].
FlowTable = Mapping[tuple[str, float], Flow]

#: Width of the door of the square room [m], and the greatest flow of Weidmann's fundamental diagram [1/s/m].
WIDTH = 0.82
WEIDMANN = 1.22

#: Position sets and runs of each, by step [s]: the finest step costs a hundred times the coarsest.
FULL_RUNS = {1e-2: (20, 50), 1e-3: (20, 50), 1e-4: (20, 5)}
QUICK_RUNS = {1e-2: (4, 5), 1e-3: (4, 1), 1e-4: (2, 1)}


def run(evidence: Evidence) -> None:
    """Compute the page."""
    report_flow(evidence)
    draw_figure_2(evidence)
    draw_figure_3(evidence)
    report_classroom(evidence)
    report_school(evidence)
    evidence.write_page("Table 3 of the paper, and the figures around it")


def report_flow(evidence: Evidence) -> None:
    """Add the flow through the door of the square room."""
    plan = QUICK_RUNS if evidence.quick else FULL_RUNS
    flows, changes = _flows(evidence, plan)
    coarse = max(plan)
    summary = [
        f"{name} {flows[name, coarse].pooled.value:.0f} ({PUBLISHED[name][coarse]}; "
        f"{flows[name, coarse].mean.value:.0f})"
        for name in MODELS
    ]
    evidence.text(
        f"""Flow of twenty people through a door of {WIDTH} m, in people per minute at h = {coarse} s, by one regression
        over the exits of all runs, in brackets as published and as the mean of one regression for each run:
        {", ".join(summary)}; the real exercise had {EXERCISE}."""
    )
    evidence.heading("Flow of the square room (Table 3, section 4.1)")
    evidence.text(
        f"""The paper leaves open where the door is, where people start, where they aim and how the regression is made,
        and all of it matters. The recipe here: the shipped case square_room (door in mid-wall, walls without thickness,
        directions and driving as shipped; out is whose centre crosses the door line); position sets and parameters
        drawn from seeds of their own, the same people for every model and step. {100 * CONFIDENCE:.0f} % intervals come
        from {RESAMPLES} bootstrap resamples of position sets. Runs in which nobody leaves for more than {GAP:.0f} s are
        counted apart. Nothing is tuned to the published values."""
    )
    evidence.text(_definitions(flows, coarse))
    specific = [found.pooled.value / (60.0 * WIDTH) for found in flows.values()]
    evidence.text(
        f"""Per second and metre of door Q pooled is {min(specific):.1f} to {max(specific):.1f} people. Weidmann's
        fundamental diagram (Transporttechnik der Fussgaenger, 1993) allows {WEIDMANN} at most: nobody here slows down
        before bodies touch, so these are flows of people who push, and no design values."""
    )
    evidence.text(_comparison(flows, changes, coarse, min(plan)))
    rows = [_row(name, step, plan[step][0], flows[name, step]) for name in MODELS for step in plan]
    caption = "Flow Q [people per minute] by both definitions, fewer runs at finer steps as the table says."
    evidence.table("table3", rows, caption, {"h [s]": "g"})
    _report_changes(evidence, changes, coarse)
    _plot(evidence, flows, sorted(plan))


def _flows(evidence: Evidence, plan: Mapping[float, tuple[int, int]]) -> tuple[FlowTable, FlowTable]:
    """Return the flow by model and step, and how it changes from the coarsest step to the others."""
    tasks = [SetTask(evidence.seed, k, runs, step) for step, (sets, runs) in plan.items() for k in range(sets)]
    parts = evidence.map(run_set, tasks)
    times = {
        (name, step): [part[name] for task, part in zip(tasks, parts, strict=True) if task.step == step]
        for name in MODELS
        for step in plan
    }
    flows = {
        (name, step): flow(sets, evidence.generator("bootstrap", name, str(step)))
        for (name, step), sets in times.items()
    }
    changes = {
        (name, step): change(times[name, max(plan)], sets, evidence.generator("change", name, str(step)))
        for (name, step), sets in times.items()
        if step != max(plan)
    }
    return flows, changes


def _definitions(flows: FlowTable, step: float) -> str:
    """Return what the two definitions of the flow are, and how far they are apart."""
    apart = [
        f"{100.0 * (flows[name, step].mean.value / flows[name, step].pooled.value - 1.0):+.0f} % ({name})"
        for name in MODELS
    ]
    return (
        "The flow of a run is the slope of the linear regression of the number out, 1 to 20, on the exit times. Of "
        "many runs two flows can be made. Q pooled, which stands first on this page, is the slope of one regression "
        "over the exits of all runs together: one line for a model, as the paper gives one number for it. Q of runs "
        "is the mean of the slopes of single runs, as part e of the accuracy page has it. Runs differ in "
        "when their exits come, which spreads the times at the same number and makes the pooled line flatter: at "
        f"h = {step:g} s the mean of runs is off the pooled flow by {', '.join(apart)}."
    )


def _row(name: str, step: float, sets: int, found: Flow) -> dict[str, Any]:
    return {
        "model": name,
        "h [s]": step,
        "position sets": sets,
        "runs": found.runs,
        "counted apart": found.stopped,
        "Q pooled": found.pooled.value,
        "from": found.pooled.low,
        "to": found.pooled.high,
        "per metre [1/s/m]": found.pooled.value / (60.0 * WIDTH),
        "Q of runs": found.mean.value,
        "of runs, from": found.mean.low,
        "of runs, to": found.mean.high,
        "published": PUBLISHED[name][step],
        "Q pooled - published": found.pooled.value - PUBLISHED[name][step],
        "Q of runs - published": found.mean.value - PUBLISHED[name][step],
    }


def _comparison(flows: FlowTable, changes: FlowTable, coarse: float, fine: float) -> str:
    """Return what the flows say about the order of the models, the trend in h and the published values."""
    order = sorted(MODELS, key=lambda name: flows[name, coarse].pooled.value)
    told = []
    for which in ("pooled", "mean"):
        intervals = {key: getattr(found, which) for key, found in flows.items()}
        inside = [
            f"{name} at h = {step:g} s"
            for (name, step), one in intervals.items()
            if one.low <= PUBLISHED[name][step] <= one.high
        ]
        told.append(f"Q {'pooled' if which == 'pooled' else 'of runs'} for {', '.join(inside) or 'none'}")
    trend = [
        f"{found.pooled.value:+.0f} ({found.pooled.low:+.0f} to {found.pooled.high:+.0f}) for {name}"
        for (name, step), found in changes.items()
        if step == fine
    ]
    words = (
        f" From h = {coarse:g} s to {fine:g} s Q pooled changes, for the same people, by {', '.join(trend)}."
        if trend
        else ""
    )
    return (
        f"From least to greatest flow at h = {coarse:g} s: {', '.join(order)}.{words} The published value lies inside "
        f"the interval of {' and of '.join(told)}."
    )


def _report_changes(evidence: Evidence, changes: FlowTable, coarse: float) -> None:
    """Add how the flow changes with the step, on the runs that both steps have."""
    rows = [
        {
            "model": name,
            "from h [s]": coarse,
            "to h [s]": step,
            "shared runs": found.runs,
            "counted apart": found.stopped,
            "change of Q pooled": found.pooled.value,
            "from": found.pooled.low,
            "to": found.pooled.high,
            "change of Q of runs": found.mean.value,
            "of runs, from": found.mean.low,
            "of runs, to": found.mean.high,
        }
        for (name, step), found in changes.items()
    ]
    if rows:
        changed = ("change of Q pooled", "from", "to", "change of Q of runs", "of runs, from", "of runs, to")
        formats = dict.fromkeys(changed, "+.1f") | {"from h [s]": "g", "to h [s]": "g"}
        caption = (
            "Change of the flow with the step [people per minute]: differences on the runs that both steps have, with "
            "the interval of the paired difference; a run that was stopped at either step is counted apart at both."
        )
        evidence.table("table3_steps", rows, caption, formats)


def _plot(evidence: Evidence, flows: FlowTable, steps: list[float]) -> None:
    """Draw Q over h with intervals, and the published values."""
    figure, axis = new_figure(7.5, 4.2)
    handles: list[Any] = []
    for shift, name in enumerate(MODELS):
        place = [step * 1.08 ** (shift - 1.5) for step in steps]
        found = [flows[name, step].pooled for step in steps]
        spread = [[one.value - one.low for one in found], [one.high - one.value for one in found]]
        colour = MODEL_COLOURS[name]
        handles.append(
            axis.errorbar(place, [one.value for one in found], spread, fmt="o-", color=colour, capsize=3, label=name)
        )
        runs = [flows[name, step].mean.value for step in steps]
        axis.plot(place, runs, "o", color=colour, markerfacecolor="none")
        if name != "NSM1 overdamped":
            published = [PUBLISHED[name][step] for step in steps]
            label = f"{name.split()[0]}, published"
            handles += axis.plot(steps, published, "x--", color=colour, alpha=0.6, label=label)
    handles += axis.plot([], [], "o", color="0.4", markerfacecolor="none", label="Q of runs")
    handles.append(axis.axhline(EXERCISE, color="0.5", linewidth=0.8, label="exercise"))
    axis.set(xscale="log", xlabel="step h [s]", ylabel="Q [people per minute]", ylim=(0.0, None))
    figure.legend(handles=handles, frameon=False, loc="outside right center")
    caption = "Flow over the step: Q pooled with intervals (full), Q of runs (open), published (dashed)."
    evidence.plot("table3", figure, caption)
