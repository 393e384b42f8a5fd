"""How large buildings are, and the factor that makes one of an implausible size plausible."""

#: Buildings of another extent than this are doubted [m].
SMALLEST, LARGEST = 2.0, 5e3
#: Metres in units that drawings are made in, and in those that exporters take for others: the likelier first.
FACTORS = (0.001, 0.01, 0.0254, 0.3048, 1000.0, 100.0, 1.0 / 0.0254, 1.0 / 0.3048)


def helpful_factor(extent: float) -> float | None:
    """Return by what to multiply an implausible extent [m]; None if it is plausible or nothing helps."""
    if SMALLEST <= extent <= LARGEST:
        return None
    return next((factor for factor in FACTORS if SMALLEST <= factor * extent <= LARGEST), None)
