"""Neighbour lists: bodies and walls that a body can touch until the lists are rebuilt.

The lists contain everything within the reach of a body plus a skin. They are rebuilt when a body has moved by half
the skin or has changed its level. Kernels select entries by current distances, so results do not depend on when the
lists were built. People are sorted into square cells of each level by a counting sort.
"""

import math

from evac.base.arrays import FloatArray, IntArray
from evac.jit import inner
from evac.physics.extent import greatest_extent
from evac.physics.seams import walls_near
from evac.physics.state import CELLS_PER_LEVEL, CELLS_PER_PERSON, Cells
from evac.physics.status import OK, PAIRS_FULL, WALLS_FULL

#: Least number of columns and rows of cells that are used again, so that those around a cell are different ones.
FEWEST = 3

#: Values of ``Bodies.near_link``: a portal or exit may be crossed before the lists are rebuilt, or one has been.
NEAR, CROSSED = 1, 2


@inner
def line_at(x: float, size: float) -> int:
    """Return the column of an x coordinate, or the row of a y coordinate [m], counted from the origin of the plan."""
    return math.floor(x / size)


@inner
def sort_by_level(cells: Cells, n: int, position: FloatArray, level: IntArray, size: float) -> None:
    """Sort the first `n` people who are on a level into cells of `size` [m]."""
    cells.size = size
    number = _divide(cells, n, position, level)
    start = cells.start
    for c in range(number + 1):
        start[c] = 0
    for i in range(n):
        cells.cell_of[i] = -1
        at = level[i]
        if at >= 0:
            column = line_at(position[i, 0], size) - cells.low_column[at]
            row = line_at(position[i, 1], size) - cells.low_row[at]
            if cells.wraps[at]:
                column, row = column % cells.columns[at], row % cells.rows[at]
            cells.cell_of[i] = cells.first[at] + column * cells.rows[at] + row
            start[cells.cell_of[i]] += 1
    for c in range(number):
        start[c + 1] += start[c]
    # Filling backwards, the end of each cell decreases to its start and people are in ascending order.
    for i in range(n - 1, -1, -1):
        c = cells.cell_of[i]
        if c >= 0:
            start[c] -= 1
            cells.slots[start[c]] = i


@inner
def _divide(cells: Cells, n: int, position: FloatArray, level: IntArray) -> int:
    """Set the rectangle, the numbers of columns and rows and the first cell of each level; return how many cells."""
    levels = cells.first.shape[0]
    for at in range(levels):
        cells.first[at] = 0  # the number of its people, until that of the cells is known
    for i in range(n):
        at = level[i]
        if at >= 0:
            column, row = line_at(position[i, 0], cells.size), line_at(position[i, 1], cells.size)
            if cells.first[at] == 0:
                cells.low_column[at], cells.low_row[at] = column, row
                cells.columns[at], cells.rows[at] = column, row  # the last ones, likewise
            cells.first[at] += 1
            cells.low_column[at] = min(cells.low_column[at], column)
            cells.low_row[at] = min(cells.low_row[at], row)
            cells.columns[at] = max(cells.columns[at], column)
            cells.rows[at] = max(cells.rows[at], row)
    number = 0
    for at in range(levels):
        people = cells.first[at]
        cells.first[at] = number
        if people == 0:
            cells.columns[at] = cells.rows[at] = cells.wraps[at] = 0
            continue
        columns = cells.columns[at] - cells.low_column[at] + 1
        rows = cells.rows[at] - cells.low_row[at] + 1
        room = CELLS_PER_PERSON * people + CELLS_PER_LEVEL
        cells.wraps[at] = columns * rows > room
        if cells.wraps[at]:
            fewer = max(min(columns, rows, int(math.sqrt(room))), FEWEST)
            if columns < rows:
                columns, rows = fewer, room // fewer
            else:
                columns, rows = room // fewer, fewer
        cells.columns[at], cells.rows[at] = columns, rows
        number += columns * rows
    return number


@inner
def segment_distance(segments, w, px, py):
    """Return the distance of p from segment w of some [m], and the nearest point."""
    x1, y1 = segments[w, 0], segments[w, 1]
    dx = segments[w, 2] - x1
    dy = segments[w, 3] - y1
    length2 = dx * dx + dy * dy
    share = 0.0
    if length2 > 0.0:
        share = min(max(((px - x1) * dx + (py - y1) * dy) / length2, 0.0), 1.0)
    nx = x1 + share * dx
    ny = y1 + share * dy
    return ((px - nx) ** 2 + (py - ny) ** 2) ** 0.5, nx, ny


@inner
def unit_normal(nx, ny, square):
    """Return the unit vector and the length; for coincident centres (1, 0), so that body i is pushed to the right."""
    distance = math.sqrt(square)
    if distance > 0.0:
        return nx / distance, ny / distance, distance
    return 1.0, 0.0, 0.0


@inner
def build_lists(world, bodies, lists):
    """List the pairs and walls of the bodies; return OK, PAIRS_FULL or WALLS_FULL."""
    n = bodies.inside
    greatest = 0.0
    for i in range(n):
        if bodies.level[i] >= 0:
            greatest = max(greatest, greatest_extent(bodies, i))
    lists.pair_start[0] = 0
    lists.wall_start[0] = 0
    lists.greatest = greatest
    size = 2.0 * greatest + lists.pair_reach + lists.skin
    sort_by_level(lists.cells, n, bodies.position, bodies.level, size)
    status = _list_pairs(world, bodies, lists)
    if status == OK:
        status = _list_walls(world, bodies, lists)
    if status == OK:
        lists.stale = 0
    return status


@inner
def _list_pairs(world, bodies, lists):
    """List the pairs of bodies, which on different levels touch through portals only; return OK or PAIRS_FULL."""
    pair_body, cells, span = lists.pair_body, lists.cells, lists.pair_reach + lists.skin
    capacity = pair_body.shape[0]
    used = 0
    for i in range(bodies.inside):
        first = used
        own = bodies.level[i]
        x, y, r = bodies.position[i, 0], bodies.position[i, 1], greatest_extent(bodies, i) + span
        levels = levels_in_reach(world, own, x, y, r + lists.greatest) if own >= 0 else 0
        for k in range(levels):
            level = world.linked_level[world.linked_start[own] + k]
            columns, rows, wraps = cells.columns[level], cells.rows[level], cells.wraps[level]
            column = line_at(x, cells.size) - cells.low_column[level]
            row = line_at(y, cells.size) - cells.low_row[level]
            for block in range(9 if wraps else 3):
                # The rows of a column follow one another, unless they begin again.
                if wraps:
                    low = cells.first[level] + (column + block // 3 - 1) % columns * rows + (row + block % 3 - 1) % rows
                    high = low + 1
                else:
                    cx = column + block - 1
                    if cx < 0 or cx >= columns or row < -1 or row > rows:
                        continue
                    low = cells.first[level] + cx * rows + max(row - 1, 0)
                    high = cells.first[level] + cx * rows + min(row + 2, rows)
                low, high = cells.start[low], cells.start[high]
                if used + high - low > capacity:
                    return PAIRS_FULL
                for slot in range(low, high):
                    j = cells.slots[slot]
                    dx = bodies.position[j, 0] - x
                    dy = bodies.position[j, 1] - y
                    limit = r + greatest_extent(bodies, j)
                    # Written in any case, and counted only if it is near, to save a branch that is often mispredicted.
                    pair_body[used] = j
                    used += (dx * dx + dy * dy < limit * limit) & (j > i)
        _sort(pair_body, first, used)
        lists.pair_start[i + 1] = used
    return OK


@inner
def levels_in_reach(world, level, x, y, reach):
    """Return how many of the linked levels of a level are in reach of a place [m]: its own, or all if a portal is."""
    for s in range(world.link_start[level], world.link_start[level + 1]):
        if world.link_to[s] >= 0 and _is_near(world.link_segment, s, x, y, reach):
            return world.linked_start[level + 1] - world.linked_start[level]
    return 1


@inner
def _is_near(segment, s, x, y, reach):
    """Return whether a place is within `reach` of the rectangle around a segment [m]."""
    x1, y1, x2, y2 = segment[s, 0], segment[s, 1], segment[s, 2], segment[s, 3]
    across = max(min(x1, x2) - x, x - max(x1, x2))
    return max(across, min(y1, y2) - y, y - max(y1, y2)) <= reach


@inner
def _sort(numbers, first, last):
    """Sort a few numbers in place, by insertion."""
    for k in range(first + 1, last):
        number = numbers[k]
        place = k
        while place > first and numbers[place - 1] > number:
            numbers[place] = numbers[place - 1]
            place -= 1
        numbers[place] = number


@inner
def _list_walls(world, bodies, lists):
    """List the walls of bodies, and which can reach a portal or exit before the next lists; return OK or WALLS_FULL."""
    wall_item, capacity = lists.wall_item, lists.wall_item.shape[0]
    span, near = lists.wall_reach + lists.skin, 1.5 * lists.skin
    used = 0
    for i in range(bodies.inside):
        level = bodies.level[i]
        bodies.near_link[i] = 0
        if level >= 0:
            x, y, limit = bodies.position[i, 0], bodies.position[i, 1], greatest_extent(bodies, i) + span
            first = used
            levels = levels_in_reach(world, level, x, y, limit)
            for k in range(levels):
                low, high = walls_near(world, world.linked_level[world.linked_start[level] + k], x, y, limit)
                for slot in range(low, high):
                    w = world.bucket_wall[slot]
                    if _is_near(world.wall, w, x, y, limit) and segment_distance(world.wall, w, x, y)[0] < limit:
                        if used == capacity:
                            return WALLS_FULL
                        wall_item[used] = w
                        used += 1
            if levels > 1:
                _sort(wall_item, first, used)
            for s in range(world.link_start[level], world.link_start[level + 1]):
                if _is_near(world.link_segment, s, x, y, near):
                    bodies.near_link[i] = NEAR
                    break
        lists.wall_start[i + 1] = used
        bodies.built_position[i, 0] = bodies.position[i, 0]
        bodies.built_position[i, 1] = bodies.position[i, 1]
    return OK
