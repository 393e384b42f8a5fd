"""Portals, tagged exits, walls and doors from the edges of a surface."""

from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IndexArray, IntArray
from evac.base.errors import BuildingError
from evac.building.geometry.segments import segment_lengths
from evac.building.model.building import Door, Exit, Level, Portal
from evac.building.model.elevation import level_elevation
from evac.building.model.findings import away
from evac.building.surface.edges import EdgeTable, chains, edge_place
from evac.building.surface.levels import LevelSet
from evac.building.surface.surface import Surface


def find_portals(surface: Surface, table: EdgeTable, level_set: LevelSet) -> tuple[Portal, ...]:
    """Make a portal from each chain of edges shared by two levels, ordered by levels and place."""
    shared = np.flatnonzero(table.partner >= 0)
    pairs = np.column_stack([table.cell[shared], table.partner[shared]])
    pairs = level_set.level_of_cell[pairs]
    portals: list[Portal] = []
    for first, second in np.unique(pairs[pairs[:, 0] < pairs[:, 1]], axis=0).tolist():
        between = shared[(pairs == (first, second)).all(axis=1)]
        title = f"{level_set.levels[first].name} - {level_set.levels[second].name}"
        for number, segments in enumerate(chains(surface.vertices, table.ends[between]), start=1):
            name = title if number == 1 else f"{title} ({number})"
            width = float(segment_lengths(segments).sum())
            portals.append(Portal(len(portals), name, (first, second), segments, width))
    return tuple(portals)


def find_exits_and_walls(
    source: Path, surface: Surface, table: EdgeTable, level_set: LevelSet
) -> tuple[tuple[Exit, ...], FloatArray, IntArray]:
    """Divide the free edges into tagged exits, ordered by name, and walls with their levels."""
    free = np.flatnonzero(table.partner < 0)
    level = level_set.level_of_cell[table.cell]
    row_of = {(min(a, b), max(a, b)): row for row, (a, b) in zip(free.tolist(), table.ends[free].tolist(), strict=True)}
    exits: list[Exit] = []
    taken: dict[int, str] = {}
    for tag in sorted(surface.exit_edges):
        rows = []
        for a, b in sorted({(min(edge), max(edge)) for edge in surface.exit_edges[tag].tolist()}):
            row = row_of.get((a, b))
            if row is None or row in taken:
                place = edge_place(surface.vertices, np.array([a, b]))
                cause = (
                    "is not a free edge of the walkable surface" if row is None else f"also has the tag {taken[row]!r}"
                )
                near = "" if row is not None else _nearest_free_edge(surface, table.ends[free], (a, b))
                raise BuildingError(f"{source}: the edge {place} of {tag!r} {cause}; move or remove the tag{near}")
            rows.append(row)
            taken[row] = tag
        exits.append(_tagged_exit(source, surface, table, level_set, len(exits), tag, np.array(rows, dtype=np.int64)))

    walls, wall_level = [np.empty((0, 4))], [np.empty(0, dtype=np.int32)]
    is_wall = np.isin(free, list(taken), invert=True)
    for index in range(len(level_set.levels)):
        own = chains(surface.vertices, table.ends[free[is_wall & (level[free] == index)]])
        walls += own
        wall_level.append(np.full(sum(map(len, own)), index, dtype=np.int32))
    return tuple(exits), *sorted_walls(np.concatenate(walls), np.concatenate(wall_level))


def find_doors(surface: Surface, levels: tuple[Level, ...]) -> tuple[Door, ...]:
    """Return the doors of a surface, each on the level that is nearest to its middle."""
    if not surface.doors:
        return ()
    middle = np.array([ends.mean(axis=0) for _, ends in surface.doors])
    point = shapely.points(middle[:, :2])
    off = np.empty((len(levels), len(middle)))
    for row, level in enumerate(levels):
        near = shapely.get_coordinates(shapely.shortest_line(level.polygon, point))[::2]
        height = level_elevation(surface.vertices, level, near)
        off[row] = shapely.distance(level.polygon, point) + np.abs(height - middle[:, 2])
    doors = []
    for (name, ends), on in zip(surface.doors, off.argmin(axis=0).tolist(), strict=True):
        segment = ends[:, :2].ravel()
        doors.append(Door(name, on, segment, float(np.hypot(*(segment[2:] - segment[:2])))))
    return tuple(doors)


def sorted_walls(walls: FloatArray, wall_level: NDArray[np.integer]) -> tuple[FloatArray, IntArray]:
    """Sort walls (w, 4) by level, x1, y1, x2, y2."""
    order = np.lexsort((*walls.T[::-1], wall_level))
    return np.ascontiguousarray(walls[order]), wall_level[order].astype(np.int32)


def nearest_wall(walls: FloatArray, wall_level: IntArray, levels: tuple[Level, ...], plan: FloatArray) -> str:
    """Describe, for a message, the wall nearest to plan points (n, 2), with its place and distance."""
    if not len(walls):
        return "there is no free edge"
    distance = shapely.distance(shapely.linestrings(walls.reshape(-1, 2, 2)), shapely.multipoints(plan))
    row = int(distance.argmin())
    x1, y1, x2, y2 = walls[row]
    return (
        f"the nearest free edge is ({x1:z.2f}, {y1:z.2f}) - ({x2:z.2f}, {y2:z.2f}) of level "
        f"{levels[wall_level[row]].name!r}, {away(distance[row])}"
    )


def _tagged_exit(
    source: Path, surface: Surface, table: EdgeTable, level_set: LevelSet, index: int, tag: str, rows: IndexArray
) -> Exit:
    """Make the exit of one tag from rows of the edge table."""
    if not len(rows):
        raise BuildingError(f"{source}: the edges of {tag!r} have no length; tag edges longer than building.weld")
    on = np.unique(level_set.level_of_cell[table.cell[rows]])
    if len(on) > 1:
        names = " and ".join(repr(level_set.levels[level].name) for level in on)
        raise BuildingError(f"{source}: {tag!r} lies on the levels {names}; give each part its own name")
    segments = np.concatenate(chains(surface.vertices, table.ends[rows]))
    return Exit(index, tag.removeprefix("exit:"), int(on[0]), segments, float(segment_lengths(segments).sum()))


def _nearest_free_edge(surface: Surface, free: IndexArray, edge: tuple[int, int]) -> str:
    """Describe, for a message, the free edge whose midpoint is nearest to that of an edge."""
    middle = surface.vertices[list(edge)].mean(axis=0)
    distance = np.linalg.norm(surface.vertices[free].mean(axis=1) - middle, axis=1)
    if not len(free):
        return ""
    return f"; the nearest free edge is {edge_place(surface.vertices, free[distance.argmin()])}"
