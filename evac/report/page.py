"""The page of a report: its head, its numbered sections, and the file it is written to."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from string import Template

from evac.folder.files import replacing, writing
from evac.report.checklist import checklist_section
from evac.report.html import Html, Section, element, facts, joined, link, note, paragraph, table, to_fill_in

#: Sections that begin on a new page when they are printed.
ON_A_NEW_PAGE = ("building", "verification", "times", "statistics", "congestion", "maps", "checklist", "case")

#: Sections that stay on one page.
TOGETHER = ("purpose", "assessment", "limits", "warnings")


@dataclass(frozen=True)
class Labels:
    """What somebody fills in, by hand on the printed report where it is None.

    Attributes
    ----------
    project, author, reviewer, date : str or None
    """

    project: str | None = None
    author: str | None = None
    reviewer: str | None = None
    date: str | None = None


#: Everything is filled in by hand.
BLANK = Labels()


@dataclass(frozen=True)
class Head:
    """What opens a report.

    Attributes
    ----------
    title : str
    kind : str
        What it is the report of.
    banner : str
        What makes the results incomplete; empty if nothing does.
    results : dict of str to object
        The main results.
    """

    title: str
    kind: str
    banner: str
    results: dict[str, object]


def page(head: Head, labels: Labels, sections: Iterable[Section], generator: str) -> str:
    """Return the whole page.

    Parameters
    ----------
    head : Head
    labels : Labels
    sections : iterable of Section
        In order; they are numbered, after the fields to fill in, and the checklist is put behind them, before
        appendices, whose titles begin with that word.
    generator : str
        Program and version.
    """
    given = [_purpose(), *sections]
    body = [one for one in given if not one.title.startswith("Appendix")]
    appendices = [one for one in given if one.title.startswith("Appendix")]
    numbers = {"project": "head"} | {one.id: str(number) for number, one in enumerate(body, 1)}
    numbers |= {one.id: chr(ord("A") + index) for index, one in enumerate(appendices)}
    missing = {one.id for one in given if one.is_missing}
    lacking = {content for one in given for content in one.lacks}
    checklist = checklist_section({name: number for name, number in numbers.items() if name not in missing}, lacking)
    numbers[checklist.id] = str(len(body) + 1)
    everything = [*body, checklist, *appendices]
    contents = (element("li", f"{numbers[one.id]} ", link(one.id, one.title)) for one in everything)
    parts = (
        element("h1", head.title),
        paragraph(head.kind, class_="kind"),
        *([note("bad", paragraph(head.banner, class_="banner"))] if head.banner else []),
        _labels(labels),
        _results(head.results),
        element("nav", element("ol", *contents)),
        *(_section(one, numbers[one.id]) for one in everything),
    )
    home = files("evac.report")
    return Template(home.joinpath("page.html").read_text(encoding="utf-8")).substitute(
        title=element("x", head.title)[3:-4],
        generator=element("x", generator)[3:-4],
        style=home.joinpath("page.css").read_text(encoding="utf-8"),
        content=joined(*parts),
    )


def write_page(text: str, path: Path) -> None:
    """Write a page, which replaces an earlier one as a whole.

    Raises
    ------
    ResultError
        The file cannot be written.
    """
    with writing("the report", path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path, "the report") as new:
        new.write_text(text, encoding="utf-8")


def assessment_section() -> Section:
    """Return the section that the author writes."""
    words = paragraph("To be written by the author: comparison with the protection goals, safety margins, conclusions.")
    return Section("assessment", "Assessment", (words, to_fill_in("assessment", class_="box")))


def files_section(folder: Path, names: Iterable[str]) -> Section:
    """Return the appendix with the files of a folder from which a report was made, if they exist."""
    rows = []
    for path in (folder / name for name in names):
        if path.is_file():
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            rows.append((path.name, f"{path.stat().st_size}", element("code", digest)))
    columns = ("file", "bytes", "SHA-256")
    return Section("files", "Appendix: files", (table("The files from which this report was made", columns, rows),))


def _purpose() -> Section:
    words = paragraph(
        "To be written by the author: purpose, protection goals, scenario, plans on which the building is based."
    )
    return Section("purpose", "Project and purpose", (words, to_fill_in("purpose", class_="box")))


def _labels(labels: Labels) -> Html:
    return element(
        "div",
        facts(
            {
                "Project": to_fill_in("project", labels.project),
                "Author": to_fill_in("author", labels.author),
                "Reviewer": to_fill_in("reviewer", labels.reviewer),
                "Date": to_fill_in("date", labels.date),
                "Signature": to_fill_in("signature", class_="signature"),
            }
        ),
        id="project",
        class_="together",
    )


def _results(results: dict[str, object]) -> Html:
    return element("div", facts(results), class_="together results")


def _section(section: Section, number: str) -> Html:
    title = section.title.removeprefix("Appendix: ")
    words = f"Appendix {number}: {title[:1].upper()}{title[1:]}" if title != section.title else f"{number} {title}"
    kinds = {"page": section.id in ON_A_NEW_PAGE, "together": section.id in TOGETHER}
    attributes = {"id": section.id, "class_": " ".join(name for name, holds in kinds.items() if holds)}
    return element("section", element("h2", words), *section.parts, **attributes)
