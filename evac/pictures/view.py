"""A view of a building: its picture without people, and the projection to it."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray


class Projection(Protocol):
    """Maps points of the building to a picture."""

    def __call__(self, level: IntArray, points: FloatArray) -> FloatArray:
        """Return column, row and nearness (p, 3) of points (p, 3) [m] on levels (p,) [pixels].

        The third number increases towards the camera [pixels]. NaN for points on levels that are not shown.
        """


@dataclass(frozen=True)
class Label:
    """A text in a picture."""

    text: str
    place: FloatArray  # (2,) float64: column and row [pixels]
    anchor: str  # part of the text that is at the place, by the names of Pillow: ``"rm"`` is right and middle
    colour: str


@dataclass(frozen=True)
class View:
    """A picture of a building into which people are drawn."""

    image: NDArray[np.uint8]  # (h, w, 3) uint8: the building
    # (h, w) float64 or None: nearness, as in `project`, of the visible surface in each pixel, which hides people behind
    # it; None if people are never hidden
    nearness: FloatArray | None
    project: Projection
    scale: float  # pixels per metre, across the picture
    elevation: float  # angle of the view above the horizontal [rad]; pi / 2 is straight down
    labels: tuple[Label, ...]  # names of floors and exits
    # tuple of (colour, (p, 2) float64): closed lines drawn over people: exits
    outlines: tuple[tuple[str, FloatArray], ...]
    side: tuple[int, int, int, int]  # left, top, right and bottom of the space for a legend [pixels]
