"""Plausible sizes of buildings, and the unit that makes an implausible size plausible."""

#: Range of plausible extents of a building [m]; others cause a warning.
SMALLEST, LARGEST = 2.0, 5e3
#: Factors between length units that drawings and exporters confuse, the most likely first.
FACTORS = (0.001, 0.01, 0.0254, 0.3048, 1000.0, 100.0, 1.0 / 0.0254, 1.0 / 0.3048)


def helpful_factor(extent: float) -> float | None:
    """Return the factor that makes an implausible extent [m] plausible; None if it is plausible or no factor helps."""
    if SMALLEST <= extent <= LARGEST:
        return None
    return next((factor for factor in FACTORS if SMALLEST <= factor * extent <= LARGEST), None)
