"""Accuracy, part c: greatest overlap over run time for one crowd, to choose a model."""

import itertools
import math
import time
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from evac.base.errors import SimulationError
from evac.evidence.accuracy.problems import DoorCrowd, standing_crowd
from evac.evidence.accuracy.trajectories import colour_of
from evac.evidence.evidence import Evidence, Row, new_figure
from evac.evidence.scenes import plugins
from evac.evidence.verdicts import reported
from evac.physics.contact.model import ContactModel

#: Time for which the crowd walks against the closed door, and then leaves through it [s].
CLOSED, OPEN = 3.0, 2.0

#: DEM's step is this share of the limit of a dense packing, h^2 6k/m = 4.
SHARE = 0.5

TICK = 0.1  # s

FINISHED = "run to the end"

SPAN = "time per simulated second [s]"

#: Overlaps that users may tolerate [mm].
ALLOWED = (100.0, 30.0, 10.0, 3.0, 1.0, 0.1, 0.01)

#: How the names of settings, and of series that share a colour, are drawn: offset and side; fill and line.
LABELS = {
    "NSM1 inertial": ((-8, -6), "right"),
    "NSM1 inertial as shipped": ((9, 0), "left"),
    "NSM2, K_N = 1e5": ((-6, -6), "right"),
    "NSM2, K_N = 0": ((-3, -9), "right"),
}
STYLES = {"NSM1 inertial as shipped": ("white", "*"), "NSM2, K_N = 0": ("white", "s--")}


class Setting(NamedTuple):
    """A model, what is varied, and the step."""

    label: str
    model: ContactModel
    knob: str
    value: float
    step: float


SECTION = "c. Greatest overlap against run time: which model to take"


def run(evidence: Evidence) -> None:
    """Add part c to the page."""
    people = 60 if evidence.quick else 300
    rows = evidence.measured("overlap", _rows, people, evidence.seed, evidence.quick)
    table = list(cheapest_rows(rows))
    texts = []
    for model, group in itertools.groupby(table, key=lambda row: row["cheapest here"]):
        texts.append(f"{model or 'none'}: {', '.join(row['overlap allowed [mm]'] for row in group)} mm")
    evidence.verdict(reported("Cheapest contact model by permitted overlap", "; ".join(texts), "-", SECTION))
    evidence.show("overlap", __name__, people=people, rows=rows, cheapest=table)


def _rows(people: int, seed: int, is_quick: bool) -> list[Row]:
    start = standing_crowd("settled", people, seed)
    return [measure(setting, start) for setting in settings(float(start.crowd.mass.min()), is_quick)]


def settings(lightest: float, is_quick: bool) -> list[Setting]:
    """Return the models with what is varied."""
    dem, nsm1, nsm2 = (plugins().get("contact_model", name) for name in ("dem", "nsm1", "nsm2"))
    chosen = []
    for stiffness in (1.2e5, 1.2e6, 1.2e7) if is_quick else (1.2e4, 1.2e5, 1.2e6, 1.2e7, 1.2e8, 1.2e9):
        step = TICK / math.ceil(TICK / (SHARE * 2.0 / math.sqrt(6.0 * stiffness / lightest)))
        chosen.append(Setting("DEM", dem(stiffness=stiffness), "k [kg/s2]", stiffness, step))
    for tolerance in (1e-3, 1e-5) if is_quick else (1e-2, 1e-3, 1e-4, 1e-5, 1e-6):
        model = nsm1(gap_tolerance=tolerance, velocity_tolerance=tolerance / 0.01, iterations=20_000)
        chosen.append(Setting("NSM1 inertial", model, "gap tolerance [m]", tolerance, 0.01))
    shipped = nsm1()
    tolerance = shipped.values()["gap_tolerance"]
    chosen.append(Setting("NSM1 inertial as shipped", shipped, "gap tolerance [m]", tolerance, 0.01))
    for label, dissipation in (("NSM2, K_N = 1e5", 1e5), ("NSM2, K_N = 0", 0.0)):
        for step in (0.01, 0.002) if is_quick else (0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005):
            chosen.append(Setting(label, nsm2(normal_dissipation=dissipation), "h [s]", step, step))
    return chosen


def measure(setting: Setting, start: DoorCrowd) -> Row:
    """Run a setting from the same start; return its row."""
    crowd = start.copy()
    per_tick = round(TICK / setting.step)
    crowd.engine.load(setting.model)
    begin = time.process_time()
    outcome = FINISHED
    for tick in range(round((CLOSED + OPEN) / TICK)):
        if tick == round(CLOSED / TICK):
            crowd.open_door(True)
        try:
            crowd.walk(setting.model, per_tick, setting.step)
        except SimulationError as error:
            outcome = f"stopped: {error}"
            break
    walked = max(crowd.step, 1) * setting.step
    span = time.process_time() - begin
    report = crowd.engine.report()
    return {
        "model": setting.label,
        "varied": setting.knob,
        "value": setting.value,
        "h [s]": setting.step,
        "greatest overlap [mm]": 1e3 * max(report["greatest_overlap"], 0.0),
        SPAN: span / walked,
        "out": int(np.sum(crowd.crowd.level < 0)),
        "unconverged steps": int(report["unconverged_steps"]),
        "outcome": outcome,
    }


def draw(rows: Sequence[Row], people: int) -> Any:
    """Draw the chart: runs to the end joined by series, stopped ones apart."""
    figure, axis = new_figure(8.5, 5.4)
    for model in dict.fromkeys(row["model"] for row in rows):
        series = [row for row in rows if row["model"] == model]
        colour = colour_of(model)
        line, stopped = ([row for row in series if (row["outcome"] == FINISHED) is ends] for ends in (True, False))
        fill, style = STYLES.get(model, (colour, "o-"))
        label = f"{model}: {series[0]['varied']}"
        axis.loglog(*_places(line), style, color=colour, markerfacecolor=fill, markersize=7, label=label)
        if stopped:
            axis.loglog(*_places(stopped), "x", color=colour, markersize=9, label=f"{model}: stopped with an error")
        offset, side = LABELS.get(model, ((5, 5), "left"))
        for row, x, y in zip(series, *_places(series), strict=True):
            axis.annotate(
                f"{row['value']:.3g}", (x, y), textcoords="offset points", xytext=offset, ha=side, va="center",
                fontsize=7, color=colour,
            )  # fmt: skip
    axis.margins(x=0.12, y=0.08)
    axis.set(xlabel="CPU time of one simulated second [s]", ylabel="greatest overlap [mm]")
    axis.set_title(f"{people} people at a door, closed and then open", fontsize=10)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    return figure


def _places(rows: Sequence[Row]) -> tuple[list[float], list[float]]:
    return [row[SPAN] for row in rows], [row["greatest overlap [mm]"] for row in rows]


def cheapest_rows(rows: Sequence[Row]) -> Iterator[Row]:
    """Return the cheapest setting for each tolerated overlap, and the ratio of each model's least time to its time."""
    models = list(dict.fromkeys(row["model"] for row in rows))
    for allowed in ALLOWED:
        good = [row for row in rows if row["greatest overlap [mm]"] <= allowed and row["outcome"] == FINISHED]
        good.sort(key=lambda row: row[SPAN])
        least = {row["model"]: row[SPAN] / good[0][SPAN] for row in reversed(good)}
        yield {
            "overlap allowed [mm]": f"{allowed:g}",
            "cheapest here": good[0]["model"] if good else None,
            "setting": "{varied} = {value:.3g}".format(**good[0]) if good else None,
            SPAN: good[0][SPAN] if good else None,
            **{f"{model} / cheapest": least.get(model) for model in models},
        }
