"""Table 3 of the paper and the figures around it: flow of the square room, figures 2 and 3, classroom, school."""

from collections.abc import Mapping
from typing import Any

from evac.evidence.classroom import report_classroom
from evac.evidence.models import MODELS
from evac.evidence.paper_figures import draw_figure_2, draw_figure_3
from evac.evidence.report import MODEL_COLOURS, Evidence, new_figure
from evac.evidence.school import report_school
from evac.evidence.square_room import CONFIDENCE, GAP, RESAMPLES, Flow, SetTask, flow, run_set

#: Table 3 as published, h [s] -> people per minute. Its NSM1 is compared with both variants.
PUBLISHED: Mapping[str, Mapping[float, int]] = {
    "DEM": {1e-2: 182, 1e-3: 182, 1e-4: 181},
    "NSM1 inertial": {1e-2: 279, 1e-3: 276, 1e-4: 278},
    "NSM1 overdamped": {1e-2: 279, 1e-3: 276, 1e-4: 278},
    "NSM2": {1e-2: 156, 1e-3: 154, 1e-4: 155},
}

#: The real exercise of the table [people per minute].
EXERCISE = 160

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
    tasks = [SetTask(evidence.seed, k, runs, step) for step, (sets, runs) in plan.items() for k in range(sets)]
    parts = evidence.map(run_set, tasks)
    flows = {
        (name, step): flow(
            [part[name] for task, part in zip(tasks, parts, strict=True) if task.step == step],
            evidence.generator("bootstrap", name, str(step)),
        )
        for name in MODELS
        for step in plan
    }
    rows = [_row(name, step, plan[step][0], flows[name, step]) for name in MODELS for step in plan]
    coarse = max(plan)
    summary = [f"{name} {flows[name, coarse].pooled:.0f} ({PUBLISHED[name][coarse]})" for name in MODELS]
    evidence.text(
        f"""Flow of twenty people through a door of {WIDTH} m, in people per minute at h = {coarse} s, in brackets as
        published: {", ".join(summary)}; the real exercise had {EXERCISE}."""
    )
    evidence.heading("Flow of the square room (Table 3, section 4.1)")
    evidence.text(
        f"""The paper leaves open where the door is, where people start, where they aim and how the regression is made,
        and all of it matters. The recipe here: the shipped case square_room (door in mid-wall, walls without thickness,
        directions and driving as shipped; out is whose centre crosses the door line); position sets and parameters
        drawn from seeds of their own, the same people for every model and step. Q is the slope of the regression of the
        number out, 1 to 20, on the exit times of all runs of a model together; its {100 * CONFIDENCE:.0f} % interval
        comes from {RESAMPLES} bootstrap resamples of position sets. Runs in which nobody leaves for more than
        {GAP:.0f} s are counted apart. Nothing is tuned to the published values."""
    )
    evidence.text(
        f"""Per second and metre of door that is {min(found.pooled for found in flows.values()) / (60.0 * WIDTH):.1f} to
        {max(found.pooled for found in flows.values()) / (60.0 * WIDTH):.1f} people. Weidmann's fundamental diagram
        (Transporttechnik der Fussgaenger, 1993) allows {WEIDMANN} at most: nobody here slows down before bodies touch,
        so these are flows of people who push, and no design values."""
    )
    evidence.text(_comparison(flows, sorted(plan, reverse=True)))
    evidence.table(
        "table3", rows, "Q [people per minute], fewer runs at finer steps as the table says.", {"h [s]": "g"}
    )
    _plot(evidence, flows, sorted(plan))


def _row(name: str, step: float, sets: int, found: Flow) -> dict[str, Any]:
    return {
        "model": name,
        "h [s]": step,
        "position sets": sets,
        "runs": found.runs,
        "counted apart": found.stopped,
        "Q pooled": found.pooled,
        "per metre [1/s/m]": found.pooled / (60.0 * WIDTH),
        "from": found.low,
        "to": found.high,
        "median Q of runs": found.median,
        "published": PUBLISHED[name][step],
        "Q - published": found.pooled - PUBLISHED[name][step],
    }


def _comparison(flows: Mapping[tuple[str, float], Flow], steps: list[float]) -> str:
    """Return what the flows say about the order of the models, the trend in h and the published values."""
    coarse, fine = steps[0], steps[-1]
    order = sorted(MODELS, key=lambda name: flows[name, coarse].pooled)
    inside = [
        f"{name} at h = {step:g} s"
        for (name, step), found in flows.items()
        if found.low <= PUBLISHED[name][step] <= found.high
    ]
    trend = [f"{flows[name, fine].pooled - flows[name, coarse].pooled:+.0f} ({name})" for name in MODELS]
    return (
        f"From least to greatest flow at h = {coarse:g} s: {', '.join(order)}. From h = {coarse:g} s to {fine:g} s, Q "
        f"changes by {', '.join(trend)}, of different numbers of runs (the table has them, and the intervals). The "
        "published value lies inside the interval for: "
        f"{', '.join(inside) or 'none'}."
    )


def _plot(evidence: Evidence, flows: Mapping[tuple[str, float], Flow], steps: list[float]) -> None:
    """Draw Q over h with intervals, and the published values."""
    figure, axis = new_figure(7.0, 4.2)
    for shift, name in enumerate(MODELS):
        place = [step * 1.08 ** (shift - 1.5) for step in steps]
        found = [flows[name, step] for step in steps]
        spread = [[one.pooled - one.low for one in found], [one.high - one.pooled for one in found]]
        colour = MODEL_COLOURS[name]
        axis.errorbar(place, [one.pooled for one in found], spread, fmt="o-", color=colour, capsize=3, label=name)
        if name != "NSM1 overdamped":
            published = [PUBLISHED[name][step] for step in steps]
            axis.plot(steps, published, "x--", color=colour, alpha=0.6, label=f"{name.split()[0]}, published")
    axis.axhline(EXERCISE, color="0.5", linewidth=0.8, label="exercise")
    axis.set(xscale="log", xlabel="step h [s]", ylabel="Q [people per minute]", ylim=(0.0, None))
    axis.legend(frameon=False, ncols=1, loc="center left", bbox_to_anchor=(1.0, 0.5))
    evidence.plot("table3", figure, "Flow over the step: computed with intervals (full), published (dashed).")
