"""Validation: the standard tests of the field for every contact model without and with headway.

Each test covers the whole process from a mesh file to the table of people.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from evac.evidence.report import MODEL_COLOURS, Evidence, new_figure
from evac.evidence.validation import capacity, choices, flows, kinematics
from evac.evidence.validation.trial import Check, Criterion, Trial
from evac.evidence.verdicts import all_of, at_least, at_most, reported
from evac.study.statistics import CONFIDENCE

Row = Mapping[str, Any]

#: The tested models, NSM1 with its defaults, without and with headway.
SUBJECTS = tuple(Trial(model, (), headway) for headway in (False, True) for model in ("DEM", "NSM1 inertial", "NSM2"))
QUICK_SUBJECTS = tuple(Trial("NSM2", (), headway) for headway in (False, True))

#: The tests in the order of the page, and how many runs each makes: one where nothing is drawn.
TESTS: Mapping[Callable[[Trial], list[Check]], int] = {
    kinematics.corridor: 1,
    kinematics.stairs: 1,
    flows.fundamental_diagram: 3,
    kinematics.response: 5,
    kinematics.round_a_corner: 5,
    kinematics.speeds_by_age: 1,
    choices.faster_people: 3,
    choices.four_and_two_doors: 3,
    choices.assigned_exits: 3,
    choices.nearer_exit: 3,
    choices.rooms_in_a_row: 5,
    flows.wider_bottlenecks: 5,
    flows.foot_of_a_stair: 3,
    choices.route: 1,
    choices.corner_of_a_crowd: 3,
    flows.counterflow: 3,
    kinematics.response_distributions: 1,
    choices.group: 1,
}
QUICK_TESTS: Mapping[Callable[[Trial], list[Check]], int] = {
    kinematics.corridor: 1,
    kinematics.stairs: 1,
    kinematics.round_a_corner: 2,
    choices.route: 1,
}

STAIR_RUNS, DOOR_RUNS = 5, 10
QUICK_RUNS = 2
QUICK_STAIRS = capacity.STAIR_WIDTHS[:2]
QUICK_DOORS = (capacity.IMO_DOOR,)

#: The documents of the tests, and the sources in which they were read, since not all originals were available.
SOURCES = (
    {
        "name": "RiMEA",
        "what": "RiMEA guideline, annex 1, versions 3.0 and 4.1.1 (2025)",
        "read in": "drawings of 3.0 in jpscore's system tests; 4.1.1 as others read it",
    },
    {
        "name": "IMO",
        "what": "IMO MSC.1/Circ.1238 (2007), annexes 1 and 3; test 12 of MSC.1/Circ.1533 is left out",
        "read in": "guide of FDS+Evac and community documents, not the original",
    },
    {
        "name": "NIST TN 1822",
        "what": "Ronchi et al., The process of verification and validation of building fire evacuation models (2013)",
        "read in": "a port by the community, whose dimensions may be its own",
    },
    {
        "name": "ISO 20414",
        "what": "ISO 20414:2020, fire evacuation models: verification and validation",
        "read in": "community documents, whose dimensions may be their own",
    },
    {
        "name": "SFPE",
        "what": "hydraulic model of Nelson and Mowrer, SFPE Handbook: greatest flow on stairs by their treads",
        "read in": "community documents; one row of the table confirmed",
    },
    {
        "name": "Weidmann",
        "what": "Weidmann, Transporttechnik der Fussgänger (1993), fundamental diagram",
        "read in": "the formula as published",
    },
    {
        "name": "laboratory",
        "what": "bottlenecks: Seyfried et al. (2009), Kretz et al. (2006), Müller (1981), Nagai et al. (2006), Daamen"
        " and Hoogendoorn (2010), Düsseldorf (2006)",
        "read in": "data files of jpscore's validation tests",
    },
    {
        "name": "headway",
        "what": "Tordeux, Chraibi and Seyfried, Collision-free speed model for pedestrian dynamics (2016)",
        "read in": "the model and its parameters as others quote them, and as JuPedSim ships it",
    },
)


@dataclass(frozen=True)
class Job:
    """A task of one process: a call with a trial."""

    call: Callable[[Trial], Any]
    runs: int
    subject: Trial
    seed: int

    @property
    def trial(self) -> Trial:
        """The trial of the job."""
        return replace(self.subject, seeds=tuple(range(self.seed, self.seed + self.runs)))


def carry_out(job: Job) -> Any:
    """Execute a job."""
    return job.call(job.trial)


@dataclass(frozen=True)
class Surveyed:
    """All checks, and the stairs and doors that some of them were made of."""

    checks: Sequence[Check]
    stairs: Sequence[capacity.Stair]
    doors: Sequence[capacity.Door]


#: Headings of the page.
RELY, STAIRS, DOORS = "What to rely on", "Flow and speed on stairs", "Doors that block for good"


def run(evidence: Evidence) -> None:
    """Run every test with every model and write the page."""

    @cache
    def surveyed() -> Surveyed:
        return survey(evidence)

    tests = evidence.measured("tests", lambda: [check_row(check) for check in _in_order(surveyed().checks)])
    verdicts = evidence.measured("verdicts", lambda: verdict_rows(surveyed().checks))
    stairs = evidence.measured("stairs", lambda: [capacity.stair_row(stair) for stair in surveyed().stairs])
    doors = evidence.measured("doors", lambda: [capacity.door_row(door) for door in surveyed().doors])
    _judge(evidence, tests, stairs, doors)
    _report_tests(evidence, tests, verdicts, lambda: draw(surveyed().checks))
    _report_stairs(evidence, stairs)
    _report_doors(evidence, doors)
    evidence.heading("Where the tests come from")
    evidence.table("sources", SOURCES, "Names in the tables, and what was read.")
    evidence.write_page(
        "Validation: the standard tests of the field",
        "Examined: every contact model, without and with headway, in the standard tests of RiMEA, IMO, NIST and ISO;"
        " nothing is tuned to pass a test.",
    )


def survey(evidence: Evidence) -> Surveyed:
    """Run all tests, and the stairs and doors of every width, with every subject."""
    quick = evidence.quick
    tests, subjects = (QUICK_TESTS, QUICK_SUBJECTS) if quick else (TESTS, SUBJECTS)

    def made(calls: Iterable[tuple[Callable[[Trial], Any], int]]) -> list[Any]:
        return evidence.map(carry_out, [Job(*call, subject, evidence.seed) for call in calls for subject in subjects])

    checks = [check for found in made(tests.items()) for check in found]
    widths, runs = (QUICK_STAIRS, QUICK_RUNS) if quick else (capacity.STAIR_WIDTHS, STAIR_RUNS)
    stairs = made((partial(capacity.run_stair, width=one, way=way), runs) for way in capacity.WAYS for one in widths)
    openings, runs = (QUICK_DOORS, QUICK_RUNS) if quick else (capacity.DOOR_WIDTHS, DOOR_RUNS)
    doors = made((partial(capacity.run_door, width=one), runs) for one in openings)
    for subject in subjects:
        checks += capacity.stair_checks([stair for stair in stairs if stair.trial.name == subject.name])
    return Surveyed(checks + capacity.door_checks(doors), stairs, doors)


def check_row(check: Check) -> dict[str, Any]:
    """Return the row of a check on the page."""
    low, high = check.interval or (None, None)
    return {
        "test": check.criterion.test,
        "measured": check.criterion.quantity,
        "expected": check.criterion.band,
        "by": check.criterion.source,
        "model": check.model,
        "found": check.mean,
        "from": low,
        "to": high,
        "runs": len(check.values),
        "blocked": check.blocked,
        "passed": "yes" if check.is_passed else "NO",
    }


def verdict_rows(checks: Sequence[Check]) -> list[dict[str, Any]]:
    """Return a row for each criterion, with the verdict on each model."""
    rows: dict[Criterion, dict[str, Any]] = {}
    for check in checks:
        asked = check.criterion
        row = rows.setdefault(
            asked, {"test": asked.test, "measured": asked.quantity, "expected": asked.band, "by": asked.source}
        )
        row[check.model] = check.verdict
    return list(rows.values())


def _in_order(checks: Sequence[Check]) -> list[Check]:
    """Return the checks of each criterion together."""
    criteria = list(dict.fromkeys(check.criterion for check in checks))
    return sorted(checks, key=lambda check: criteria.index(check.criterion))


def failed_tests(rows: Sequence[Row]) -> dict[str, list[str]]:
    """Return the tests that each model fails: a test is passed if all its checks are."""
    failed: dict[str, list[str]] = {row["model"]: [] for row in rows}
    for row in rows:
        if row["passed"] != "yes" and row["test"] not in failed[row["model"]]:
            failed[row["model"]].append(row["test"])
    return failed


def _judge(evidence: Evidence, tests: Sequence[Row], stairs: Sequence[Row], doors: Sequence[Row]) -> None:
    """Add the verdicts: tests passed by each model and by none, flows on stairs, flows through doors."""
    total = len({row["test"] for row in tests})
    failed = failed_tests(tests)
    for model, names in failed.items():
        evidence.verdict(all_of(f"Tests passed by {model}", total - len(names), total, RELY))
    by_none = set.intersection(*map(set, failed.values()))
    evidence.verdict(all_of("Tests passed by any model", total - len(by_none), total, RELY))
    evidence.verdict(reported("Failed by all models", "; ".join(sorted(by_none)) or "none", "none", RELY))
    for words, headway in (("without", False), ("with", True)):
        models = {model for model in failed if model.endswith("headway") == headway}
        some = sorted({name for model in models for name in failed[model]} - by_none)
        told = "; ".join(some) or "none"
        evidence.verdict(reported(f"Failed by some {words} headway, besides", told, "none", RELY))
        flow = max(row["flow per metre [1/s/m]"] for row in stairs if row["model"] in models)
        question = f"Greatest flow on stairs {words} headway [1/s/m]"
        evidence.verdict(at_most(question, flow, flows.STAIR_FLOW[1], section=STAIRS))
        runs, blocked = (sum(row[key] for row in doors if row["model"] in models) for key in ("runs", "blocked"))
        evidence.verdict(all_of(f"Runs at doors {words} headway that do not block", runs - blocked, runs, DOORS))
    _judge_doors(evidence, [row for row in doors if row["model"].endswith("headway") and row["flow [1/s]"]])


def _judge_doors(evidence: Evidence, doors: Sequence[Row]) -> None:
    """Add the verdicts on flows through doors with headway: against laboratories, and with the exit at the door."""
    for question, bound, judge, extreme in (
        ("Flow through doors with headway over the least in laboratories, least [-]", 0, at_least, min),
        ("Flow through doors with headway over the greatest in laboratories, greatest [-]", 1, at_most, max),
    ):
        known = [(row["flow [1/s]"], capacity.LABORATORY.get(row["width [m]"])) for row in doors]
        evidence.verdict(judge(question, extreme(flow / lab[bound] for flow, lab in known if lab), 1.0, section=DOORS))
    question = "Flow with the exit at the door against ground behind it, with headway, greatest difference [-]"
    differences = [abs(row[capacity.AT_EXIT] - 1.0) for row in doors if row[capacity.AT_EXIT]]
    evidence.verdict(at_most(question, max(differences), capacity.SAME_FLOW, section=DOORS))


def _report_tests(evidence: Evidence, tests: Sequence[Row], verdicts: Sequence[Row], figure: Callable[[], Any]) -> None:
    """Add the verdicts, the plot and the table of all checks."""
    evidence.heading(RELY)
    evidence.text(
        """Every building is written to a mesh file, loaded with a case.toml, run into a result folder, and judged
        by what that folder holds. People have the defaults of case.toml, except where one person is timed by hand,
        and the speeds of the test or those of men of 30 to 50 years (IMO). Without headway people walk at full
        speed until bodies touch, as in the paper; with it they turn from others and slow down behind them, with
        published parameters (docs/physics.md)."""
    )
    evidence.text(
        """A check is passed if the mean over runs with different seeds lies in what is expected and no run is
        blocked: a run that ends with people inside, nobody having moved on for a minute."""
    )
    evidence.table(
        "verdicts",
        verdicts,
        f"Whether each model passes, and by how much it misses. Not certain: the {100 * CONFIDENCE:.0f} % interval of "
        "the mean, as that of a study, reaches across a bound, or the runs determine none.",
    )
    evidence.data("tests", tests, "Every check with its mean and interval")
    evidence.plot(
        "validation",
        figure,
        "Found over the middle of the expected band (grey), or over its one bound, with intervals; crosses: runs are "
        "blocked, of all runs where one stands at the right edge. What lies beyond an edge stands at it.",
    )


def _report_stairs(evidence: Evidence, rows: Sequence[Row]) -> None:
    evidence.heading(STAIRS)
    evidence.text(
        """A hundred people in a hall, a landing, a flight of 4.24 m along its slope, a landing, a hall (ISO 20414,
        test 12). Flow is counted where people come onto the flight, between the first and the last fifth of them.
        Beside it are the speeds on the flight meanwhile over the own stair speed, along the slope: more than 1 for
        whoever is pushed from behind."""
    )
    evidence.table("stairs", rows, f"Stairs; intervals of {100 * CONFIDENCE:.0f} %.", {"width [m]": "g", "runs": "d"})


def _report_doors(evidence: Evidence, rows: Sequence[Row]) -> None:
    evidence.heading(DOORS)
    evidence.text(
        f"""A hundred people in a room of 8 x 5 m with one door in the middle of the short wall (IMO 4), and
        {capacity.GROUND:g} m of ground behind the wall, as wide as the room. Flows are of the runs that do not block,
        from the first to the last person; IMO allows {capacity.IMO_FLOW} /s through {capacity.IMO_DOOR:g} m. Beside
        them are the flows with the exit right at the door instead of the ground behind it, and the least and the
        greatest flow that laboratories measured at each width, without hurry."""
    )
    evidence.table("doors", rows, "Doors.", {"width [m]": "g", "runs": "d", "blocked": "d", "share blocked": ".2f"})


def draw(checks: Sequence[Check]) -> Any:
    """Draw found over expected, a line for each criterion with a mark for each model."""
    criteria = list(dict.fromkeys(check.criterion for check in checks))
    models = list(dict.fromkeys(check.model for check in checks))
    edges = (0.2, 8.0)
    figure, axis = new_figure(10.0, 0.27 * len(criteria) + 1.2)
    for place, criterion in enumerate(criteria):
        low, high = (
            np.clip(bound / criterion.reference, *edges) if criterion.reference else 1.0
            for bound in (criterion.low, criterion.high)
        )
        axis.barh(place, high - low, left=low, height=0.8, color="0.88")
        axis.plot([1.0, 1.0], [place - 0.4, place + 0.4], color="0.6", linewidth=1.0)
    for number, model in enumerate(models):
        shift = 0.13 * (number - 0.5 * (len(models) - 1))
        for check in (check for check in checks if check.model == model):
            _mark(axis, check, criteria.index(check.criterion) + shift, edges)
        axis.plot([], [], "o", **_style(model), label=model)
    axis.set_yticks(range(len(criteria)), [_label(criterion) for criterion in criteria], fontsize=7)
    axis.set(xscale="log", xlim=edges, ylim=(len(criteria) - 0.5, -0.5), xlabel="found over expected")
    axis.minorticks_off()
    axis.set_xticks([0.2, 0.5, 1.0, 2.0, 5.0], ["0.2", "0.5", "1", "2", "5"])
    axis.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure


def _mark(axis: Any, check: Check, place: float, edges: tuple[float, float]) -> None:
    """Draw one check: a dot with its interval, a cross where runs are blocked."""
    style = _style(check.model)
    if check.mean is None:
        axis.plot(edges[1], place, "x", **style, markersize=5, clip_on=False)
        return
    value = _relative(check, check.mean)
    low, high = (_relative(check, end) for end in check.interval or (check.mean, check.mean))
    mark = "x" if check.blocked else "o"
    axis.plot(np.clip([low, high], *edges), [place, place], "-", color=style["color"], linewidth=1.0)
    axis.plot(np.clip(value, *edges), place, mark, **style, markersize=4, clip_on=False)


def _style(name: str) -> dict[str, str]:
    """Return colour and filling of the marks of one subject: hollow with headway."""
    subject = next(subject for subject in SUBJECTS if subject.name == name)
    return {"color": MODEL_COLOURS[subject.model], "markerfacecolor": "white" if subject.headway else "auto"}


def _relative(check: Check, value: float) -> float:
    """Return a value over the middle of the band; where that is zero, 1 for zero and infinite for more."""
    if check.criterion.reference:
        return value / check.criterion.reference
    return 1.0 if value == 0.0 else float("inf")


def _label(criterion: Criterion) -> str:
    words = f"{criterion.test}: {criterion.quantity}"
    return words if len(words) <= 90 else words[:87] + "..."
