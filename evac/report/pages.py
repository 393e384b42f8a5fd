"""The page of a report: templates that escape what they show, its head, its numbered sections, and its checklist."""

import base64
import re
import tomllib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
from jinja2 import ChoiceLoader, DictLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from evac.base.distributions import as_text
from evac.base.errors import counted
from evac.folder.files import digest_of_file, replacing, writing
from evac.report.figures import Picture
from evac.results.recordedcase import ReportTable
from evac.results.tables import TABLES, Rows
from evac.results.verdict import Verdict

#: Words longer than this may be broken in a line.
LONG_WORD = re.compile(r"(\S{24})(?=\S{8})")

#: Families of the page, their files, and the weights for which they are used.
FONTS = (
    ("Page", "DejaVuSans.ttf", "400"),
    ("Page", "DejaVuSans-Bold.ttf", "600 900"),
    ("Page Mono", "DejaVuSansMono.ttf", "400"),
)

#: Shown where there is no value.
NOTHING = "-"

#: Beginning of the titles of appendices.
APPENDIX = "Appendix: "


@dataclass(frozen=True)
class Section:
    """A section of a report."""

    id: str  # target of links
    title: str  # begins with `APPENDIX` for appendices
    content: Markup
    is_missing: bool = False  # whether it only says that what belongs there is not known
    lacks: tuple[str, ...] = ()  # contents that it lacks although it is not missing, such as "doors"


class Cell(NamedTuple):
    """A cell of a table whose colour says more than its words: ``"good"``, ``"bad"`` or ``"open"``."""

    content: object
    kind: str


#: Kinds of cells by the status of a verdict.
BADGES = {"green": "good", "amber": "open", "red": "bad", "none": ""}


def read(name: str) -> str:
    """Return the text of a file beside this module."""
    return files("evac.report").joinpath(name).read_text(encoding="utf-8")


def section(
    id_: str, title: str, template: str = "", *, is_missing: bool = False, lacks: tuple[str, ...] = (), **data: Any
) -> Section:
    """Return a section, rendered from a template; by default the part of sections.html with its id."""
    content = Markup(templates().get_template(template or id_).render(data))
    return Section(id_, title, content, is_missing, lacks)


def fixed(value: float | None, digits: int) -> str | None:
    """Return a number with so many digits behind the point; None for None, NaN and infinity."""
    return None if value is None or not abs(value) < float("inf") else f"{value:.{digits}f}"


def shown(value: object) -> Markup:
    """Return a value as text of a page: nothing as a dash, floats short, truth as yes or no, long words breakable."""
    if isinstance(value, Markup):
        return value
    if value is None or value == "":
        return Markup(NOTHING)
    if isinstance(value, bool):
        return Markup("yes" if value else "no")
    words = f"{value:.4g}" if isinstance(value, float) else str(value)
    return Markup("<wbr>").join(LONG_WORD.sub("\\1\0", words).split("\0"))


def rendered(template: str, **data: Any) -> str:
    """Return a page, rendered from a template that extends `frame.html`, whose ``title`` and ``kind`` are in `data`."""
    style = Markup(read("page.css"))
    page = templates().get_template(template).render(style=style, generator=f"evac {version('evac')}", **data)
    return page.replace("</style>", f"{_fonts(page)}</style>", 1)


def _fonts(page: str) -> str:
    """Return the style with the fonts of matplotlib, by which lines and pages are divided alike on all machines."""
    from fontTools.subset import Options, Subsetter, load_font, save_font

    options = Options(flavor="woff", hinting=False, layout_features=["kern", "tnum"], notdef_outline=True)
    options.drop_tables += ["FFTM"]
    rules = []
    for family, file, weight in FONTS:
        packed, subsetter = BytesIO(), Subsetter(options)
        subsetter.populate(unicodes=map(ord, set(page)))
        with load_font(Path(matplotlib.get_data_path(), "fonts", "ttf", file), options) as font:
            subsetter.subset(font)
            save_font(font, packed, options)
        data = base64.b64encode(packed.getvalue()).decode()
        face = f'font-family: "{family}"; font-weight: {weight}; src: url(data:font/woff;base64,{data})'
        rules.append(f"@font-face {{ {face}; }}\n")
    return "".join(rules)


@cache
def templates() -> Environment:
    """Return the templates beside this module; every value that they show is escaped, or is markup of another one."""
    _, *parts = re.split(r"\{# section (\w+) #\}\n", read("sections.html"))
    sections = DictLoader(dict(zip(parts[::2], parts[1::2], strict=True)))
    made = Environment(
        loader=ChoiceLoader([sections, PackageLoader("evac.report", "")]),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.globals |= {"columns_of": _columns_of, "counted": counted, "tables_of": TABLES, "cells_of": cells_of}
    made.filters |= {"fixed": fixed, "as_text": as_text}
    return made


def cells_of(name: str, rows: Rows) -> list[tuple[object, ...]]:
    """Return the rows of one of the `TABLES` as text: times and shares with one digit behind the point, others two."""

    def cell(value: Any, head: str) -> object:
        if value == float("inf"):
            return TABLES[name].never
        return fixed(value, 1 if head.endswith(("[s]", "[%]")) else 2) if isinstance(value, float) else value

    return [tuple(map(cell, row, TABLES[name].head)) for row in rows]


def _columns_of(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> tuple[list[str], list[list[Any]]]:
    """Return the classes of the columns of a table, numbers on the right, and its cells with contents and classes."""
    cells = [[cell if isinstance(cell, Cell) else Cell(cell, "") for cell in row] for row in rows]
    classes = [
        "number" if cells and all(_is_numeric(row[index].content) for row in cells) else ""
        for index in range(len(columns))
    ]
    return classes, [
        [(cell.content, f"{kind} {cell.kind}".strip()) for kind, cell in zip(classes, row, strict=True)]
        for row in cells
    ]


def _is_numeric(value: object) -> bool:
    """Return whether a value is right-aligned: numbers, formatted ones too, and nothing."""
    if value is None or (isinstance(value, int | float) and not isinstance(value, bool)):
        return True
    if not isinstance(value, str) or isinstance(value, Markup):
        return False
    try:
        float(value.removesuffix(" %"))
    except ValueError:
        return value in (NOTHING, "not reached")
    return True


class Point(NamedTuple):
    """A point of the documentation; of what the author has to add, it names what applies."""

    words: str
    sections: Sequence[str]  # that have it, where they are part of the report
    author: str = ""
    of_run: str = ""  # for the report of a single run
    content: str = ""  # that the sections need, see `Section.lacks`
    without: str = ""  # if a section lacks it


@cache
def points() -> tuple[Point, ...]:
    """Return the points of the documentation, which are listed in checklist.toml."""
    return tuple(Point(**table) for table in tomllib.loads(read("checklist.toml"))["points"])


def checklist_section(numbers: dict[str, str], lacking: Collection[str] = ()) -> Section:
    """Return the checklist."""
    rows = [(str(number), point.words, *_where(point, numbers, lacking)) for number, point in enumerate(points(), 1)]
    return section("checklist", f"{APPENDIX}checklist of the documentation", rows=rows)


def _where(point: Point, numbers: dict[str, str], lacking: Collection[str]) -> tuple[Cell, str]:
    of_run = "" if "statistics" in numbers else point.of_run
    without = point.without if point.content in lacking else ""
    left = "; ".join(words for words in (point.author, of_run, without) if words)
    present = [section for section in point.sections if section in numbers]
    if not present:
        return Cell("not provided", "bad"), left or "add it"
    links = Markup(", ").join(Markup('<a href="#{}">{}</a>').format(key, numbers[key]) for key in present)
    return Cell(links, "open" if left else "good"), left or "nothing"


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
    verdict: Verdict
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
