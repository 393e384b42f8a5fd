"""Importers of meshes of polygons: Wavefront OBJ, OFF and PLY.

meshio fails on texture indices of OBJ, reads triangles of OFF only, and fails on edges and ``vertex_index`` of PLY.
trimesh drops the names of groups, and divides non-convex polygons into fans, which cover additional ground.
"""

import codecs
import fnmatch
import itertools
import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

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
                    faces.append(_checked_face(_corners(rest, len(points))))
                    face_group.append(len(groups) - 1)
                elif word == "l":
                    chain = _corners(rest, len(points))
                    if len(chain) < 2:
                        raise ValueError("a line has only one corner")
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


def _lines(data: bytes, first: int = 1) -> Iterator[tuple[int, str, list[str]]]:
    """Yield the number, the text and the words of each line that has words; `first`: number of the first line."""
    text = data.decode("utf-8-sig", errors="replace").replace("\\\n", " ")
    if "\0" in text:
        raise ValueError("the text is not UTF-8; save it as UTF-8")
    for number, line in enumerate(text.splitlines(), start=first):
        if words := line.partition("#")[0].split():
            yield number, line.strip(), words


@contextmanager
def _in_line(number: int, line: str) -> Iterator[None]:
    """Name the line in errors."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"line {number}: {line!r}: {error}") from error


def _checked_face(corners: list[int]) -> list[int]:
    """Return the corners of a face, at least three."""
    if len(corners) < 3:
        raise ValueError(f"a face has only {len(corners)} corners, not at least 3")
    return corners


def _corners(words: list[str], n_points: int) -> list[int]:
    """Return the rows of the vertices of a face or a line of OBJ."""
    numbers = [_whole(*_numbers([word.partition("/")[0]])) for word in words]
    if 0 in numbers or min(numbers, default=1) < -n_points:
        raise ValueError("a corner does not exist; vertices are counted from 1, or from -1 backwards")
    return [number - 1 if number > 0 else n_points + number for number in numbers]


def _tag(group: str, kinds: dict[str, str]) -> str:
    """Return the tag of a group, ``"ignore"``, or an empty string."""
    for pattern, kind in kinds.items():
        if fnmatch.fnmatchcase(group.lower(), pattern.lower()):
            return kind if kind in ("", "ignore") else f"{KINDS[kind]}:{group}"
    found = next((word for word in WORDS if word in group.lower()), "")
    return f"{KINDS[found]}:{group}" if found else ""


#: Format characters of `struct` for the types of PLY.
TYPES = {
    **{"char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H", "uint16": "H"},
    **{"int": "i", "int32": "i", "uint": "I", "uint32": "I"},
    **{"float": "f", "float32": "f", "double": "d", "float64": "d"},
}
#: A number of rows.
COUNT = re.compile(r"\d{1,15}")
#: Names of the property with the corners of a face.
CORNERS = ("vertex_indices", "vertex_index")


@dataclass
class _Element:
    """An element of PLY: name, number of rows, and properties (name, type, type of the length of a list or None)."""

    name: str
    count: int
    properties: list[tuple[str, str, str | None]] = field(default_factory=list)


class OffImporter(Importer):
    """OFF files (also COFF, NOFF, STOFF: values after x, y, z are ignored)."""

    name = "off"
    suffixes = (".off",)

    def read(self, path: Path) -> SurfaceMesh:
        """Read vertices and polygons; raise ValueError if the header, a count or a line is wrong."""
        lines = [*_lines(path.read_bytes())]
        if not lines or not re.fullmatch(r"(ST)?C?N?OFF", lines[0][2][0]):
            raise ValueError("the first word must be OFF")
        counts, rest = lines[0][2][1:], lines[1:]
        if not counts and rest:
            counts, rest = rest[0][2], rest[1:]
        if len(counts) < 2 or not all(COUNT.fullmatch(count) for count in counts[:2]):
            raise ValueError("the numbers of vertices and faces are missing")
        vertices = _Element("vertex", int(counts[0]), [(axis, "d", None) for axis in "xyz"])
        return _mesh([vertices, _Element("face", int(counts[1]), [(CORNERS[0], "i", "i")])], iter(rest))


class PlyImporter(Importer):
    """PLY files, text and binary."""

    name = "ply"
    suffixes = (".ply",)

    def read(self, path: Path) -> SurfaceMesh:
        """Read vertices and faces; raise ValueError if the file is truncated, or its header invalid."""
        data = path.read_bytes().removeprefix(codecs.BOM_UTF8)
        head, end, rest = data.partition(b"end_header")
        if not data.startswith(b"ply") or not end:
            raise ValueError("not a PLY file: the header is missing or incomplete")
        encoding, elements = _read_header(head.decode("ascii", errors="replace"))
        rest = rest[rest.index(b"\n") + 1 :] if b"\n" in rest else b""
        is_text, first = encoding == "ascii", head.count(b"\n") + 2
        return _mesh(elements, _lines(rest, first) if is_text else _unpacked(rest, encoding, elements))


def _read_header(head: str) -> tuple[str, list[_Element]]:
    """Return ``"ascii"`` or the byte order (``"<"``, ``">"``), and the elements."""
    encodings = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}
    encoding, elements = "", list[_Element]()
    for line in head.splitlines():
        match line.split():
            case ["format", name, _]:
                encoding = encodings.get(name, "")
            case ["element", name, count] if COUNT.fullmatch(count):
                elements.append(_Element(name, int(count)))
            case ["property", "list", length, kind, name] if elements and {length, kind} <= TYPES.keys():
                elements[-1].properties.append((name, TYPES[kind], TYPES[length]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append((name, TYPES[kind], None))
            case ["property" | "element", *_]:
                raise ValueError(f"header line {line.strip()!r} is invalid")
    if not encoding:
        raise ValueError("the header has no known format")
    return encoding, elements


def _unpacked(data: bytes, order: str, elements: list[_Element]) -> Iterator[tuple[int, str, list[float]]]:
    """Yield binary rows as `_lines` does those of a text; `order`: "<" or ">"."""
    at = number = 0

    def take(kind: str, count: int) -> list[float]:
        nonlocal at
        at += count * struct.calcsize(f"{order}{kind}")
        if at > len(data):
            raise ValueError(f"row {number} is truncated")
        return [*struct.unpack_from(f"{order}{count}{kind}", data, at - count * struct.calcsize(f"{order}{kind}"))]

    for element in elements:
        for number in range(1, element.count + 1):
            row = list[float]()
            for _, kind, length in element.properties:
                row += (count := take(length, 1) if length else [])
                row += take(kind, max(_whole(*count), 0) if length else 1)
            yield number, element.name, row
    if data[at:].strip():
        yield 0, "", []


def _mesh(elements: list[_Element], lines: Iterator[tuple[int, str, list[Any]]]) -> SurfaceMesh:
    """Return the mesh of the vertices and faces in the rows of a file; what else is on their lines is ignored."""
    points, faces = list[list[float]](), list[list[int]]()
    for element in elements:
        scalars = {name for name, _, length in element.properties if length is None}
        corners = next((name for name, _, length in element.properties if name in CORNERS and length), "")
        if element.name == "vertex" and not {"x", "y", "z"} <= scalars:
            raise ValueError("the vertices have no x, y, z")
        if element.name == "face" and not corners:
            raise ValueError(f"the faces have no list {' or '.join(CORNERS)}")
        for number, line, words in itertools.islice(lines, element.count):
            with _in_line(number, line):
                row = _row(element, _numbers(words))
                if element.name == "vertex":
                    points.append([row[axis][0] for axis in "xyz"])
                elif element.name == "face":
                    faces.append(_checked_face([_whole(corner) for corner in row[corners]]))
    if next(lines, None) is not None:
        raise ValueError("the file has more rows than its header declares")
    counts = {element.name: element.count for element in elements}
    if (len(points), len(faces)) != (counts.get("vertex", 0), counts.get("face", 0)):
        raise ValueError("the file has fewer rows than its header declares")
    return SurfaceMesh(points, faces)


def _numbers(words: list[Any], count: int = 0) -> list[float]:
    """Return words as numbers, of which there must be at least so many."""
    if len(words) < count:
        raise ValueError(f"it has only {len(words)} of {count} numbers")
    try:
        return [float(word) for word in words]
    except ValueError:
        raise ValueError("a word is not a number") from None


def _row(element: _Element, numbers: list[float]) -> dict[str, list[float]]:
    """Return the values of each property of a row."""
    row, at = {}, 0
    for name, _, length in element.properties:
        count = 1 if length is None else max(_whole(*_numbers(numbers[at : at + 1], 1)), 0)
        at += (length is not None) + count
        row[name] = _numbers(numbers[at - count : at], count)
    return row


def _whole(value: float) -> int:
    """Return the integer that a corner or a number of corners must be."""
    if not float(value).is_integer() or abs(value) > 2**31:
        raise ValueError(f"{value:g} is not an integer, or too large")
    return int(value)
