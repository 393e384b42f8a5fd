"""VTK XML files of points and cells (``.vtp``), written without VTK, whose import takes longer than writing them.

The format is that of https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html, with the arrays as raw
bytes after the XML.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

_NO_CELLS = np.zeros((0, 1), dtype=np.int64)


@dataclass(frozen=True)
class PolyData:
    """Points, cells and their data arrays."""

    points: NDArray[np.float64]  # (n, 3) float64: coordinates [m]; float32 would be too coarse far from the origin
    # vertices, lines, polygons: (c, corners) int: rows of `points`; cells are numbered in this order
    vertices: NDArray[np.integer] = field(default_factory=lambda: _NO_CELLS)
    lines: NDArray[np.integer] = field(default_factory=lambda: _NO_CELLS)
    polygons: NDArray[np.integer] = field(default_factory=lambda: _NO_CELLS)
    # point_arrays, cell_arrays: mapping of str to (n,) or (n, components) array: arrays of int32 or float32, by name
    point_arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    cell_arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    texts: Mapping[str, Sequence[str]] = field(default_factory=dict)  # string arrays of the whole file, by name
    shown: str = ""  # name of the point array that viewers show by default, empty for none


def vtp_bytes(data: PolyData) -> bytes:
    """Return the content of a ``.vtp`` file."""
    raw = _Raw()
    texts = "".join(raw.text(name, words) for name, words in data.texts.items())
    point_arrays = "".join(raw.array(name, values) for name, values in data.point_arrays.items())
    cell_arrays = "".join(raw.array(name, values) for name, values in data.cell_arrays.items())
    points = raw.array("Points", data.points)
    kinds = {"Verts": data.vertices, "Lines": data.lines, "Polys": data.polygons}
    cells = "".join(f"<{kind}>{raw.cells(corners)}</{kind}>\n" for kind, corners in kinds.items())
    numbers = " ".join(f'NumberOf{kind}="{len(corners)}"' for kind, corners in kinds.items())
    shown = f' Scalars="{data.shown}"' if data.shown else ""
    head = f"""<?xml version="1.0"?>
<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">
<PolyData>
<FieldData>{texts}</FieldData>
<Piece NumberOfPoints="{len(data.points)}" {numbers} NumberOfStrips="0">
<PointData{shown}>{point_arrays}</PointData>
<CellData>{cell_arrays}</CellData>
<Points>{points}</Points>
{cells}</Piece>
</PolyData>
<AppendedData encoding="raw">
_"""
    return b"".join([head.encode(), *raw.blocks, b"\n</AppendedData>\n</VTKFile>\n"])


class _Raw:
    """The bytes after the XML, each block preceded by its length; methods return the XML elements for them."""

    def __init__(self) -> None:
        self.blocks: list[bytes] = []
        self._end = 0

    def array(self, name: str, values: NDArray[Any]) -> str:
        """Add an array (n,) or (n, components)."""
        kind = f"{'Float' if values.dtype.kind == 'f' else 'Int'}{8 * values.dtype.itemsize}"
        components = f' NumberOfComponents="{values.shape[1]}"' if values.ndim > 1 else ""
        place = self._add(values.astype(values.dtype.newbyteorder("<"), copy=False).tobytes())
        return f'<DataArray type="{kind}" Name="{name}"{components} {place}/>\n'

    def text(self, name: str, words: Sequence[str]) -> str:
        """Add an array of strings."""
        place = self._add(b"".join(word.encode() + b"\0" for word in words))
        return f'<Array type="String" Name="{name}" NumberOfTuples="{len(words)}" {place}/>\n'

    def cells(self, corners: NDArray[np.integer]) -> str:
        """Add cells (c, corners)."""
        count, size = corners.shape
        ends = size * np.arange(1, count + 1, dtype=np.int64)
        return self.array("connectivity", corners.ravel().astype(np.int64)) + self.array("offsets", ends)

    def _add(self, content: bytes) -> str:
        place = f'format="appended" offset="{self._end}"'
        self.blocks += [len(content).to_bytes(8, "little"), content]
        self._end += 8 + len(content)
        return place
