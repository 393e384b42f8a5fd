"""Templates of reports: they escape every value that they show."""

import base64
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from evac.base.distributions import told
from evac.base.errors import counted

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


def section(
    id_: str, title: str, template: str = "", *, is_missing: bool = False, lacks: tuple[str, ...] = (), **data: Any
) -> Section:
    """Return a section, rendered from a template; by default the one with the name of its id."""
    content = Markup(templates().get_template(template or f"{id_}.html").render(data))
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
    style = Markup(files("evac.report").joinpath("page.css").read_text(encoding="utf-8"))
    page = templates().get_template(template).render(style=style, generator=f"evac {version('evac')}", **data)
    return page.replace("</style>", f"{_fonts(page)}</style>", 1)


def _fonts(page: str) -> str:
    """Return the style with the letters of a page in the fonts that come with matplotlib, so that lines and pages are
    divided alike on all machines.
    """
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
    made = Environment(
        loader=PackageLoader("evac.report", ""),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.globals |= {"columns_of": _columns_of, "counted": counted}
    made.filters |= {"fixed": fixed, "told": told}
    return made


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
