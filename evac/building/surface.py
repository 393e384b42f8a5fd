"""A clean walkable surface: welded, free of degenerate cells and hanging nodes, in an order of its own.

The result depends on the geometry alone: shuffling the vertices, cells or winding of a file changes nothing.
"""

import itertools
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from evac.building.meshfile import SurfaceMesh
from evac.errors import BuildingError

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Surface:
    """The walkable cells of a building.

    Attributes
    ----------
    vertices : (v, 3) float64 [m]
        In the order of (x, y, z).
    triangles : (t, 3) int64
        Counter-clockwise in plan, least vertex first, in the order of their vertices.
    gradient : (t, 2) float64
        Rise of each cell along x and y.
    is_sloped : (t,) bool
        False on flat cells.
    cell_tags : dict of str to (t,) bool
    exit_edges : dict of str to (e, 2) int64
        Tagged edges; ``exit:NAME`` is the key.
    obstacles : dict of str to (o, 3, 3) float64 [m]
        Corners of the cells of each tag ``obstacle:``, which are not among `triangles`.
    warnings : tuple of str
    """

    vertices: FloatArray
    triangles: IndexArray
    gradient: FloatArray
    is_sloped: BoolArray
    cell_tags: dict[str, BoolArray]
    exit_edges: dict[str, IndexArray]
    obstacles: dict[str, FloatArray]
    warnings: tuple[str, ...]


def clean_surface(mesh: SurfaceMesh, weld: float, flat_angle: float, walkable_angle: float, scale: float) -> Surface:
    """Weld, sort out and split the cells of a mesh until it is a walkable surface.

    Parameters
    ----------
    weld : float [m]
        Vertices no farther apart become one; a vertex no farther from the edge of a cell splits it.
    flat_angle, walkable_angle : float [degrees]
        Cells below the first are flat, above the second dropped, between them sloped.
    scale : float
        Metres per unit of the file.

    Raises
    ------
    BuildingError
        If no walkable cell is left.
    """
    notes = list(mesh.warnings)
    vertices, new_index = _weld(mesh.points * scale, weld)
    triangles, tags = new_index[mesh.triangles], mesh.cell_tags
    exit_edges = {name: new_index[edges] for name, edges in mesh.edge_tags.items()}
    exit_edges = {name: edges[edges[:, 0] != edges[:, 1]] for name, edges in exit_edges.items()}

    is_degenerate = _least_height(vertices[triangles]) <= weld
    if is_degenerate.any():
        place = _first_place(vertices, triangles, is_degenerate)
        notes.append(f"{_count(is_degenerate)} without extent dropped, {place}")
    triangles, tags = _distinct(triangles[~is_degenerate], _select(tags, ~is_degenerate))

    is_obstacle = _any_tag(tags, "obstacle", len(triangles))
    obstacles = {
        name: vertices[np.sort(triangles[mask], axis=1)] for name, mask in tags.items() if name.startswith("obstacle:")
    }
    is_steep = np.rad2deg(slope_angle(vertices[triangles])) > walkable_angle + 1e-9
    if (is_steep & ~is_obstacle).any():
        dropped = is_steep & ~is_obstacle
        place = _first_place(vertices, triangles, dropped)
        notes.append(
            f"{_count(dropped)} steeper than {walkable_angle:g} degrees dropped, {place}: walls are not needed, and "
            "stairs are drawn as inclined surfaces, not as treads and risers"
        )
    keep = ~is_steep & ~is_obstacle
    if not keep.any():
        raise BuildingError(
            f"{mesh.source}: no cell is walkable (slope of at most {walkable_angle:g} degrees); "
            "the surface must be drawn in metres with z upwards, in cells larger than building.weld "
            f"({weld:g} m): set building.scale, or turn the mesh"
        )

    triangles, owner, exit_edges = _split_hanging(vertices, triangles[keep], exit_edges, weld)
    tags = {name: mask[owner] for name, mask in _select(tags, keep).items() if not name.startswith("obstacle:")}
    triangles = _counter_clockwise(vertices, triangles)
    order = np.lexsort(triangles.T[::-1])
    triangles, tags = triangles[order], _select(tags, order)
    gradient = _gradient(vertices[triangles])
    is_sloped = np.rad2deg(np.arctan(np.hypot(*gradient.T))) >= flat_angle
    return Surface(vertices, triangles, gradient, is_sloped, tags, exit_edges, obstacles, tuple(notes))


def slope_angle(corners: FloatArray) -> FloatArray:
    """Angle of triangles (t, 3, 3) with the horizontal [rad], whichever way they are wound."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    angle: FloatArray = np.arctan2(np.hypot(normal[:, 0], normal[:, 1]), np.abs(normal[:, 2]))
    return angle


def _weld(points: FloatArray, distance: float) -> tuple[FloatArray, IndexArray]:
    """Merge close points into the least of each cluster; return them sorted, and the new row of each old one."""
    distinct, row = np.unique(points + 0.0, axis=0, return_inverse=True)  # + 0.0 turns -0.0 into 0.0
    pairs = cKDTree(distinct).query_pairs(distance, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(distinct), len(distinct)))
    _, cluster = connected_components(links, directed=False)
    least, cluster_row = np.unique(cluster, return_index=True)
    order = np.argsort(cluster_row)
    rank = np.empty(len(least), dtype=np.int64)
    rank[order] = np.arange(len(least))
    return distinct[cluster_row[order]], rank[cluster[row.ravel()]]


def _least_height(corners: FloatArray) -> FloatArray:
    """Least height of triangles (t, 3, 3), zero where corners coincide [m]."""
    sides = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    twice_area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    height: FloatArray = np.divide(twice_area, longest, out=np.zeros(len(corners)), where=longest > 0)
    return height


def _distinct(triangles: IndexArray, tags: dict[str, BoolArray]) -> tuple[IndexArray, dict[str, BoolArray]]:
    """Drop repeated cells (Gmsh 2.2 writes a cell once for each of its groups) and join their tags."""
    distinct, row = np.unique(np.sort(triangles, axis=1), axis=0, return_inverse=True)
    joined = {}
    for name, mask in tags.items():
        joined[name] = np.zeros(len(distinct), dtype=bool)
        joined[name][row.ravel()[mask]] = True
    return distinct, joined


def _split_hanging(
    vertices: FloatArray, triangles: IndexArray, exit_edges: dict[str, IndexArray], distance: float
) -> tuple[IndexArray, IndexArray, dict[str, IndexArray]]:
    """Split free edges and tagged edges at the vertices that lie on them.

    Returns the triangles, the row each was cut from, and the tagged edges.
    """
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    edges, uses = np.unique(edges, axis=0, return_counts=True)
    tagged = [np.sort(e, axis=1) for e in exit_edges.values()]
    used = np.unique(np.concatenate([triangles.ravel(), *(e.ravel() for e in tagged)]))
    hanging = _vertices_on_edges(vertices, np.concatenate([edges[uses == 1], *tagged]), used, distance)
    if not hanging:
        return triangles, np.arange(len(triangles)), exit_edges

    cells: list[tuple[int, ...]] = []
    owner: list[int] = []
    for row, triangle in enumerate(triangles.tolist()):
        pieces = _split_triangle(tuple(triangle), hanging)
        cells += pieces
        owner += [row] * len(pieces)
    split_edges = {
        name: np.array([piece for a, b in e.tolist() for piece in _split_edge(a, b, hanging)], dtype=np.int64)
        for name, e in exit_edges.items()
    }
    return np.array(cells, dtype=np.int64), np.array(owner), split_edges


def _vertices_on_edges(
    vertices: FloatArray, edges: IndexArray, candidates: IndexArray, distance: float
) -> dict[tuple[int, int], list[int]]:
    """Map each edge (a, b), a < b, to the vertices that lie on it, in their order from a to b."""
    tree = shapely.STRtree(shapely.points(vertices[candidates, :2]))
    lines = shapely.linestrings(vertices[edges][:, :, :2])
    edge, point = tree.query(lines, predicate="dwithin", distance=distance)
    a, b, p = edges[edge, 0], edges[edge, 1], candidates[point]
    along = vertices[b] - vertices[a]
    reach = vertices[p] - vertices[a]
    share = (along * reach).sum(axis=1) / np.square(along).sum(axis=1)
    off = np.linalg.norm(reach - share[:, None] * along, axis=1)
    on = (p != a) & (p != b) & (share > 0) & (share < 1) & (off <= distance)
    hanging: dict[tuple[int, int], list[int]] = {}
    for row in np.flatnonzero(on)[np.argsort(share[on], kind="stable")]:
        found = hanging.setdefault((int(a[row]), int(b[row])), [])
        if int(p[row]) not in found:
            found.append(int(p[row]))
    return hanging


def _split_edge(a: int, b: int, hanging: dict[tuple[int, int], list[int]]) -> list[tuple[int, int]]:
    """Cut an edge at the vertices on it."""
    stops = [min(a, b), *hanging.get((min(a, b), max(a, b)), ()), max(a, b)]
    return list(itertools.pairwise(stops))


def _split_triangle(triangle: tuple[int, ...], hanging: dict[tuple[int, int], list[int]]) -> list[tuple[int, ...]]:
    """Cut a triangle at the vertices on its edges, always through the opposite corner."""
    for turn in range(3):
        a, b, c = triangle[turn], triangle[(turn + 1) % 3], triangle[(turn + 2) % 3]
        inner = hanging.get((min(a, b), max(a, b)))
        if inner:
            pieces = [(p, q, c) for p, q in _split_edge(a, b, hanging)]
            return [cell for piece in pieces for cell in _split_triangle(piece, hanging)]
    return [triangle]


def _counter_clockwise(vertices: FloatArray, triangles: IndexArray) -> IndexArray:
    """Sort the corners of each triangle, then swap the last two where it is clockwise in plan."""
    triangles = np.sort(triangles, axis=1)
    first, second = np.diff(vertices[triangles][:, :, :2], axis=1).transpose(1, 0, 2)
    clockwise = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] < 0
    triangles[clockwise, 1:] = triangles[clockwise, :0:-1]
    return triangles


def _gradient(corners: FloatArray) -> FloatArray:
    """Gradient of z over the plan of triangles (t, 3, 3)."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    gradient: FloatArray = -normal[:, :2] / normal[:, 2:]
    return gradient + 0.0


def _select(tags: dict[str, BoolArray], rows: BoolArray | IndexArray) -> dict[str, BoolArray]:
    """Take some rows of every mask."""
    return {name: mask[rows] for name, mask in tags.items()}


def _any_tag(tags: dict[str, BoolArray], kind: str, n_cells: int) -> BoolArray:
    """Cells that carry a tag of a kind."""
    found = np.zeros(n_cells, dtype=bool)
    for name, mask in tags.items():
        if name.startswith(f"{kind}:"):
            found |= mask
    return found


def _count(mask: BoolArray) -> str:
    """Word the number of cells."""
    number = int(mask.sum())
    return "1 cell" if number == 1 else f"{number} cells"


def _first_place(vertices: FloatArray, triangles: IndexArray, mask: BoolArray) -> str:
    """Name the least vertex of some cells."""
    x, y, z = vertices[triangles[mask].min()]
    return f"the first at ({x:.2f}, {y:.2f}, {z:.2f})"
