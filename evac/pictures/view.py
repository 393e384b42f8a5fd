"""A view of a building: its picture without people, the projection to it, and the camera."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import ResultError
from evac.building.model.building import Building, Level


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
    north: FloatArray | None  # (2,) direction to the north in the picture, right and down, as seen; None: not known
    side: tuple[int, int, int, int]  # left, top, right and bottom of the space for a legend [pixels]


#: From the side of low y and a little from the right: what is left in plan is left in the picture [degrees].
AZIMUTH = -70.0
ELEVATION_FLAT, ELEVATION = 58.0, 36.0  # angle above the horizontal for one storey, for several [degrees]
CLEARANCE = 0.9  # share of a storey that is visible below the one above


@dataclass(frozen=True)
class Camera:
    """Parallel projection of a building; parameters that are None are chosen for the building.

    `azimuth`: direction from the building to the camera in plan, counterclockwise from x [degrees]: -90 views from the
    side of low y; `elevation`: angle of the view above the horizontal, between 0 and 90 [degrees]; by default 36 for
    several storeys, 58 for one; `stretch`: factor for heights that separates storeys; by default large enough to show
    the floor of each; `zoom`: factor relative to the size at which the building fills the picture.
    """

    azimuth: float = AZIMUTH
    elevation: float | None = None
    stretch: float | None = None
    zoom: float = 1.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.azimuth) and (self.elevation is None or 0.0 < self.elevation < 90.0)):
            raise ResultError("elevation: must be between 0 and 90 degrees; the plan view is from above")
        if any(value is not None and not 0.01 <= value <= 100.0 for value in (self.stretch, self.zoom)):
            raise ResultError("stretch and zoom: the factors must be between 0.01 and 100; 1 draws true sizes")


@dataclass(frozen=True)
class Aimed:
    """A camera with all parameters set for a building."""

    axes: FloatArray  # (3, 3) float64: unit vectors to the right and up in the picture, and towards the camera
    stretch: float
    elevation: float  # [rad]


def aim(building: Building, levels: Sequence[Level], camera: Camera) -> Aimed:
    """Choose the parameters that a camera leaves open."""
    heights = np.unique(np.round([level.z_min for level in levels if level.kind == "floor"], 1))
    angle = camera.elevation if camera.elevation is not None else ELEVATION if len(heights) > 1 else ELEVATION_FLAT
    tilt = math.radians(angle)
    axes = _axes(math.radians(camera.azimuth), tilt)
    return Aimed(axes, camera.stretch or _clear_stretch(building, levels, heights, axes), tilt)


def _axes(azimuth: float, tilt: float) -> FloatArray:
    ground = np.array([math.cos(azimuth), math.sin(azimuth)])
    toward = np.append(math.cos(tilt) * ground, math.sin(tilt))
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    return np.array([right, np.cross(toward, right), toward])


def _clear_stretch(building: Building, levels: Sequence[Level], heights: FloatArray, axes: FloatArray) -> float:
    """Return the factor for heights at which `CLEARANCE` of each storey is visible below the one above."""
    if len(heights) < 2:
        return 1.0
    corners = building.vertices[np.unique(np.concatenate([level.triangles.ravel() for level in levels]))]
    depth = np.ptp(corners[:, :2] @ axes[1, :2])
    return max(1.0, float(CLEARANCE * depth / (np.diff(heights).min() * axes[1, 2])))
