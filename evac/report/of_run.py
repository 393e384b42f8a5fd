"""The report of one run."""

from pathlib import Path

from evac.base.errors import counted
from evac.folder.files import CROSSINGS_NAME, EGRESS_NAME, PEOPLE_NAME, SUMMARY_NAME, TRAJECTORY_NAME
from evac.report import figures
from evac.report.pages import BLANK, Head, Labels, Section, files_section, page, section
from evac.report.sections import (
    USUAL,
    Places,
    building_section,
    case_section,
    congestion_sections,
    design_section,
    fire_section,
    levels_section,
    margins_section,
    model_section,
    occupants_section,
    places_section,
    times_section,
)
from evac.report.verification import evidence_section, standard_section, verification_section
from evac.results.reading import read_results
from evac.results.results import Results

#: Files of a result folder whose digests are listed.
RESULT_FILES = (SUMMARY_NAME, PEOPLE_NAME, CROSSINGS_NAME, EGRESS_NAME, TRAJECTORY_NAME)

#: Ends of a run that it did not come to by itself.
STOPPED = ("interrupted", "failed")


def run_report(folder: Path, labels: Labels = BLANK, places: Places = USUAL) -> str:
    """Return the report of a run as a page of HTML."""
    run = read_results(folder)
    picture = figures.cover(run.trajectory) if run.trajectory else None
    head = Head(run.title or folder.name, "Evacuation analysis: one run", banner(run), main_results(run), picture)
    margins = margins_section(run)
    sections: list[Section] = [
        building_section(run),
        occupants_section(run.case_table, run),
        times_section(run),
        *([margins] if margins is not None else []),
        *([fire_section(run)] if run.conditions else []),
        *congestion_sections(run, places),
        section("warnings", "Warnings", quality=quality_of(run), before=run.warnings, is_study=False),
        verification_section(run.case_table, run.keeps_distance),
        section("assessment", "Assessment"),
        section("limits", "Limits of use", is_study=False, has_fire=run.conditions is not None),
        model_section(run.case_table, run.versions, run.plugins, str(run.seed), "evac run case.toml --out RESULT"),
        *([levels_section(run.trajectory)] if run.trajectory is not None else []),
        places_section(run),
        design_section(run),
        standard_section(run.case_table, run.keeps_distance),
        evidence_section(),
        files_section(folder, RESULT_FILES),
        case_section(run.settings),
    ]
    return page(head, labels.filled(run.case_table.report), sections)


def main_results(run: Results) -> dict[str, object]:
    """Return the main results of a run, which open its report."""
    answer = run.answer
    return {
        "Answer": answer.verdict,
        "Evacuation": answer.times or "nobody is out",
        "Exits": "; ".join(answer.exits),
        "Queues": answer.queue or "not recorded",
        "People": str(run.number_of_people),
        **{f"At {place}": str(len(place.people)) for place in run.places},
        **{f"Note {number}": note for number, note in enumerate(run.notes, 1)},
        "End of the run": f"{run.ended}, after {run.time:.1f} s of simulated time ({run.steps} steps)",
        "Number of runs": f"1, with seed {run.seed}; a single run does not show the variation of times",
        "Quality warnings": str(len(run.quality_warnings)),
        "Warnings about building and people": str(len(run.warnings)),
    }


def banner(run: Results) -> str:
    """Return what makes the results of a run incomplete, empty if nothing does."""
    left = len(run.leaving) - run.evacuated
    inside = f"{left} of {run.number_of_people} people were still inside after {run.time:.1f} s."
    if run.not_arrived:
        inside += f" {counted(run.not_arrived, 'person', 'people')} had not entered the building."
    if len(run.stopped):
        inside += f" {counted(len(run.stopped), 'person has', 'people have')} been stopped by gases or heat."
    if run.ended in STOPPED:
        return f"This run was stopped before its end ({run.ended}); its results are incomplete. {inside}"
    return f"Not everybody left the building ({run.ended}): {inside}" if left or run.not_arrived else ""


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
