"""The building for the replay page, in whole centimetres from the origin of the replay."""

import math
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from evac.analysis.maps import SPACING
from evac.base.arrays import FloatArray
from evac.building.model.building import Building, Level, Place
from evac.building.model.cells import Cells
from evac.building.model.elevation import on_level, triangles_on
from evac.building.model.marks import furniture_of, marks_of
from evac.replay.motion import GRAIN, is_even, level_plane

#: Greatest number of cells of the maps of all levels, and along x on one of them: a texture has no more.
MOST_CELLS, MOST_COLUMNS = 1_000_000, 4000

#: Half the diagonal of the square on the floor that stands for a sign or a fire, and half of the width of a line [m].
WIDTHS = {"sign": 0.3, "fire": 0.8, "line": 0.06}


def building_for_page(building: Building, origin: FloatArray) -> tuple[dict[str, Any], NDArray[np.uint8]]:
    """Return levels, walls, portals, exits, stairs and places as lists of numbers and strings, and the floors.

    `origin` (2,) [m]: origin of positions in plan. Returns `page`: ``vertices`` [x, y, z, ...] and all other lengths in
    centimetres; ``triangles`` of a level are vertex indices. Planes z = c + a x + b y are in metres. ``segments`` are
    [x1, y1, z1, x2, y2, z2, ...]. ``cell`` is the side of the cells of maps, of which ``grid`` of a level has the lower
    left corner [m] and the numbers along x and y; `floors` (b,): bits: whether the centre of each cell is on the floor,
    of all levels.
    """
    spacing = _spacing(building)
    grids = [Cells(level, spacing) for level in building.levels]
    on_floor = [
        shapely.contains_xy(level.polygon, *cells.centres()).ravel()
        for level, cells in zip(building.levels, grids, strict=True)
    ]
    shaft_of = {stair: shaft for shaft, stairs in building.shafts.items() for stair in stairs}
    ends = np.array([door.segment for door in building.doors]).reshape(-1, 2)
    on = np.array([door.level for door in building.doors], np.int32).repeat(2)
    doors = _grains(on_level(building, on, ends), origin)  # of all at once, since there may be thousands
    page = {
        "cell": spacing,
        "vertices": _grains(building.vertices, origin).ravel().tolist(),
        "levels": [
            _level(building, level, origin) | {"grid": [*(cells.origin - origin).tolist(), *cells.shape[::-1]]}
            for level, cells in zip(building.levels, grids, strict=True)
        ],
        "portals": [
            {"levels": list(portal.levels), "segments": _segments(building, portal.segments, portal.levels[0], origin)}
            for portal in building.portals
        ],
        "exits": [
            {
                "name": exit_.name,
                "level": exit_.level,
                "segments": _segments(building, exit_.segments, exit_.level, origin),
            }
            for exit_ in building.exits
        ],
        "doors": [
            {"level": door.level, "segments": segments}
            for door, segments in zip(building.doors, doors.reshape(-1, 6).tolist(), strict=True)
        ],
        "places": [_place(building, place, origin) for place in building.places],
        "stairs": [
            {"name": name, "shaft": shaft_of[name], "levels": list(levels)} for name, levels in building.stairs.items()
        ],
    }
    return page, np.packbits(np.concatenate(on_floor))


def _spacing(building: Building) -> float:
    """Return the side of the cells of maps [m]: that of `evac map`, or a multiple of it for large buildings."""
    low_x, low_y, high_x, high_y = shapely.bounds([level.polygon for level in building.levels]).T
    area, longest = float(((high_x - low_x) * (high_y - low_y)).sum()), float((high_x - low_x).max())
    return SPACING * math.ceil(max(1.0, math.sqrt(area / MOST_CELLS) / SPACING, longest / MOST_COLUMNS / SPACING))


def _level(building: Building, level: Level, origin: FloatArray) -> dict[str, Any]:
    c, a, b = level_plane(building, level)
    walls = building.walls[building.wall_level == level.index]
    furniture = furniture_of(level) if level.kind == "floor" else []
    is_low = _are_sides(walls, furniture)
    tops = triangles_on(building, level.index, shapely.multipolygons(furniture)) if furniture else np.zeros((0, 3))
    return {
        "name": level.title,
        "kind": level.kind,
        "plane": [round(c + a * origin[0] + b * origin[1], 5), round(a, 7), round(b, 7)],
        "uneven": not is_even(building, level) or level.kind == "car",  # cars move
        "z": [round(level.z_min, 3), round(level.z_max, 3)],
        "triangles": level.triangles.ravel().tolist(),
        "walls": _segments(building, walls[~is_low], level.index, origin),
        "furniture": {
            "sides": _segments(building, walls[is_low], level.index, origin),
            "top": _grains(tops[:, :2], origin).ravel().tolist(),
        },
    }


def marks_for_page(building: Building, origin: FloatArray) -> list[dict[str, Any]]:
    """Return slow and barred areas and the arrows of links of a building as it is at a time."""
    return [
        {"kind": mark.kind, "level": mark.level, "triangles": _triangles(building, mark.shape, mark.level, origin)}
        for mark in marks_of(building)
    ]


def _place(building: Building, place: Place, origin: FloatArray) -> dict[str, Any]:
    """Return the middle of a place, and its triangles as points in space; points and lines have some width."""
    width = WIDTHS.get(place.kind)
    shape = place.shape if width is None else place.shape.buffer(width, quad_segs=1)
    at = on_level(building, place.level, shapely.get_coordinates(shape.representative_point()))
    return {
        "name": str(place),
        "kind": place.kind,
        "level": place.level,
        "at": _grains(at, origin).ravel().tolist(),
        "triangles": _triangles(building, shape, place.level, origin),
    }


def _triangles(building: Building, shape: BaseGeometry, level: int, origin: FloatArray) -> list[int]:
    """Return the triangles of a shape on a level as points in space."""
    return _grains(triangles_on(building, level, shape), origin).ravel().tolist()


def _segments(building: Building, segments: FloatArray, level: int, origin: FloatArray) -> list[int]:
    """Return plan segments (s, 4) on a level as points in space."""
    return _grains(on_level(building, level, segments.reshape(-1, 2)), origin).ravel().tolist()


def _are_sides(walls: FloatArray, furniture: list[shapely.Polygon]) -> NDArray[np.bool_]:
    """Return which walls (w, 4) are sides of furniture, (w,)."""
    if not furniture:
        return np.zeros(len(walls), bool)
    middles = shapely.points(0.5 * (walls[:, :2] + walls[:, 2:]))
    sides = shapely.STRtree([piece.exterior for piece in furniture])
    are_sides = np.zeros(len(walls), bool)
    are_sides[sides.query(middles, predicate="dwithin", distance=GRAIN)[0]] = True
    return are_sides


def _grains(points: FloatArray, origin: FloatArray) -> NDArray[np.int64]:
    """Return points (n, 2 or 3) relative to the origin in plan, in whole centimetres."""
    zero = np.zeros(points.shape[1])
    zero[:2] = origin
    return np.rint((points - zero) / GRAIN).astype(np.int64)
