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
    """A text in a picture.

    Attributes
    ----------
    text : str
    place : (2,) float64
        Column and row [pixels].
    anchor : str
        Part of the text that is at the place, by the names of Pillow: ``"rm"`` is right and middle.
    colour : str
    """

    text: str
    place: FloatArray
    anchor: str
    colour: str


@dataclass(frozen=True)
class View:
    """A picture of a building into which people are drawn.

    Attributes
    ----------
    image : (h, w, 3) uint8
        The building.
    nearness : (h, w) float64 or None
        Nearness, as in `project`, of the visible surface in each pixel, which hides people behind it; None if people
        are never hidden.
    project : Projection
    scale : float
        Pixels per metre, across the picture.
    elevation : float
        Angle of the view above the horizontal [rad]; pi / 2 is straight down.
    labels : tuple of Label
        Names of floors and exits.
    outlines : tuple of (colour, (p, 2) float64)
        Closed lines drawn over people: exits.
    side : tuple of int
        Left, top, right and bottom of the space for a legend [pixels].
    """

    image: NDArray[np.uint8]
    nearness: FloatArray | None
    project: Projection
    scale: float
    elevation: float
    labels: tuple[Label, ...]
    outlines: tuple[tuple[str, FloatArray], ...]
    side: tuple[int, int, int, int]
