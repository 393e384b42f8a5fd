"""Names in buildings: one line without control characters, of a bounded length."""

import unicodedata
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from evac.building.findings import Finding
from evac.defaults import LONGEST_NAME
from evac.errors import BuildingError

Value = TypeVar("Value")

#: Categories of Unicode that break lines, control terminals, or cannot be written: controls, surrogates, separators.
_CONTROL = frozenset({"Cc", "Cs", "Zl", "Zp"})


def is_one_line(text: str) -> bool:
    """Return whether a text contains neither line breaks nor other control characters, nor what XML cannot contain."""
    return text.isprintable() or not any(
        unicodedata.category(sign) in _CONTROL or sign in "\ufffe\uffff" for sign in text
    )


def escaped(text: str) -> str:
    """Return a text in which line breaks and control characters are escaped as in Python."""
    return text if is_one_line(text) else "".join(sign if is_one_line(sign) else repr(sign)[1:-1] for sign in text)


def repaired(name: str) -> str:
    """Return a name in one line of at most `LONGEST_NAME` characters; usually the name itself."""
    if not is_one_line(name):
        name = " ".join("".join(sign if is_one_line(sign) else " " for sign in name).split()) or "unnamed"
    return name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 3]}..."


def with_repaired_names(source: Path, tags: Mapping[str, Value], notes: list[Finding]) -> dict[str, Value]:
    """Return tags ``kind:NAME`` with repaired names, and note which have changed.

    Raises
    ------
    BuildingError
        Two tags become the same.
    """
    found: dict[str, Value] = {}
    for tag, value in tags.items():
        kind, colon, name = tag.partition(":")
        own = f"{kind}{colon}{repaired(name)}"
        if own in found:
            raise BuildingError(
                f"{source}: two names are {own!r} when written in one line of at most {LONGEST_NAME} characters; "
                "rename one"
            )
        if own != tag:
            text = f"the name {tag!r:.{2 * LONGEST_NAME}} is read as {own!r}: names are one line of at most "
            notes.append(Finding("repaired", f"{text}{LONGEST_NAME} characters"))
        found[own] = value
    return found
