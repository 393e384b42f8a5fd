"""Clean walkable surface: welded, without degenerate cells and hanging nodes, in canonical order.

The result depends only on the geometry, not on the order of vertices and cells in a file or on their orientation.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from evac.base.arrays import BoolArray, FloatArray, IndexArray
from evac.base.errors import BuildingError, usable_path
from evac.building.geometry import least_height, plan_area
from evac.building.model.building import Building
from evac.building.model.findings import Finding, refusal
from evac.building.options import SurfaceOptions
from evac.building.surface.foreign import walked_surface
from evac.building.surface.resolution import check_extent, check_resolution, doubted_axis
from evac.building.surface.surfacemesh import SurfaceMesh, TriangleMesh, checked
from evac.building.surface.welding import split_at_vertices, weld_points

MOST_CHANGE = 5e-4  #: Largest share by which welding may change the area of the ground.
SILL = 0.02  #: Largest difference in height along the lower edge of a door [m].

#: Greatest rise of a riser, and smallest slope of the sides of a stair, which are not flights [m, degrees].
MOST_RISER, UPRIGHT = 0.5, 85.0


@dataclass(frozen=True)
class Surface:
    """The walkable cells of a building."""

    vertices: FloatArray  # (v, 3) float64 [m]: in the order of (x, y, z)
    triangles: IndexArray  # (t, 3) int64: counter-clockwise in plan, smallest vertex first, sorted by their vertices
    gradient: FloatArray  # (t, 2) float64: gradient (dz/dx, dz/dy) of each cell
    is_sloped: BoolArray  # (t,) bool: false on flat cells
    cell_tags: dict[str, BoolArray]  # dict of str to (t,) bool
    exit_edges: dict[str, IndexArray]  # dict of str to (e, 2) int64: tagged edges; ``exit:NAME`` is the key
    # dict of str to (o, 3, 3) float64 [m]: corners of the cells of each tag ``obstacle:``; they are not in `triangles`
    obstacles: dict[str, FloatArray]
    findings: tuple[Finding, ...]
    doubts: tuple[Finding, ...]  # those of the findings that errors repeat, since they may tell the cause
    given: SurfaceMesh  # the mesh from which it was made, with doors in metres


def clean_surface(mesh: TriangleMesh, options: SurfaceOptions) -> Surface:
    """Convert a mesh to a walkable surface: weld vertices, drop cells that are not walkable, and split cells."""
    weld, walkable_angle, scale = options.weld, options.walkable_angle, options.scale
    check_resolution(mesh.source, mesh.points, scale, weld)
    points = mesh.points * scale
    doubts = (*check_extent(mesh, points, scale), *(doubted_axis(mesh, points) if options.up == "z" else ()))
    is_upright = np.rad2deg(slope_angle(points[mesh.triangles])) > walkable_angle + 1e-9
    mesh, points = walked_surface(mesh, points, is_upright, options)
    notes = [*mesh.findings, *doubts]
    vertices, new_index = weld_points(points, weld)
    exit_edges = {name: new_index[edges] for name, edges in mesh.edge_tags.items()}
    triangles, drawn, tags = _distinct(new_index[mesh.triangles], mesh.cell_tags)
    exit_edges |= _lower_edges(vertices, triangles, tags, walkable_angle, exit_edges)
    exit_edges = {name: edges[edges[:, 0] != edges[:, 1]] for name, edges in exit_edges.items()}

    is_sliver = least_height(vertices[triangles]) <= weld
    is_whole = (np.diff(triangles, axis=1) != 0).all(axis=1)  # none of its sides has collapsed
    is_sliver[is_whole] &= ~_is_fitted(vertices, triangles[is_whole])
    if is_sliver.any():
        text = f"{_count(is_sliver)} dropped as degenerate (height below building.weld)"
        notes.append(Finding("repaired", text, place=_first_place(vertices, triangles, is_sliver)))
    is_obstacle = _any_tag(tags, "obstacle", len(triangles))
    obstacles = {
        name: vertices[triangles[mask & ~is_sliver]] for name, mask in tags.items() if name.startswith("obstacle:")
    }
    is_steep = np.rad2deg(slope_angle(vertices[triangles])) > walkable_angle + 1e-9
    dropped = is_steep & ~is_obstacle & ~is_sliver
    _check_stairs(
        mesh.source, vertices[triangles], {name: mask & dropped for name, mask in tags.items()}, walkable_angle
    )
    if dropped.any():
        text = (
            f"{_count(dropped)} dropped as steeper than {walkable_angle:g} degrees: walls are not needed, and stairs "
            "must be drawn as inclined surfaces, not as treads and risers"
        )
        notes.append(Finding("warning", text, place=_first_place(vertices, triangles, dropped)))
    walkable = ~is_steep & ~is_obstacle & ~is_sliver
    if not walkable.any():
        x, y, z = vertices[triangles[0]].mean(axis=0)
        raise BuildingError(
            f"{mesh.source}: no cell is walkable (slope of at most {walkable_angle:g} degrees), for example the one at "
            f"({x:z.2f}, {y:z.2f}, {z:z.2f}); the surface must be drawn in metres with z upwards, in cells larger than "
            f"building.weld ({weld:g} m): set building.scale or building.up"
        )
    counted = walkable | (is_sliver & ~is_obstacle)
    before, is_sure = points[mesh.triangles[drawn[counted]]], (walkable | ~is_whole)[counted]
    triangles, tags = triangles[walkable], _select(tags, walkable)
    triangles, owner, exit_edges = split_at_vertices(mesh.source, vertices, triangles, exit_edges, weld)
    _check_ground(mesh.source, before, is_sure, vertices[triangles], weld)

    tags = {name: mask[owner] for name, mask in tags.items() if not name.startswith("obstacle:")}
    triangles, tags, exit_edges = _cut_exits(mesh.source, vertices, triangles, tags, exit_edges)
    triangles = _counter_clockwise(vertices, triangles)
    order = np.lexsort(triangles.T[::-1])
    triangles, tags = triangles[order], _select(tags, order)
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    gradient = -normal[:, :2] / normal[:, 2:] + 0.0
    is_sloped = np.rad2deg(np.arctan(np.hypot(*gradient.T))) >= options.flat_angle
    given = replace(mesh.given, doors=[(name, scale * np.asarray(ends)) for name, ends in mesh.given.doors])
    return Surface(vertices, triangles, gradient, is_sloped, tags, exit_edges, obstacles, tuple(notes), doubts, given)


def _is_fitted(vertices: FloatArray, triangles: IndexArray) -> BoolArray:
    """Return the level cells that share at least two sides with one other cell each, as in a triangulation."""
    # Such a cell may be narrow: it is needed, since its neighbours meet its sides and not each other. It is not where
    # rounding has turned it over, so that a neighbour is on the same side of an edge.
    directed = _counter_clockwise(vertices, triangles)[:, [[0, 1], [1, 2], [2, 0]]]
    _, row, uses = np.unique(np.sort(directed.reshape(-1, 2), axis=1), axis=0, return_inverse=True, return_counts=True)
    is_shared = (uses[row.ravel()] == 2).reshape(-1, 3).sum(axis=1) >= 2
    is_level = np.ptp(vertices[triangles][:, :, 2], axis=1) == 0.0
    _, row, uses = np.unique(directed[is_level].reshape(-1, 2), axis=0, return_inverse=True, return_counts=True)
    is_level[is_level] = (uses[row.ravel()] == 1).reshape(-1, 3).all(axis=1)
    is_fitted: BoolArray = is_level & is_shared & (plan_area(vertices[triangles]) > 0.0)
    return is_fitted


def slope_angle(corners: FloatArray) -> FloatArray:
    """Return the angles (t,) of triangles (t, 3, 3) with the horizontal [rad], independent of their orientation."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    angle: FloatArray = np.arctan2(np.hypot(normal[:, 0], normal[:, 1]), np.abs(normal[:, 2]))
    return angle


def _check_stairs(source: Path, corners: FloatArray, steep: dict[str, BoolArray], walkable_angle: float) -> None:
    """Refuse flights of tagged stairs that are too steep, among the cells (t,) that are; risers are no flights."""
    rise, angle = np.ptp(corners[:, :, 2], axis=1), slope_angle(corners)
    errors = []
    is_flight = (rise > MOST_RISER) & (np.rad2deg(angle) < UPRIGHT)
    for name, mask in sorted(steep.items()):
        rows = np.flatnonzero(mask & is_flight)
        if name.startswith("stair:") and len(rows):
            row = rows[rise[rows].argmax()]
            x, y, _ = corners[row].mean(axis=0)
            text = (
                f"stair {name.removeprefix('stair:')!r} rises {rise[row]:.2f} m over "
                f"{rise[row] / np.tan(angle[row]):.2f} m in plan ({np.rad2deg(angle[row]):.0f} degrees) at ({x:z.2f}, "
                f"{y:z.2f}), steeper than building.walkable_angle ({walkable_angle:g} degrees): make it at least "
                f"{np.ceil(100.0 * rise[row] / np.tan(np.deg2rad(walkable_angle))) / 100.0:.2f} m long"
            )
            errors.append(Finding("error", text, None, (float(x), float(y)), f"stairs.{name.removeprefix('stair:')}"))
    if errors:
        raise refusal(source, errors)


def _distinct(triangles: IndexArray, tags: dict[str, BoolArray]) -> tuple[IndexArray, IndexArray, dict[str, BoolArray]]:
    """Return the distinct cells, since Gmsh 2.2 repeats them, the row of `triangles` of each, and the merged tags."""
    distinct, first, row = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True, return_inverse=True)
    joined = {}
    for name, mask in tags.items():
        joined[name] = np.zeros(len(distinct), dtype=bool)
        joined[name][row.ravel()[mask]] = True
    return distinct, first, joined


def _lower_edges(
    vertices: FloatArray,
    triangles: IndexArray,
    tags: dict[str, BoolArray],
    walkable_angle: float,
    edges: dict[str, IndexArray],
) -> dict[str, IndexArray]:
    """Return the edges of exits, including the level lower edges of upright cells, which represent doors."""
    found: dict[str, IndexArray] = {}
    for name in (name for name in tags if name.startswith("exit:")):
        cells = triangles[tags[name]]
        cells = cells[np.rad2deg(slope_angle(vertices[cells])) > walkable_angle + 1e-9]
        if len(cells):
            sides = np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]])
            lowest = vertices[cells][:, :, 2].min()
            is_low = (np.abs(vertices[sides][:, :, 2] - lowest) <= SILL).all(axis=1)
            found[name] = np.concatenate([edges.get(name, np.empty((0, 2), dtype=np.int64)), sides[is_low]])
    return found


def _cut_exits(
    source: Path, vertices: FloatArray, triangles: IndexArray, tags: dict[str, BoolArray], edges: dict[str, IndexArray]
) -> tuple[IndexArray, dict[str, BoolArray], dict[str, IndexArray]]:
    """Remove the cells of exits, which are ground outside; the edges that they share with the rest become exits."""
    is_exit = _any_tag(tags, "exit", len(triangles))
    if not is_exit.any():
        return triangles, {name: mask for name, mask in tags.items() if not name.startswith("exit:")}, edges
    sides = np.sort(np.stack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]], axis=1), axis=2)
    floor = {tuple(side) for side in sides[~is_exit].reshape(-1, 2).tolist()}
    edges = dict(edges)
    for name in (name for name in tags if name.startswith("exit:") and tags[name].any()):
        own = [side for side in sides[tags[name]].reshape(-1, 2).tolist() if tuple(side) in floor]
        if not own:
            x, y, z = vertices[triangles[tags[name]][0]].mean(axis=0)
            raise BuildingError(
                f"{source}: the cells of {name!r} at ({x:z.2f}, {y:z.2f}, {z:z.2f}) share no edge with the floor; draw "
                "them adjacent to the floor (within building.weld), or tag edges of its outline instead"
            )
        edges[name] = np.concatenate([edges.get(name, np.empty((0, 2), dtype=np.int64)), np.array(own)])
    kept = {name: mask[~is_exit] for name, mask in tags.items() if not name.startswith("exit:")}
    return triangles[~is_exit], kept, edges


def _check_ground(source: Path, before: FloatArray, is_sure: BoolArray, after: FloatArray, weld: float) -> None:
    """Refuse cells (t, 3, 3) so narrow that welding changes the area of the ground in plan."""
    # Cells that are not `is_sure` are slivers, which may be separate ground or overlap other cells: the area must be
    # right in both cases.
    drawn = plan_area(before)
    for least in (drawn.sum(), drawn[is_sure].sum()):
        change = float(plan_area(after).sum() - least)
        if abs(change) > MOST_CHANGE * least:
            x, y, z = before[np.argmin(least_height(before))].mean(axis=0)
            raise BuildingError(
                f"{source}: merging vertices changes the area of {least:.4g} m2 by {change:+.2g} m2: the width of "
                f"cells is close to building.weld ({weld:g} m), for example at ({x:z.2f}, {y:z.2f}, {z:z.2f}); "
                "remove such cells, draw larger cells, or decrease building.weld"
            )


def _counter_clockwise(vertices: FloatArray, triangles: IndexArray) -> IndexArray:
    """Sort the corners of each triangle, then swap the last two if it is clockwise in plan."""
    triangles = np.sort(triangles, axis=1)
    first, second = np.diff(vertices[triangles][:, :, :2], axis=1).transpose(1, 0, 2)
    clockwise = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] < 0
    triangles[clockwise, 1:] = triangles[clockwise, :0:-1]
    return triangles


def _select(tags: dict[str, BoolArray], rows: BoolArray | IndexArray) -> dict[str, BoolArray]:
    """Select rows of every mask."""
    return {name: mask[rows] for name, mask in tags.items()}


def _any_tag(tags: dict[str, BoolArray], kind: str, n_cells: int) -> BoolArray:
    """Return the mask of cells with a tag of a given kind."""
    is_tagged = np.zeros(n_cells, dtype=bool)
    for name, mask in tags.items():
        if name.startswith(f"{kind}:"):
            is_tagged |= mask
    return is_tagged


def _count(mask: BoolArray) -> str:
    """Describe a number of cells, for a message."""
    number = int(mask.sum())
    return "1 cell" if number == 1 else f"{number} cells (the first one is here)"


def _first_place(vertices: FloatArray, triangles: IndexArray, mask: BoolArray) -> tuple[float, float, float]:
    """Return the first vertex, in the order of (x, y, z), of the marked cells."""
    x, y, z = vertices[triangles[mask].min()].tolist()
    return x, y, z


LINE, TRIANGLE = 1, 2  #: Element type numbers of Gmsh.


def write_surface(mesh: SurfaceMesh, path: Path) -> None:
    """Write a triangulated surface mesh; a cell or edge with several tags is written once for each, as in Gmsh."""
    whole = checked(path, mesh)
    groups = [(1, LINE, tag, pairs) for tag, pairs in whole.edge_tags.items()]
    groups += [(2, TRIANGLE, tag, whole.triangles[mask]) for tag, mask in whole.cell_tags.items()]
    is_bare = ~np.any([np.zeros(len(whole.triangles), dtype=bool), *whole.cell_tags.values()], axis=0)
    named = [group for group in groups if len(group[3])]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(named))]
    # As meshio reads them, quotes and backslashes in tags follow a backslash.
    quoted = [tag.replace("\\", "\\\\").replace('"', '\\"') for _, _, tag, _ in named]
    lines += [f'{named[row][0]} {row + 1} "{tag}"' for row, tag in enumerate(quoted)]
    lines += ["$EndPhysicalNames", "$Nodes", str(len(whole.points))]
    lines += [f"{row} {x!r} {y!r} {z!r}" for row, (x, y, z) in enumerate(whole.points.tolist(), start=1)]
    cells = [f"{TRIANGLE} 2 0 0 {a} {b} {c}" for a, b, c in (whole.triangles[is_bare] + 1).tolist()]
    for number, (_, element, _, rows) in enumerate(named, start=1):
        cells += [f"{element} 2 {number} {number} {' '.join(map(str, row))}" for row in (rows + 1).tolist()]
    lines += ["$EndNodes", "$Elements", str(len(cells))]
    lines += [f"{row} {cell}" for row, cell in enumerate(cells, start=1)]
    try:
        usable_path(path, BuildingError).write_text("\n".join([*lines, "$EndElements", ""]), encoding="utf-8")
    except OSError as error:
        raise BuildingError(f"{path}: cannot be written ({error.strerror}); choose another path") from error


def tagged_surface(surface: Surface, building: Building) -> SurfaceMesh:
    """Return a surface as a mesh with tags for its floors and stairs, from which an equal building is made."""
    row_of = {tuple(cell): row for row, cell in enumerate(surface.triangles.tolist())}
    tags: dict[str, BoolArray] = {}
    for level in building.levels:
        tag = f"floor:{level.name}" if level.stair is None else f"stair:{level.stair}"
        mask = tags.setdefault(tag, np.zeros(len(row_of), dtype=bool))
        mask[[row_of[tuple(cell)] for cell in level.triangles.tolist()]] = True
    tags |= {tag: mask for tag, mask in surface.cell_tags.items() if tag.startswith("area:")}
    points, cells = surface.vertices, surface.triangles
    obstacles = [corners for corners in surface.obstacles.values() if len(corners)]
    more = np.arange(len(points), len(points) + 3 * sum(map(len, obstacles))).reshape(-1, 3)
    tags = {tag: np.append(mask, np.zeros(len(more), dtype=bool)) for tag, mask in tags.items()}
    first = len(cells)
    for tag, corners in surface.obstacles.items():
        tags[tag] = np.zeros(len(cells) + len(more), dtype=bool)
        tags[tag][first : first + len(corners)] = True
        first += len(corners)
    points = np.concatenate([points, *(corners.reshape(-1, 3) for corners in obstacles)])
    return SurfaceMesh(points, np.concatenate([cells, more]), tags, surface.exit_edges)
