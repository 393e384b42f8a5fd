"""The report of a study: many runs of a case."""

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from evac.base.distributions import as_text
from evac.base.errors import ResultError
from evac.folder.files import EGRESS_NAME, RUNS_NAME, STATISTICS_NAME, SUMMARY_NAME
from evac.folder.textfiles import checked, read_json
from evac.report import figures
from evac.report.pages import APPENDIX, BLANK, Cell, Head, Labels, Section, files_section, fixed, page, section
from evac.report.sections import (
    MARGINS,
    USUAL,
    PlaceSettings,
    case_section,
    congestion_sections,
    levels_section,
    model_section,
    occupants_section,
    places_section,
    plan_section,
    safety_cells,
    times_section,
    walking_of,
)
from evac.report.verification import verification_section
from evac.results.ending import FAILED
from evac.results.reading import read_results
from evac.results.recordedcase import CaseTable, Record
from evac.results.results import Results
from evac.results.tables import HYDRAULIC, TABLES
from evac.study.maps import maps_over_runs
from evac.study.outputs import egress, hold_up_of, parameter_keys, people_at, points_table, quality_of, statistics_table
from evac.study.statistics import MEDIAN, Estimate, estimate
from evac.study.study import Study

#: Percentiles over runs of what exits have [%].
PERCENTILES = (5, 50, 95)

#: Tables of the sections over runs.
WHO, WHAT = ("shares", "groups", "phases", "cleared", "exits"), ("queues", "congestion", "doses", "outcomes")
WHERE = ("levels", "stairs", "merging", "flows")

#: Greatest number of runs that are listed one by one; the others are in runs.csv.
MOST_LISTED = 100

#: Greatest number of seeds in a line.
MOST_SEEDS = 20


#: Columns of the rows of runs that a report shows.
ROW = ("point", "run", "seed", "ended", "people", "out", "last_out", "quality_warnings")


class StudySummary(Record):
    """What the summary of a study contains besides its numbers, which are those of its rows."""

    title: str
    plugins: list[str]
    versions: dict[str, str]
    keeps_distance: list[str]
    table: CaseTable = Field(alias="case")


def is_study(folder: Path) -> bool:
    """Return whether a folder is that of a study."""
    return (folder / STATISTICS_NAME).is_file() and (folder / RUNS_NAME).is_file()


def study_report(folder: Path, runs: Sequence[Path] = (), labels: Labels = BLANK, places: PlaceSettings = USUAL) -> str:
    """Return the report of a study as a page of HTML."""
    study = Study.read(folder)
    data = read_json(folder / SUMMARY_NAME)
    summary = checked(StudySummary, data, folder / SUMMARY_NAME)
    members = [read_results(path) for path in runs]
    for run in members:
        check_member(study, data["case"], run)
    first = members[0] if members else None
    sources = [as_text(table) for table in data["case"].get("conditions") or ()]
    rows, building = list(study.rows(columns=ROW, failed=True)), study.building()
    sections = [
        plan_section(building, (), summary.table.building),
        *([levels_section(building)] if building is not None else []),
        occupants_section(summary.table, building, _sizes(study, summary.table), first),
        model_section(
            summary.table,
            summary.versions,
            summary.plugins,
            _ranges(sorted({row["seed"] for row in rows})),
            _command(study),
        ),
        verification_section(summary.table, summary.keeps_distance),
        *_points(study),
        _statistics(study),
        *_margins(data["points"]),
        *([section("fire", "Smoke, gases and heat", "sources", sources=sources)] if sources else []),
        _over_runs(study, "exits", "People out, groups, phases and exits over runs", WHO),
        _over_runs(study, "outcomes", "Queues, hydraulic time, events, smoke, doses and margins over runs", WHAT),
        _over_runs(study, "parts", f"{APPENDIX}levels, stairs and flows over runs", WHERE),
        *_maps(study, places),
        *(section for number, run in enumerate(members, 1) for section in _of_run(run, number, places)),
        section("warnings", "Warnings", quality=quality_of(study), is_study=True),
        section("assessment", "Assessment"),
        section("limits", "Limits of use", is_study=True, has_fire=bool(sources)),
        _runs(study, rows),
        files_section(folder, (SUMMARY_NAME, STATISTICS_NAME, RUNS_NAME, EGRESS_NAME)),
        case_section(data["case"]),
    ]
    title = summary.title or folder.name
    picture = figures.cover(first.trajectory) if first is not None and first.trajectory else None
    kind, verdict = f"Evacuation analysis: {len(rows)} runs", data["verdict"]
    results = _results(study, rows) | {"Walking": walking_of(summary.table, summary.keeps_distance)}
    head = Head(title, kind, verdict, _banner(study), results, picture)
    return page(head, labels.filled(summary.table.report), sections)


def _sizes(study: Study, case: CaseTable) -> dict[str, int]:
    """Return the numbers of people of the groups; of those that it does not state, those who leave in the first run."""
    tables = next((row["tables"] for row in study.rows(0, ("tables",))), ())
    told = {one["row"]: int(one["value"]) for one in tables if (one["table"], one["column"]) == ("groups", "people")}
    return {group.name: group.size or told.get(group.name, 0) for group in case.people}


def check_member(study: Study, case: Mapping[str, Any], run: Results) -> None:
    """Refuse a run that is none of the first point of a study with a case."""
    place = f"{run.folder}: is no run of {study.folder}"
    row = next((row for row in study.rows(0, ("seed", "last_out"), failed=True) if row["seed"] == run.seed), None)
    if row is None:
        raise ResultError(f"{place}: its seed {run.seed} is none of those of the first point")
    for key in ("people", "building", "contact", "forces", "behaviours", "directions"):
        if run.settings.get(key) != case.get(key):
            raise ResultError(f"{place}: [{key}] of its case differs; run the case of the study with that seed")
    last = run.last_out if run.is_complete else None
    if row["last_out"] != last:
        there, here = ("at no time" if time is None else f"at {time} s" for time in (row["last_out"], last))
        raise ResultError(f"{place}: with seed {run.seed} the last person leaves {there} there and {here} here")


def _ranges(seeds: Sequence[int]) -> str:
    """Return seeds as ranges."""
    if seeds and seeds[-1] - seeds[0] + 1 == len(seeds) > 1:
        return f"{seeds[0]} to {seeds[-1]}, a run with each"
    return _listed([str(seed) for seed in seeds])


def _command(study: Study) -> str:
    """Return the command that repeats a study."""
    rule = study.rule
    number = f"--runs {rule.most}"
    if rule.until is not None:
        number = (
            f'--until {100.0 * rule.until:g}% --statistic "{rule.statistic}" --least {rule.least} --most {rule.most}'
        )
    if rule.repetitions > 1:
        number += f" --repetitions {rule.repetitions}"
    if len(study.points) == 1 and not study.points[0].parameters:
        return f"evac repeat case.toml {number} --out STUDY"
    return f"evac sweep case.toml --table points.csv {number} --out STUDY"


def _banner(study: Study) -> str:
    runs, blocked, failed = study.counts
    lines = []
    if failed:
        lines.append(f"{failed} of {runs + failed} runs failed and are in no statistic.")
    if blocked:
        lines.append(f"{blocked} of {runs} runs ended with people inside; their evacuation time counts as infinite.")
    return " ".join(lines)


def _noted(estimate: Estimate, form: str = ".2f") -> str:
    return "; ".join(part for part in (estimate.words(form), estimate.note) if part)


def _results(study: Study, rows: Sequence[Mapping[str, Any]]) -> dict[str, object]:
    """Return the main results, which open the report: of the only point, or how many there are."""
    runs, blocked, failed = study.counts
    results: dict[str, object] = {"Number of runs": str(len(rows))}
    if len(study.points) > 1:
        results["Variants"] = f"{len(study.points)}, see below"
    else:
        estimates, hold_up = study.statistics[0], hold_up_of(study, 0)
        people = sorted({row["people"] for row in rows if row["ended"] != FAILED})
        results |= {
            "People": ", ".join(map(str, people)),
            **{what.capitalize(): number for what, number in people_at(study, 0).items()},
            **{
                f"Evacuation time, {one.name}{' of complete runs' * (one is estimates.mean)} [s]": _noted(one)
                for one in (estimates.mean, *estimates.percentiles)
            },
            "Queues": hold_up or "not recorded",
            "Second opinion": _hydraulic_answer(study),
        }
    if study.step_change is not None:
        results["Change of the mean with half the time step [s]"] = _noted(study.step_change, "+.2f")
    if failed:
        results["Failed runs"] = f"{failed} of {runs + failed}"
    results["Blocked runs"] = f"{blocked} of {runs}"
    results["Runs with quality warnings"] = f"{sum(bool(row['quality_warnings']) for row in rows)} of {len(rows)}"
    return results


def _hydraulic_answer(study: Study) -> str:
    """Return the hydraulic evacuation time over the runs of the first point."""
    numbers = (number for row in study.rows(0, ["tables"]) for number in row["tables"])
    times = [number["value"] for number in numbers if number["row"] == HYDRAULIC]
    if not times:
        return "Not computed"
    apart = 100.0 * (float(np.median(study.times(0))) / float(np.median(times)) - 1.0)
    own = (
        f"; that of the runs is {abs(apart):.0f} % {'less' if apart < 0.0 else 'more'}" if math.isfinite(apart) else ""
    )
    value = _noted(estimate(MEDIAN, np.array(times)), ".1f")
    return f"The hydraulic evacuation time [s], median over runs, is {value}{own}"


def _points(study: Study) -> Iterator[Section]:
    """Yield the section on the points of a sweep."""
    keys = parameter_keys(study)
    if not keys:
        return
    heads, rows = points_table(study)
    numbered = [
        (str(point), *(None if cell is None else as_text(cell) for cell in row)) for point, row in enumerate(rows)
    ]
    yield section("points", "Variants", columns=["point", *heads], rows=numbered, file=_points_file(study, keys))


def _points_file(study: Study, keys: Sequence[str]) -> str:
    """Return the parameters of points as evac sweep --table reads them."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(keys)
    for point in study.points:
        values = (point.parameters.get(key, "") for key in keys)
        writer.writerow([value if isinstance(value, str) else json.dumps(value) for value in values])
    return file.getvalue()


def _statistics(study: Study) -> Section:
    """Return the section on evacuation times over runs."""
    points = []
    for point, estimates in zip(study.points, study.statistics, strict=True):
        points.append(
            {
                "name": ", ".join(f"{key} = {as_text(value)}" for key, value in point.parameters.items()),
                "rows": statistics_table(study, point.index),
                "picture": figures.egress_over_runs(study.people(point.index), egress(study, point.index))
                if estimates.runs
                else None,
            }
        )
    return section("statistics", "Evacuation times over runs", points=points)


def _margins(points: Sequence[Mapping[str, Any]]) -> Iterator[Section]:
    """Yield a section for each point of a summary with limits."""
    for k, safety in enumerate(point["safety"] for point in points):
        if safety is not None:
            suffix, where = (f"-{k}", f": point {k}") if len(points) > 1 else ("", "")
            rows, factor = safety_cells(safety), safety["factor"]
            yield section(f"margins{suffix}", f"{MARGINS}{where}", "margins", rows=rows, factor=factor, worst=())


def _spread(values: Sequence[float]) -> tuple[object, ...]:
    """Return the number of runs with a finite value, their mean, median with its interval, and other percentiles."""
    known = np.array([value for value in values if math.isfinite(value)])
    if not len(known):
        return (0, *[None] * 4)
    if np.ptp(known) == 0.0:
        return len(known), f"{known[0]:.4g}", *[None] * 3
    median, digits = estimate(MEDIAN, known), 2 if np.abs(known).max() < 10.0 else 1
    low, high = (fixed(float(np.percentile(known, of)), digits) for of in (PERCENTILES[0], PERCENTILES[-1]))
    bounds = median.bounds(f".{digits}f")
    middle = f"{fixed(median.value, digits)} ({bounds})" if bounds else fixed(median.value, digits)
    return len(known), fixed(float(known.mean()), digits), low, middle, high


def _over_runs(study: Study, id_: str, title: str, names: Sequence[str]) -> Section:
    """Return a section with some of the tables of runs over runs; nothing of what is zero in all of them."""
    points = []
    for point in study.points:
        values: dict[str, dict[tuple[str, str], list[float]]] = {name: {} for name in names}
        for row in study.rows(point.index, ["tables"]):
            for number in row["tables"]:
                if number["table"] in values:
                    values[number["table"]].setdefault((number["row"], number["column"]), []).append(number["value"])
        rows = {
            f"{TABLES[name].caption}, over runs": [(*place, *_spread(of)) for place, of in own.items() if any(of)]
            for name, own in values.items()
        }
        points.append([table for table in rows.items() if table[1]])
    return section(id_, title, "over_runs", points=points, names=[point.label for point in study.points])


def _maps(study: Study, places: PlaceSettings) -> Iterator[Section]:
    """Yield a section with the maps over the runs of each point that has some."""
    for point in study.points:
        building, maps = study.building(point.index), maps_over_runs(study, point.index)
        if building is not None and maps:
            suffix = f"-{point.index}" if point.index else ""
            where = f", {point.label}" if point.label else ""
            pictures, without = figures.maps_of_runs(building, maps, places.maps, places.service)
            title = f"{APPENDIX}maps over runs{where}"
            yield section(f"run_maps{suffix}", title, "maps", pictures=pictures, without=without)


def _of_run(run: Results, number: int, places: PlaceSettings) -> Iterator[Section]:
    """Yield the sections on one run: its places, course and times, congestion and maps."""
    name = f"Run with seed {run.seed}"
    suffix = "" if number == 1 else f"-{number}"
    yield places_section(run, f"places{suffix}", f"{name}: ")
    for part in (times_section(run), *congestion_sections(run, places)):
        appendix = APPENDIX if part.title.startswith(APPENDIX) else ""
        title = f"{appendix}{name}: {part.title.removeprefix(appendix).lower()}"
        yield replace(part, id=f"{part.id}{suffix}", title=title)


def _listed(words: Sequence[str]) -> str:
    return ", ".join(words[:MOST_SEEDS]) + (" ..." if len(words) > MOST_SEEDS else "")


def _runs(study: Study, rows: Sequence[Mapping[str, Any]]) -> Section:
    """Return the appendix with a row for each run."""
    listed = []
    for row in rows[:MOST_LISTED]:
        why = FAILED if row["ended"] == FAILED else "people left"
        last = fixed(row["last_out"], 2) or Cell(why, "bad")
        point = () if len(study.points) == 1 else (str(row["point"]),)
        out = f"{row['out']} of {row['people']}"
        listed.append((*point, str(row["run"]), str(row["seed"]), row["ended"], out, last))
    is_single = len(study.points) == 1
    return section("runs", f"{APPENDIX}runs", rows=listed, is_single=is_single, number=len(rows), file=RUNS_NAME)
