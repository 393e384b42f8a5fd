"""Walkable surfaces of meshes from other tools, with solid bodies and with stairs drawn as treads."""

from dataclasses import replace

import numpy as np

from evac.base.arrays import BoolArray, FloatArray
from evac.base.errors import BuildingError
from evac.building.geometry.polygons import least_height
from evac.building.model.findings import Finding
from evac.building.options import SurfaceOptions
from evac.building.surface.patches import bodies, cells_of, closed_bodies, patches_of
from evac.building.surface.solids import walked_on
from evac.building.surface.surfacemesh import TriangleMesh
from evac.building.surface.treads import may_have_treads, with_flights
from evac.building.surface.welding import weld_points


def turned(mesh: TriangleMesh, up: str) -> TriangleMesh:
    """Rotate a mesh so that its axis `up` becomes z."""
    if up == "z":
        return mesh
    doors = tuple((name, _turned(ends)) for name, ends in mesh.doors)
    return replace(mesh, points=_turned(mesh.points), doors=doors)


def _turned(points: FloatArray) -> FloatArray:
    x, y, z = points.T
    return np.ascontiguousarray(np.column_stack([x, -z, y]) + 0.0)


def walked_surface(
    mesh: TriangleMesh, points: FloatArray, is_steep: BoolArray, options: SurfaceOptions
) -> tuple[TriangleMesh, FloatArray]:
    """Remove ground inside solid bodies or with too little headroom, and replace treads by inclined flights.

    A mesh without solid bodies and treads is returned unchanged.

    Parameters
    ----------
    mesh : TriangleMesh
    points : (v, 3) float64 [m]
        Its points.
    is_steep : (t,) bool
        Cells too steep to walk on.
    options : SurfaceOptions

    Returns
    -------
    mesh : TriangleMesh
    points : (w, 3) float64 [m]
        Its points.

    Raises
    ------
    BuildingError
        The remaining surface cannot be triangulated; names the place.
    """
    weld, headroom, treads = options.weld, options.headroom, options.treads
    heights = points[mesh.triangles][:, :, 2]
    has_treads = treads and may_have_treads(heights[np.ptp(heights, axis=1) <= weld][:, 0])
    has_bodies = headroom > 0.0 and bool(is_steep.any())
    if not (has_treads or has_bodies) or is_steep.all():
        return mesh, points
    vertices, index = weld_points(points, weld)
    rows = np.unique(np.sort(index[mesh.triangles], axis=1), axis=0, return_index=True)[1]
    rows = rows[least_height(vertices[index[mesh.triangles[rows]]]) > weld]
    cells, steep = index[mesh.triangles[rows]], is_steep[rows]
    if steep.all():
        return mesh, points
    body = bodies(len(vertices), cells)
    tags = {name: mask[rows][~steep] for name, mask in mesh.cell_tags.items()}
    before = patches_of(vertices, cells[~steep], body[~steep], tags)
    after, notes = before, list[Finding]()
    if has_bodies:
        solid = set(body[steep].tolist())
        after, notes = walked_on(before, solid, closed_bodies(cells, body) & solid, headroom)
    if has_treads:
        after, more = with_flights(after, headroom)
        notes = notes + more
    if not notes:
        return mesh, points
    try:
        corners, of = cells_of(after)
    except ValueError as error:
        raise BuildingError(f"{mesh.source}: {error}; repair the mesh there, or set building.headroom = 0") from error
    made = np.arange(3 * len(corners)).reshape(-1, 3) + len(points)
    cell_tags = {name: np.array([name in own for own in of], dtype=bool) for name in mesh.cell_tags}
    whole = np.concatenate([points, corners.reshape(-1, 3)])
    findings = (*mesh.findings, *notes)
    return replace(mesh, points=whole, triangles=made, cell_tags=cell_tags, findings=findings), whole
