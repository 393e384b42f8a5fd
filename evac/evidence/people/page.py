"""Every measured value of an experiment beside the results of each movement model and contact model in its scene."""

from collections.abc import Sequence
from itertools import pairwise

from evac.evidence.evidence import Evidence, Row
from evac.evidence.people import scenes
from evac.evidence.people.runs import DEFAULT, KEY, LEFT, NEVER_BLOCKED, TABLE, jobs, measure_runs
from evac.evidence.people.scenes import OF_DEFAULT
from evac.evidence.people.sensitivity import measure_sensitivity
from evac.evidence.people.values import SHARE_ON_AVERAGE, VALUES, Value, outcome
from evac.evidence.verdicts import MET, REPORTED, Finding, all_of, at_most, reported
from evac.study.statistics import share_interval

HELD, BLOCKED, SCENES, SENSITIVITY = "Held out", "Blocked runs", "The scenes", "What each parameter changes"


def run(evidence: Evidence) -> None:
    """Make the runs that are missing and write the page."""
    rows = evidence.measured(TABLE, measure_runs, evidence)
    asked = {job.key for job in jobs(evidence.quick, evidence.seed)}
    runs = [row for row in rows if tuple(str(row[key]) for key in KEY) in asked]
    subjects = list(dict.fromkeys((row["setting"], row["model"]) for row in runs))
    names = {row["scene"] for row in runs}
    values = [value for value in VALUES if names.issuperset(value.scenes)]
    outcomes = evidence.measured(
        "values",
        lambda: [
            outcome(value, *own, runs)
            for own in subjects
            for value in values
            if own[0] == DEFAULT or not OF_DEFAULT.keys() & value.scenes
        ],
    )
    for finding in verdicts(values, outcomes, runs):
        evidence.verdict(finding)
    evidence.show("scenes", __name__, outcomes=outcomes)
    for setting in dict.fromkeys(setting for setting, _ in subjects):
        _report_setting(evidence, setting, values, [row for row in outcomes if row["setting"] == setting])
    shares = [
        {"scene": scene} | {", ".join(own): _share(*blocked(scene, *own, runs)) for own in subjects}
        for scene in dict.fromkeys(row["scene"] for row in runs)
    ]
    evidence.show("blocked", __name__, shares=shares)
    if not evidence.quick:
        evidence.show("sensitivity", __name__, rows=evidence.measured("sensitivity", measure_sensitivity, evidence))
    evidence.write_page(__name__)


def heading(setting: str) -> str:
    """Return the heading of the section of a movement model."""
    return f"Movement model: {setting}"


def verdicts(values: Sequence[Value], outcomes: Sequence[Row], runs: Sequence[Row]) -> list[Finding]:
    """Return the verdicts on the default with the first contact model, and how many targets the others meet."""
    setting, model = outcomes[0]["setting"], outcomes[0]["model"]  # the default, unless it was not asked for
    own = {row["value"]: row for row in outcomes if (row["setting"], row["model"]) == (setting, model)}
    section = heading(setting)
    rows = []
    for question in dict.fromkeys(value.question for value in values if value.wanted):
        group = [value for value in values if value.question == question]
        rows.append(_judge(question, group[0].share, [own[value.name] for value in group], section))
    speeds = [abs(own[value.name]["deviation [%]"]) for value in values if value.weight and own[value.name]["mean"]]
    if speeds:
        question = "corridor, speeds by density: mean deviation"
        rows.append(at_most(question, sum(speeds) / len(speeds), 100.0 * SHARE_ON_AVERAGE, "%", section))
    last = [own[value.name]["mean"] for value in values if value.scenes[0].startswith(scenes.IMO_8)]
    if last:
        later = sum(None not in pair and pair[0] < pair[1] for pair in pairwise(last))
        rows.append(
            all_of(f"{scenes.IMO_8}: times increase with the number of oncoming people", later, len(last) - 1, section)
        )
    for scene in NEVER_BLOCKED:
        count, total = blocked(scene, setting, model, runs)
        if total:
            rows.append(all_of(f"{scene}: runs not blocked", total - count, total, BLOCKED))
    own_rows = [row for row in outcomes if row["setting"] == setting]
    rows.append(all_of("values that were not fitted: targets met", *_met(own_rows, True), HELD))
    for movement in dict.fromkeys(row["setting"] for row in outcomes):
        met, total = _met([row for row in outcomes if row["setting"] == movement])
        rows.append(
            reported(f"{movement}, all contact models: targets met", f"{met} of {total}", section=heading(movement))
        )
    return rows


def _judge(question: str, share: float | None, rows: Sequence[Row], section: str) -> Finding:
    """Return the verdict on values of one question; where runs block, on these, since means would flatter."""
    total, count = sum(row["runs"] for row in rows), sum(row["blocked"] for row in rows)
    if count:
        return all_of(f"{question}: runs not blocked", total - count, total, section)
    if share is None:
        return all_of(f"{question}: in the target", *_met(rows), section)
    deviations = [abs(row["deviation [%]"]) for row in rows if row["mean"] is not None]
    return at_most(f"{question}: greatest deviation", max(deviations, default=None), 100.0 * share, "%", section)


def _met(rows: Sequence[Row], held_out: bool = False) -> tuple[int, int]:
    judged = [row["verdict"] for row in rows if row["target"] and (row["held out"] == "yes" or not held_out)]
    return sum(verdict.startswith(MET) for verdict in judged), len(judged)


def blocked(scene: str, setting: str, model: str, runs: Sequence[Row]) -> tuple[int, int]:
    """Return how many runs of a scene are blocked, and how many there are."""
    left = [run[LEFT] for run in runs if tuple(run[key] for key in KEY[:3]) == (scene, setting, model)]
    return sum(count > 0 for count in left), len(left)


def _share(count: int, total: int) -> str:
    low, high = share_interval(count, total)
    return f"{count} of {total} ({100 * low:.0f} to {100 * high:.0f} %)"


def _report_setting(evidence: Evidence, setting: str, values: Sequence[Value], outcomes: Sequence[Row]) -> None:
    rows: list[Row] = []
    measured = {row["value"] for row in outcomes}
    for value in (one for one in values if one.name in measured):
        told = {"value": value.name, "measured": value.measured, "target": value.wanted or "-"}
        cells = {row["model"]: _cell(row) for row in outcomes if row["value"] == value.name}
        rows.append({**told, "held out": "yes" if value.is_held_out else "no", **cells})
    evidence.show("setting", __name__, rows=rows, setting=setting)


def _cell(row: Row) -> str:
    """Return a mean with everything without which it must not be read."""
    shares = f"{row['blocked']} of {row['runs']} blocked"
    if row["mean"] is None:
        return f"-; {shares}"
    interval = f" ({row['from']:.3g} to {row['to']:.3g})" if row["from"] is not None else ""
    deviation = f"; {row['deviation [%]']:+.0f} %" if row["deviation [%]"] is not None else ""
    verdict = "" if row["verdict"] == REPORTED else f"; {row['verdict']}"
    return f"{row['mean']:.3g}{interval}{deviation}; {shares}{verdict}"
