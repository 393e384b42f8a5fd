"""Smoke on the floors of pictures: the recorded field, as a veil that is denser where less is seen."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from evac.building.model.elevation import on_level
from evac.pictures.palette import DEPTH, LEVELS, SMOKE, rgb
from evac.pictures.view import View
from evac.trajectory.trajectory import Trajectory

#: Extinction coefficients of the scale [1/m].
TOLD = (0.1, 0.3, 1.0, 3.0, 10.0)

#: Extinction coefficients that are not drawn [1/m], and the colour of smoke.
THIN, GREY = 0.02, (70, 66, 62)


class Smoke:
    """The smoke of a trajectory, drawn onto pictures of its building."""

    def __init__(self, trajectory: Trajectory) -> None:
        self._field, building = trajectory.field(SMOKE), trajectory.building
        half = 0.5 * self._field.spacing
        levels, corners = [], []
        for level, cells in zip(building.levels, self._field.cells, strict=True):
            centres = np.column_stack([values.ravel() for values in cells.centres()])
            levels.append(np.full(len(centres), level.index, np.int32))
            corners.append(centres[:, None] + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]))
        self._level = np.concatenate(levels)
        self._points = on_level(building, self._level.repeat(4), np.concatenate(corners).reshape(-1, 2))

    def greatest(self, frame: int) -> float:
        """Return the greatest extinction coefficient of a frame [1/m]."""
        return float(self._field.values[frame].max(initial=0.0))

    def scale(self) -> list[tuple[str, tuple[int, ...]]]:
        """Return extinction coefficients [1/m] and the colours of a floor in such smoke."""
        floor, hidden = np.array(rgb([LEVELS["floor"]])[0]), 1.0 - np.exp(-DEPTH * np.array(TOLD)[:, None])
        colours = np.rint(floor + hidden * (np.array(GREY) - floor)).astype(int)
        return [(f"{value:g}", tuple(colour)) for value, colour in zip(TOLD, colours.tolist(), strict=True)]

    def draw(self, image: NDArray[np.uint8], view: View, frame: int) -> NDArray[np.uint8]:
        """Return a picture (h, w, 3) of the building with the smoke of a frame."""
        values = self._field.values[frame]
        shown = np.flatnonzero(values > THIN)
        if not len(shown):
            return image
        shown = shown[np.argsort(values[shown], kind="stable")]  # the densest smoke on top, where levels overlap
        rows = (4 * shown[:, None] + np.arange(4)).ravel()
        pixels = view.project(np.repeat(self._level[shown], 4), self._points[rows])[:, :2].reshape(-1, 4, 2)
        veil = Image.new("L", (image.shape[1], image.shape[0]), 0)
        pen = ImageDraw.Draw(veil)
        for quad, hidden in zip(pixels, 255.0 * (1.0 - np.exp(-DEPTH * values[shown])), strict=True):
            if np.isfinite(quad).all():
                pen.polygon([tuple(corner) for corner in quad.tolist()], fill=round(hidden))
        picture = Image.fromarray(image)
        picture.paste(GREY, (0, 0), veil)
        return np.array(picture)
