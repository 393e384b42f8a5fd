"""Resolution of the coordinates in a mesh file, limited by float32 or by the number of digits."""

from pathlib import Path

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.defaults import WELD
from evac.base.errors import BuildingError

#: Usual numbers of significant digits, as written by the formats ``%g`` and ``%e`` of C.
DIGITS = (6, 7)
#: A number is on a grid if its distance is at most this share of the grid step.
ON_GRID = 1e-3
#: If at most this share of the distinct coordinates of an axis has decimals that the other axis lacks, the coordinates
#: were not rounded, but drawn so, for example in whole metres except for one wall.
DRAWN_SO = 0.25
#: Axes whose coordinates are all smaller than this are not used to estimate digits [units of the file].
LEAST_EXTENT = 1e-6
#: Coordinates coarser than this cannot represent doors and walls, whatever the weld [m].
COARSEST = 0.02


def check_resolution(source: Path, points: FloatArray, scale: float, weld: float) -> None:
    """Refuse coordinates rounded so coarsely that adjacent cells of the building do not meet in the file.

    A coarse grid alone is accepted, since a room may be drawn in whole metres. The grid step must result from the
    number format, see `rounding_step`.

    Parameters
    ----------
    points : (v, 3) float64 [units of the file]
    scale : float
        Metres per unit of the file.
    weld : float [m]

    Raises
    ------
    BuildingError
        If the rounding step of x or y is greater than both `weld` and its default, which is fine enough.
    """
    plan = points[:, :2]
    step = rounding_step(plan) * scale
    if step <= max(weld, WELD) * (1.0 + ON_GRID):
        return
    x, y, z = points[np.abs(plan).max(axis=1).argmax()]
    unit = 10.0 ** np.floor(np.log10(step))
    weaker = "" if step > COARSEST else f", or set building.weld to {2.0 * np.ceil(step / unit) * unit:g}"
    raise BuildingError(
        f"{source}: coordinates as large as those of the vertex ({x:z.2f}, {y:z.2f}, {z:z.2f}) are rounded to steps "
        f"of {step:.2g} m in the file, too coarse for neighbours to meet (building.weld = {weld:g} m); "
        f"export the mesh relative to an origin in the building, or in double precision with all digits{weaker}"
    )


def rounding_step(plan: FloatArray) -> float:
    """Estimate the rounding step of stored plan coordinates; 0 if there is no evidence of rounding.

    There are two kinds of evidence. All coordinates are float32 numbers, or their shortest decimal representations, and
    some use the last bit: the step is the largest spacing of float32. Or the two axes have different magnitudes but the
    same number of significant digits, so that the larger one has fewer decimals: the step is its last decimal.

    Parameters
    ----------
    plan : (v, 2) float64 [units of the file]
    """
    return max(_float32_step(plan), _decimal_step(plan))


def _float32_step(plan: FloatArray) -> float:
    """Return the largest spacing of float32 among the coordinates, if all are float32 numbers and use the last bit."""
    values = np.unique(plan)
    single = values.astype(np.float32)
    spacing = np.spacing(np.abs(single)).astype(np.float64)
    # Small numbers may be written with a fixed number of decimals, fewer than float32 has, and are not evidence.
    off = (np.abs(values - single) > ON_GRID * spacing) & (spacing > ON_GRID * spacing.max())
    if off.any():
        # Shortest decimals that are read back as the same float32. Coordinates on a coarser grid were drawn so.
        coarser = 10.0 ** np.ceil(np.log10(spacing[off]))
        pairs = zip(values[off].tolist(), single[off], strict=True)
        if _on_grid(values[off], coarser) or any(float(str(number)) != value for value, number in pairs):
            return 0.0
    uses_last_bit = np.round(single / spacing) % 2 == 1
    return float(spacing[uses_last_bit].max(initial=0.0))


def _decimal_step(plan: FloatArray) -> float:
    """Return the last decimal of the axis with fewer decimals, if both axes have equally many significant digits."""
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
    """Return the share of the distinct values that are not multiples of a step."""
    cells = np.unique(values) / step
    return float((np.abs(cells - np.round(cells)) > ON_GRID).mean())


def _on_grid(values: FloatArray, step: float | FloatArray) -> bool:
    """Return whether all values are multiples of a common step, or each of its own step."""
    return bool((np.abs(values / step - np.round(values / step)) <= ON_GRID).all())
