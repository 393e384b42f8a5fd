"""Surface meshes of buildings as importers return them or as polygons give them, and their triangulation."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import BoolArray, FloatArray, IndexArray
from evac.base.change import Control, LiftOptions
from evac.base.errors import BuildingError, PluginError
from evac.building.geometry import GRID, divided, remembered, rounded, triangulate
from evac.building.model.findings import Finding, as_findings, repaired, with_repaired_names

#: Kinds of tag on surfaces and on edges.
SURFACE_TAGS = ("floor", "stair", "area", "obstacle")
EDGE_TAGS = ("exit",)
#: Largest coordinate of a vertex, in units of the file; larger than UTM coordinates in millimetres.
FARTHEST = 1e11
#: Height of a surface [m]: a number, or a function of the plan position (x, y) for a slope.
Height = float | Callable[[float, float], float]
Point = tuple[float, float, float]  #: A point (x, y, z).


@dataclass(frozen=True)
class SurfaceMesh:
    """The surfaces that people can walk on, as read from a file, before any processing.

    The core welds vertices, splits cells at hanging nodes and ignores the orientation of cells, so neighbours need not
    share vertices or edges exactly. Tags are names ``kind:NAME``, see docs/meshes.md.
    """

    points: ArrayLike  #: (v, 3) [units of the file]
    #: triangles or polygons, convex or not, as rows of `points`, counted from 0
    cells: Sequence[Sequence[int]] | IndexArray
    #: mask of the cells with each tag ``floor:``, ``stair:``, ``area:`` or ``obstacle:``. A cell may have several tags.
    #: Cells with a tag ``exit:`` are ground outside; they are removed, and the edges that they share with the floor
    #: become the exit. Upright cells with such a tag are doors, whose lower edges become the exit.
    cell_tags: Mapping[str, ArrayLike] = field(default_factory=dict)
    #: (e, 2) int: edges with each tag ``exit:``, as pairs of rows of `points`
    edge_tags: Mapping[str, ArrayLike] = field(default_factory=dict)
    findings: Sequence[Finding | str] = ()  #: findings about the file; a string is a warning
    #: possible exits that the file does not declare, each a level and the ends x1, y1, x2, y2 of a piece of its outline
    #: [units of the file]. `evac import` suggests them.
    openings: Sequence[tuple[str, ArrayLike]] = ()
    #: doors between rooms, which are part of the floor, each a name and its ends (2, 3) [units of the file]
    doors: Sequence[tuple[str, ArrayLike]] = ()
    #: use and number of people of areas, by their names; see `Area`
    uses: Mapping[str, tuple[str, float | None]] = field(default_factory=dict)
    #: direction of north in plan, counterclockwise from y [degrees]; None if it is not known
    north: float | None = None
    #: how exits and doors let people through, by their names
    controls: Mapping[str, Control] = field(default_factory=dict)
    #: name, names of the storeys from bottom to top, and how the lift works. Its room at STOREY is a floor with the tag
    #: ``floor:NAME STOREY``; its doors are the edges that it shares with other floors.
    lifts: Sequence[tuple[str, Sequence[str], LiftOptions]] = ()

    @classmethod
    def of_polygons(
        cls,
        surfaces: Iterable[tuple[str | Sequence[str], BaseGeometry, Height]],
        edges: Iterable[tuple[str, Point, Point]] = (),
        findings: Sequence[Finding | str] = (),
        openings: Sequence[tuple[str, ArrayLike]] = (),
        doors: Sequence[tuple[str, ArrayLike]] = (),
        uses: Mapping[str, tuple[str, float | None]] | None = None,
    ) -> Self:
        """Return the conforming mesh of polygons in plan; coordinates are rounded to 6 decimals.

        Wherever a corner of one surface, or an end of an edge, lies on the side of another surface at the same height,
        both get a vertex there, so that there are no hanging nodes.

        Parameters
        ----------
        surfaces : iterable of (tag or tags, polygon or multipolygon, float or callable)
            Holes are allowed. The height is a number, or a function of x and y that is linear over the polygon.
        edges : iterable of (tag, point, point)
            Straight edges on the outlines of the surfaces, such as exits, by their ends (x, y, z).
        findings, openings, doors, uses
            See the attributes.

        Raises
        ------
        ValueError
            A surface is not a valid polygon, or an edge is not on any surface; names the tag and the place.
        """
        drawn = [((tag,) if isinstance(tag, str) else tuple(tag), *rest) for tag, *rest in surfaces]
        edges = list(edges)
        for (name, *_), plan, _ in drawn:
            fault = "" if plan.is_valid else shapely.is_valid_reason(plan)
            if plan.is_empty or plan.geom_type not in ("Polygon", "MultiPolygon"):
                fault = f"it is {'empty' if plan.is_empty else f'a {plan.geom_type}'}"
            if fault:
                raise ValueError(f"the surface {name!r} must be a polygon whose sides do not cross: {fault}")
        lines = rounded(np.reshape([[start, end] for _, start, end in edges], (-1, 2, 3)))
        lifted = [_lifted(shapely.get_coordinates(plan), height) for _, plan, height in drawn]
        corners = np.unique(np.concatenate([lines.reshape(-1, 3), *lifted]), axis=0)
        tree = shapely.STRtree(shapely.points(corners[:, :2]))
        pieces = [_triangles(plan, height, corners, tree) for _, plan, height in drawn]
        points, first, row = np.unique(
            np.concatenate(pieces).reshape(-1, 3), axis=0, return_index=True, return_inverse=True
        )
        rank = np.argsort(np.argsort(first))  # points are numbered as they come
        points, triangles = points[np.argsort(first)], rank[row.ravel()].reshape(-1, 3)
        row_of = {(x, y, z): number for number, (x, y, z) in enumerate(points.tolist())} if edges else {}
        edge_tags: dict[str, list[list[int]]] = {}
        side, chain = divided(corners, tree, lines, GRID)
        for number, (tag, *_) in enumerate(edges):
            own = [*chain[side == number].tolist(), lines[number, 1].tolist()]
            for x, y, z in own:
                if (x, y, z) not in row_of:
                    raise ValueError(
                        f"the edge {tag!r}: its point ({x:z.2f}, {y:z.2f}, {z:z.2f}) is not on any surface; move it to "
                        "one"
                    )
            edge_tags.setdefault(tag, []).extend(
                [row_of[tuple(one)], row_of[tuple(other)]] for one, other in pairwise(own)
            )
        stops: list[int] = np.cumsum([len(own) for own in pieces]).tolist()
        cell_tags: dict[str, BoolArray] = {}
        for (tags, *_), piece, stop in zip(drawn, pieces, stops, strict=True):
            for tag in tags:
                cell_tags.setdefault(tag, np.zeros(len(triangles), np.bool_))[stop - len(piece) : stop] = True
        return cls(points, triangles, cell_tags, edge_tags, findings, openings, doors, uses or {})


@dataclass(frozen=True)
class TriangleMesh:
    """A surface mesh that has been checked and triangulated."""

    source: Path
    points: FloatArray  # (v, 3) float64 [units of the file]
    triangles: IndexArray  # (t, 3) int64
    cell_tags: dict[str, BoolArray]  # dict of str to (t,) bool: cells with each known tag
    edge_tags: dict[str, IndexArray]  # dict of str to (e, 2) int64: edges with each tag of edges
    findings: tuple[Finding, ...]
    given: SurfaceMesh  # as the importer gave it, with checked doors and names in one line


def checked(source: Path, mesh: SurfaceMesh) -> TriangleMesh:
    """Check and triangulate the mesh that an importer returned."""
    points = _as_array(source, "points", mesh.points, np.float64, (-1, 3))
    blocks, rows = _by_length(source, mesh.cells)
    n_cells = sum(len(block) for block in blocks)
    edges = {name: _as_array(source, name, pairs, np.int64, (-1, 2)) for name, pairs in mesh.edge_tags.items()}
    masks = {name: _as_array(source, name, mask, np.bool_, (n_cells,)) for name, mask in mesh.cell_tags.items()}
    if not n_cells:
        raise BuildingError(
            f"{source}: the file contains no surface cells (triangles, quads or polygons); "
            "export the walkable surface with its faces"
        )
    _check_vertices(source, points, [*blocks, *edges.values()])
    try:
        pieces = [triangulate(points, block) for block in blocks]
    except ValueError as error:
        raise BuildingError(f"{source}: {error}; repair this face, or triangulate the mesh") from error
    triangles = np.concatenate([piece for piece, _ in pieces])
    cell = np.concatenate([of[owner] for of, (_, owner) in zip(rows, pieces, strict=True)])
    notes = [replace(note, level=note.level and repaired(note.level)) for note in as_findings(tuple(mesh.findings))]
    for name in [*masks, *edges]:
        kind = name.partition(":")[0]
        if kind in EDGE_TAGS and not len(edges.get(name, ())) and not np.any(masks.get(name, False)):
            raise BuildingError(f"{source}: the tag {name!r} has neither edges nor cells; tag the edges of the exit")
        if kind not in (*SURFACE_TAGS, *EDGE_TAGS):
            known = ", ".join(f"{kind}:NAME" for kind in (*SURFACE_TAGS, *EDGE_TAGS))
            text = f"the unknown tag {name!r} is ignored; known tags are {known}"
            notes.append(Finding("warning", text))
    kinds = (*SURFACE_TAGS, *EDGE_TAGS)
    cell_tags = {name: mask[cell] for name, mask in masks.items() if name.partition(":")[0] in kinds}
    edge_tags = {name: pairs for name, pairs in edges.items() if name.partition(":")[0] in EDGE_TAGS}
    cell_tags = with_repaired_names(source, cell_tags, notes)
    edge_tags = with_repaired_names(source, edge_tags, notes)
    doors = [(repaired(name), _as_array(source, f"door:{name}", at, np.float64, (2, 3))) for name, at in mesh.doors]
    uses = {repaired(name): use for name, use in mesh.uses.items()}
    given = replace(mesh, doors=doors, uses=uses)
    return TriangleMesh(source, points, triangles, cell_tags, edge_tags, tuple(notes), given)


def _as_array(source: Path, name: str, values: ArrayLike, dtype: Any, shape: tuple[int, ...]) -> Any:
    """Convert values to an array of a given type and shape (-1 for any length); refuse other values."""
    try:
        array = np.asarray(values)
        if not array.size:
            array = array.reshape([max(length, 0) for length in shape])
        array = np.ascontiguousarray(array.astype(dtype, casting="unsafe" if dtype is np.bool_ else "same_kind"))
    except (TypeError, ValueError) as error:
        raise PluginError(
            f"{source}: the importer's {name!r} are not an array of numbers: {error}; return numbers of type "
            f"{np.dtype(dtype)}"
        ) from error
    if array.ndim != len(shape) or any(b not in (-1, a) for a, b in zip(array.shape, shape, strict=True)):
        wanted = ", ".join("n" if length < 0 else str(length) for length in shape)
        raise PluginError(f"{source}: the importer's {name!r} have the shape {array.shape}; it must be ({wanted})")
    return array


def _by_length(source: Path, cells: Sequence[Sequence[int]] | IndexArray) -> tuple[list[IndexArray], list[IndexArray]]:
    """Group the cells by their number of corners; return the groups and the rows of their cells."""
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
    """Refuse cells whose vertices do not exist, and vertices that are not finite or too far from the origin."""
    ends = [corner for block in blocks if block.size for corner in (block.min(), block.max())]
    outside = [corner for corner in ends if not 0 <= corner < len(points)]
    if outside:
        raise BuildingError(
            f"{source}: a cell refers to vertex {outside[0] + 1}, but the file has {len(points)}; write the mesh again"
        )
    far = np.flatnonzero(~(np.abs(points) <= FARTHEST).all(axis=1))  # or not finite
    if len(far):
        raise BuildingError(
            f"{source}: vertex {far[0] + 1} lies at {points[far[0]].tolist()}, which is not finite, or farther than "
            f"{FARTHEST:g} from the origin; repair its coordinates or draw the building in metres"
        )


def _triangles(plan: BaseGeometry, height: Height, corners: FloatArray, tree: shapely.STRtree) -> FloatArray:
    """Triangulate a surface to (t, 3, 3); every corner of the drawing on its sides becomes a vertex."""
    triangles = [np.empty((0, 3, 3))]
    for polygon in shapely.get_parts(shapely.normalize(plan)):
        outline, ring = shapely.get_coordinates(shapely.get_rings(polygon), return_index=True)
        points, is_side = _lifted(outline, height), ring[:-1] == ring[1:]
        side, whole = divided(corners, tree, np.stack([points[:-1], points[1:]], axis=1)[is_side], GRID)
        rings = shapely.linearrings(whole[:, :2], indices=ring[:-1][is_side][side])
        triangles.append(_lifted(_triangulated(shapely.polygons(rings[0], rings[1:])), height).reshape(-1, 3, 3))
    return np.concatenate(triangles)


@remembered
def _triangulated(polygon: BaseGeometry) -> FloatArray:
    """Return the corners (3 t, 2) of the triangles of a polygon."""
    try:
        pieces = shapely.constrained_delaunay_triangles(polygon)
    except shapely.GEOSException:  # corners beside a sliver are on both of its long sides
        whole = shapely.make_valid(polygon, method="structure", keep_collapsed=False)
        pieces = shapely.constrained_delaunay_triangles(whole)
    corners: FloatArray = shapely.get_coordinates(shapely.get_parts(pieces)).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    return corners


def _lifted(plan: FloatArray, height: Height) -> FloatArray:
    """Return points (n, 2) in plan with their heights, (n, 3)."""
    z = [height(x, y) for x, y in plan.tolist()] if callable(height) else np.full(len(plan), height)
    return rounded(np.column_stack([plan, np.array(z, np.float64)]))
