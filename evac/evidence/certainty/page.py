"""Uncertainty of studies: coverage of intervals, required numbers of runs, and the benefit of common seeds."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from evac.base.arrays import FloatArray
from evac.case.loading import load_case
from evac.evidence.certainty.coverage import Drawn, covered
from evac.evidence.evidence import WORKERS, Evidence, Row, new_figure
from evac.evidence.verdicts import all_of, at_least, at_most, reported
from evac.simulation.shared import simulation_of
from evac.simulation.simulation import Simulation
from evac.study.api import repeat, sweep
from evac.study.statistics import CONFIDENCE, least_runs, share_interval
from evac.study.stopping import rule_of
from evac.study.study import Study

#: Case, runs that studies are drawn from, and studies of each kind: full and quick.
CASE = "square_room"
RUNS = {False: 4000, True: 120}
STUDIES = {False: 2000, True: 60}

#: A case in which runs are often blocked, and its runs.
BLOCKED = "classroom"
BLOCKED_RUNS = {False: 2000, True: 60}

#: Populations, with so many repetitions each.
POPULATIONS = {False: 400, True: 20}
REPETITIONS = 5

#: Every so manieth run is so many times longer in runs with rare long ones.
RARE, LONGER = 10, 1.8

#: Range of the required coverage of intervals [%].
LEAST_COVER, MOST_COVER = 93.0, 97.0

#: Studies with a fixed number of runs, by statistic; below `least_runs` a percentile has no interval.
FIXED: Mapping[str, Sequence[int]] = {
    "mean": (10, 20, 50, 100, 200),
    "percentile 50": (10, 20, 50, 100, 200),
    "percentile 95": (72, 80, 100, 150, 200),
}

#: The same for the other runs: with blocked ones, with rare long ones, and with repetitions (of populations).
FIXED_BLOCKED: Mapping[str, Sequence[int]] = {"mean": (10, 20, 50, 100), "percentile 50": (10, 20, 50, 100)}
FIXED_RARE: Mapping[str, Sequence[int]] = {"mean": (10, 20, 50), "percentile 50": (10, 20, 50)}
FIXED_POPULATIONS: Mapping[str, Sequence[int]] = {
    "mean": (10, 20, 80),
    "percentile 50": (10, 20, 80),
    "percentile 95": (10, 20, 80),
}

#: Studies that stop, by statistic: shares of it that are precise enough.
STOPPED: Mapping[str, Sequence[float]] = {
    "mean": (0.05, 0.03, 0.02),
    "percentile 50": (0.05, 0.03, 0.02),
    "percentile 95": (0.10, 0.05),
}

#: Other methods for comparison: statistic, runs or precision, method.
COMPARED: Sequence[tuple[str, int, float | None, str]] = (
    ("mean", 10, None, "Student's t"),
    ("mean", 10, None, "percentile bootstrap"),
    ("mean", 10, None, "BCa bootstrap"),
    ("mean", 50, None, "percentile bootstrap"),
    ("percentile 95", 10, None, "percentile bootstrap"),
    ("percentile 95", 50, None, "percentile bootstrap"),
    ("percentile 95", 100, None, "percentile bootstrap"),
    ("mean", 0, 0.10, "a look after every run from 3 on"),
    ("mean", 0, 0.05, "a look after every run from 3 on"),
    ("percentile 50", 0, 0.02, "a look after every run from 20 on"),
)

#: Changes of the case whose effect is measured, and the runs of each.
CHANGES: Sequence[Row] = (
    {"people.people.speed": {"uniform": [1.26, 2.1]}},
    {"people.people.number": 22},
    {"people.people.mass": {"uniform": [70.0, 110.0]}},
    {"simulation.step": 0.005},
    {"contact.model": "dem"},
)
PAIRS = {False: 400, True: 12}

#: A sweep of small runs, and a study of long ones.
SWEPT: Mapping[str, Sequence[Any]] = {
    "people.people.speed": [1.0, 1.1, 1.2, 1.3, 1.4, 1.5],
    "contact.model": ["nsm1", "nsm2"],
}
SWEPT_RUNS = {False: 20, True: 2}
SCHOOL_RUNS = {False: 50, True: 2}

#: Pairs of runs with the default step and with half of it, by shipped case; and the contact models.
STEP_PAIRS: Mapping[bool, Mapping[str, int]] = {
    False: {"square_room": 400, "classroom": 200, "primary_school": 60},
    True: {"square_room": 4},
}
STEP_MODELS = ("dem", "nsm1", "nsm2")

#: Formats of the tables of coverage.
FORMATS = dict.fromkeys(("no interval [%]", "covers [%]", "truth below [%]", "truth above [%]"), ".1f")
FORMATS |= dict.fromkeys(("runs, median", "runs, 5 %", "runs, 95 %", "until [%]"), ".0f") | {
    "half width, median [%]": ".2f"
}

COVERAGE, OTHER_RUNS, STEPS, QUESTIONS, SEEDS, WORK = (
    "What the intervals cover",
    "Blocked runs, rare long runs and repetitions",
    "What the time step changes",
    "How many runs a question needs",
    "What common seeds save",
    "Shared work",
)


def run(evidence: Evidence) -> None:
    """Measure and write the page."""
    times = _times(evidence, "times", CASE, RUNS[evidence.quick])
    report_coverage(evidence, times)
    report_other_runs(evidence, times)
    report_steps(evidence)
    report_questions(evidence, times)
    report_seeds(evidence)
    report_work(evidence)
    evidence.write_page(__name__, times=times)


def report_coverage(evidence: Evidence, times: FloatArray) -> None:
    """Add true coverage, for fixed numbers of runs and for stopped studies, and that of other intervals."""
    studies = STUDIES[evidence.quick]

    def drawn(**of: Any) -> Drawn:
        return Drawn(times=times, studies=studies, seed=evidence.seed, **of)

    fixed = [drawn(statistic=name, runs=runs) for name, counts in FIXED.items() for runs in counts]
    stopped = [drawn(statistic=name, until=until) for name, shares in STOPPED.items() for until in shares]
    others = [drawn(statistic=name, runs=runs, until=until, method=how) for name, runs, until, how in COMPARED]

    fixed_rows = evidence.measured("fixed", _covered, evidence, fixed)
    stopped_rows = evidence.measured("stopped", _covered, evidence, stopped)
    other_rows = evidence.measured("others", _covered, evidence, others)
    for what, rows in (("a fixed number of runs", fixed_rows), ("a precision", stopped_rows)):
        good = [LEAST_COVER <= row["covers [%]"] <= MOST_COVER for row in rows]
        question = f"Intervals of studies with {what} that cover in {LEAST_COVER:g} to {MOST_COVER:g} % of {studies}"
        evidence.verdict(all_of(question, sum(good), len(good), COVERAGE))
        least, greatest = (of(row["covers [%]"] for row in rows) for of in (min, max))
        evidence.verdict(at_least(f"Least coverage, {what}", least, LEAST_COVER, "%", COVERAGE))
        evidence.verdict(at_most(f"Greatest coverage, {what}", greatest, MOST_COVER, "%", COVERAGE))
    evidence.verdict(
        reported("Runs below which the 95th percentile has no 95 % interval", f"{least_runs(95.0)}", section=COVERAGE)
    )
    blocked = int(np.isinf(times).sum())
    interval = share_interval(blocked, len(times))
    tables = {"fixed": fixed_rows, "stopped": stopped_rows, "others": other_rows}
    evidence.show("coverage", __name__, times=times, studies=studies, blocked=blocked, interval=interval, **tables)


def report_other_runs(evidence: Evidence, times: FloatArray) -> None:
    """Add the coverage for runs that are less regular: blocked, with rare long ones, or of the same people."""
    studies = STUDIES[evidence.quick]
    blocked = _times(evidence, "times_blocked", BLOCKED, BLOCKED_RUNS[evidence.quick])
    repeated = _times(evidence, "times_repeated", CASE, REPETITIONS * POPULATIONS[evidence.quick], REPETITIONS)
    rare = np.where(np.arange(len(times)) % RARE == 0, LONGER * times, times)
    kinds: Mapping[str, tuple[FloatArray, Mapping[str, Sequence[int]]]] = {
        BLOCKED: (blocked, FIXED_BLOCKED),
        "rare long runs": (rare, FIXED_RARE),
        "populations": (repeated.reshape(-1, REPETITIONS), FIXED_POPULATIONS),
    }

    def measure() -> Iterator[Row]:
        for kind, (drawn_from, fixed) in kinds.items():
            tasks = [
                Drawn(times=drawn_from, statistic=name, studies=studies, seed=evidence.seed, runs=runs)
                for name, counts in fixed.items()
                for runs in counts
            ]
            yield from [{"runs of": kind, **row} for row in _covered(evidence, tasks)]

    rows = evidence.measured("other_runs", measure)
    complete = blocked[np.isfinite(blocked)]
    skewness = float(((complete - complete.mean()) ** 3).mean() / complete.std() ** 3)
    evidence.show(
        "other_runs", __name__, rows=rows, runs=blocked, complete=complete, repeated=repeated, skewness=skewness
    )
    required = [row for row in rows if row["statistic"] != "mean" and row["covers [%]"] is not None]
    good = [row["covers [%]"] >= LEAST_COVER for row in required]
    question = f"Intervals of percentiles of irregular runs that cover in at least {LEAST_COVER:g} % of {studies}"
    evidence.verdict(all_of(question, sum(good), len(good), OTHER_RUNS))
    for kind in (BLOCKED, "rare long runs"):
        shares = [row["covers [%]"] for row in rows if row["runs of"] == kind and row["statistic"] == "mean"]
        text = f"{min(shares):.1f} to {max(shares):.1f} %"
        evidence.verdict(reported(f"Coverage of the mean, {kind}", text, section=OTHER_RUNS))
    without = [row["no interval [%]"] for row in rows if row["statistic"] == "percentile 95" and row["runs"] < 72]
    question = "Studies of less than 72 populations without an interval of the 95th percentile"
    evidence.verdict(at_least(question, min(without), 100.0, "%", OTHER_RUNS))


def report_steps(evidence: Evidence) -> None:
    """Add what half the time step changes in the shipped cases, as `evac repeat --check-step` does."""
    rows = evidence.measured("steps", _steps, evidence)
    evidence.show("steps", __name__, rows=rows)
    for name in dict.fromkeys(row["case"] for row in rows):
        text = ", ".join(_change(row) for row in rows if row["case"] == name)
        evidence.verdict(reported(f"Change of the mean with half the step, {name}", text, section=STEPS))


def _change(row: Row) -> str:
    reach = "no interval" if row["from"] is None else f"{row['from']:+.1f} to {row['to']:+.1f} %"
    return f"{row['model']} {row['change [%]']:+.1f} % ({reach})"


def report_questions(evidence: Evidence, times: FloatArray) -> None:
    """Add the required numbers of runs, from the variance of all runs."""
    finite = times[np.isfinite(times)]
    variation = float(finite.std(ddof=1) / finite.mean())
    # a regular sample of 4000 runs, without interpolation between endless times
    regular = np.quantile(times, (np.arange(4000) + 0.5) / 4000, method="inverted_cdf")
    rows: list[Row] = []
    for name in STOPPED:
        for share in (0.10, 0.05, 0.02, 0.01):
            rule = rule_of(until=share, statistic=name)
            runs = rule.first
            width = rule.estimate(regular, range(len(regular))).relative_half_width
            needed = 4000 * (width / share) ** 2
            rows.append({"question": f"{name} to {100 * share:g} %", "runs": max(runs, round(needed))})
    evidence.show("questions", __name__, rows=rows, times=times, variation=variation)
    for row in rows:
        if row["question"].endswith(" 2 %"):
            evidence.verdict(reported(f"Runs for the {row['question']}", f"{row['runs']}", section=QUESTIONS))


def report_seeds(evidence: Evidence) -> None:
    """Add the runs saved by the same seeds at all points of a sweep when points are compared."""
    rows = evidence.measured("seeds", _pairs, evidence)
    evidence.show("seeds", __name__, rows=rows)
    best, worst = (f(rows, key=lambda row: row["runs saved by"]) for f in (max, min))
    text = f"{worst['runs saved by']:.2f} ({worst['change']}) to {best['runs saved by']:.2f} ({best['change']})"
    evidence.verdict(reported("Factor by which independent seeds need more runs than common ones", text, section=SEEDS))


def report_work(evidence: Evidence) -> None:
    """Add the share of a study's time that is spent in the loops of its runs."""
    rows = evidence.measured("work", _work, evidence)
    evidence.show("work", __name__, rows=rows)
    bounds = {"sweep": 1.5}
    for row in rows:
        if row["study"] in bounds and not evidence.quick:
            question = f"Time of a {row['study']} of {row['runs']} small runs over that of its loops"
            evidence.verdict(at_most(question, row["over the loops"], bounds[row["study"]], "", WORK))


def _times(evidence: Evidence, table: str, name: str, runs: int, repetitions: int = 1) -> FloatArray:
    """Return the evacuation times of many runs of a case, infinite where people are left; they are kept in a table."""

    def measure() -> Iterator[Row]:
        rows = evidence.study(load_case(name), runs, repetitions=repetitions).rows(columns=["seed", "last_out"])
        yield from ({"seed": row["seed"], "evacuation time [s]": row["last_out"]} for row in rows)

    times = [row["evacuation time [s]"] for row in evidence.measured(table, measure)]
    return np.array([np.inf if time is None else time for time in times])


def _steps(evidence: Evidence) -> Iterator[Row]:
    for name, pairs in STEP_PAIRS[evidence.quick].items():
        for model in STEP_MODELS:
            case = load_case(name, {"contact.model": model})
            study = evidence.study(case, pairs, check_step=True)
            change, mean = study.step_change, study.statistics[0].mean.value
            assert change is not None
            share = [100.0 * value / mean for value in (change.value, change.low, change.high)]
            yield {
                "case": name,
                "model": model,
                "step [s]": case.simulation.step,
                "pairs": change.runs,
                "left out": pairs - change.runs,
                "mean [s]": mean,
                "change [%]": share[0],
                "from": share[1] if change.has_interval else None,
                "to": share[2] if change.has_interval else None,
            }


def _covered(evidence: Evidence, tasks: Sequence[Drawn]) -> Iterator[Row]:
    for task, counts in zip(tasks, evidence.map(covered, [(task,) for task in tasks]), strict=True):
        until = None if task.until is None else 100.0 * task.until
        yield {
            "statistic": task.statistic,
            "runs": task.runs or None,
            "until [%]": until,
            "method": task.method,
            **counts,
        }


def _pairs(evidence: Evidence) -> Iterator[Row]:
    points: list[Row] = [{"simulation.duration": 300.0}, *CHANGES]
    runs = PAIRS[evidence.quick]
    study = sweep(load_case(CASE), points, runs, workers=1 if evidence.quick else WORKERS)
    before = study.times(0)
    for point in study.points[1:]:
        after = study.times(point.index)
        both = np.isfinite(before) & np.isfinite(after)
        one, other = before[both], after[both]
        difference = other - one
        error = float(difference.std(ddof=1)) / len(difference) ** 0.5
        yield {
            "change": point.label,
            "pairs": int(both.sum()),
            "difference [s]": float(difference.mean()),
            "half interval [s]": 1.96 * error,
            "correlation": float(np.corrcoef(one, other)[0, 1]),
            "runs saved by": float((one.var(ddof=1) + other.var(ddof=1)) / difference.var(ddof=1)),
        }


def _work(evidence: Evidence) -> Iterator[Row]:
    school, small = load_case("primary_school"), load_case(CASE)
    repeat(school, 1, workers=1)
    sweep(small, {"contact.model": SWEPT["contact.model"]}, 1, workers=1)
    studies: Mapping[str, Callable[[], Study]] = {
        "sweep": lambda: sweep(small, SWEPT, SWEPT_RUNS[evidence.quick], workers=1),
        "school": lambda: repeat(school, SCHOOL_RUNS[evidence.quick], workers=1),
    }
    for name, study_of in studies.items():
        start = time.process_time()
        study = study_of()
        whole = time.process_time() - start
        loops = sum(
            _loop(simulation_of(study.case_of(point.index, run), will_run=True))
            for point in study.points
            for run in range(study.runs_of(point.index))
        )
        runs = len(study.points) * study.runs_of(0)
        yield {"study": name, "runs": runs, "study [s]": whole, "loops [s]": loops, "over the loops": whole / loops}


def _loop(simulation: Simulation) -> float:
    start = time.process_time()
    while not simulation.ended:
        simulation.advance_tick()
    return time.process_time() - start


def _draw(fixed: Sequence[Row], stopped: Sequence[Row]) -> Any:
    figure, axis = new_figure(7.0, 4.0)
    axis.axhspan(LEAST_COVER, MOST_COVER, color="0.93")
    axis.axhline(100.0 * CONFIDENCE, color="0.6", linewidth=0.8)
    for name, colour in zip(FIXED, ("#0072B2", "#009E73", "#D55E00"), strict=True):
        of = [row for row in fixed if row["statistic"] == name]
        axis.plot([row["runs"] for row in of], [row["covers [%]"] for row in of], "o-", color=colour, label=name)
        of = [row for row in stopped if row["statistic"] == name]
        place = [row["runs, median"] for row in of]
        axis.plot(place, [row["covers [%]"] for row in of], "s", color=colour, markerfacecolor="none")
    axis.set(xscale="log", xlabel="runs (open squares: median of stopped studies)", ylabel="covers [%]")
    axis.legend(frameon=False)
    return figure
