"""Writing of a surface mesh to a Gmsh 2.2 file, with its tags as physical groups."""

from pathlib import Path

import numpy as np

from evac.base.errors import BuildingError, usable_path
from evac.building.surface.surfacemesh import SurfaceMesh, checked

#: Element type numbers of Gmsh.
LINE, TRIANGLE = 1, 2


def write_surface(mesh: SurfaceMesh, path: Path) -> None:
    """Write a triangulated surface mesh; equal meshes give identical files.

    A cell or edge with several tags is written once for each of them, as in Gmsh; readers merge them.

    Raises
    ------
    BuildingError
        The mesh is invalid, or the file cannot be written.
    """
    whole = checked(path, mesh)
    groups = [(1, LINE, tag, pairs) for tag, pairs in whole.edge_tags.items()]
    groups += [(2, TRIANGLE, tag, whole.triangles[mask]) for tag, mask in whole.cell_tags.items()]
    is_bare = ~np.any([np.zeros(len(whole.triangles), dtype=bool), *whole.cell_tags.values()], axis=0)
    named = [group for group in groups if len(group[3])]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(named))]
    lines += [f"{dimension} {number} {_quoted(tag)}" for number, (dimension, _, tag, _) in enumerate(named, start=1)]
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


def _quoted(tag: str) -> str:
    """Return a tag in quotes, as meshio reads it: with a backslash before quotes and backslashes."""
    escaped = tag.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
