"""Writing of surfaces to Gmsh 2.2 files: tags are physical groups, and every level of a building is tagged."""

from pathlib import Path

import numpy as np

from evac.base.arrays import BoolArray
from evac.base.errors import BuildingError, usable_path
from evac.building.model.building import Building
from evac.building.surface.surface import Surface
from evac.building.surface.surfacemesh import SurfaceMesh, checked

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
