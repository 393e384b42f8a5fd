"""Cell lists: people sorted into square cells of the plan by a counting sort."""

from evac.arrays import FloatArray, IntArray
from evac.jit import inner


@inner
def fill_cells(
    n: int, position: FloatArray, level: IntArray, size: float, start: IntArray, cell_of: IntArray, slots: IntArray
) -> tuple[int, int]:
    """Sort the first `n` people who are on a level into square cells; return the numbers of cells along x and y.

    Cell (column, row) has the index column * ny + row. Its people are in `slots`, in ascending order, from `start` of
    the cell to `start` of the next one. Cells are made larger than `size` [m] if there is no room for all of them.
    """
    big = 1e300
    x_min, y_min, x_max, y_max = big, big, -big, -big
    for i in range(n):
        if level[i] >= 0:
            x_min = min(x_min, position[i, 0])
            x_max = max(x_max, position[i, 0])
            y_min = min(y_min, position[i, 1])
            y_max = max(y_max, position[i, 1])
    cells = start.shape[0] - 1
    while (int((x_max - x_min) / size) + 1.0) * (int((y_max - y_min) / size) + 1.0) > cells:
        size *= 1.5
    nx = int((x_max - x_min) / size) + 1
    ny = int((y_max - y_min) / size) + 1
    for c in range(nx * ny + 1):
        start[c] = 0
    for i in range(n):
        cell_of[i] = -1
        if level[i] >= 0:
            column = int((position[i, 0] - x_min) / size)
            row = int((position[i, 1] - y_min) / size)
            cell_of[i] = column * ny + row
            start[column * ny + row + 1] += 1
    for c in range(nx * ny):
        start[c + 1] += start[c]
    # Filling backwards, the counter of each cell decreases to its start and people are in ascending order.
    for i in range(n - 1, -1, -1):
        c = cell_of[i]
        if c >= 0:
            start[c + 1] -= 1
            slots[start[c + 1]] = i
    for c in range(nx * ny):
        start[c] = start[c + 1]
    placed = 0
    for i in range(n):
        if cell_of[i] >= 0:
            placed += 1
    start[nx * ny] = placed
    return nx, ny
