"""Importer of PLY files, text and binary: vertices and polygons; other elements are ignored.

meshio fails on edges and on ``vertex_index``; trimesh divides non-convex polygons into fans.
"""

import codecs
import struct
from dataclasses import dataclass, field
from pathlib import Path

from evac.building.importer import Importer
from evac.building.surface.surfacemesh import SurfaceMesh

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
    if len(corners) < 3:
        raise ValueError(f"a face has only {len(corners)} corners, not at least 3")
    return [int(corner) for corner in corners]


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
