"""The report of one run, and the bundle from which somebody else repeats it."""

import posixpath
import tomllib
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from evac.base.errors import ResultError, counted
from evac.base.toml import case_text
from evac.folder.files import (
    CROSSINGS_NAME,
    EGRESS_NAME,
    PEOPLE_NAME,
    REPORT_NAME,
    SUMMARY_NAME,
    TRAJECTORY_NAME,
    replacing,
)
from evac.report import figures
from evac.report.pages import BLANK, Head, Labels, Section, files_section, page, section
from evac.report.sections import (
    USUAL,
    PlaceSettings,
    building_section,
    case_section,
    congestion_sections,
    design_section,
    fire_section,
    hydraulic_answer,
    levels_section,
    margins_section,
    model_section,
    occupants_section,
    places_section,
    times_section,
    walking_of,
)
from evac.report.verification import verification_section
from evac.results.reading import read_results
from evac.results.results import Results

#: Files of a result folder whose digests are listed.
RESULT_FILES = (SUMMARY_NAME, PEOPLE_NAME, CROSSINGS_NAME, EGRESS_NAME, TRAJECTORY_NAME)

#: Ends of a run that it did not come to by itself.
STOPPED = ("interrupted", "failed")


def run_report(folder: Path, labels: Labels = BLANK, places: PlaceSettings = USUAL) -> str:
    """Return the report of a run as a page of HTML."""
    run = read_results(folder)
    congestion = congestion_sections(run, places)  # first, because its pass over the motion finds the queues as well
    picture = figures.cover(run.trajectory) if run.trajectory else None
    head = Head(
        run.title or folder.name, "Evacuation analysis: one run", run.verdict, banner(run), main_results(run), picture
    )
    margins = margins_section(run)
    sections: list[Section] = [
        building_section(run),
        occupants_section(run.case_table, run.building_or_none, {own.name: len(own.rows) for own in run.groups}, run),
        times_section(run),
        *([margins] if margins is not None else []),
        *([fire_section(run)] if run.conditions else []),
        *congestion,
        section("warnings", "Warnings", quality=quality_of(run), before=run.warnings, is_study=False),
        verification_section(run.case_table, run.keeps_distance),
        section("assessment", "Assessment"),
        section("limits", "Limits of use", is_study=False, has_fire=run.conditions is not None),
        model_section(run.case_table, run.versions, run.plugins, str(run.seed), "evac run case.toml --out RESULT"),
        *([levels_section(run.trajectory.building, run.trajectory.changes)] if run.trajectory is not None else []),
        places_section(run),
        design_section(run),
        files_section(folder, RESULT_FILES),
        case_section(run.settings),
    ]
    return page(head, labels.filled(run.case_table.report), sections)


def main_results(run: Results) -> dict[str, object]:
    """Return the main results of a run, which open its report."""
    answer = run.answer
    return {
        "Answer": answer.outcome,
        "Evacuation": answer.times or "nobody is out",
        "Exits": "; ".join(answer.exits),
        "Queues": answer.queue or "not recorded",
        **({"Last person out": _last(run)} if run.evacuated else {}),
        "Second opinion": hydraulic_answer(run),
        "Walking": walking_of(run.case_table, run.keeps_distance),
        **{f"At {place}": str(len(place.people)) for place in run.places},
        **{f"Note {number}": note for number, note in enumerate(run.notes, 1)},
        "End of the run": f"{run.ended}, after {run.time:.1f} s of simulated time ({run.steps} steps)",
        "Number of runs": f"1, with seed {run.seed}; a single run does not show the variation of times",
        "Warnings": f"{len(run.quality_warnings)} of quality, {len(run.warnings)} about building and people",
    }


def _last(run: Results) -> str:
    """Return what the time of the last person who is out consists of: its response or arrival, and its way."""
    crowd, row = run.crowd, int(np.nanargmax(run.crowd.exit_time))
    start = float(np.fmax(crowd.start_time, crowd.arrival_time)[row])
    way = f"{crowd.distance[row]:.1f} m in {crowd.exit_time[row] - start:.1f} s"
    return f"Person {row}, who started to walk at {start:.1f} s, then {way}"


def banner(run: Results) -> str:
    """Return what makes the results of a run incomplete, empty if nothing does."""
    left = len(run.leaving) - run.evacuated
    inside = f"{left} of {run.number_of_people} people were still inside after {run.time:.1f} s."
    late = run.not_arrived - run.spare
    if late:
        inside += f" {counted(late, 'person', 'people')} had not entered the building."
    if len(run.stopped):
        inside += f" {counted(len(run.stopped), 'person has', 'people have')} been stopped by gases or heat."
    if run.ended in STOPPED:
        return f"This run was stopped before its end ({run.ended}); its results are incomplete. {inside}"
    return f"Not everybody left the building ({run.ended}): {inside}" if left or late else ""


def quality_of(run: Results) -> list[str]:
    """Return the quality warnings of a run, and warnings about its records."""
    lines = list(run.quality_warnings)
    if run.trajectory is not None:
        lines += run.trajectory.warnings
        if len(run.trajectory) and run.trajectory.time[0] > 0.0:
            lines.append(
                f"The recorded motion begins at {run.trajectory.time[0]:g} s: maps and congestion do not include"
                " earlier times."
            )
    for resumed in run.resumed:
        if resumed["differences"]:
            lines.append(
                f"The run was resumed from a checkpoint at {resumed['time']} s with other software or files:"
                f" {'; '.join(resumed['differences'])}"
            )
    return lines


#: Default file of `evac report --bundle`.
BUNDLE_NAME = "bundle.zip"

#: Keys of a case that name a file.
FILE_KEYS = ("mesh", "file")

#: Ending of the files that name other ones, relative to themselves.
PLAN = ".plan.toml"

README = """\
The run {title!r}, with seed {seed}, made by evac {evac}.

Versions (requirements.txt): install them with

    python -m pip install -r requirements.txt

Repeat the run in this folder with

    evac run case.toml --out repeated

people.csv and egress.csv in the folder "repeated" are then those of the run to the last bit, with these
versions and on the same kind of processor. summary.json and report.html are those of the run.
"""


def write_bundle(run: Results, report: str, path: Path) -> None:
    """Write a zip from which a run can be repeated; the files that it has read must be where they were."""
    folder = Path(run.source).parent.resolve()
    named = _names(folder, [Path(file) for file in run.files])
    settings = _renamed(run.settings, folder, named)
    plugins = [*settings["plugins"]["files"], *(name for path, name in named.items() if path.suffix == ".py")]
    settings["plugins"]["files"] = list(dict.fromkeys(plugins))
    words = {"title": run.title, "seed": run.seed, "evac": run.versions.get("evac", "")}
    packages = {name: version for name, version in run.versions.items() if name != "python"}
    texts = {
        "README.txt": README.format(**words),
        "requirements.txt": "".join(f"{name}=={version}\n" for name, version in packages.items()),
        "case.toml": case_text(settings),
        REPORT_NAME: report,
    }
    assert run.folder is not None
    with replacing(path, "the bundle") as new, zipfile.ZipFile(new, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in texts.items():
            archive.writestr(name, text)
        for file, name in {run.folder / SUMMARY_NAME: SUMMARY_NAME, **named}.items():
            if file.name.endswith(PLAN):
                archive.writestr(name, _plan(file, named))
            else:
                archive.write(file, name)


def _names(folder: Path, files: Iterable[Path]) -> dict[Path, str]:
    """Return the names in the zip of the files that a run has read."""
    # Those in the folder of the case keep their places; each other folder gets a number, below which files keep theirs.
    named, roots = dict[Path, str](), {folder: ""}
    for path in sorted(files, key=lambda path: (len(path.parts), path)):
        if not path.is_file():
            raise ResultError(f"{path}: the run has read this file, but it is missing; put it back")
        root = next((root for root in roots if path.is_relative_to(root)), path.parent)
        below = roots.setdefault(root, f"files/{len(roots)}/")
        named[path] = below + path.relative_to(root).as_posix()
    return named


def _plan(file: Path, named: Mapping[Path, str]) -> str:
    """Return the text of a plan file, with the places that the files of its storeys have in the zip."""
    text, place = file.read_text(encoding="utf-8-sig"), PurePosixPath(named[file]).parent
    table, beside = tomllib.loads(text), {path: posixpath.relpath(name, place) for path, name in named.items()}
    renamed = _renamed(table, file.parent, beside)
    return text if renamed == table else case_text(renamed)


def _renamed(value: Any, folder: Path, named: Mapping[Path, str]) -> Any:
    """Return a value of a case or a plan with the names that files have in the zip."""
    if isinstance(value, Mapping):
        return {
            key: named.get((folder / item).resolve(), item)
            if key in FILE_KEYS and isinstance(item, str)
            else [named.get((folder / name).resolve(), name) for name in item]
            if key == "files"
            else _renamed(item, folder, named)
            for key, item in value.items()
        }
    return [_renamed(item, folder, named) for item in value] if isinstance(value, list) else value
