"""Conversion of a clean surface to a mesh in which every level is tagged with its name."""

import numpy as np

from evac.base.arrays import BoolArray
from evac.building.model.building import Building
from evac.building.surface.surface import Surface
from evac.building.surface.surfacemesh import SurfaceMesh


def tagged_surface(surface: Surface, building: Building) -> SurfaceMesh:
    """Return a surface as a mesh with a tag for each floor and stair of its building.

    A building read from this mesh has the same levels, areas, tagged exits and obstacles.

    Parameters
    ----------
    surface : Surface
    building : Building
        The result of `evac.building.surface.build.building_of` for `surface`.

    Returns
    -------
    SurfaceMesh
        In metres.
    """
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
