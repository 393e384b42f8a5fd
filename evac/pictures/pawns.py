"""Figures of people: pawns with the radius and height of each person, drawn into pictures from any angle."""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray

#: Figures have heights of whole steps of this share of the radius, so that people share images.
HEIGHT_STEP = 0.5

#: Least height of a figure in these steps, so that the head is above the shoulders.
LEAST_STEPS = 6

#: Opacity of people behind a floor or a wall.
HIDDEN = 0.45

#: Lower and upper end of the belt, as shares of the height: up to the shoulders, so that it is seen from above.
BELT = 0.6, 0.755

#: Direction of light, from the left, above and behind the camera: right, up, towards the camera.
LIGHT = np.array([-0.45, 0.55, 0.70])

#: Subpixels per pixel in each direction, for smooth edges.
FINE = 4


class Pawn(NamedTuple):
    """The image of a figure: arrays (h, w)."""

    opacity: FloatArray  # 0 beside the figure, 1 on it, in between on its edge
    shades: FloatArray  # (h, w, 3): factors for the colours of body, head and belt, whose sum is the colour
    # float64 [pixels]: nearness of its surface to the camera, relative to its centre on the ground
    nearness: FloatArray
    # column, row: pixel of its centre on the ground
    column: int
    row: int


def draw_people(
    image: NDArray[np.uint8],
    places: FloatArray,
    radius: FloatArray,
    height: FloatArray,
    colours: NDArray[np.uint8],
    elevation: float,
    nearness: FloatArray | None = None,
) -> None:
    """Draw people into a picture, from the farthest to the nearest.

    `image` (h, w, 3): modified in place; `places` (p, 3): column, row and nearness of each person's centre on the
    ground [pixels]; `radius`, `height` (p,) [pixels]; `colours` (p, 3, 3): of the body, the head and the belt of each
    person; `elevation`: angle of the view above the horizontal [rad]; `nearness` (h, w): nearness of the objects in the
    picture; people behind them are drawn translucent.
    """
    rows_of_image, width = image.shape[:2]
    tall = HEIGHT_STEP * np.maximum(np.rint(height / (HEIGHT_STEP * radius)), LEAST_STEPS)
    columns, rows = np.rint(places[:, :2]).astype(np.int64).T
    for k in np.argsort(places[:, 2], kind="stable").tolist():
        pawn = _pawn(max(2, round(4.0 * float(radius[k]))), float(tall[k]), elevation)
        left, top = int(columns[k]) - pawn.column, int(rows[k]) - pawn.row
        x1, y1 = max(left, 0), max(top, 0)
        x2, y2 = min(left + pawn.opacity.shape[1], width), min(top + pawn.opacity.shape[0], rows_of_image)
        if x1 >= x2 or y1 >= y2:
            continue
        part = slice(y1 - top, y2 - top), slice(x1 - left, x2 - left)
        there = slice(y1, y2), slice(x1, x2)
        opacity = pawn.opacity[part]
        if nearness is not None:
            is_hidden = pawn.nearness[part] + places[k, 2] < nearness[there]
            opacity = np.where(is_hidden, HIDDEN * opacity, opacity)
        colour = np.minimum(pawn.shades[part] @ colours[k], 255.0)
        image[there] = image[there] + opacity[..., None] * (colour - image[there]) + 0.5


@cache
def _pawn(quarters: int, tall: float, elevation: float) -> Pawn:
    """Return the figure of a person with a radius of `quarters` quarters of a pixel and a height of `tall` radii."""
    size = FINE * 0.25 * quarters
    right, up, toward, shade, kind = _surface(tall, elevation, 1 + int(size / 40.0))
    low, high = FINE * np.floor(size * up.min() / FINE), FINE * np.ceil(size * up.max() / FINE)
    wide = FINE * int(np.ceil(size * right.max() / FINE))
    shape = int(high - low) + FINE, 2 * wide + FINE
    column = np.rint(size * right).astype(np.int64) + wide + FINE // 2
    row = int(high) - np.rint(size * up).astype(np.int64) + FINE // 2
    order = np.argsort(toward, kind="stable")  # the nearest point of each pixel is drawn last
    fine = np.zeros((5, *shape))
    fine[4] = -np.inf
    shades = np.where(kind == np.arange(3)[:, None], shade, 0.0)
    for layer, values in enumerate((np.ones_like(shade), *shades, size * toward / FINE)):
        fine[layer, row[order], column[order]] = values[order]
    blocks = fine.reshape(5, shape[0] // FINE, FINE, shape[1] // FINE, FINE)
    cover, *sums = blocks[:4].sum(axis=(2, 4))
    means = np.stack(sums, axis=-1) / np.maximum(cover, 1.0)[..., None]
    return Pawn(cover / FINE**2, means, blocks[4].max(axis=(1, 3)), wide // FINE, int(high) // FINE)


@cache
def _surface(tall: float, elevation: float, density: int) -> tuple[FloatArray, ...]:
    """Return the visible points of a pawn of radius 1: right, up, towards the camera, shade, part."""
    heights, angles = 400 * density, 240 * density
    head = 0.6
    turn = np.linspace(-0.4 * np.pi, 0.5 * np.pi, 12)
    radius = np.concatenate([[0.55, 0.97, 1.0, 0.85, 0.3], head * np.cos(turn)])
    height = np.concatenate([np.array([0.0, 0.66, 0.72, 0.77, 0.79]) * tall, tall - head + head * np.sin(turn)])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(radius), np.diff(height)))])
    fine = np.linspace(0.0, along[-1], heights)
    r, h = np.interp(fine, along, radius), np.interp(fine, along, height)
    slope_r, slope_h = np.gradient(r), np.gradient(h)
    angle = np.linspace(0.0, 2.0 * np.pi, angles, endpoint=False)
    cosine, sine = np.cos(angle), np.sin(angle)
    sin_e, cos_e = np.sin(elevation), np.cos(elevation)

    def seen(x: FloatArray, away: FloatArray, z: FloatArray) -> FloatArray:
        """Project coordinates in space to right, up and towards the camera."""
        return np.array([x, away * sin_e + z * cos_e, z * sin_e - away * cos_e])

    point = seen(np.outer(r, cosine), np.outer(r, sine), np.outer(h, np.ones_like(angle)))
    # The normal is perpendicular to the profile: (slope_h, -slope_r) in the plane of radius and height.
    length = np.hypot(slope_r, slope_h)
    normal = seen(
        np.outer(slope_h / length, cosine),
        np.outer(slope_h / length, sine),
        np.outer(-slope_r / length, np.ones(angles)),
    )
    light = np.maximum(np.tensordot(LIGHT / np.linalg.norm(LIGHT), normal, 1), 0.0)
    rim = np.clip(normal[2] * 2.5, 0.0, 1.0)  # darker at the outline, so that neighbours can be distinguished
    shade = (0.55 + 0.55 * light) * (0.72 + 0.28 * rim)
    front = normal[2] > -0.05
    kind = np.where(h > 0.79 * tall, 1, np.where((h > BELT[0] * tall) & (h < BELT[1] * tall), 2, 0))
    parts = np.broadcast_to(kind[:, None], front.shape)
    return point[0][front], point[1][front], point[2][front], shade[front], parts[front]
