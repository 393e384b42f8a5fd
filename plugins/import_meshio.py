"""Importer of formats read by meshio: Gmsh 2.2 and 4.1, VTK unstructured grids, OFF, PLY, STL.

Tags are names ``kind:NAME``. They are defined by

- Gmsh: physical groups. Surfaces ``floor:``, ``stair:``, ``area:``, ``obstacle:``; curves ``exit:``.
- VTU: one integer cell-data array for each tag, with the name of the tag (``floor:ground``) and non-zero on the
  cells with this tag. Exits are line cells in the same file. A cell may have several tags.
"""

import contextlib
import io
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from evac.base.arrays import BoolArray, IndexArray
from evac.building.importer import Importer
from evac.building.surface.surfacemesh import EDGE_TAGS, SurfaceMesh

#: Number of corners of the types of cells that are edges or surfaces, besides polygons.
CORNERS = {"line": 2, "triangle": 3, "quad": 4}

#: For each tag, the masks of its cells in each block of the file.
Tags = dict[str, list[BoolArray]]


class MeshioImporter(Importer):
    """Gmsh files (.msh, 2.2 and 4.1), VTK unstructured grids in one piece (.vtu), OFF, PLY and STL files."""

    name = "meshio"
    suffixes = (".msh", ".off", ".ply", ".stl", ".vtu")

    def read(self, path: Path) -> SurfaceMesh:
        """Read vertices, surface cells and tags; raise ValueError if the file is damaged."""
        mesh = _read(path)
        if not len(mesh.points):
            raise ValueError("it has no vertices: it is empty, or of another format")
        points = np.asarray(mesh.points, dtype=np.float64).reshape(len(mesh.points), -1)
        points = np.column_stack([points, np.zeros((len(points), 3 - points.shape[1]))])
        _check_count(path, mesh)
        blocks: dict[int, IndexArray] = {}  # by their numbers in the file
        notes = []
        for number, block in enumerate(mesh.cells):
            sizes = CORNERS | {"polygon": max(np.shape(block.data)[-1], 3)}
            corners = sizes.get(block.type.rstrip("0123456789"), 0)
            if corners and np.shape(block.data)[-1] < corners:  # meshio reads the rest of a line that is cut off
                raise ValueError(
                    f"a cell of type {block.type!r} has {np.shape(block.data)[-1]} corners: a line is cut off"
                )
            if corners and len(block.data):
                blocks[number] = np.asarray(block.data, dtype=np.int64)[:, :corners]
            elif len(block.data) and block.type != "vertex":
                notes.append(f"{len(block.data)} cells of type {block.type!r} are not surface cells and are ignored")
        surfaces = [number for number, block in blocks.items() if block.shape[1] > 2]
        lines = [number for number, block in blocks.items() if block.shape[1] == 2]
        edges = np.concatenate([np.empty((0, 2), dtype=np.int64), *(blocks[number] for number in lines)])
        tags = _gmsh_tags(mesh) if path.suffix.lower() == ".msh" else _array_tags(mesh)
        return SurfaceMesh(
            points,
            _joined([blocks[number] for number in surfaces]),
            {tag: _all_of(masks, surfaces) for tag, masks in tags.items() if not _is_of_edges(tag)},
            {tag: edges[_all_of(masks, lines)] for tag, masks in tags.items() if _is_of_edges(tag)},
            notes,
        )


def _read(path: Path) -> Any:
    """Read a file with meshio, which prints, exits, or raises errors of many types if the file is damaged."""
    import meshio

    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return meshio.read(path)
    except (Exception, SystemExit) as error:
        cause = str(error) if isinstance(error, meshio.ReadError) else ""
        told = " ".join(f"{said.getvalue()} {cause}".split())
        raise ValueError(told or "its content is damaged, or of another format") from error


def _joined(blocks: list[IndexArray]) -> IndexArray | list[list[int]]:
    """Return the concatenated cells of all blocks."""
    if len({block.shape[1] for block in blocks}) == 1:
        return np.concatenate(blocks)
    return [cell for block in blocks for cell in block.tolist()]


def _all_of(masks: list[BoolArray], numbers: list[int]) -> BoolArray:
    """Return the concatenated masks of some blocks."""
    return np.concatenate([np.empty(0, dtype=bool), *(masks[number] for number in numbers)])


def _is_of_edges(tag: str) -> bool:
    return tag.partition(":")[0] in EDGE_TAGS


def _check_count(path: Path, mesh: Any) -> None:
    """Refuse a VTU file if meshio has silently skipped some of its cells."""
    if path.suffix.lower() == ".vtu":
        announced = sum(map(int, re.findall(rb'NumberOfCells="\s*(\d+)\s*"', path.read_bytes())))
        read = sum(len(block.data) for block in mesh.cells)
        if read != announced:
            raise ValueError(
                f"only {read} of {announced} cells can be read; strips, polylines and further pieces are not read: "
                "write one piece of triangles, quads, polygons and lines"
            )


def _gmsh_tags(mesh: Any) -> Tags:
    """Return the masks of physical groups: cell sets in Gmsh 4.1 (a cell may be in several), integers in 2.2."""
    tags: Tags = {}
    physical = mesh.cell_data.get("gmsh:physical")
    for name, (number, dimension) in mesh.field_data.items():
        if name in mesh.cell_sets:
            members = mesh.cell_sets[name]
            tags[name] = [np.isin(np.arange(len(b.data)), m) for b, m in zip(mesh.cells, members, strict=True)]
        elif physical is not None:
            tags[name] = []
            for block, numbers in zip(mesh.cells, physical, strict=True):
                # Gmsh writes the negative number if the group contains the surface with reversed orientation.
                tags[name].append(np.asarray((np.abs(numbers) == number) & (block.dim == dimension)))
    return tags


def _array_tags(mesh: Any) -> Tags:
    """Return the masks of the cell-data arrays whose names are tags."""
    tags: Tags = {}
    for name, arrays in mesh.cell_data.items():
        if ":" in name:
            values = [np.asarray(array).reshape(len(array), -1) for array in arrays]
            if any(array.shape[1] != 1 for array in values):
                raise ValueError(f"the cell array {name!r} has several numbers per cell; a tag needs exactly one")
            tags[name] = [np.nan_to_num(array[:, 0]) != 0 for array in values]
    return tags
