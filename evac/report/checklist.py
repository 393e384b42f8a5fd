"""What a documentation of an evacuation analysis should hold, point by point, and where the report has it."""

import tomllib
from collections.abc import Collection, Sequence
from functools import cache
from importlib.resources import files
from typing import NamedTuple

from markupsafe import Markup

from evac.report.templates import APPENDIX, Cell, Section, section


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
    text = files("evac.report").joinpath("checklist.toml").read_text(encoding="utf-8")
    return tuple(Point(**one) for one in tomllib.loads(text)["points"])


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
