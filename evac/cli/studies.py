"""Commands that run studies: evac repeat, evac sweep."""

import argparse
import math
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.base.display import Display
from evac.base.errors import EvacError, ScenarioError, counted, text_of
from evac.cli import inputs
from evac.cli.main import BAD_INPUT
from evac.cli.screen import STYLES, note, say, show_facts, show_table, show_warnings

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.study.points import Point
    from evac.study.statistics import Estimate
    from evac.study.study import Study, StudyProgress

TITLE = "Evacuation time: when the last person left"

PEOPLE_LEFT = 3  #: Exit status if people are left in a run.
MOST_SHOWN = 40  #: Maximum number of points whose statistics are shown; statistics.csv contains all.
MOST_NOTES = 3  #: Maximum number of different notes on a statistic that are shown for a sweep.


def declare_repeat(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac repeat`."""
    inputs.declare_case(parser)
    _declare_study(parser)
    step = "make all runs with half the time step as well, and show the difference"
    parser.add_argument("--check-step", action="store_true", help=step)
    replay = "repeat the median and the worst run, and write replay-median.html and replay-worst.html"
    parser.add_argument("--replay", action="store_true", help=replay)


def execute_repeat(arguments: argparse.Namespace) -> int:
    """Run a case with many seeds and compute statistics with confidence intervals.

    Results are written to ./CASE-runs, or to --out. Each run is saved as soon as it has ended, and --resume continues a
    study that was killed. At the end, runs.arrows and runs.csv contain a row for each run, statistics.csv and
    summary.json the statistics, and egress.csv and egress.png the mean and percentiles of the egress curves. `evac run
    CASE --seed N` repeats one of the runs.
    """
    from evac.study.points import halved_steps, single

    case = inputs.case_to_run(arguments)
    points = halved_steps(case) if arguments.check_step else single(case)
    return run_study(arguments, points, inputs.default_folder(case, "runs"))


def declare_sweep(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac sweep`."""
    case = "a case.toml, a folder that contains one, or a shipped case; not needed if the table names cases"
    parser.add_argument("case", metavar="CASE", nargs="?", help=case)
    inputs.declare_set(
        parser, "values of keys, such as people.people.number=100,200,300 simulation.step=0.005,0.01", "KEY=VALUES"
    )
    table = "one point per row: CSV with dotted keys as header; `case` names a case"
    parser.add_argument("--table", type=Path, metavar="FILE", help=table)
    parser.add_argument("--seed", type=int, metavar="N", help="seed of the first run of each point (simulation.seed)")
    inputs.declare_plugin(parser)
    _declare_study(parser)
    parser.set_defaults(replay=False)


def execute_sweep(arguments: argparse.Namespace) -> int:
    """Run a case with many seeds for each combination of parameters, or for each row of a table.

    --set KEY=VALUE,VALUE,... varies a key; a single value sets it for all points. All points use the same seeds, so
    that they differ only in their parameters. The files of `evac repeat`, for each point, and statistics.png are
    written to ./CASE-sweep, or to --out.
    """
    from evac.study.points import from_rows, grid

    parameters, fixed = swept(arguments.set)
    if arguments.seed is not None:
        fixed.append(f"simulation.seed={arguments.seed}")
    case = _case_of_sweep(arguments, fixed)
    if arguments.table is not None:
        rows, place = _rows_of_table(arguments, parameters, fixed), arguments.table.parent
        points = from_rows(case, rows, place, run_files=partial(_with_files_beside, place))
    else:
        assert case is not None
        points = grid(case, parameters)
    return run_study(arguments, points, inputs.default_folder(case or points[0].case, "sweep"))


def _declare_study(parser: argparse.ArgumentParser) -> None:
    """Declare the options of a study."""

    def number(name: str, what: str) -> None:
        parser.add_argument(f"--{name}", type=inputs.positive, metavar="N", help=what)

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
    maps = "make the maps and find the congestion of each run, for maps over runs in reports and comparisons"
    parser.add_argument("--maps", action="store_true", help=maps)
    parser.add_argument("--out", type=Path, metavar="DIR", help="result folder")


def run_study(arguments: argparse.Namespace, points: "Sequence[Point]", folder: Path) -> int:
    """Run and show the study of some points; return 2 if runs failed, else 3 if people are left in any run, else 0."""
    from evac.study.api import execute_study
    from evac.study.execute import dask_executor
    from evac.study.statistics import IMO_POPULATIONS, IMO_REPETITIONS
    from evac.study.stopping import rule_of

    runs, repetitions = arguments.runs, arguments.repetitions or 1
    if arguments.imo:
        if runs is not None or arguments.repetitions is not None:
            raise ScenarioError("--imo sets --runs and --repetitions; remove these or --imo")
        repetitions = IMO_REPETITIONS
        runs = None if arguments.until is not None else IMO_POPULATIONS * IMO_REPETITIONS
    rule = rule_of(runs, arguments.until, arguments.statistic, arguments.least, arguments.most, repetitions)
    case = points[0].case
    prepare(case)
    of_each = f"points: {len(points)}, runs of each" if arguments.command == "sweep" else "runs"
    number = rule.first if rule.until is None else f"{rule.first} to {rule.most}"
    note(f"{of_each}: {number}, seeds from {case.simulation.seed} on")
    connected = nullcontext() if arguments.dask is None else dask_executor(arguments.dask)
    with connected as executor, Display() as display:
        display.phase("first runs")
        study = execute_study(
            points,
            rule,
            folder=arguments.out or folder,
            workers=arguments.jobs,
            executor=executor,
            resume=arguments.resume,
            maps=arguments.maps,
            progress=shown_progress(display),
            replay=arguments.replay,
        )
    return show_study(study)


def study_of(case: "Case", runs: int, folder: Path, maps: bool) -> "Study":
    """Make a study of a case, and show its progress."""
    from evac.study.api import execute_study
    from evac.study.points import single
    from evac.study.stopping import rule_of

    prepare(case)
    note(f"{case.title}: {counted(runs, 'run')}, seeds from {case.simulation.seed} on, into {folder}")
    with Display() as display:
        return execute_study(single(case), rule_of(runs), folder=folder, maps=maps, progress=shown_progress(display))


def prepare(case: "Case") -> None:
    """Compile missing kernels, show warnings, and keep building and directions; the study tells if a run is refused."""
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
    from evac.study.outputs import hold_up_of, parameter_keys, people_at, quality_of, remarks_of, statistics_table

    case = study.points[0].case
    people = {row["people"] for row in study.rows(columns=["people"])} or {0}
    runs, blocked, failed = study.counts
    say(study.verdict["text"], style=STYLES[study.verdict["status"]])
    facts: dict[str, object] = {"case": case.title}
    facts["people"] = f"{min(people)} to {max(people)}" if len(people) > 1 else min(people)
    at_places = people_at(study, 0) if len(study.points) == 1 else {}
    facts["everybody out or safe" if at_places else "everybody out"] = f"in {runs - blocked} of {counted(runs, 'run')}"
    facts |= at_places
    if failed:
        facts["failed"] = f"{counted(failed, 'more run')}, which are in no statistic"
    change = study.step_change
    if len(study.points) == 1 or change is not None:
        hold_up = hold_up_of(study, 0)
        show_facts(facts | ({"queues": hold_up} if hold_up else {}))
        show_table(TITLE, ("statistic", "value [s]", "95 % interval", "over"), statistics_table(study, 0))
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


def _show_step(study: "Study", change: "Estimate") -> None:
    """Show the effect of half the time step, and what follows from it."""
    from evac.study.statistics import time_text

    mean, half = (estimates.mean for estimates in study.statistics)
    step = study.points[1].parameters["simulation.step"]
    pairs = counted(change.runs, "pair") + " of runs with the same seed"
    rows = [half.row(counted(half.runs, "complete run"))]
    value, bounds = time_text(change.value, "+.2f"), change.bounds("+.2f")
    rows.append(("change of the mean", value, bounds, f"{pairs}; {change.note}".removesuffix("; ")))
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


def swept(overrides: "Sequence[str]") -> tuple[dict[str, list[Any]], list[str]]:
    """Return the keys with several values, and the overrides with a single value."""
    from evac.case.overrides import split_values, value_of

    several: dict[str, list[Any]] = {}
    fixed = []
    for text in overrides:
        key, _, words = (part.strip() for part in text.partition("="))
        values = split_values(words)
        if len(values) < 2:
            fixed.append(text)
            continue
        try:
            several[key] = [value_of(word) for word in values]
        except (ValueError, IndexError) as error:
            raise ScenarioError(f"--set {text}: not a list of values: {error or 'a value is empty'}") from error
    return several, fixed


def _case_of_sweep(arguments: argparse.Namespace, fixed: list[str]) -> "Case | None":
    """Return the case of the sweep; None if the table names all cases."""
    from evac.case.loading import load_case

    if arguments.case is None and arguments.table is None:
        raise ScenarioError("name a case, or a table of cases (--table)")
    if arguments.table is None and not any("," in text for text in arguments.set):
        raise ScenarioError("no key has several values: give them (--set KEY=V1,V2), or use evac repeat")
    if arguments.case is None:
        return None
    return inputs.with_plugin_files(load_case(arguments.case, fixed, arguments.plugins))


def _with_files_beside(folder: Path, case: "Case") -> "Case":
    """Execute the plugin files of a case that a table in a folder names; both must lie there."""
    from evac.case.loading import is_inside

    if case.unloaded_files and not is_inside(case.source, folder):
        raise ScenarioError(
            f"{case.source}: has plugin files, and is named by a table in another folder; move the table beside the "
            "folder of the case, or sweep the case itself"
        )
    return inputs.with_plugin_files(case)


def _rows_of_table(
    arguments: argparse.Namespace, parameters: dict[str, list[Any]], fixed: list[str]
) -> list[dict[str, Any]]:
    """Return the rows of the table, each repeated for all combinations of the swept values."""
    import itertools

    from evac.case.overrides import parsed
    from evac.study.points import check_number, read_table

    rows = read_table(arguments.table)
    check_number(len(rows) * math.prod(map(len, parameters.values())))
    single = {} if arguments.case is not None else dict(parsed(fixed)[0])
    return [
        {**single, **row, **dict(zip(parameters, values, strict=True))}
        for row in rows
        for values in itertools.product(*parameters.values())
    ]
