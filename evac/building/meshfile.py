"""Mesh files of any supported format, read to one plain `SurfaceMesh`.

Formats: Gmsh 2.2 and 4.1 (``.msh``), VTK unstructured grid (``.vtu``), OBJ, OFF, PLY and STL.

Tags are names ``kind:NAME``. They are given by

- Gmsh: physical groups. Surfaces ``floor:``, ``stair:``, ``area:``, ``obstacle:``; curves ``exit:``.
- VTU: one integer cell-data array for each tag, named exactly as the tag (``floor:ground``) and non-zero on the
  cells that carry it. Exits are line cells in the same file. A cell may carry several tags.
"""

import contextlib
import io
import re
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.building.plymesh import read_ply
from evac.building.textmesh import read_obj, read_off
from evac.building.triangulation import triangulate
from evac.errors import BuildingError

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

#: Kinds of tag on surfaces and on edges.
SURFACE_TAGS = ("floor", "stair", "area", "obstacle")
EDGE_TAGS = ("exit",)
#: Own readers of bare formats: meshio's fail on what common exporters write (OBJ with ``vt``, OFF with polygons,
#: PLY with edges or ``vertex_index``).
READERS = {".obj": read_obj, ".off": read_off, ".ply": read_ply}
#: File name endings that can be read, those of meshio last.
FORMATS = (*READERS, ".msh", ".stl", ".vtu")


#: Farthest coordinate of a vertex, in the file's unit: beyond UTM coordinates in millimetres.
FARTHEST = 1e11


@dataclass(frozen=True)
class SurfaceMesh:
    """A mesh file as read: nothing welded, dropped or interpreted yet.

    Attributes
    ----------
    source : Path
    points : (v, 3) float64 [units of the file]
    triangles : (t, 3) int64
        Polygons are triangulated already; winding as in the file.
    cell_tags : dict of str to (t,) bool
        Triangles that carry each tag ``floor:``, ``stair:``, ``area:`` or ``obstacle:``.
    edge_tags : dict of str to (e, 2) int64
        Edges that carry each tag ``exit:``.
    warnings : tuple of str
    """

    source: Path
    points: FloatArray
    triangles: IndexArray
    cell_tags: dict[str, BoolArray] = field(default_factory=dict)
    edge_tags: dict[str, IndexArray] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


def read_mesh(path: Path) -> SurfaceMesh:
    """Read a mesh file.

    Raises
    ------
    BuildingError
        If the file is missing, of an unknown format, damaged, without surface cells, or has a vertex
        that is no finite number.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise BuildingError(f"{path}: cannot read files ending in {suffix!r}; use one of {', '.join(FORMATS)}")
    if not path.is_file():
        raise BuildingError(f"{path}: no such file; check the path")
    if path.stat().st_size == 0:
        raise BuildingError(f"{path}: the file is empty; write the mesh again")
    try:
        tags: dict[str, list[BoolArray]] = {}
        notes: list[str] = []
        if suffix in READERS:
            points, blocks = READERS[suffix](path)
        else:
            points, blocks, tags, notes = _read_with_meshio(path)
    except (ValueError, IndexError, UnicodeDecodeError, OSError) as error:
        raise BuildingError(f"{path}: cannot be read: {error}; write the mesh again, or in another format") from error
    return _assemble(path, points, blocks, tags, notes)


def _read_with_meshio(path: Path) -> tuple[FloatArray, list[IndexArray], dict[str, list[BoolArray]], list[str]]:
    """Read with meshio; return points, blocks of cells (n, k), per tag one mask for each block, and warnings."""
    import meshio

    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mesh = meshio.read(path)
    # meshio prints, exits, and lets errors of every kind through when a file is damaged.
    except (Exception, SystemExit) as error:
        cause = "" if isinstance(error, SystemExit) else str(error)
        raise ValueError(" ".join(f"{said.getvalue()} {cause}".split()) or type(error).__name__) from error

    points = np.asarray(mesh.points, dtype=np.float64).reshape(len(mesh.points), -1)
    points = np.column_stack([points, np.zeros((len(points), 3 - points.shape[1]))])
    _check_count(path, mesh)
    blocks, kept, notes = [], [], []
    for number, block in enumerate(mesh.cells):
        corners = _corner_count(block.type, np.shape(block.data)[-1])
        if corners and len(block.data):
            blocks.append(np.asarray(block.data, dtype=np.int64)[:, :corners])
            kept.append(number)
        elif len(block.data) and block.type != "vertex":
            notes.append(f"{len(block.data)} cells of type {block.type!r} are no surface cells and mean nothing")
    tags = _gmsh_tags(mesh) if path.suffix.lower() == ".msh" else _array_tags(mesh)
    return points, blocks, {name: [masks[number] for number in kept] for name, masks in tags.items()}, notes


def _corner_count(cell_type: str, nodes: int) -> int:
    """Count the corners of a meshio cell type; 0 for cells that are no edges or surfaces."""
    kind = cell_type.rstrip("0123456789")
    return {"line": 2, "triangle": 3, "quad": 4, "polygon": nodes}.get(kind, 0)


def _check_count(path: Path, mesh: Any) -> None:
    """Refuse a VTU file some of whose cells meshio has passed over in silence."""
    if path.suffix.lower() == ".vtu":
        announced = sum(map(int, re.findall(rb'NumberOfCells="\s*(\d+)\s*"', path.read_bytes())))
        read = sum(len(block.data) for block in mesh.cells)
        if read != announced:
            raise ValueError(
                f"only {read} of its {announced} cells can be read, not those of strips, polylines and a second piece; "
                "write one piece of triangles, quads, polygons and lines"
            )


def _gmsh_tags(mesh: Any) -> dict[str, list[BoolArray]]:
    """Masks of the physical groups: cell sets in Gmsh 4.1 (a cell may be in several), integers in 2.2."""
    tags: dict[str, list[BoolArray]] = {}
    physical = mesh.cell_data.get("gmsh:physical")
    for name, (number, dimension) in mesh.field_data.items():
        if name in mesh.cell_sets:
            members = mesh.cell_sets[name]
            tags[name] = [np.isin(np.arange(len(b.data)), m) for b, m in zip(mesh.cells, members, strict=True)]
        elif physical is not None:
            tags[name] = []
            for block, numbers in zip(mesh.cells, physical, strict=True):
                # Gmsh writes the negative number where the group has the surface the other way round.
                tags[name].append(np.asarray((np.abs(numbers) == number) & (block.dim == dimension)))
    return tags


def _array_tags(mesh: Any) -> dict[str, list[BoolArray]]:
    """Masks of the cell-data arrays that are named like tags."""
    tags: dict[str, list[BoolArray]] = {}
    for name, arrays in mesh.cell_data.items():
        if ":" in name:
            values = [np.asarray(array).reshape(len(array), -1) for array in arrays]
            if any(array.shape[1] != 1 for array in values):
                raise ValueError(f"the cell array {name!r} has several numbers for each cell; a tag has one")
            tags[name] = [np.nan_to_num(array[:, 0]) != 0 for array in values]
    return tags


def _assemble(
    path: Path, points: FloatArray, blocks: list[IndexArray], tags: dict[str, list[BoolArray]], notes: list[str]
) -> SurfaceMesh:
    """Check indices and coordinates, triangulate, and sort tags into those of surfaces and of edges."""
    surfaces = [number for number, block in enumerate(blocks) if block.shape[1] > 2]
    if not surfaces:
        raise BuildingError(
            f"{path}: there are no surface cells (triangles, quads or polygons) in this file; "
            "export the walkable surface with its faces"
        )
    _check_vertices(path, points, blocks)
    try:
        pieces = [triangulate(points, blocks[number]) for number in surfaces]
    except ValueError as error:
        raise BuildingError(f"{path}: {error}; repair this face or triangulate the mesh") from error
    cell_tags, edge_tags, notes = {}, {}, [*notes]
    for name, masks in tags.items():
        kind = name.partition(":")[0]
        if kind in SURFACE_TAGS:
            cell_tags[name] = np.concatenate(
                [masks[number][owner] for number, (_, owner) in zip(surfaces, pieces, strict=True)]
            )
        elif kind in EDGE_TAGS:
            edge_tags[name] = _tagged_edges(path, name, blocks, masks)
        else:
            known = ", ".join(f"{kind}:NAME" for kind in (*SURFACE_TAGS, *EDGE_TAGS))
            notes.append(f"the tag {name!r} is not known and means nothing; known tags are {known}")
    triangles = np.concatenate([piece for piece, _ in pieces])
    return SurfaceMesh(path, points, triangles, cell_tags, edge_tags, tuple(notes))


def _check_vertices(path: Path, points: FloatArray, blocks: list[IndexArray]) -> None:
    """Refuse cells with vertices that are not there, and vertices that lie nowhere or too far off."""
    outside = [corner for block in blocks for corner in (block.min(), block.max()) if not 0 <= corner < len(points)]
    if outside:
        raise BuildingError(
            f"{path}: a cell refers to vertex {outside[0] + 1}, but the file has {len(points)}; write the mesh again"
        )
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise BuildingError(
            f"{path}: vertex {bad[0] + 1} is not finite: {points[bad[0]].tolist()}; repair its coordinates"
        )
    far = np.flatnonzero((np.abs(points) > FARTHEST).any(axis=1))
    if len(far):
        raise BuildingError(
            f"{path}: vertex {far[0] + 1} lies at {points[far[0]].tolist()}, farther than {FARTHEST:g} from the "
            "origin; repair its coordinates or draw the building in metres"
        )


def _tagged_edges(path: Path, name: str, blocks: list[IndexArray], masks: list[BoolArray]) -> IndexArray:
    """Return the edges (e, 2) that carry a tag, or refuse one that is on none."""
    edges = [block[mask] for block, mask in zip(blocks, masks, strict=True) if block.shape[1] == 2]
    tagged = np.concatenate([np.empty((0, 2), dtype=np.int64), *edges])
    if not len(tagged):
        raise BuildingError(f"{path}: the tag {name!r} is on no edge: put it on line cells, not on surfaces")
    return tagged
