"""How finely the coordinates of a mesh file are resolved: float32 far from the origin, or too few digits."""

from pathlib import Path

import numpy as np

from evac.arrays import FloatArray
from evac.defaults import WELD
from evac.errors import BuildingError

#: Significant digits of numbers that are written with a fixed number of them: ``%g`` and ``%e`` of C.
DIGITS = (6, 7)
#: A number is on a grid if it is no farther off than this share of the grid's step.
ON_GRID = 1e-3
#: Where no more than this share of an axis' different coordinates have decimals that the other axis lacks, the plan was
#: drawn so: in whole metres with an odd wall, say.
DRAWN_SO = 0.25
#: An axis along which all coordinates are smaller than this says nothing about digits [units of the file].
LEAST_EXTENT = 1e-6
#: Coordinates coarser than this cannot describe doors and walls, whatever the weld [m].
COARSEST = 0.02


def check_resolution(source: Path, points: FloatArray, scale: float, weld: float) -> None:
    """Refuse coordinates that were rounded so coarsely that cells which touch in the building miss in the file.

    A coarse grid alone is no reason, for a room may be drawn in whole metres: the step of the grid must follow from
    how numbers are stored, see `rounding_step`.

    Parameters
    ----------
    points : (v, 3) float64 [units of the file]
    scale : float
        Metres per unit of the file.
    weld : float [m]

    Raises
    ------
    BuildingError
        If the step that x or y were rounded to is greater than `weld` and than its default, which is fine enough.
    """
    plan = points[:, :2]
    step = rounding_step(plan) * scale
    if step <= max(weld, WELD) * (1.0 + ON_GRID):
        return
    x, y, z = points[np.abs(plan).max(axis=1).argmax()]
    unit = 10.0 ** np.floor(np.log10(step))
    weaker = "" if step > COARSEST else f", or set building.weld to {2.0 * np.ceil(step / unit) * unit:g}"
    raise BuildingError(
        f"{source}: coordinates as large as those of the vertex ({x:z.2f}, {y:z.2f}, {z:z.2f}) were rounded to steps "
        f"of {step:.2g} m where they were stored: too coarse for neighbours to meet (building.weld = {weld:g} m); "
        f"export the mesh relative to an origin in the building, or in double precision with all digits{weaker}"
    )


def rounding_step(plan: FloatArray) -> float:
    """Estimate the step that plan coordinates were rounded to where they were stored; 0 if there is no sign of it.

    There are two signs. All coordinates are numbers of float32, as they are or as the shortest decimals for them, and
    some use its last bit: the greatest spacing of float32 is the step. Or the two axes, of different magnitude, have
    the same number of significant digits, the greater one fewer decimals: its last decimal is the step.

    Parameters
    ----------
    plan : (v, 2) float64 [units of the file]
    """
    return max(_float32_step(plan), _decimal_step(plan))


def _float32_step(plan: FloatArray) -> float:
    """Greatest spacing of float32 among the coordinates, if they are all its numbers and use its last bit."""
    values = np.unique(plan)
    single = values.astype(np.float32)
    spacing = np.spacing(np.abs(single)).astype(np.float64)
    # Small numbers may be written with a fixed number of decimals, fewer than float32 has: they are no counter-example.
    off = (np.abs(values - single) > ON_GRID * spacing) & (spacing > ON_GRID * spacing.max())
    if off.any():
        # The shortest decimals that are read back as the same float32; on a coarser grid, they were drawn so.
        coarser = 10.0 ** np.ceil(np.log10(spacing[off]))
        pairs = zip(values[off].tolist(), single[off], strict=True)
        if _on_grid(values[off], coarser) or any(float(str(number)) != value for value, number in pairs):
            return 0.0
    uses_last_bit = np.round(single / spacing) % 2 == 1
    return float(spacing[uses_last_bit].max(initial=0.0))


def _decimal_step(plan: FloatArray) -> float:
    """Last decimal of the axis with fewer decimals, if both axes have the same number of significant digits."""
    largest = np.abs(plan).max(axis=0)
    if largest.min() < LEAST_EXTENT:
        return 0.0
    magnitude = np.floor(np.log10(largest))
    coarse = int(magnitude.argmax())
    for digits in DIGITS:
        steps = 10.0 ** (magnitude - digits + 1)
        if (
            all(_on_grid(plan[:, axis], steps[axis]) for axis in (0, 1))
            and not _on_grid(plan[:, coarse], 10.0 * steps[coarse])
            and _share_off_grid(plan[:, 1 - coarse], steps[coarse]) > DRAWN_SO
        ):
            return float(steps[coarse])
    return 0.0


def _share_off_grid(values: FloatArray, step: float) -> float:
    """Return the share of the different values that are no multiples of a step."""
    cells = np.unique(values) / step
    return float((np.abs(cells - np.round(cells)) > ON_GRID).mean())


def _on_grid(values: FloatArray, step: float | FloatArray) -> bool:
    """Return whether all values are multiples of a step, or each of its own."""
    return bool((np.abs(values / step - np.round(values / step)) <= ON_GRID).all())
