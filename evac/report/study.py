"""The report of a study: many runs of a case, from the files of its folder."""

import csv
import io
import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from evac.folder.files import EGRESS_NAME, RUNS_NAME, STATISTICS_NAME, SUMMARY_NAME
from evac.report import figures
from evac.report.building import building_section
from evac.report.congestion import MAPS, congestion_sections
from evac.report.html import Cell, Html, Section, element, fixed, heading, items, note, paragraph, table
from evac.report.limits import limits_section, warnings_section
from evac.report.model import case_section, model_section
from evac.report.occupants import occupants_section, told
from evac.report.page import BLANK, Head, Labels, assessment_section, files_section, page
from evac.report.study_files import (
    EXIT_LAST,
    EXIT_PEOPLE,
    EstimateTable,
    PointTable,
    StatisticsTable,
    StudyFiles,
    StudySummary,
    check_member,
    numbers,
    read_study,
)
from evac.report.times import place_tables
from evac.report.verification import evidence_section, verification_section
from evac.results.ending import FAILED
from evac.results.reading import read_results
from evac.results.results import Results

#: Percentiles over runs of what exits have [%].
PERCENTILES = (5, 50, 95)

#: So many runs are listed one by one; the others are in runs.csv.
MOST_LISTED = 100

#: So many seeds are listed in a line.
MOST_SEEDS = 20

#: A number in a warning; warnings that differ by numbers alone are told once.
NUMBER = re.compile(r"\d+(\.\d+)?")


def study_report(
    folder: Path,
    runs: Sequence[Path] = (),
    labels: Labels = BLANK,
    *,
    density: float,
    least_time: float | None = None,
    maps: Sequence[str] = MAPS,
) -> str:
    """Return the report of a study as a page of HTML.

    Parameters
    ----------
    folder : Path
        Of `evac repeat` or `evac sweep`.
    runs : sequence of Path
        Result folders of runs of the study. Plans are those of the first; places, congestion and maps of each are
        added.
    labels, density, least_time, maps
        As for `evac.report.of_run.run_report`.

    Raises
    ------
    ResultError
        A file is missing or damaged, or a run is none of the study.
    """
    study = read_study(folder)
    summary = study.summary
    shown = [read_results(path) for path in runs]
    for run in shown:
        check_member(study, run)
    first = shown[0] if shown else None
    seeds = sorted({int(seed) for seed in study.runs["seed"]})
    sections = [
        building_section(first),
        occupants_section(summary.table, first),
        model_section(summary.table, summary.versions, summary.plugins, _ranges(seeds), _command(summary)),
        verification_section(summary.table, summary.keeps_distance),
        *_points(study),
        _statistics(study),
        _exits(study),
        *(
            section
            for number, run in enumerate(shown, 1)
            for section in _of_run(run, number, density, least_time, maps)
        ),
        _warnings(study),
        assessment_section(),
        limits_section(is_study=True),
        _runs(study),
        evidence_section(),
        case_section(study.case),
        files_section(folder, (SUMMARY_NAME, STATISTICS_NAME, RUNS_NAME, EGRESS_NAME)),
    ]
    head = Head(
        summary.title or folder.name, f"Evacuation analysis: {summary.runs} runs", _banner(summary), _results(study)
    )
    return page(head, labels, sections, f"evac {summary.versions.get('evac', '')}")


def _ranges(seeds: Sequence[int]) -> str:
    """Return seeds as ranges."""
    if seeds and seeds[-1] - seeds[0] + 1 == len(seeds) > 1:
        return f"{seeds[0]} to {seeds[-1]}, a run with each"
    return _listed([str(seed) for seed in seeds])


def _command(summary: StudySummary) -> str:
    """Return the command that repeats a study."""
    rule = summary.rule
    number = f"--runs {rule.most}"
    if rule.until is not None:
        number = (
            f'--until {100.0 * rule.until:g}% --statistic "{rule.statistic}" --least {rule.least} --most {rule.most}'
        )
    if rule.repetitions > 1:
        number += f" --repetitions {rule.repetitions}"
    if len(summary.points) == 1 and not summary.points[0].parameters:
        return f"evac repeat case.toml {number} --out STUDY"
    return f"evac sweep case.toml --table points.csv {number} --out STUDY"


def _banner(summary: StudySummary) -> str:
    told = []
    if summary.failed:
        told.append(f"{summary.failed} of {summary.runs} runs failed and are in no statistic.")
    if summary.blocked:
        runs = summary.runs - summary.failed
        told.append(
            f"{summary.blocked} of {runs} runs ended with people inside; their evacuation time counts as infinite."
        )
    return " ".join(told)


def _interval(one: EstimateTable, is_blocked: bool = False) -> str:
    """Return an estimate with its interval."""
    if one.value is None:
        return "not reached" if is_blocked else "-"
    if one.low is None and one.high is None:
        return f"{one.value:.1f} s"
    low = "open" if one.low is None else f"{one.low:.1f}"
    high = "open" if one.high is None else f"{one.high:.1f}"
    return f"{one.value:.1f} s ({low} to {high})"


def _mean(one: EstimateTable) -> str:
    """Return the mean with its interval, or with the reason why it has none."""
    told = f"{_interval(one)}, with 95 % interval" if one.low is not None else _interval(one)
    return f"{told}; {one.note}" if one.note else told


def _change(one: EstimateTable) -> str:
    """Return a difference with its interval, or with the reason why it has none."""
    if one.value is None:
        return one.note or "-"
    reach = "" if one.low is None or one.high is None else f" ({one.low:+.2f} to {one.high:+.2f})"
    return f"{one.value:+.2f} s{reach}{'; ' if one.note else ''}{one.note}"


def _results(study: StudyFiles) -> dict[str, object]:
    """Return the main results, which open the report: of the only point, or how many there are."""
    summary = study.summary
    results: dict[str, object] = {"Number of runs": str(summary.runs)}
    if len(summary.points) > 1:
        results["Variants"] = f"{len(summary.points)}, see below"
    else:
        one = summary.points[0].statistics
        results |= {
            "People": ", ".join(sorted({study.runs["people"][row] for row in study.finished(0)}, key=int)),
            "Evacuation time, mean of complete runs": _mean(one.mean),
            **{
                f"Evacuation time, {estimate.name}": _interval(estimate, bool(one.blocked))
                for estimate in one.percentiles
            },
        }
    if summary.step_change is not None:
        results["Change of the mean with half the time step"] = _change(summary.step_change)
    if summary.failed:
        results["Failed runs"] = f"{summary.failed} of {summary.runs}"
    results["Blocked runs"] = f"{summary.blocked} of {summary.runs - summary.failed}"
    warned = sum(bool(text) for text in study.runs["quality_warnings"])
    results["Runs with quality warnings"] = f"{warned} of {summary.runs}"
    return results


def _points(study: StudyFiles) -> Iterator[Section]:
    """Yield the section on the points of a sweep."""
    points = study.summary.points
    keys = list(dict.fromkeys(key for point in points for key in point.parameters))
    if not keys:
        return
    rows = [
        (
            str(number),
            *(told(point.parameters[key]) if key in point.parameters else None for key in keys),
            point.statistics.runs,
            point.statistics.blocked,
            _interval(point.statistics.mean),
            *(_interval(one, bool(point.statistics.blocked)) for one in point.statistics.percentiles),
        )
        for number, point in enumerate(points)
    ]
    names = [one.name for one in points[0].statistics.percentiles]
    columns = ("point", *keys, "runs", "blocked", "mean [s]", *names)
    words = paragraph(
        "Each variant (point) of the study has other values of the keys below; all points have the same seeds."
    )
    found = table("Evacuation time at each point", columns, rows)
    file = paragraph("Content of points.csv for the command that repeats the study:")
    yield Section("points", "Variants", (words, found, file, element("pre", points_file(keys, points))))


def points_file(keys: Sequence[str], points: Sequence[PointTable]) -> str:
    """Return the parameters of points as evac sweep --table reads them."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(keys)
    for point in points:
        values = (point.parameters.get(key, "") for key in keys)
        writer.writerow([value if isinstance(value, str) else json.dumps(value) for value in values])
    return file.getvalue()


def _statistics(study: StudyFiles) -> Section:
    """Return the section on evacuation times over runs."""
    parts: list[Html] = [
        paragraph(
            "The evacuation time of a run is the time at which the last person leaves. All statistics are over runs,"
            " not over people. The time of a run that ends with people inside counts as infinite; the mean is that of"
            " the other runs. Intervals have a confidence level of 95 %."
        )
    ]
    is_single = len(study.summary.points) == 1
    for number, point in enumerate(study.summary.points):
        if not is_single:
            named = ", ".join(f"{key} = {told(value)}" for key, value in point.parameters.items())
            parts.append(heading(f"Point {number}: {named}"))
        parts.append(_statistics_table(point.statistics))
        if study.finished(number):
            parts.append(_egress(study, number))
        if point.settled:
            settled = [(name, runs) for name, runs in point.settled.items()]
            caption = (
                "Convergence after Ronchi, Reneke and Peacock (2014): number of runs after which a measure stayed below"
                " its bound ten times in a row; a dash if it has not converged"
            )
            parts.append(table(caption, ("measure", "converged after runs"), settled))
    return Section("statistics", "Evacuation times over runs", tuple(parts))


def _statistics_table(one: StatisticsTable) -> Html:
    blocked = f"{100.0 * one.blocked_low:.1f} to {100.0 * one.blocked_high:.1f} %"
    greatest = "not reached" if one.greatest is None and one.blocked else fixed(one.greatest, 1)
    rows: list[tuple[object, ...]] = [
        ("runs", one.runs, None, None),
        ("blocked runs", one.blocked, blocked, "interval of the share"),
        ("minimum [s]", fixed(one.least, 1), None, None),
    ]
    for estimate in (one.mean, *one.percentiles):
        bounds = [fixed(bound, 1) or "open" for bound in (estimate.low, estimate.high)]
        interval = None if estimate.low is None and estimate.high is None else " to ".join(bounds)
        value = fixed(estimate.value, 1) or ("not reached" if one.blocked else None)
        rows.append((f"{estimate.name} [s]", value, interval, estimate.note))
    rows += [
        ("maximum [s]", greatest, None, None),
        ("standard deviation of complete runs [s]", fixed(one.standard_deviation, 2), None, None),
    ]
    return table("Evacuation time", ("statistic", "value", "interval", "remark"), rows)


def _egress(study: StudyFiles, point: int) -> Html:
    """Return the egress curves of a point."""
    columns = dict(study.egress)
    if "point" in columns:
        here = columns.pop("point") == point
        columns = {name: column[here] for name, column in columns.items()}
    people = max((int(study.runs["people"][row]) for row in study.rows(point)), default=0)
    caption = (
        "Number of people out over time: mean, median and percentiles over runs at each time. The dotted line is the"
        " total number of people."
    )
    return figures.egress_over_runs(people, columns, caption)


def _exits(study: StudyFiles) -> Section:
    """Return the section on the use of exits over runs."""
    exits = [name.removesuffix(EXIT_PEOPLE) for name in study.runs if name.endswith(EXIT_PEOPLE)]
    parts: list[Html] = []
    for point in range(len(study.summary.points)):
        rows = []
        here = study.rows(point)
        for name in exits:
            people = numbers([study.runs[name + EXIT_PEOPLE][row] for row in here])
            last = numbers([study.runs[name + EXIT_LAST][row] for row in here])
            used = last[np.isfinite(last)]
            if not np.isfinite(people).any():
                continue
            shares = [fixed(float(np.percentile(used, of)), 1) if used.size else None for of in PERCENTILES]
            mean = fixed(float(np.nanmean(people)), 1)
            rows.append((name, mean, used.size, fixed(float(used.mean()), 1) if used.size else None, *shares))
        columns = (
            "exit",
            "people, mean",
            "runs that used it",
            "mean [s]",
            *(f"{of} % of runs [s]" for of in PERCENTILES),
        )
        where = "" if len(study.summary.points) == 1 else f", point {point}"
        parts.append(
            table(f"Time at which the last person left by each exit, over the runs that used it{where}", columns, rows)
        )
    parts.append(
        paragraph(
            "A study does not store times of levels and stairs; they are given for single runs, if the report has any."
        )
    )
    return Section("exits", "Exits over runs", tuple(parts))


def _of_run(
    run: Results, number: int, density: float, least_time: float | None, maps: Sequence[str]
) -> Iterator[Section]:
    """Yield the sections on one run: its places, congestion and maps."""
    name = f"Run with seed {run.record.seed}"
    suffix = "" if number == 1 else f"-{number}"
    last = fixed(run.record.last_out, 1)
    words = paragraph(f"{run.record.evacuated} of {run.record.people} people left, the last of them after {last} s.")
    yield Section(f"places{suffix}", f"{name}: levels and stairs", (words, *place_tables(run)))
    for section in congestion_sections(run, density, least_time, maps):
        yield Section(f"{section.id}{suffix}", f"{name}: {section.title.lower()}", section.parts)


def _warnings(study: StudyFiles) -> Section:
    """Return the section on quality warnings: each with the seeds of its runs."""
    alike: dict[str, list[tuple[str, str]]] = {}
    for seed, text in zip(study.runs["seed"], study.runs["quality_warnings"], strict=True):
        if text:
            alike.setdefault(NUMBER.sub("#", text), []).append((seed, text))
    lines = []
    for found in alike.values():
        seed, text = found[0]
        others = f", and similar ones in {len(found) - 1} more (seeds {_listed([s for s, _ in found[1:]])})"
        lines.append(f"run with seed {seed}{others if len(found) > 1 else ''}: {text}")
    section = warnings_section(lines, ())
    told_of = paragraph("A study does not store warnings about building and people; evac check CASE shows them.")
    return Section(section.id, section.title, (*section.parts[:-1], told_of))


def _listed(words: Sequence[str]) -> str:
    return ", ".join(words[:MOST_SEEDS]) + (" ..." if len(words) > MOST_SEEDS else "")


def _runs(study: StudyFiles) -> Section:
    """Return the appendix with a row for each run."""
    runs = study.runs
    is_single = len(study.summary.points) == 1
    rows = []
    for row in range(min(len(runs["run"]), MOST_LISTED)):
        why = FAILED if runs["ended"][row] == FAILED else "people left"
        last = Cell(why, "bad") if not runs["last_out"][row] else fixed(float(runs["last_out"][row]), 2)
        point = () if is_single else (runs["point"][row],)
        out = f"{runs['out'][row]} of {runs['people'][row]}"
        rows.append((*point, runs["run"][row], runs["seed"][row], runs["ended"][row], out, last))
    columns = (*(() if is_single else ("point",)), "run", "seed", "ended", "out", "last person out [s]")
    parts = [table("Every run" if len(runs["run"]) <= MOST_LISTED else f"The first {MOST_LISTED} runs", columns, rows)]
    if len(runs["run"]) > MOST_LISTED:
        parts.append(note("open", items([f"The other {len(runs['run']) - MOST_LISTED} runs are in {RUNS_NAME}."])))
    return Section("runs", "Appendix: runs", tuple(parts))
