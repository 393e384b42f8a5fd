"""Outputs of a study in addition to its rows: CSV tables, a summary, pictures, and remarks on its runs."""

import math
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from evac.analysis.queues import is_little
from evac.base.arrays import FloatArray
from evac.base.defaults import LONGEST_NAME
from evac.base.errors import counted, in_order
from evac.folder import files
from evac.folder.textfiles import plain, write_csv, write_json
from evac.results.results import versions
from evac.results.tables import AT, WAITED
from evac.simulation.assembly import providers
from evac.simulation.simulation import Simulation
from evac.study.points import STEP
from evac.study.statistics import PERCENTILES, estimate, percentile_name, time_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from evac.study.study import Study

#: Greatest number of times of an egress curve over runs; in longer runs their distance exceeds ``output.every``.
MOST_TIMES = 2000

MOST_CURVES = 8  #: Greatest number of points whose egress curves are drawn in one figure.
COUNTED = ("run", "last_out", "out")  #: Columns by which runs are ranked for replays.

#: Maximum number of kinds of quality warnings and of seeds that are named in remarks.
MOST_WARNINGS = 10
MOST_SEEDS = 20

#: Columns of runs.csv between the parameters and the exits.
RUN_COLUMNS = ("ended", "blocked", "time", "people", "out", "last_out")


def write_outputs(study: "Study") -> None:
    """Write all outputs of a study to its folder, besides its rows and replays."""
    folder = study.folder
    with files.writing("the results", folder):
        write_runs(study, folder / files.RUNS_NAME)
        rows = statistics_rows(study)
        write_csv(folder / files.STATISTICS_NAME, rows[0], (map(_field, row.values()) for row in rows))
        egress_curves = [egress(study, point.index) for point in study.points]
        _write_egress(study, egress_curves, folder / files.EGRESS_NAME)
        if study.points[0].case.output.picture:
            from evac.pictures.writing import as_shipped, save

            name = files.EGRESS_PICTURE_NAME if len(study.points) == 1 else files.SWEEP_PICTURE_NAME
            with as_shipped():
                save(figure_of(study, egress_curves[0]), folder / name)
        write_json(folder / files.SUMMARY_NAME, plain(summary(study)), "the results")


def write_replays(study: "Study") -> None:
    """Repeat the median and the worst run of a study of one point, and write their replays.

    Runs are ranked by evacuation time; blocked runs are the worst, in the order of the number of people out. For an
    even number the lower median is used; for a single run only the median is written.
    """
    order = sorted((row["last_out"] or math.inf, -row["out"], row["run"]) for row in study.rows(0, COUNTED))
    ranked = [run for _, _, run in order]
    chosen = {files.MEDIAN_REPLAY_NAME: ranked[(len(ranked) - 1) // 2], files.WORST_REPLAY_NAME: ranked[-1]}
    for name, run in list(chosen.items())[: len(ranked)]:
        case, rank = study.case_of(0, run), "Worst" if name == files.WORST_REPLAY_NAME else "Median"
        title = f"{rank} of {counted(len(ranked), 'run')}, seed {case.simulation.seed}: {case.title}"[:LONGEST_NAME]
        changes = {"output.replay": True, "output.animation": False, "output.trajectory": True, "title": title}
        case = case.change(changes)
        with files.writing("the replays", study.folder), TemporaryDirectory(dir=study.folder) as place:
            Simulation(case, Path(place)).run()
            files.note_written([study.folder / name])
            (Path(place) / files.REPLAY_NAME).replace(study.folder / name)


def summary(study: "Study") -> dict[str, Any]:
    """Return the content of summary.json."""
    case = study.points[0].case
    rows_of_points = []
    for point, each in zip(study.points, study.statistics, strict=True):
        entry: dict[str, Any] = {"parameters": point.parameters, "statistics": asdict(each)}
        entry["safety"] = study.safety(point.index)
        if study.rule.until is not None:
            entry["known"] = study.rule.is_known(study.times(point.index), study.populations(point.index))
        if study.seeds.repetitions > 1:
            entry["variation"] = asdict(study.variation(point.index))
        rows_of_points.append(entry)
    change, (runs, blocked, failed) = study.step_change, study.counts
    return {
        "title": case.title,
        "runs": runs + failed,
        "blocked": blocked,
        "failed": failed,
        "first_seed": study.seeds.first,
        "rule": asdict(study.rule),
        "verdict": study.verdict,
        "points": rows_of_points,
        **({} if change is None else {"step_change": asdict(change)}),
        "case": case.to_dict(),
        "keeps_distance": case.keeps_distance,
        "plugins": providers(case),
        "versions": versions(),
    }


def safety_of(study: "Study", point: int) -> dict[str, Any] | None:
    """Return the compartments of a point as in the results of a run, with percentiles of the required times over runs.

    ``people`` are the most of any run, the available time and the least margin are the least. None without limits.
    """
    settings = study.points[point].case.safety
    runs = [row["compartments"] for row in study.rows(point, ["compartments"], failed=True)]
    first = next(filter(None, runs), None)
    if settings is None or first is None:
        return None
    return {
        "factor": settings.factor,
        "percentile": settings.percentile,
        "compartments": [
            _compartment(study, point, [row[k] if row else None for row in runs], settings.percentile)
            for k in range(len(first))
        ],
    }


def _compartment(
    study: "Study", point: int, rows: Sequence[Mapping[str, Any] | None], percentile: float
) -> dict[str, Any]:
    """Return the row of a compartment over the runs of a point, of which failed ones are None."""

    def least(name: str) -> float | None:
        return min((row[name] for row in own if row[name] is not None), default=None)

    own = [row for row in rows if row is not None]
    # People who have not left need infinitely long, and nobody needs no time; failed runs are in no statistic.
    none = [math.nan if row is None else math.inf if row["people"] else 0.0 for row in rows]
    times = [none[k] if row is None or row["required"] is None else row["required"] for k, row in enumerate(rows)]
    required = estimate(percentile_name(percentile), np.array(times), study.populations(point), study.rule.confidence)
    interval = f", interval {required.bounds('.1f')}" if required.bounds() else ""
    available = least("available")
    return {
        "name": own[0]["name"],
        "people": max(row["people"] for row in own),
        "required": required.value if math.isfinite(required.value) else None,
        "required_interval": [required.low, required.high],
        "spread": f" ({percentile:g} % of {counted(required.runs, 'run')}{interval})",
        "available": available,
        "criterion": next((row["criterion"] for row in own if row["available"] == available), ""),
        "until": least("until") if available is None else None,
        "least_margin": least("least_margin"),
    }


def hold_up_of(study: "Study", point: int) -> str:
    """Return what holds up most over the runs of a point, in words; empty if no motion was recorded."""
    waited, recorded = dict[str, list[float]](), list[float]()  # of all people [s]: by cause in each run, and in all
    for row in study.rows(point, ["tables"]):
        numbers = {(one["table"], one["row"], one["column"]): one["value"] for one in row["tables"]}
        places = [place for table, place, column in numbers if (table, column) == ("queues", "people")]
        own = {at: numbers["queues", at, "people"] * numbers["queues", at, "mean wait [s]"] for at in places}
        for at in (at for at in places if not is_little(own[at], numbers["queues", at, "people"])):
            waited.setdefault(at, []).append(own[at])
        if ("outcomes", WAITED, "number") in numbers:
            recorded.append(numbers["outcomes", WAITED, "number"])
    if not recorded or not waited:
        return "Little waiting in every run" if recorded else ""
    most = max(waited, key=lambda at: sum(waited[at]))
    share, runs = sum(waited[most]) / sum(recorded), f"{len(waited[most])} of {counted(len(recorded), 'run')}"
    return f"What holds up most is {most}: {100.0 * share:.0f} % of all waiting, long in {runs}"


def _at_places(row: Mapping[str, Any]) -> dict[str, int]:
    """Return how many people were at each safe place at the end of a run."""
    return {one["row"]: int(one["value"]) for one in row["tables"] or () if one["row"].startswith(AT)}


def people_at(study: "Study", point: int) -> dict[str, str]:
    """Return how many people were at each safe place at the end of the runs of a point, in words."""
    found: dict[str, list[int]] = {}
    for row in study.rows(point, ["tables"]):
        for what, people in _at_places(row).items():
            found.setdefault(what, []).append(people)
    return {what: " to ".join(f"{of:g}" for of in sorted({min(each), max(each)})) for what, each in found.items()}


def statistics_rows(study: "Study") -> list[dict[str, Any]]:
    """Return a row for each point: its parameters, then the values of `Statistics`."""
    keys = parameter_keys(study)
    return [
        {"point": point.index} | {key: point.parameters.get(key) for key in keys} | estimates.as_row()
        for point, estimates in zip(study.points, study.statistics, strict=True)
    ]


def statistics_table(study: "Study", point: int) -> list[tuple[str, str, str, str]]:
    """Return the statistics of a point: name, value [s], interval, and over how many runs, with remarks."""
    of = study.statistics[point]
    everywhere = counted(of.runs, "run")
    complete = counted(of.runs - of.blocked, "complete run") if of.blocked else everywhere
    rows = [
        ("minimum", time_text(of.least), "", everywhere),
        *(percentile.row(everywhere) for percentile in of.percentiles),
        ("maximum", time_text(of.greatest), "", everywhere),
        of.mean.row(complete),
        ("standard deviation", time_text(of.standard_deviation), "", complete),
    ]
    if study.rule.until is not None and study.rule.statistic not in [row[0] for row in rows]:
        rows.append(study.deciding(point).row(everywhere))
    if of.blocked:
        share = f"{100 * of.blocked_low:.1f} to {100 * of.blocked_high:.1f} %"
        rows.append(("blocked runs", str(of.blocked), share, f"interval of the share of {everywhere}"))
    if study.seeds.repetitions > 1:
        spread = study.variation(point)
        rows.append(("higher than 95 % of times (IMO)", time_text(spread.reported), "", everywhere))
        rows.append(("deviation between populations", time_text(spread.between), "", complete))
        rows.append(("deviation within populations", time_text(spread.within), "", complete))
    return rows


def points_table(study: "Study") -> tuple[list[str], list[list[Any]]]:
    """Return the heads and cells of a table of the points, with evacuation times and their intervals."""
    keys, percentile = parameter_keys(study), study.statistics[0].percentiles[-1].name
    rows = []
    for point, row in zip(study.points, study.statistics, strict=True):
        times = row[study.central].words(), row.percentiles[-1].words()
        blocked = f"{row.blocked} of {row.runs}" + (f", {row.failed} failed" if row.failed else "")
        said = study.verdict_at(point.index)["text"].partition(":")[0]
        rows.append([*(point.parameters.get(key) for key in keys), *times, blocked, said])
    return [*keys, *(f"{name} [s] (95 % interval)" for name in (study.central, percentile)), "blocked", "verdict"], rows


def parameter_keys(study: "Study") -> list[str]:
    """Return the names of the parameters of a study, in order."""
    return list(dict.fromkeys(key for point in study.points for key in point.parameters))


def write_runs(study: "Study", path: Path) -> None:
    """Write runs.csv: a row for each run, even a failed one, with columns for exits and safe places, not for people."""
    names = in_order({exit_["name"] for row in study.rows(columns=["exits"]) for exit_ in row["exits"]}, str)
    places = in_order({at for row in study.rows(columns=["tables"]) for at in _at_places(row)}, str)
    own = ["point", "run", "seed", *parameter_keys(study), *RUN_COLUMNS]
    if study.seeds.repetitions > 1:
        own.insert(3, "population_seed")
    of_exits = [f"{name}: {what}" for name in names for what in ("people", "last_out")]
    head = [*own, *of_exits, *places, "quality_warnings", "error"]

    def lines() -> Iterator[list[Any]]:
        for row in study.rows(columns=[*own, "exits", "tables", "quality_warnings", "error"], failed=True):
            used = {exit_["name"]: exit_ for exit_ in row["exits"]}
            exits = [used.get(name, {}).get(what) for name in names for what in ("people", "last_out")]
            exits += map(_at_places(row).get, places)
            yield [*(_field(row[key]) for key in own), *exits, "; ".join(row["quality_warnings"]), row["error"]]

    write_csv(path, head, lines())


def egress(study: "Study", point: int) -> dict[str, FloatArray]:
    """Return ``time`` [s], and mean and percentiles over the runs of a point of the number of people out, each (k,).

    The times are those of ``output.every``, to the end of the longest run.
    """
    end = max((row["time"] for row in study.rows(point, ["time"])), default=None)
    if end is None:  # all runs failed
        return out_over_runs(np.empty(0), [np.empty(0)])
    every = study.points[point].case.output.every
    every *= math.ceil(end / every / MOST_TIMES)
    time = every * np.arange(math.ceil(end / every * (1.0 - 1e-12)) + 1)
    return out_over_runs(time, (row["exit_time"] for row in study.rows(point, ["exit_time"])))


def out_over_runs(time: FloatArray, exit_times: Iterable[FloatArray]) -> dict[str, FloatArray]:
    """Return times (k,) [s], and mean and percentiles (k,) over runs of the number of people out by then."""
    # NaN is sorted after all times.
    out = np.array([np.searchsorted(np.sort(times), time, "right").astype(np.int32) for times in exit_times])
    percentiles = {f"percentile_{of:g}_over_runs": np.percentile(out, of, axis=0) for of in PERCENTILES}
    return {"time": time, "mean_over_runs": out.mean(axis=0), **percentiles}


def _write_egress(study: "Study", curves: Sequence[Mapping[str, FloatArray]], path: Path) -> None:
    """Write the curves of all points below one another; a single point without the column of its number."""
    is_single = len(study.points) == 1
    rows = (
        row if is_single else (point, *row)
        for point, columns in enumerate(curves)
        for row in zip(*(column.tolist() for column in columns.values()), strict=True)
    )
    write_csv(path, [*([] if is_single else ["point"]), *curves[0]], rows)


def figure_of(study: "Study", curve: Mapping[str, FloatArray]) -> "Figure":
    """Return a figure of the curve (`egress`) of a single point, or else of the statistics of all points."""
    from evac.pictures.pictures import points_figure, runs_figure

    each, case = study.statistics[0], study.points[0].case
    title = f"{textwrap.fill(case.title, 90)}\n"
    if len(study.points) == 1:
        title += f"{each.runs} runs, everybody out in {each.runs - each.blocked}"
        return runs_figure(title, study.people(0), curve)
    middle = np.array([(of.value, of.low, of.high) for of in (each[study.central] for each in study.statistics)])
    greatest = np.array([each.percentiles[-1].value for each in study.statistics])
    of = "mean of the complete runs" if study.central == "mean" else "median of all runs"
    note = f"dots: {of} and its 95 % interval; triangles: 95th percentile of all runs, if finite"
    parameters = [point.parameters for point in study.points]
    return points_figure(title, parameters, middle, greatest, note)


def _field(value: Any) -> Any:
    """Return a value for a CSV file: an empty field for None or NaN, ``inf`` for infinity."""
    if isinstance(value, float) and math.isnan(value):
        return None
    if isinstance(value, bool):
        return str(value).lower()
    return value


def remarks_of(study: "Study") -> list[str]:
    """Return lines on failed runs, people left inside, wider intervals than required, and the effect of the step."""
    return [*_failed(study), *_blocked(study), *_too_wide(study), *_step(study)]


def quality_of(study: "Study") -> list[str]:
    """Return the quality warnings of all runs: one line for each kind, with the first run and the number of others."""
    seeds: dict[str, list[str]] = {}
    for row in study.rows(columns=["point", "seed", "quality_warnings"]):
        for line in row["quality_warnings"]:
            kind = "".join(sign for sign in line.partition(":")[0] if not sign.isdigit())
            seeds.setdefault(kind, []).append(f"{_where(study, row)}: {line}")
    return _first_of_each(seeds.values(), " with such a warning")


def _first_of_each(texts: Iterable[list[str]], which: str = "") -> list[str]:
    """Return the first line of each kind, with the number of other runs."""
    firsts = []
    for lines in list(texts)[:MOST_WARNINGS]:
        others = counted(len(lines) - 1, "more run")
        firsts.append(lines[0] + (f" (and {others}{which}, in runs.csv)" if len(lines) > 1 else ""))
    return firsts


def _failed(study: "Study") -> list[str]:
    """Return a line for the first failed run of each point."""
    reasons: dict[int, list[str]] = {}
    if any(estimates.failed for estimates in study.statistics):
        for row in study.rows(columns=["point", "seed", "error"], failed=True):
            if row["error"] is not None:
                reasons.setdefault(row["point"], []).append(f"failed: {_where(study, row)}: {row['error']}")
    lines = _first_of_each(reasons.values())
    if len(reasons) > MOST_WARNINGS:
        lines.append(f"failed: runs of {len(reasons) - MOST_WARNINGS} more points, in runs.csv")
    return lines


def _step(study: "Study") -> list[str]:
    """Return a line on the effect of the time step, if it is more than chance or not determined."""
    change = study.step_change
    if change is None or change.low <= 0.0 <= change.high:
        return []
    if not change.has_interval:
        return ["the runs do not determine the effect of the time step; make more"]
    step, share = study.points[1].parameters[STEP], 100.0 * change.value / study.statistics[0].mean.value
    return [
        f"the time step changes the mean by more than chance: {share:+.1f} % with half of it; set "
        f"{STEP}={step:g}, and check that step again"
    ]


def _where(study: "Study", row: Mapping[str, Any]) -> str:
    """Return the seed of a row, and its point if there are several."""
    if len(study.points) == 1:
        return f"seed {row['seed']}"
    return f"point {row['point']} ({study.points[row['point']].label}), seed {row['seed']}"


def _blocked(study: "Study") -> list[str]:
    """Return a line on blocked runs, if there are any."""
    if not any(of.blocked for of in study.statistics):
        return []
    if len(study.points) > 1:
        return ["people are left in blocked runs: percentiles count their times as infinite, means exclude these runs"]
    of = study.statistics[0]
    seeds = [str(row["seed"]) for row in study.rows(0, ["seed", "blocked"]) if row["blocked"]]
    listed = ", ".join(seeds[:MOST_SEEDS]) + (" and others" if len(seeds) > MOST_SEEDS else "")
    return [
        f"people are left in {of.blocked} of {of.runs} runs ({100 * of.blocked_share:.1f} %, 95 % interval "
        f"{100 * of.blocked_low:.1f} to {100 * of.blocked_high:.1f} %), with seeds {listed}; percentiles count their "
        "times as infinite, means exclude these runs; evac run --seed N shows where people are left"
    ]


def _too_wide(study: "Study") -> list[str]:
    """Return a line for each point at which a study has not reached the required interval."""
    rule = study.rule
    lines = []
    for point in study.points if rule.until is not None else ():
        if not rule.is_known(study.times(point.index), study.populations(point.index)):
            estimate = study.deciding(point.index)
            where = f" at {point.label}" if len(study.points) > 1 else ""
            half = estimate.relative_half_width
            reached = f"half-width {100 * half:.2g} %" if math.isfinite(half) else "no finite interval"
            if not rule.is_open(study.times(point.index), study.populations(point.index)):
                runs = counted(study.runs_of(point.index), "run")
                line = f"interval of the {estimate.name} cannot become finite{where}, stopped after {runs}"
                lines.append(f"{line}: {estimate.note}" if estimate.note else line)
                continue
            lines.append(
                f"interval of the {estimate.name} too wide{where} after {counted(study.runs_of(point.index), 'run')}: "
                f"{reached}, required {100 * (rule.until or 0.0):g} %; {estimate.note or 'raise most'}"
            )
    return lines
