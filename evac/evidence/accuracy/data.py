"""Common definitions of the accuracy page: plot styles of variants, measured orders of convergence."""

from collections.abc import Sequence

import numpy as np

from evac.evidence.report import MODEL_COLOURS

#: Marker, marker size and line width of each line, such that lines on top of each other remain visible.
STYLES = (("o", 9.0, 4.0), ("s", 6.5, 2.6), ("^", 5.5, 1.8), ("D", 4.0, 1.3), (".", 4.0, 0.8))


def order_of(steps: Sequence[float], errors: Sequence[float]) -> float:
    """Return the measured order of convergence: the slope of log error over log step, least squares."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def colour_of(variant: str) -> str:
    """Return the colour of the contact model that a label such as ``"NSM2, K_N = 0"`` begins with."""
    return next(colour for model, colour in MODEL_COLOURS.items() if variant.startswith(model))
