"""HTML in pieces: all text is escaped once, where it becomes an element."""

import base64
import html
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

#: Words longer than this may be broken in a line.
LONG_WORD = re.compile(r"(\S{24})(?=\S{8})")

#: Tables of at most so many rows stay on one printed page.
MOST_TOGETHER = 14

#: Shown where there is no value.
NOTHING = "-"


class Html(str):
    """Markup that is complete; every other text is escaped when it is put into an element."""

    __slots__ = ()


@dataclass(frozen=True)
class Section:
    """A section of a report.

    Attributes
    ----------
    id : str
        Target of links.
    title : str
    parts : tuple of Html
        What is below the title.
    is_missing : bool
        Whether it only says that what belongs there is not known.
    lacks : tuple of str
        Contents that it lacks although it is not missing, such as ``"doors"``.
    """

    id: str
    title: str
    parts: tuple[Html, ...]
    is_missing: bool = False
    lacks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Cell:
    """A cell of a table whose colour says more than its words.

    Attributes
    ----------
    content : object
    kind : str
        ``"good"``, ``"bad"`` or ``"open"``.
    """

    content: object
    kind: str


def counted(number: int, one: str, several: str = "") -> str:
    """Return a number with its noun."""
    return f"{number} {one if number == 1 else several or one + 's'}"


def escaped(value: object) -> Html:
    """Return a value as text of a page: nothing as a dash, floats short, truth as yes or no."""
    if isinstance(value, Html):
        return value
    if value is None or value == "":
        return Html(NOTHING)
    if isinstance(value, bool):
        return Html("yes" if value else "no")
    words = f"{value:.4g}" if isinstance(value, float) else str(value)
    return Html("<wbr>".join(html.escape(part) for part in LONG_WORD.sub("\\1\0", words).split("\0")))


def fixed(value: float | None, digits: int) -> str | None:
    """Return a number with so many digits behind the point, or None."""
    return None if value is None else f"{value:.{digits}f}"


def element(tag: str, *content: object, **attributes: str) -> Html:
    """Return an element; empty attributes are left out, and an underscore behind a name is too (``class_``)."""
    given = "".join(f' {name.rstrip("_")}="{html.escape(value)}"' for name, value in attributes.items() if value)
    return Html(f"<{tag}{given}>{''.join(escaped(one) for one in content)}</{tag}>")


def joined(*parts: object) -> Html:
    """Return parts one after the other, each escaped unless it is markup."""
    return Html("".join(escaped(part) for part in parts))


def paragraph(*content: object, class_: str = "") -> Html:
    """Return a paragraph."""
    return element("p", *content, class_=class_)


def heading(words: str) -> Html:
    """Return a heading within a section."""
    return element("h3", words)


def items(lines: Iterable[object]) -> Html:
    """Return a list."""
    return element("ul", *(element("li", line) for line in lines))


def note(kind: str, *content: object) -> Html:
    """Return a box: ``"good"``, ``"bad"`` or ``"open"``."""
    return element("div", *content, class_=f"note {kind}")


def link(section: str, words: object) -> Html:
    """Return a link to a section of the page."""
    return element("a", words, href=f"#{section}")


def facts(rows: Mapping[str, object], caption: str = "") -> Html:
    """Return names and values, a row each."""
    above = [element("caption", caption)] if caption else []
    body = (element("tr", element("th", name, scope="row"), element("td", value)) for name, value in rows.items())
    return element("table", *above, element("tbody", *body), class_="facts")


def table(caption: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> Html:
    """Return a table; columns of numbers stand on the right."""
    rows = [list(row) for row in rows]
    numeric = [bool(rows) and all(_is_numeric(row[index]) for row in rows) for index in range(len(columns))]

    def cell(index: int, value: object) -> Html:
        kinds = ["number"] if numeric[index] else []
        if isinstance(value, Cell):
            kinds.append(value.kind)
            value = value.content
        return element("td", value, class_=" ".join(kinds))

    head = (
        element("th", name, scope="col", class_="number" if numeric[index] else "")
        for index, name in enumerate(columns)
    )
    body = (element("tr", *(cell(index, value) for index, value in enumerate(row))) for row in rows)
    is_short = len(rows) <= MOST_TOGETHER
    return element(
        "table",
        element("caption", caption),
        element("thead", element("tr", *head)),
        element("tbody", *body),
        class_="together" if is_short else "",
    )


def picture(data: bytes, kind: str, caption: str, words: str, class_: str = "drawing") -> Html:
    """Return a figure whose picture is part of the page.

    Parameters
    ----------
    data : bytes
        Of the file.
    kind : str
        ``"png"`` or ``"svg+xml"``.
    caption : str
    words : str
        What it shows, for those who cannot see it.
    class_ : str
        ``"drawing"``, or ``"map"``, of which a printed page has two.
    """
    source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
    image = Html(f'<img src="{source}" alt="{html.escape(words)}">')
    return element("figure", image, element("figcaption", caption), class_=class_)


def to_fill_in(name: str, value: str | None = None, class_: str = "line") -> Html:
    """Return a field of a form: its value, or room to write by hand or, in a browser, with the keyboard."""
    return element("div", value or Html(""), class_=f"field {class_}", contenteditable="true", title=name)


def _is_numeric(value: Any) -> bool:
    """Return whether a value is right-aligned: numbers, formatted ones too, and nothing."""
    if isinstance(value, Cell):
        value = value.content
    if value is None or (isinstance(value, int | float) and not isinstance(value, bool)):
        return True
    if not isinstance(value, str) or isinstance(value, Html):
        return False
    try:
        float(value.removesuffix(" %"))
    except ValueError:
        return value in (NOTHING, "not reached")
    return True
