"""Table 3 of the paper and the figures around it: flow of the square room, figures 2 and 3, classroom, school."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

from evac.case.schema import SimulationSettings
from evac.evidence.evidence import MODEL_COLOURS, Evidence, Row, new_figure
from evac.evidence.scenes import MODELS
from evac.evidence.square_room import Flow, change, flow, run_set, stopped
from evac.evidence.table3.classroom import report_classroom
from evac.evidence.table3.figures import draw_figure_2, draw_figure_3
from evac.evidence.table3.school import report_school
from evac.evidence.verdicts import reported, surely_at_most, within

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

#: Position sets and runs of each, by step [s]: the same crowds, fewer at other steps than the published coarser ones.
FULL_RUNS = {0.1: (20, 10), 5e-2: (20, 10), 2e-2: (20, 10), 1e-2: (20, 50), 1e-3: (20, 50), 1e-4: (20, 10)}
QUICK_RUNS = {1e-1: (2, 2), 1e-2: (4, 5), 1e-3: (4, 1), 1e-4: (2, 1)}

#: The default step is justified if the flow differs from that at the finest step by at most this [%].
DEFAULT = SimulationSettings().step
LITTLE = 5.0

#: Columns of changes of the flow.
CHANGES = ("change of Q pooled", "from", "to", "change of Q of runs", "of runs, from", "of runs, to")

SECTION = "Flow of the square room (Table 3, section 4.1)"


def run(evidence: Evidence) -> None:
    """Measure and write the page."""
    report_flow(evidence)
    draw_figure_2(evidence)
    draw_figure_3(evidence)
    report_classroom(evidence)
    report_school(evidence)
    evidence.write_page(__name__)


def report_flow(evidence: Evidence) -> None:
    """Add the flow through the door of the square room."""
    plan = QUICK_RUNS if evidence.quick else FULL_RUNS

    @cache
    def measured() -> tuple[FlowTable, FlowTable]:
        return _flows(evidence, plan)

    rows = evidence.measured("table3", lambda: [_row(*key, plan[key[1]][0], own) for key, own in measured()[0].items()])
    changes = evidence.measured("table3_steps", lambda: _change_rows(measured()[1]))
    _judge_flows(evidence, rows, changes)
    evidence.show("flow", __name__, rows=rows, changes=changes, draw=lambda: _draw(measured()[0], sorted(plan)))


def _judge_flows(evidence: Evidence, rows: Sequence[Row], changes: Sequence[Row]) -> None:
    for row in rows:
        if row["h [s]"] == DEFAULT:
            for kind, low, high in (("pooled", "from", "to"), ("of runs", "of runs, from", "of runs, to")):
                question = f"{row['model']}: flow Q {kind} at h = {DEFAULT:g} s [1/min]"
                bounds = row[low], row[high]
                evidence.verdict(within(question, row[f"Q {kind}"], *bounds, row["published"], section=SECTION))
    flow_of = {(row["model"], row["h [s]"]): row["Q of runs"] for row in rows}
    fine = min(row["h [s]"] for row in rows)
    for row in changes:
        if row["to h [s]"] == fine:
            share = 100.0 / flow_of[row["model"], fine]
            bias, half = -share * row["change of Q of runs"], 0.5 * share * (row["of runs, to"] - row["of runs, from"])
            question = f"{row['model']}: Q of runs at h = {DEFAULT:g} s over that at {fine:g} s"
            evidence.verdict(surely_at_most(question, bias, half, LITTLE, "%", SECTION))
    specific = [row["per metre [1/s/m]"] for row in rows]
    text = f"{min(specific):.1f} to {max(specific):.1f}"
    evidence.verdict(reported("Flow per metre of door, all models [1/s/m]", text, f"{WEIDMANN} (Weidmann)", SECTION))


def _flows(evidence: Evidence, plan: Mapping[float, tuple[int, int]]) -> tuple[FlowTable, FlowTable]:
    tasks = [(evidence.seed, k, runs, step) for step, (sets, runs) in plan.items() for k in range(sets)]
    parts = evidence.map(run_set, tasks)
    times = {
        (name, step): [part[name] for task, part in zip(tasks, parts, strict=True) if task[-1] == step]
        for name in MODELS
        for step in plan
    }
    times = {key: sets for key, sets in times.items() if not all(stopped(one).all() for one in sets)}
    flows = {
        (name, step): flow(sets, evidence.generator("bootstrap", name, str(step)))
        for (name, step), sets in times.items()
    }
    changes = {
        (name, step): change(times[name, DEFAULT], sets, evidence.generator("change", name, str(step)))
        for (name, step), sets in times.items()
        if step != DEFAULT
    }
    return flows, changes


def _row(name: str, step: float, sets: int, flow: Flow) -> Row:
    published = PUBLISHED[name].get(step)
    (pooled, low, high), mean = flow.pooled, flow.mean
    return {
        **{"model": name, "h [s]": step, "position sets": sets, "runs": flow.runs, "counted apart": flow.stopped},
        **{"Q pooled": pooled, "from": low, "to": high, "per metre [1/s/m]": pooled / (60.0 * WIDTH)},
        **{"Q of runs": mean.value, "of runs, from": mean.low, "of runs, to": mean.high, "published": published},
        "Q pooled - published": pooled - published if published else None,
        "Q of runs - published": mean.value - published if published else None,
    }


def _change_rows(changes: FlowTable) -> Iterator[Row]:
    for (name, step), own in changes.items():
        head = {"model": name, "from h [s]": DEFAULT, "to h [s]": step}
        head |= {"shared runs": own.runs, "counted apart": own.stopped}
        yield head | dict(zip(CHANGES, (*own.pooled, *own.mean), strict=True))


def _draw(flows: FlowTable, steps: list[float]) -> Any:
    figure, axis = new_figure(7.5, 4.2)
    handles: list[Any] = []
    for shift, name in enumerate(MODELS):
        here = [step for step in steps if (name, step) in flows]
        place = [step * 1.08 ** (shift - 1.5) for step in here]
        pooled = [flows[name, step].pooled for step in here]
        spread = [[own.value - own.low for own in pooled], [own.high - own.value for own in pooled]]
        colour = MODEL_COLOURS[name]
        handles.append(
            axis.errorbar(place, [own.value for own in pooled], spread, fmt="o-", color=colour, capsize=3, label=name)
        )
        runs = [flows[name, step].mean.value for step in here]
        axis.plot(place, runs, "o", color=colour, markerfacecolor="none")
        if name != "NSM1 overdamped":
            label = f"{name.split()[0]}, published"
            handles += axis.plot(
                *zip(*PUBLISHED[name].items(), strict=True), "x--", color=colour, alpha=0.6, label=label
            )
    handles += axis.plot([], [], "o", color="0.4", markerfacecolor="none", label="Q of runs")
    handles.append(axis.axhline(EXERCISE, color="0.5", linewidth=0.8, label="exercise"))
    axis.set(xscale="log", xlabel="step h [s]", ylabel="Q [people per minute]", ylim=(0.0, None))
    figure.legend(handles=handles, frameon=False, loc="outside right center")
    return figure
