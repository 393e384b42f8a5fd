"""The page of a report: its head, its numbered sections, and the file it is written to."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from markupsafe import Markup

from evac.folder.digests import digest_of_file
from evac.folder.files import replacing, writing
from evac.report.checklist import checklist_section
from evac.report.figures import Picture
from evac.report.templates import APPENDIX, Section, rendered, section, shown
from evac.results.record import ReportTable


@dataclass(frozen=True)
class Labels:
    """What somebody fills in, by hand on the printed report where it is None."""

    project: str | None = None
    author: str | None = None
    reviewer: str | None = None
    date: str | None = None

    def filled(self, case: ReportTable) -> "Labels":
        """Return these labels, those that are missing from what the case says."""
        return replace(
            self, project=self.project or case.project, author=self.author or case.author, date=self.date or case.date
        )


#: Everything is filled in by hand.
BLANK = Labels()


@dataclass(frozen=True)
class Head:
    """What opens a report."""

    title: str
    kind: str  # what it is the report of
    banner: str  # what makes the results incomplete; empty if nothing does
    results: Mapping[str, object]
    picture: Picture | None = None


def page(head: Head, labels: Labels, sections: Iterable[Section]) -> str:
    """Return the whole page."""
    remarks = section("remarks", f"{APPENDIX}remarks of the reviewer")
    given = [section("purpose", "Project and purpose"), *sections, remarks]
    body = [part for part in given if not part.title.startswith(APPENDIX)]
    appendices = [part for part in given if part.title.startswith(APPENDIX)]
    numbers = {"project": "head"} | {part.id: str(number) for number, part in enumerate(body, 1)}
    numbers |= {part.id: chr(ord("B") + index) for index, part in enumerate(appendices)}
    missing = {part.id for part in given if part.is_missing}
    lacking = {content for part in given for content in part.lacks}
    checklist = checklist_section({name: number for name, number in numbers.items() if name not in missing}, lacking)
    numbers[checklist.id] = "A"
    return rendered(
        "page.html",
        title=head.title,
        kind=head.kind,
        head=head,
        labels=labels,
        sections=[*body, checklist, *appendices],
        first=checklist.id,
        numbers=numbers,
        appendix=APPENDIX,
    )


def write_page(text: str, path: Path) -> None:
    """Write a page, which replaces an earlier one as a whole."""
    with writing("the report", path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path, "the report") as new:
        new.write_text(text, encoding="utf-8")


def files_section(folder: Path, names: Iterable[str]) -> Section:
    """Return the appendix with the files of a folder from which a report was made, if they exist."""
    rows = []
    for path in (folder / name for name in names):
        if path.is_file():
            digest = Markup("<code>{}</code>").format(shown(digest_of_file(path)))
            rows.append((path.name, f"{path.stat().st_size}", digest))
    return section("files", f"{APPENDIX}files", rows=rows)
