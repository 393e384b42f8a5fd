"""Importers of meshes of polygons: Wavefront OBJ, OFF and PLY.

meshio fails on texture indices of OBJ, reads triangles of OFF only, and fails on edges and ``vertex_index`` of PLY.
trimesh drops the names of groups, and divides non-convex polygons into fans, which cover additional ground.
"""

import codecs
import fnmatch
import itertools
import re
import struct
from dataclasses import dataclass, field
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
        text = path.read_text(encoding="utf-8-sig", errors="replace").replace("\\\n", " ")
        if "\0" in text:
            raise ValueError("the text is not UTF-8; save it as UTF-8")
        for number, line in enumerate(text.splitlines(), start=1):
            word, *rest = line.partition("#")[0].split() or [""]
            try:
                if word == "v":
                    x, y, z = rest[:3]
                    points.append([float(x), float(y), float(z)])
                elif word == "f":
                    faces.append(_checked_face(_rows(rest, len(points))))
                    face_group.append(len(groups) - 1)
                elif word == "l":
                    chain = _rows(rest, len(points))
                    if len(chain) < 2:
                        raise ValueError("a line has only one corner")
                    edges += [[a, b] for a, b in itertools.pairwise(chain)]
                    edge_group += [len(groups) - 1] * (len(chain) - 1)
                elif word in ("g", "o"):
                    groups.append(" ".join(rest))
            except ValueError as error:
                raise _in_line(number, line, error) from error
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


def _checked_face(corners: list[int]) -> list[int]:
    """Return the corners of a face, at least three."""
    if len(corners) < 3:
        raise ValueError(f"a face has only {len(corners)} corners, not at least 3")
    return corners


def _in_line(number: int, line: str, error: ValueError) -> ValueError:
    """Return an error that names the line."""
    return ValueError(f"line {number}: {line.strip()!r}: {error}")


def _rows(corners: list[str], n_points: int) -> list[int]:
    """Return the rows of the vertices of a face or a line."""
    numbers = [int(corner.partition("/")[0]) for corner in corners]
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


class OffImporter(Importer):
    """OFF files (also COFF, NOFF, STOFF: values after x, y, z are ignored)."""

    name = "off"
    suffixes = (".off",)

    def read(self, path: Path) -> SurfaceMesh:
        """Read vertices and polygons; raise ValueError if the header, a count or a line is wrong."""
        text = path.read_text(encoding="utf-8-sig").splitlines()
        lines = [(number, line.partition("#")[0].split()) for number, line in enumerate(text, start=1)]
        lines = [(number, words) for number, words in lines if words]
        if not lines or not re.fullmatch(r"(ST)?C?N?OFF", lines[0][1][0]):
            raise ValueError("the first word must be OFF")
        number, first = lines[0]
        (_, counts), *rest = [(number, first[1:]), *lines[1:]] if len(first) > 1 else lines[1:] or [(number, [])]
        if len(counts) < 2:
            raise ValueError("the numbers of vertices and faces are missing")
        n_points, n_faces = int(counts[0]), int(counts[1])
        if len(rest) != n_points + n_faces:
            raise ValueError(f"{n_points} vertices and {n_faces} faces are declared, but {len(rest)} lines follow")
        points, faces = [], []
        for index, (number, words) in enumerate(rest):
            try:
                if index < n_points:
                    x, y, z = words[:3]
                    points.append([float(x), float(y), float(z)])
                else:
                    corners = [int(corner) for corner in words[1 : 1 + int(words[0])]]
                    if len(corners) != int(words[0]):
                        raise ValueError(f"{words[0]} corners are declared, but {len(corners)} follow")
                    faces.append(_checked_face(corners))
            except ValueError as error:
                raise _in_line(number, text[number - 1], error) from error
        return SurfaceMesh(points, faces)


#: Format characters of `struct` for the types of PLY.
TYPES = {
    **{"char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H", "uint16": "H"},
    **{"int": "i", "int32": "i", "uint": "I", "uint32": "I"},
    **{"float": "f", "float32": "f", "double": "d", "float64": "d"},
}
#: Names of the property with the corners of a face.
CORNERS = ("vertex_indices", "vertex_index")


@dataclass
class _Element:
    """An element: name, number of rows, and properties (name, type, type of the length of a list or None)."""

    name: str
    count: int
    properties: list[tuple[str, str, str | None]] = field(default_factory=list)


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
        body = _Body(rest, encoding)
        points: list[list[float]] = []
        faces: list[list[int]] = []
        for element in elements:
            names = [name for name, _, _ in element.properties]
            rows = body.rows(element)
            if element.name == "vertex":
                numbers = [name for name, _, length in element.properties if length is None]
                if not {"x", "y", "z"} <= set(numbers):
                    raise ValueError("the vertices have no x, y, z")
                columns = [names.index(axis) for axis in "xyz"]
                points = [[row[column][0] for column in columns] for row in rows]
            elif element.name == "face":
                corners = next((names.index(name) for name in CORNERS if name in names), None)
                if corners is None:
                    raise ValueError(f"the faces have no list {' or '.join(CORNERS)}")
                faces = [_face(row[corners]) for row in rows]
        if not body.is_read:
            raise ValueError("the file has more rows than its header declares")
        return SurfaceMesh(points, faces)


def _face(corners: list[float]) -> list[int]:
    """Return the rows of a face's vertices."""
    broken = next((corner for corner in corners if corner != int(corner)), None)
    if broken is not None:
        raise ValueError(f"a face refers to vertex {broken:g}, which is not an integer")
    return _checked_face([int(corner) for corner in corners])


def _read_header(head: str) -> tuple[str, list[_Element]]:
    """Return ``"ascii"`` or the byte order (``"<"``, ``">"``), and the elements."""
    encodings = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}
    encoding, elements = "", list[_Element]()
    for line in head.splitlines():
        match line.split():
            case ["format", name, _]:
                encoding = encodings.get(name, "")
            case ["element", name, count]:
                elements.append(_Element(name, int(count)))
            case ["property", "list", length, kind, name] if elements and {length, kind} <= TYPES.keys():
                elements[-1].properties.append((name, TYPES[kind], TYPES[length]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append((name, TYPES[kind], None))
            case ["property", *_]:
                raise ValueError(f"header line {line.strip()!r} is invalid")
    if not encoding:
        raise ValueError("the header has no known format")
    return encoding, elements


class _Body:
    """Reader of the numbers after the header, of text or binary with the byte order "<" or ">"."""

    def __init__(self, body: bytes, encoding: str) -> None:
        self.body = body.split() if encoding == "ascii" else body
        self.encoding, self.at = encoding, 0

    def take(self, kinds: str) -> list[float]:
        """Read the next numbers, of the types given by the letters of `kinds`."""
        row = None if self.encoding == "ascii" else struct.Struct(self.encoding + kinds)
        taken = self.body[self.at : self.at + (row.size if row else len(kinds))]
        self.at += len(taken)
        if len(taken) < (row.size if row else len(kinds)):
            raise ValueError("the file is truncated: it has fewer rows than its header declares")
        return list(row.unpack(taken)) if row else [float(word) for word in taken]  # type: ignore[arg-type]

    @property
    def is_read(self) -> bool:
        """Whether all numbers have been read, apart from line ends."""
        rest = self.body[self.at :]
        return not (rest.strip() if isinstance(rest, bytes) else rest)

    def rows(self, element: _Element) -> list[list[list[float]]]:
        """Read all rows of an element: a list of numbers for each property, with one number for scalar properties."""
        if all(length is None for _, _, length in element.properties):
            kinds = "".join(kind for _, kind, _ in element.properties)
            numbers = self.take(kinds * element.count)
            return [[[value] for value in row] for row in zip(*[iter(numbers)] * len(kinds), strict=True)]
        counts = [(kind, length) for _, kind, length in element.properties]
        return [
            [self.take(kind * (1 if length is None else int(self.take(length)[0]))) for kind, length in counts]
            for _ in range(element.count)
        ]
