"""A mesh of a building's surfaces as an importer returns it, and the triangles that it is made of."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from evac.arrays import BoolArray, FloatArray, IndexArray
from evac.building.conforming import Height, Point, conform
from evac.building.findings import Finding, as_findings
from evac.building.polygons import triangulate
from evac.errors import BuildingError, PluginError

#: Kinds of tag on surfaces and on edges.
SURFACE_TAGS = ("floor", "stair", "area", "obstacle")
EDGE_TAGS = ("exit",)
#: Farthest coordinate of a vertex, in the file's unit: beyond UTM coordinates in millimetres.
FARTHEST = 1e11


@dataclass(frozen=True)
class SurfaceMesh:
    """The walkable surfaces of a file, before vertices are merged and cells are dropped or interpreted.

    The core welds vertices, splits cells at hanging nodes and ignores the winding, so neighbours need share neither
    vertices nor edges exactly. Tags are names ``kind:NAME``, as docs/buildings.md lists them.

    Attributes
    ----------
    points : (v, 3) array [units of the file]
    cells : sequence of sequences of int, or (c, k) array
        Triangles or polygons, convex or not: rows of `points`, counted from 0.
    cell_tags : mapping of str to (c,) array of bool
        Cells that carry each tag ``floor:``, ``stair:``, ``area:`` or ``obstacle:``. A cell may carry several. Cells
        with the tag ``exit:`` are ground outside: they are cut away, and the edges that they share with the floor are
        exit. Upright ones are doors, whose lower edges are exit.
    edge_tags : mapping of str to (e, 2) array of int
        Edges that carry each tag ``exit:``, as pairs of rows of `points`.
    findings : sequence of Finding or str
        What the user should know of the file; a text alone is a warning.
    openings : sequence of (str, (4,) array [units of the file])
        Where an exit may be that the file does not name: a level and the ends x1, y1, x2, y2 of a piece of its outline.
        `evac import` offers them.
    """

    points: ArrayLike
    cells: Sequence[Sequence[int]] | IndexArray
    cell_tags: Mapping[str, ArrayLike] = field(default_factory=dict)
    edge_tags: Mapping[str, ArrayLike] = field(default_factory=dict)
    findings: Sequence[Finding | str] = ()
    openings: Sequence[tuple[str, ArrayLike]] = ()

    @classmethod
    def of_polygons(
        cls,
        surfaces: Iterable[tuple[str | Sequence[str], BaseGeometry, Height]],
        edges: Iterable[tuple[str, Point, Point]] = (),
        findings: Sequence[Finding | str] = (),
        openings: Sequence[tuple[str, ArrayLike]] = (),
    ) -> Self:
        """Return the conforming mesh of polygons in plan; coordinates are rounded to 6 decimals.

        Parameters
        ----------
        surfaces : iterable of (tag or tags, polygon or multipolygon, height)
            Holes are allowed. The height is a number, or a function of x and y that is linear over the polygon.
        edges : iterable of (tag, point, point)
            Straight edges on the outlines of the surfaces, such as exits, by their ends (x, y, z).
        findings, openings : sequence
            As the attributes.

        Raises
        ------
        ValueError
            A surface is no valid polygon, or an edge is on no surface; names its tag and the place.
        """
        surfaces, edges = list(surfaces), list(edges)
        tags = [(tag,) if isinstance(tag, str) else tuple(tag) for tag, _, _ in surfaces]
        mesh = conform([(own[0], *rest) for own, (_, *rest) in zip(tags, surfaces, strict=True)], edges)
        edge_tags: dict[str, list[list[int]]] = {}
        for (tag, _, _), chain in zip(edges, mesh.chains, strict=True):
            edge_tags.setdefault(tag, []).extend(chain)
        known = dict.fromkeys(tag for own in tags for tag in own)
        surface = np.array(mesh.surface, dtype=np.int64)
        rows = {tag: [row for row, own in enumerate(tags) if tag in own] for tag in known}
        cell_tags = {tag: np.isin(surface, of_tag) for tag, of_tag in rows.items()}
        return cls(mesh.points, mesh.triangles, cell_tags, edge_tags, findings, openings)


@dataclass(frozen=True)
class TriangleMesh:
    """A surface mesh that has been checked and cut into triangles.

    Attributes
    ----------
    source : Path
    points : (v, 3) float64 [units of the file]
    triangles : (t, 3) int64
    cell_tags : dict of str to (t,) bool
        Tags that are known.
    edge_tags : dict of str to (e, 2) int64
        Tags of edges only.
    findings : tuple of Finding
    """

    source: Path
    points: FloatArray
    triangles: IndexArray
    cell_tags: dict[str, BoolArray]
    edge_tags: dict[str, IndexArray]
    findings: tuple[Finding, ...]


def checked(source: Path, mesh: SurfaceMesh) -> TriangleMesh:
    """Check what an importer returned, and cut it into triangles.

    Raises
    ------
    BuildingError
        There are no cells, a cell refers to a vertex that is not there, a vertex is not finite or too far off, the
        outline of a polygon crosses itself, or a tag of exits is on no edge.
    PluginError
        An array has the wrong shape.
    """
    points = _as_array(source, "points", mesh.points, np.float64, (-1, 3))
    blocks, rows = _by_length(source, mesh.cells)
    n_cells = sum(len(block) for block in blocks)
    edges = {name: _as_array(source, name, pairs, np.int64, (-1, 2)) for name, pairs in mesh.edge_tags.items()}
    masks = {name: _as_array(source, name, mask, np.bool_, (n_cells,)) for name, mask in mesh.cell_tags.items()}
    if not n_cells:
        raise BuildingError(
            f"{source}: there are no surface cells (triangles, quads or polygons) in this file; "
            "export the walkable surface with its faces"
        )
    _check_vertices(source, points, [*blocks, *edges.values()])
    try:
        pieces = [triangulate(points, block) for block in blocks]
    except ValueError as error:
        raise BuildingError(f"{source}: {error}; repair this face or triangulate the mesh") from error
    triangles = np.concatenate([piece for piece, _ in pieces])
    cell = np.concatenate([of[owner] for of, (_, owner) in zip(rows, pieces, strict=True)])
    notes = [*as_findings(tuple(mesh.findings))]
    for name in [*masks, *edges]:
        kind = name.partition(":")[0]
        if kind in EDGE_TAGS and not len(edges.get(name, ())) and not np.any(masks.get(name, False)):
            raise BuildingError(f"{source}: the tag {name!r} is on no edge and on no surface; put it where the exit is")
        if kind not in (*SURFACE_TAGS, *EDGE_TAGS):
            known = ", ".join(f"{kind}:NAME" for kind in (*SURFACE_TAGS, *EDGE_TAGS))
            text = f"the tag {name!r} is not known and means nothing; known tags are {known}"
            notes.append(Finding("warning", text))
    kinds = (*SURFACE_TAGS, *EDGE_TAGS)
    cell_tags = {name: mask[cell] for name, mask in masks.items() if name.partition(":")[0] in kinds}
    edge_tags = {name: pairs for name, pairs in edges.items() if name.partition(":")[0] in EDGE_TAGS}
    return TriangleMesh(source, points, triangles, cell_tags, edge_tags, tuple(notes))


def _as_array(source: Path, name: str, values: ArrayLike, dtype: Any, shape: tuple[int, ...]) -> Any:
    """Return an array of a type and shape, in which -1 is any length, or name the importer's mistake."""
    try:
        array = np.asarray(values)
        if not array.size:
            array = array.reshape([max(length, 0) for length in shape])
        array = np.ascontiguousarray(array.astype(dtype, casting="unsafe" if dtype is np.bool_ else "same_kind"))
    except (TypeError, ValueError) as error:
        raise PluginError(f"{source}: the importer's {name!r} are no array of numbers: {error}") from error
    if array.ndim != len(shape) or any(b not in (-1, a) for a, b in zip(array.shape, shape, strict=True)):
        wanted = ", ".join("n" if length < 0 else str(length) for length in shape)
        raise PluginError(f"{source}: the importer's {name!r} have the shape {array.shape}, not ({wanted})")
    return array


def _by_length(source: Path, cells: Sequence[Sequence[int]] | IndexArray) -> tuple[list[IndexArray], list[IndexArray]]:
    """Return the cells with equal numbers of corners together, and the row of each."""
    if isinstance(cells, np.ndarray):
        return [_as_array(source, "cells", cells, np.int64, (-1, cells.shape[-1]))], [np.arange(len(cells))]
    by_length: dict[int, list[int]] = {}
    for row, cell in enumerate(cells):
        by_length.setdefault(len(cell), []).append(row)
    if min(by_length, default=3) < 3:
        raise BuildingError(f"{source}: cell {by_length[min(by_length)][0]} has fewer than three corners; remove it")
    blocks = [
        _as_array(source, "cells", [cells[row] for row in by_length[length]], np.int64, (-1, length))
        for length in sorted(by_length)
    ]
    return blocks, [np.array(by_length[length]) for length in sorted(by_length)]


def _check_vertices(source: Path, points: FloatArray, blocks: list[IndexArray]) -> None:
    """Refuse cells with vertices that are not there, and vertices that lie nowhere or too far off."""
    ends = [corner for block in blocks if block.size for corner in (block.min(), block.max())]
    outside = [corner for corner in ends if not 0 <= corner < len(points)]
    if outside:
        raise BuildingError(
            f"{source}: a cell refers to vertex {outside[0] + 1}, but the file has {len(points)}; write the mesh again"
        )
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise BuildingError(
            f"{source}: vertex {bad[0] + 1} is not finite: {points[bad[0]].tolist()}; repair its coordinates"
        )
    far = np.flatnonzero((np.abs(points) > FARTHEST).any(axis=1))
    if len(far):
        raise BuildingError(
            f"{source}: vertex {far[0] + 1} lies at {points[far[0]].tolist()}, farther than {FARTHEST:g} from the "
            "origin; repair its coordinates or draw the building in metres"
        )
