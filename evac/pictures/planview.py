"""The building of a trajectory in plan, with storeys side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evac.base.arrays import FloatArray, IntArray
from evac.building.model.building import Building
from evac.pictures.floorplan import draw_plans
from evac.pictures.view import View


@dataclass(frozen=True)
class _InPlan:
    """The projection to the plan of each person's storey, see `evac.pictures.view.Projection`."""

    scale: float
    corner: FloatArray  # (levels, 2): column and row of the plan's origin in the picture; NaN for levels not drawn

    def __call__(self, level: IntArray, points: FloatArray) -> FloatArray:
        """Return column, row and nearness [pixels]."""
        corner = self.corner[level]
        return np.column_stack(
            [
                corner[:, 0] + self.scale * points[:, 0],
                corner[:, 1] - self.scale * points[:, 1],
                self.scale * points[:, 2],
            ]
        )


def plan_view(building: Building, size: tuple[int, int], levels: Sequence[str | int] | None, side: float) -> View:
    """Draw the plans of all storeys or of given levels.

    `size`: width and height into which the picture is fitted [pixels]; `levels`: by default all, grouped by storey;
    `side`: width of the space at the right for a legend [inches], for a picture 10 inches wide.
    """
    plans = draw_plans(building, "", levels, side=side, has_scale_bar=False)
    inches = plans.figure.get_size_inches()
    dpi = min(size[0] / inches[0], size[1] / inches[1])
    # Some film formats require even numbers of pixels.
    plans.figure.set_size_inches(2 * np.floor(0.5 * dpi * inches) / dpi)
    plans.figure.set_dpi(dpi)
    canvas = plans.figure.canvas
    canvas.draw()
    image = np.array(canvas.buffer_rgba())[..., :3]  # type: ignore[attr-defined]
    corner = np.full((len(building.levels), 2), np.nan)
    scale = 1.0
    for axes, shown in zip(plans.axes, plans.levels, strict=True):
        (x, y), (x1, _) = axes.transData.transform([[0.0, 0.0], [1.0, 0.0]])
        scale = float(x1 - x)
        corner[[level.index for level in shown]] = x, image.shape[0] - y
    left, bottom, width, height = plans.side * np.tile([image.shape[1], image.shape[0]], 2)
    box = round(left), round(image.shape[0] - bottom - height), round(left + width), round(image.shape[0] - bottom)
    return View(
        image=image,
        nearness=None,
        project=_InPlan(scale, corner),
        scale=scale,
        elevation=0.5 * np.pi,
        labels=(),
        outlines=(),
        side=box,
    )
