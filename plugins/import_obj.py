"""Importer of Wavefront OBJ files: polygons in groups.

meshio fails on texture indices. trimesh drops the names of groups, and divides non-convex polygons into fans, which
cover additional ground.
"""

import fnmatch
import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from evac.base.parameters import Parameter, did_you_mean
from evac.building.importer import Importer
from evac.building.model.findings import Finding
from evac.building.surface.surfacemesh import SurfaceMesh

#: Kinds of groups and the tags of their faces; ``ignore`` drops the faces.
KINDS = {"exit": "exit", "stair": "stair", "room": "area", "floor": "floor", "obstacle": "obstacle", "ignore": ""}
#: Kinds that are recognised by words in the name of a group, in the order of precedence.
WORDS = ("exit", "stair", "room", "floor")


class ObjImporter(Importer):
    """The vertices, faces, lines and groups (``v``, ``f``, ``l``, ``g``, ``o``) of Wavefront OBJ files.

    The kind of a group follows from `exit`, `stair`, `room` or `floor` in its name, or from `names`. Texture and normal
    indices (``f 1/2/3``) and all other lines are ignored; negative indices count from the last vertex read.
    """

    name = "obj"
    suffixes = (".obj",)

    names = Parameter(
        None,
        "kinds of groups, as a table of patterns to exit, stair, room, floor, obstacle, ignore or \"\": "
        'names = { "Treppe*" = "stair" }',
    )  # fmt: skip

    def read(self, path: Path) -> SurfaceMesh:
        """Read vertices, polygons and groups; raise ValueError, naming the line, if a line is invalid."""
        kinds = self._table()
        points: list[list[float]] = []
        faces: list[list[int]] = []
        edges: list[list[int]] = []
        groups, face_group, edge_group = [""], list[int](), list[int]()
        for number, line, (word, *rest) in _lines(path.read_bytes()):
            with _in_line(number, line):
                if word == "v":
                    points.append(_numbers(rest[:3], 3))
                elif word == "f":
                    faces.append(_corners(rest, len(points), 3))
                    face_group.append(len(groups) - 1)
                elif word == "l":
                    chain = _corners(rest, len(points), 2)
                    edges += [[a, b] for a, b in itertools.pairwise(chain)]
                    edge_group += [len(groups) - 1] * (len(chain) - 1)
                elif word in ("g", "o"):
                    groups.append(" ".join(rest))
        tags = [_tag(name, kinds) for name in groups]
        kept = [row for row, group in enumerate(face_group) if tags[group] != "ignore"]
        own = np.array([face_group[row] for row in kept], dtype=np.int64)
        cell_tags, edge_tags, findings = {}, {}, []
        for tag in sorted({tags[group] for group in face_group} - {"", "ignore"}):
            cell_tags[tag] = np.isin(own, [group for group in range(len(tags)) if tags[group] == tag])
            findings.append(Finding("found", f"group of {int(cell_tags[tag].sum())} faces: {tag}"))
        for tag in sorted({tags[group] for group in edge_group if tags[group].startswith("exit:")}):
            edge_tags[tag] = [edge for edge, group in zip(edges, edge_group, strict=True) if tags[group] == tag]
            findings.append(Finding("found", f"group of {len(edge_tags[tag])} lines: {tag}"))
        if len(kept) < len(faces):
            names = sorted({groups[group] for group in face_group if tags[group] == "ignore"})
            number, text = len(faces) - len(kept), f"faces of the groups {', '.join(names)} (names)"
            findings.append(Finding("left out", f"{number} {text}", element="face", number=number))
        return SurfaceMesh(points, [faces[row] for row in kept], cell_tags, edge_tags, findings)

    def _table(self) -> dict[str, str]:
        """Return the checked table of name patterns and kinds."""
        given = self.names or {}
        if not isinstance(given, dict):
            raise ValueError(f'names: must be a table such as {{ "Treppe*" = "stair" }}, not {given!r}')
        for pattern, kind in given.items():
            if kind not in ("", *KINDS):
                raise ValueError(f"names: {pattern!r}: unknown kind {kind!r}; {did_you_mean(str(kind), list(KINDS))}")
        return given


def _lines(data: bytes) -> Iterator[tuple[int, str, list[str]]]:
    """Yield the number, the text and the words of each line that has words."""
    text = data.decode("utf-8-sig", errors="replace").replace("\\\n", " ")
    if "\0" in text:
        raise ValueError("the text is not UTF-8; save it as UTF-8")
    for number, line in enumerate(text.splitlines(), start=1):
        if words := line.partition("#")[0].split():
            yield number, line.strip(), words


@contextmanager
def _in_line(number: int, line: str) -> Iterator[None]:
    """Name the line in errors."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"line {number}: {line!r}: {error}") from error


def _corners(words: list[str], n_points: int, least: int) -> list[int]:
    """Return the rows of the vertices of a face or a line, of which there must be at least so many."""
    if len(words) < least:
        raise ValueError(f"it has only {len(words)} corners, not at least {least}")
    numbers = [_whole(_numbers([word.partition("/")[0]])[0]) for word in words]
    if 0 in numbers or min(numbers) < -n_points:
        raise ValueError("a corner does not exist; vertices are counted from 1, or from -1 backwards")
    return [number - 1 if number > 0 else n_points + number for number in numbers]


def _tag(group: str, kinds: dict[str, str]) -> str:
    """Return the tag of a group, ``"ignore"``, or an empty string."""
    for pattern, kind in kinds.items():
        if fnmatch.fnmatchcase(group.lower(), pattern.lower()):
            return kind if kind in ("", "ignore") else f"{KINDS[kind]}:{group}"
    found = next((word for word in WORDS if word in group.lower()), "")
    return f"{KINDS[found]}:{group}" if found else ""


def _numbers(words: list[str], count: int = 0) -> list[float]:
    """Return words as numbers, of which there must be at least so many."""
    if len(words) < count:
        raise ValueError(f"it has only {len(words)} of {count} numbers")
    try:
        return [float(word) for word in words]
    except ValueError:
        raise ValueError("a word is not a number") from None


def _whole(value: float) -> int:
    """Return the integer that a corner or a number of corners must be."""
    if not float(value).is_integer() or abs(value) > 2**31:
        raise ValueError(f"{value:g} is not an integer, or too large")
    return int(value)
