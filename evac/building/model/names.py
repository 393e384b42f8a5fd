"""Names in buildings: one line without control characters, of a bounded length."""

import itertools
from collections.abc import Container, Mapping
from pathlib import Path
from typing import TypeVar

from evac.base.defaults import LONGEST_NAME
from evac.base.errors import BuildingError, is_one_line
from evac.building.model.findings import Finding

Value = TypeVar("Value")


def repaired(name: str) -> str:
    """Return a name in one line of at most `LONGEST_NAME` characters; usually the name itself."""
    if not is_one_line(name):
        name = " ".join("".join(sign if is_one_line(sign) else " " for sign in name).split()) or "unnamed"
    return name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 3]}..."


def numbered(name: str, taken: Container[str]) -> str:
    """Return the name, or if it is taken the name with the lowest free number from 2 on: ``door (2)``."""
    further = (f"{name} ({number})" for number in itertools.count(2))
    return next(own for own in itertools.chain([name], further) if own not in taken)


def with_repaired_names(source: Path, tags: Mapping[str, Value], notes: list[Finding]) -> dict[str, Value]:
    """Return tags ``kind:NAME`` with repaired names, and note which have changed."""
    renamed: dict[str, Value] = {}
    for tag, value in tags.items():
        kind, colon, name = tag.partition(":")
        own = f"{kind}{colon}{repaired(name)}"
        if own in renamed:
            raise BuildingError(
                f"{source}: two names are {own!r} when written in one line of at most {LONGEST_NAME} characters; "
                "rename one"
            )
        if own != tag:
            text = f"the name {tag!r:.{2 * LONGEST_NAME}} is read as {own!r}: names are one line of at most "
            notes.append(Finding("repaired", f"{text}{LONGEST_NAME} characters"))
        renamed[own] = value
    return renamed
