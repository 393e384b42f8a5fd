"""Options and tables shared by `evac repeat` and `evac sweep`."""

import argparse
import math
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from evac.base.display import Display
from evac.base.errors import counted, text_of
from evac.cli.inputs import positive
from evac.cli.screen import show_facts, show_table, show_warnings
from evac.cli.streams import note

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.study.points import Point
    from evac.study.statistics import Estimate
    from evac.study.study import Study, StudyProgress

TITLE = "Evacuation time: when the last person left"

#: Exit statuses of a study: runs failed, people are left.
BAD_INPUT, PEOPLE_LEFT = 2, 3

#: Maximum number of points whose statistics are shown; statistics.csv contains all.
MOST_SHOWN = 40

#: Maximum number of different notes on a statistic that are shown for a sweep.
MOST_NOTES = 3


def declare_study(parser: argparse.ArgumentParser) -> None:
    """Declare the options of a study."""

    def number(name: str, what: str) -> None:
        parser.add_argument(f"--{name}", type=positive, metavar="N", help=what)

    number("runs", "number of runs, in a sweep of each point (default: 20)")
    until = "run until half the width of the confidence interval is at most this share of the statistic, such as 2%%"
    parser.add_argument("--until", type=share, metavar="SHARE", help=until)
    statistic = 'with --until: the statistic, mean or a percentile such as "percentile 95" (default: mean)'
    parser.add_argument("--statistic", metavar="NAME", default="mean", help=statistic)
    number("least", "with --until: the smallest number of runs (default: 20, more for outer percentiles)")
    number("most", "with --until: the greatest number of runs (default: 1000)")
    number("repetitions", "number of runs of each population, with different start positions (default: 1)")
    imo = "100 populations with 5 repetitions each, as in IMO MSC.1/Circ.1533"
    parser.add_argument("--imo", action="store_true", help=imo)
    number("jobs", "number of processes (default: one for each core)")
    dask = "address or file of a Dask scheduler whose workers execute the runs"
    parser.add_argument("--dask", metavar="ADDRESS", help=dask)
    parser.add_argument("--resume", action="store_true", help="continue the study in the result folder")
    parser.add_argument("--out", type=Path, metavar="DIR", help="result folder")


def run_study(arguments: argparse.Namespace, points: "Sequence[Point]", folder: Path) -> int:
    """Run and show the study of some points; return 2 if runs failed, else 3 if people are left in any run, else 0."""
    from evac.base.errors import ScenarioError
    from evac.study.api import execute_study
    from evac.study.execute import dask_executor
    from evac.study.statistics import IMO_POPULATIONS, IMO_REPETITIONS
    from evac.study.stopping import rule_of

    if arguments.imo:
        if arguments.runs is not None or arguments.repetitions is not None:
            raise ScenarioError("--imo sets --runs and --repetitions; remove these or --imo")
        arguments.repetitions = IMO_REPETITIONS
        arguments.runs = None if arguments.until is not None else IMO_POPULATIONS * IMO_REPETITIONS
    arguments.repetitions = arguments.repetitions or 1
    numbers = {
        name: getattr(arguments, name) for name in ("runs", "until", "statistic", "least", "most", "repetitions")
    }
    rule = rule_of(**numbers)
    case = points[0].case
    prepare(case)
    of_each = f"points: {len(points)}, runs of each" if arguments.command == "sweep" else "runs"
    number = rule.first if rule.until is None else f"{rule.first} to {rule.most}"
    note(f"{of_each}: {number}, seeds from {case.simulation.seed} on")
    connected = nullcontext() if arguments.dask is None else dask_executor(arguments.dask)
    with connected as executor, Display() as display:
        display.phase("checking points and seeds")
        study = execute_study(
            points,
            **numbers,
            folder=arguments.out or folder,
            workers=arguments.jobs,
            executor=executor,
            resume=arguments.resume,
            progress=shown_progress(display),
            replay=arguments.replay,
        )
    return show_study(study)


def prepare(case: "Case") -> None:
    """Compile missing kernels, show warnings, and keep building and directions for the runs.

    If the first run is refused, the study tells why, after it has checked the others.
    """
    from evac.base.errors import EvacError
    from evac.simulation.shared import simulation_of

    warnings: tuple[str, ...] = ()
    with Display() as display, suppress(EvacError):
        display.phase("reading the building, computing directions")
        warnings = simulation_of(case, compiling=display.compiling).warnings()
    show_warnings(warnings)


def shown_progress(display: Display) -> "Callable[[StudyProgress], None]":
    """Return what shows the progress of a study, its first run that fails, and how many runs a resumed study has."""
    failed: list[str] = []

    def show(progress: "StudyProgress") -> None:
        if progress.row is None:
            if progress.done:
                note(f"resuming: {progress.done} of {progress.wanted} runs are done")
            return
        if (error := progress.row.error) is not None and not failed:
            failed.append(f"failed, while others go on: {text_of(error)}, {error.__notes__[-1]}")
            show_warnings(failed)
        display.runs(progress.done, progress.wanted)

    return show


def show_study(study: "Study") -> int:
    """Show the statistics; return 2 if runs failed, else 3 if people are left in any run, else 0."""
    from evac.study.outputs import parameter_keys, quality_of, remarks_of

    case = study.points[0].case
    people = {sum(group.count for group in point.case.people) for point in study.points}
    runs, blocked, failed = (
        sum(getattr(estimates, name) for estimates in study.statistics) for name in ("runs", "blocked", "failed")
    )
    facts: dict[str, object] = {"case": case.title}
    facts["people"] = f"{min(people)} to {max(people)}" if len(people) > 1 else min(people)
    facts["everybody out"] = f"in {runs - blocked} of {counted(runs, 'run')}"
    if failed:
        facts["failed"] = f"{counted(failed, 'more run')}, which are in no statistic"
    change = study.step_change
    if len(study.points) == 1 or change is not None:
        show_facts(facts | _settled_facts(study))
        show_table(TITLE, ("statistic", "value [s]", "95 % interval", "over"), _rows(study))
    else:
        varied = ", ".join(parameter_keys(study))
        show_facts(facts | {"points": f"{len(study.points)}: {varied}", "seeds": "the same at every point"})
        _show_points(study)
    if change is not None:
        _show_step(study, change)
    _show_rule(study)
    for line in remarks_of(study):
        note(f"evac: {line}")
    show_warnings(quality_of(study))
    show_facts({"results in": study.folder})
    return BAD_INPUT if failed else PEOPLE_LEFT if blocked else 0


def _rows(study: "Study") -> list[tuple[str, str, str, str]]:
    """Return the rows of the table of statistics of a study with one point."""
    from evac.study.statistics import told_time

    one = study.statistics[0]
    everywhere = counted(one.runs, "run")
    rows = [("minimum", told_time(one.least), "", everywhere)]
    rows += [_row(found, everywhere) for found in one.percentiles]
    rows.append(("maximum", told_time(one.greatest), "", everywhere))
    complete = counted(one.runs - one.blocked, "complete run") if one.blocked else everywhere
    rows.append(_row(one.mean, complete))
    rows.append(("standard deviation", told_time(one.standard_deviation), "", complete))
    names = [found.name for found in (one.mean, *one.percentiles)]
    if study.rule.until is not None and study.rule.statistic not in names:
        rows.append(_row(study.deciding(0), everywhere))
    if study.seeds.repetitions > 1:
        found = study.variation(0)
        rows.append(("higher than 95 % of times (IMO)", told_time(found.reported), "", everywhere))
        rows.append(("deviation between populations", told_time(found.between), "", complete))
        rows.append(("deviation within populations", told_time(found.within), "", complete))
    return rows


def _row(estimate: "Estimate", over: str) -> tuple[str, str, str, str]:
    return estimate.name, estimate.told, estimate.bounds(), _noted(over, estimate.note)


def _noted(over: str, note: str) -> str:
    return f"{over}; {note}" if note else over


def _show_step(study: "Study", change: "Estimate") -> None:
    """Show the effect of half the time step, and what follows from it."""
    from evac.study.statistics import told_time

    mean, half = (estimates.mean for estimates in study.statistics)
    step = study.points[1].parameters["simulation.step"]
    pairs = counted(change.runs, "pair") + " of runs with the same seed"
    rows = [_row(half, counted(half.runs, "complete run"))]
    value, bounds = told_time(change.value, "+.2f"), change.bounds("+.2f")
    rows.append(("change of the mean", value, bounds, _noted(pairs, change.note)))
    share = [100.0 * value / mean.value for value in (change.value, change.low, change.high)]
    percent = [f"{value:+.1f} %" for value in share]
    reach = f"{percent[1]} to {percent[2]}" if change.has_interval else "none"
    rows.append(("change in percent", percent[0] if change.runs else "-", reach, "of the mean"))
    show_table(f"With half the time step, {step:g} s", ("statistic", "value [s]", "95 % interval", "over"), rows)


def _show_points(study: "Study") -> None:
    from evac.study.outputs import points_table

    columns, rows = points_table(study)
    percentile = study.statistics[0].percentiles[-1].name
    heads = [key.rpartition(".")[2] for key in columns]  # the parameters are named in full above the table
    show_table(TITLE, heads, rows[:MOST_SHOWN])
    if len(study.points) > MOST_SHOWN:
        print(f"{len(study.points) - MOST_SHOWN} more points in statistics.csv")
    for name in ("mean", percentile):
        remarks = dict.fromkeys(row[name].note for row in study.statistics if row[name].note)
        for remark in list(remarks)[:MOST_NOTES]:
            note(f"evac: {name}: {remark}")


def _settled_facts(study: "Study") -> dict[str, object]:
    """Return the numbers of runs at which the measures of convergence settled."""
    from evac.study.outputs import curves
    from evac.study.statistics import convergence, settled

    settled_runs = settled(convergence(curves(study, 0)))
    at = [f"{name} after {counted(runs, 'run')}" for name, runs in settled_runs.items() if runs is not None]
    open_ = [name for name, runs in settled_runs.items() if runs is None]
    text = "; ".join([", ".join(at), f"not yet: {', '.join(open_)}" if open_ else ""]).strip("; ")
    return {"convergence (Ronchi et al.)": text}


def _show_rule(study: "Study") -> None:
    """Show the points at which a study with --until has reached the required interval."""
    for point in study.points if study.rule.until is not None else ():
        if study.rule.is_known(study.times(point.index), study.populations(point.index)):
            decision = study.deciding(point.index)
            where = f" at {point.label}" if len(study.points) > 1 else ""
            runs, half = counted(study.runs_of(point.index), "run"), 100 * decision.relative_half_width
            note(f"evac: interval of the {decision.name} narrow enough{where} after {runs}: half-width {half:.2g} %")


def share(text: str) -> float:
    """Parse a share: 0.02 or 2%."""
    try:
        value = 0.01 * float(text[:-1]) if text.endswith("%") else float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < 1.0:
        raise argparse.ArgumentTypeError("must be a share such as 2% or 0.02")
    return value
