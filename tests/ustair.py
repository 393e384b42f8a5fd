"""A bare surface, written for tests: two floors of 20 x 18 m, each with a pillar, and a U-shaped stair between them."""

import itertools
from pathlib import Path

import numpy as np
import shapely

#: Heights of the landing and of the upper floor, which are exact in single precision [m].
HALF, TOP = 1.625, 3.25
#: In plan [m]: the stair, its flights of 5 m along x, which meet at y = 8, and its landing.
STAIR = [(7, 5), (12, 5), (13.5, 5), (13.5, 11), (12, 11), (7, 11), (7, 8)]
UP, BACK = (
    [(7, 5, 0.0), (12, 5, HALF), (12, 8, HALF), (7, 8, 0.0)],
    [(12, 8, HALF), (12, 11, HALF), (7, 11, TOP), (7, 8, TOP)],
)
LANDING = [(12, 5, HALF), (13.5, 5, HALF), (13.5, 11, HALF), (12, 11, HALF), (12, 8, HALF)]
#: Least distance from the head of the stair to its foot along the slope of both flights [m].
SHORTEST = 2 * float(np.hypot(5.0, HALF))


def write_u_stair(path: Path) -> Path:
    """Write the surface as triangles in an OBJ file without names, groups and edges."""
    triangles = [corners for face in (UP, BACK, LANDING) for corners in _fan(face)]
    for z, pillar in ((0.0, shapely.box(3, 13, 5, 15)), (TOP, shapely.box(15, 2, 17, 4))):
        ground = shapely.Polygon([(0, 0), (20, 0), (20, 18), (0, 18)], [STAIR, pillar.exterior.coords])
        for part in shapely.get_parts(shapely.constrained_delaunay_triangles(ground)):
            triangles.append([(x, y, z) for x, y in part.exterior.coords[:3]])
    points = {point: number for number, point in enumerate(dict.fromkeys(itertools.chain(*triangles)), start=1)}
    lines = [f"v {x:g} {y:g} {z:g}" for x, y, z in points]
    lines += ["f " + " ".join(str(points[corner]) for corner in corners) for corners in triangles]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _fan(corners: list[tuple[float, float, float]]) -> list[list[tuple[float, float, float]]]:
    """Return the triangles of a convex polygon, of which the last three corners may lie on a line."""
    return [[corners[-1], *pair] for pair in itertools.pairwise(corners[:-1])]
