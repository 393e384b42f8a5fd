"""Findings about a building, and the names of its parts."""

import itertools
import re
from bisect import bisect_left
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from evac.base.defaults import LONGEST_NAME
from evac.base.errors import BuildingError, EvacError, is_one_line

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from evac.base.arrays import FloatArray
    from evac.building.model.building import Level

Value = TypeVar("Value")


def repaired(name: str) -> str:
    """Return a name in one line of at most `LONGEST_NAME` characters; usually the name itself."""
    if not is_one_line(name):
        name = " ".join("".join(sign if is_one_line(sign) else " " for sign in name).split()) or "unnamed"
    return name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 3]}..."


def numbered(name: str, taken: Container[str]) -> str:
    """Return the name, or if it is taken the name with a free number from 2 on: ``door (2)``."""
    if name not in taken:
        return name
    most = next(2**power for power in itertools.count(1) if f"{name} ({2**power})" not in taken)
    number = bisect_left(range(most), True, lo=2, key=lambda one: f"{name} ({one})" not in taken)
    return f"{name} ({number})"


#: Kinds of findings, the worst first. Errors refuse the building; warnings are shown at every run, the others when a
#: file is imported; what is missing, such as a stair that cannot be used, makes an import incomplete.
FINDING_KINDS = ("error", "missing", "warning", "left out", "assumed", "repaired", "found")
#: What differs between findings that tell the same of several things: names in quotation marks, and numbers.
OWN = re.compile(r"'[^']*'|-?\d+(\.\d+)?")
PART = re.compile(r" \(\d+\)$")  #: Number at the end of the name of a level that is one of several parts of its storey.


@dataclass(frozen=True)
class Finding:
    """A fact about a building: something found, assumed, repaired, left out or missing, a warning, or an error.

    Its text form (``str``) begins with the place, if there is one, and ends with the remedy.

    >>> print(Finding("repaired", "a gap of 3 mm closed", "ground", (1.0, 2.0)))
    level 'ground' at (1.00, 2.00): a gap of 3 mm closed
    """

    kind: str  #: one of `FINDING_KINDS`
    text: str  #: description, with the action to take if there is one, without the place
    level: str | None = None  #: name of the level or storey
    place: tuple[float, ...] | None = None  #: position (x, y) on the level, or (x, y, z) [m]
    item: str | None = None  #: key of what it is about in the plan, such as ``doors.inner``
    #: what removes it, as far as it is known, as keys of the item with their values as in a plan file, one on a line,
    #: such as ``turn = "right"``; ``remove KEY``; or ``remove it``
    remedy: str = ""
    element: str = ""  #: kind of elements of a file that it is about, such as ``door`` or ``layer 'A-WALL'``
    number: int = 1  #: number of these elements, in the file if they are found, else those that are concerned

    def __post_init__(self) -> None:
        if self.kind not in FINDING_KINDS:
            raise ValueError(f"the kind of a finding must be one of {', '.join(FINDING_KINDS)}, not {self.kind!r}")

    @property
    def storey(self) -> str | None:
        """Name of the storey of its level, which may be one of several parts of the storey: ``ground (2)``."""
        return None if self.level is None else PART.sub("", self.level)

    @property
    def where(self) -> str:
        """Level and place as text; empty for a finding about the whole building."""
        at = "" if self.place is None else f"({', '.join(f'{value:z.2f}' for value in self.place)})"
        if self.level is None:
            return at
        return f"level {self.level!r} at {at}" if at else f"level {self.level!r}"

    def __str__(self) -> str:
        return f"{self.where}: {self.text}{self.advice}" if self.where else f"{self.text}{self.advice}"

    @property
    def advice(self) -> str:
        """The remedy as the end of a sentence; empty if there is none."""
        return f"; remedy: {', '.join(self.remedy.splitlines())}" if self.remedy else ""


def as_findings(given: "tuple[Finding | str, ...] | list[Finding | str]") -> tuple[Finding, ...]:
    """Convert texts to warnings; findings are returned unchanged."""
    return tuple(item if isinstance(item, Finding) else Finding("warning", item) for item in given)


def keyed(findings: Iterable[Finding], keys: Mapping[str, str]) -> list[Finding]:
    """Return findings with the keys that their items have in the plan of a building, as its `keys`."""
    return [replace(one, item=keys.get(one.item or "", one.item)) for one in findings]


def warnings_of(findings: tuple[Finding, ...] | list[Finding]) -> tuple[str, ...]:
    """Return the texts of the warnings among findings."""
    return tuple(str(finding) for finding in findings if finding.kind == "warning")


def account(findings: Iterable[Finding]) -> list[tuple[str, int, int, list[str]]]:
    """Return what became of the elements of a file: of each kind, the number read, the number left out, and why."""
    kinds: dict[str, list[Finding]] = {}
    for finding in findings:
        if finding.element:
            kinds.setdefault(finding.element, []).append(finding)
    rows = []
    for element, own in sorted(kinds.items()):
        total = sum(one.number for one in own if one.kind == "found")
        lost = [one for one in own if one.kind in ("left out", "missing", "error")]
        number = sum(one.number for one in lost)
        rows.append(
            (element, max(total - number, 0), number, [f"{group[0]}{and_more(group)}" for group in grouped(lost)])
        )
    return sorted(rows, key=lambda row: not row[1])  # what is of use comes first


def grouped(findings: Iterable[Finding]) -> list[list[Finding]]:
    """Return findings in groups of those that differ only in names, numbers and places, in the order of the first."""
    groups: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        groups.setdefault((finding.kind, OWN.sub("", finding.text)), []).append(finding)
    return [*groups.values()]


def listed(findings: Iterable[Finding]) -> list[tuple[int, list[Finding]]]:
    """Return findings, repeats together, with the numbers that they have in tables, pictures and as JSON."""
    return list(enumerate(grouped(one for one in findings if one.kind != "found"), start=1))


def numbered_rows(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """Return findings as plain data, repeats together; those of kind ``found`` have no number and come last."""
    groups: list[tuple[int | None, list[Finding]]] = [*listed(findings)]
    groups += [(None, own) for own in grouped(one for one in findings if one.kind == "found")]
    return [
        {"number": number, "kind": own[0].kind} | _row(own[0]) | {"others": [_row(one) for one in own[1:]]}
        for number, own in groups
    ]


def _row(finding: Finding) -> dict[str, Any]:
    return {name: getattr(finding, name) for name in ("storey", "level", "place", "item", "text", "remedy")}


def and_more(group: Sequence[Finding]) -> str:
    """Return what follows the first finding of a group in a list."""
    return f" (and {len(group) - 1} more like this)" if len(group) > 1 else ""


def refusal(source: Path, errors: Sequence[Finding]) -> BuildingError:
    """Return one error with a line for each of some errors; copies of an item that have the same one share a line."""
    of_items = [[one for one in errors if one.item == item] for item in dict.fromkeys(one.item for one in errors)]
    groups = (group for errors_of_item in of_items for group in grouped(errors_of_item))
    lines = (f"{source}: {first.text}{and_more([first, *rest])}{first.advice}" for first, *rest in groups)
    refused = BuildingError("\n".join(lines))
    refused.findings = tuple(errors)
    return refused


def findings_of(error: EvacError, source: Path | None) -> tuple[Finding, ...]:
    """Return the errors of an exception, or its lines without the file, and the findings about what is right."""
    lines = (line.removeprefix(f"{source}: ") for line in str(error).splitlines())
    own, building = (error.findings, error.building) if isinstance(error, BuildingError) else ((), None)
    errors = own or tuple(Finding("error", line) for line in lines)
    return errors if building is None else (*errors, *building.findings)


@contextmanager
def noting(
    errors: list[Finding], what: str, item: str, level: str | None = None, at: "BaseGeometry | FloatArray | None" = None
) -> Iterator[None]:
    """Collect a ValueError as an error about an item, at a shape or in the middle of a segment."""
    try:
        yield
    except ValueError as error:
        from evac.building.geometry import place_of  # imports shapely, which the keys of a case do not need

        errors.append(Finding("error", f"{what}: {error}", level, None if at is None else place_of(at), item))


def item_of(level: "Level") -> str:
    """Return the key of the storey or the stair of a level in the plan of its building."""
    return f"stairs.{level.stair}" if level.stair is not None else f"storeys.{PART.sub('', level.name)}"


def written(ends: "FloatArray") -> str:
    """Describe a segment for a message."""
    (x1, y1), (x2, y2) = ends
    return f"({x1:z.2f}, {y1:z.2f}) - ({x2:z.2f}, {y2:z.2f})"


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
