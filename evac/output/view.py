"""A view of a building: its picture without people, and where in it everything stands."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evac.arrays import FloatArray, IntArray


class Projection(Protocol):
    """Maps points of the building to places in a picture."""

    def __call__(self, level: IntArray, points: FloatArray) -> FloatArray:
        """Return column, row and nearness (p, 3) of points (p, 3) [m] on levels (p,) [pixels].

        A point is nearer to the eye the greater its third number [pixels]. NaN for points on levels not shown.
        """


@dataclass(frozen=True)
class Label:
    """Words at a place in a picture.

    Attributes
    ----------
    text : str
    place : (2,) float64
        Column and row [pixels].
    anchor : str
        Which part of the words is at the place, as Pillow names it: ``"rm"`` is right and middle.
    colour : str
    """

    text: str
    place: FloatArray
    anchor: str
    colour: str


@dataclass(frozen=True)
class View:
    """What `render_picture` and `render_film` draw people on.

    Attributes
    ----------
    image : (h, w, 3) uint8
        The building.
    nearness : (h, w) float64 or None
        Of what is seen in each pixel, as in `project`: what is behind it is hidden. None where nothing is.
    project : Projection
    scale : float
        Pixels per metre, across the picture.
    elevation : float
        Angle of the look with the horizontal [rad]; pi / 2 looks straight down.
    labels : tuple of Label
        Names of floors and exits.
    outlines : tuple of (colour, (p, 2) float64)
        Closed lines drawn over people: exits.
    side : tuple of int
        Left, top, right and bottom of the room for a legend [pixels].
    """

    image: NDArray[np.uint8]
    nearness: FloatArray | None
    project: Projection
    scale: float
    elevation: float
    labels: tuple[Label, ...]
    outlines: tuple[tuple[str, FloatArray], ...]
    side: tuple[int, int, int, int]
