"""Plausible sizes of buildings, and the unit that makes an implausible size plausible."""

#: Range of plausible extents of a building [m]; others cause a warning.
SMALLEST, LARGEST = 2.0, 5e3
#: Factors between length units that drawings and exporters confuse, the most likely first.
FACTORS = (0.001, 0.01, 0.0254, 0.3048, 1000.0, 100.0, 1.0 / 0.0254, 1.0 / 0.3048)


def is_plausible(extent: float) -> bool:
    """Return whether a building may extend so far [m]."""
    return SMALLEST <= extent <= LARGEST


def helpful_factor(extent: float) -> float | None:
    """Return the factor that makes an implausible extent [m] plausible; None if it is plausible or no factor helps."""
    if is_plausible(extent):
        return None
    return next((factor for factor in FACTORS if is_plausible(factor * extent)), None)
