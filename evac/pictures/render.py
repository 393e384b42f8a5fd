"""Pictures and films of a trajectory, in three dimensions or in plan, drawn off screen."""

import importlib.util
import math
from collections.abc import Hashable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from evac.base.arrays import FloatArray
from evac.base.errors import ResultError
from evac.base.progress import track
from evac.building.model.building import Building
from evac.building.model.elevation import on_level
from evac.folder.files import replacing
from evac.pictures.palette import CAR, DEPTH, LEVELS, SMOKE, colouring, rgb
from evac.pictures.view import Camera, View
from evac.pictures.writing import Pen, font, legible, save_names
from evac.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    from evac.building.model.lifts import CarState

HEIGHT_STEP = 0.5  #: Figures have heights of whole steps of this share of the radius, so that people share images.
LEAST_STEPS = 6  #: Least height of a figure in these steps, so that the head is above the shoulders.
HIDDEN = 0.45  #: Opacity of people behind a floor or a wall.

#: Lower and upper end of the belt, as shares of the height: up to the shoulders, so that it is seen from above.
BELT = 0.6, 0.755

#: Direction of light, from the left, above and behind the camera: right, up, towards the camera.
LIGHT = np.array([-0.45, 0.55, 0.70])

FINE = 4  #: Subpixels per pixel in each direction, for smooth edges.


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


TOLD = (0.1, 0.3, 1.0, 3.0, 10.0)  #: Extinction coefficients of the scale [1/m].
THIN, GREY = 0.02, (70, 66, 62)  #: Extinction coefficients that are not drawn [1/m], and the colour of smoke.


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


PICTURES = (".png", ".jpg", ".jpeg")
FILMS = (".gif", ".mp4")

#: Bounds of the sides of pictures, and of a person's radius [pixels].
LEAST_SIDE, MOST_SIDE, MOST_RADIUS = 64, 4_000, 400
MOST_PICTURES = 100_000  #: Greatest number of pictures of a film.
VIEWS = ("3d", "plan")  #: Views of a building.


class _Drawn(NamedTuple):
    """The building as it is for some time, as drawn once."""

    view: View
    ground: NDArray[np.uint8]  # with all constant text
    names: Image.Image  # everything in front of people, on a transparent ground


class Renderer:
    """Draws frames of a trajectory: the building once for each set of links that are closed, and the people.

    `size`: width and height [pixels]; plans keep the building's proportions and may fill less; `view`: ``"3d"``, or
    ``"plan"``: straight from above, with storeys side by side; `levels`: draw only these, cars of lifts that stand at
    them, and the people there; `colour_by`: one of `COLOURINGS`; `service`: ``"fruin"`` or ``"weidmann"``: levels of
    service as colours of densities; `letters`: size of the letters of a picture on a page, which has the title, the
    time and the legend of groups beside it [pixels]; 0 for a picture by itself.

    Examples
    --------
    >>> image = Renderer(evac.read_trajectory("school-result"), view="plan").image(40)  # doctest: +SKIP
    """

    def __init__(
        self,
        trajectory: Trajectory,
        size: tuple[int, int] = (1600, 1200),
        view: str = "3d",
        camera: Camera | None = None,
        levels: Sequence[str | int] | None = None,
        colour_by: str = "group",
        service: str = "",
        letters: int = 0,
    ) -> None:
        if not len(trajectory):
            raise ResultError(f"{trajectory.path}: no frame to draw; the run ended before its first output")
        if view not in VIEWS:
            raise ResultError(f"unknown view {view!r}; use {' or '.join(VIEWS)}")
        if not LEAST_SIDE <= min(size) <= max(size) <= MOST_SIDE:
            raise ResultError(f"size: {size[0]} x {size[1]}; use {LEAST_SIDE} to {MOST_SIDE:,} pixels each")
        self.trajectory = trajectory
        self._colouring = colouring(trajectory, colour_by, service)
        self._smoke = Smoke(trajectory) if SMOKE in [field.name for field in trajectory.level_fields] else None
        self._size, self._kind, self._camera, self._levels = size, view, camera or Camera(), levels
        self._letters = letters
        self.names: list[str] = []  # words that are numbers in the pictures, see `legible`
        self._has_legend = self._colouring.has_legend and not (letters and self._colouring.legend)
        self._drawn: dict[Hashable, _Drawn] = {}
        largest = float(trajectory.radius.max(initial=0.0)) * self.view_at(float(trajectory.time[0])).scale
        if largest > MOST_RADIUS:
            raise ResultError(
                f"zoom: the radius of a person is {largest:.0f} pixels, more than {MOST_RADIUS}; reduce zoom"
            )

    def image(self, k: int) -> NDArray[np.uint8]:
        """Return the picture of frame `k`, (height, width, 3)."""
        trajectory = self.trajectory
        frame = trajectory[k]
        view, ground, names = self._drawn_at(frame["time"])
        image = ground.copy() if self._smoke is None else self._smoke.draw(ground, view, k).copy()
        places = view.project(frame["level"], np.column_stack([frame["position"], frame["z"]]))
        shown = np.isfinite(places[:, 0])
        if trajectory.building.lifts:
            from evac.building.model.lifts import cars_at

            cars = cars_at(trajectory.building, trajectory.changes, frame["time"])
            away = [car for car in cars if car.rise != 0.0 and self._levels is not None]
            shown &= ~np.isin(frame["level"], [car.level for car in away])
            image = self._with_cars(image, view, [car for car in cars if car not in away])
        person = frame["person"][shown]
        radius, height = view.scale * trajectory.radius[person], view.scale * trajectory.height[person]
        colours = self._colouring.of(frame)
        draw_people(image, places[shown], radius, height, colours[shown], view.elevation, view.nearness)
        out = trajectory.out_at(k)
        picture = Image.fromarray(image)
        picture.paste(names, (0, 0), names)
        if self._letters:
            return np.array(picture)
        so_far = [change for change in trajectory.changes if change.time <= frame["time"]]
        latest = f"      {legible(str(so_far[-1]), self.names)}" if so_far else ""
        smoke = "" if self._smoke is None else f"      smoke up to {self._smoke.greatest(k):.1f} 1/m"
        Pen(picture).clock(f"t = {frame['time']:.1f} s      {out} of {trajectory.number_of_people} out{smoke}{latest}")
        return np.array(picture)

    def _with_cars(self, image: NDArray[np.uint8], view: View, cars: "Sequence[CarState]") -> NDArray[np.uint8]:
        """Return a picture with cars of lifts: their ground, and their edges in space."""
        from evac.building.model.lifts import CAR_HEIGHT, car_body

        building, picture = self.trajectory.building, Image.fromarray(image).convert("RGBA")
        layer = Image.new("RGBA", picture.size, (0, 0, 0, 0))
        pen, colour = ImageDraw.Draw(layer), rgb([CAR])[0]
        for car in cars:
            outline, _ = car_body(building, car)
            ground = view.project(np.full(len(outline), car.level, np.int32), outline)[:, :2]
            if not np.isfinite(ground).all():
                continue
            above = ground - np.array([0.0, view.scale * CAR_HEIGHT * math.cos(view.elevation)])
            low, high = [*map(tuple, ground.tolist())], [*map(tuple, above.tolist())]
            pen.polygon(low, fill=(*colour, 70 if car.is_open else 150), outline=(*colour, 255))
            for post in zip(low, high, strict=True):
                pen.line(post, fill=(*colour, 255))
            pen.polygon(high, outline=(*colour, 255))
        return np.array(Image.alpha_composite(picture, layer).convert("RGB"))

    def view_at(self, time: float) -> View:
        """Return the building as it is drawn at a time [s], and the projection to the picture."""
        return self._drawn_at(time).view

    def _drawn_at(self, time: float) -> _Drawn:
        """Return the building at a time [s]."""
        building = self.trajectory.building_at(time)
        if building.condition not in self._drawn:
            view = self._look_at(building)
            self._drawn[building.condition] = _Drawn(view, self._with_writing(view), self._in_front(view))
        return self._drawn[building.condition]

    def _look_at(self, building: Building) -> View:
        """Draw a building."""
        shown = None if self._levels is None else [building.with_cars(level) for level in self._levels]
        if self._kind == "plan":
            from evac.pictures.floorplan import plan_view

            return plan_view(building, self._size, shown, 1.6 if self._has_legend else 0.3, self.names)
        from evac.pictures.model3d import LEGEND_WIDTH, MARGIN, view_of

        chosen = building.levels if shown is None else [level for own in shown for level in own]
        margin = MARGIN | {"right": MARGIN["right"] + LEGEND_WIDTH if self._has_legend else MARGIN["left"]}
        if self._letters:
            names = [level.name for level in chosen if level.kind == "floor"]
            widest = max((font(self._letters, is_bold=True).getlength(name) for name in names), default=0.0)
            margin |= {"left": min(widest / self._size[0] + 0.02, 0.4), "right": 0.04, "top": 0.05}
            margin |= {"bottom": 0.16} if self._smoke is not None else {}
        return view_of(building, self._size, self._camera, chosen, margin)

    def _with_writing(self, view: View) -> NDArray[np.uint8]:
        """Return the building with all constant text: title, legend, scales."""
        picture = Image.fromarray(view.image)
        pen, colours = Pen(picture, self._letters), self._colouring
        if not self._letters:
            pen.title(legible(str(self.trajectory.header.get("title", "")), self.names))
        if colours.scale is not None:
            pen.colour_bar(view.side, colours.scale, colours.top)
        elif self._has_legend:
            pen.legend(view.side, [(legible(name, self.names), look) for name, look in colours.legend])
        pen.scale_bar(view.scale, view.north)
        if self._smoke is not None:
            pen.swatches("smoke at the mean height of heads [1/m]", self._smoke.scale())
        return np.array(picture)

    def _in_front(self, view: View) -> Image.Image:
        """Return a transparent image of what is in front of people: names of floors and exits, outlines of exits."""
        picture = Image.new("RGBA", view.image.shape[1::-1], (255, 255, 255, 0))
        pen = Pen(picture, self._letters)
        for colour, corners in view.outlines:
            pen.outline(corners, colour)
        for label in view.labels:
            pen.label(legible(label.text, self.names), label.place, label.anchor, label.colour)
        return picture


def render_picture(renderer: Renderer, path: Path, time: float | None = None) -> None:
    """Draw the frame nearest to `time` [s], by default the one in the middle of the run, to a PNG or JPEG file."""
    trajectory = renderer.trajectory
    _check_ending(path, PICTURES)
    first, last = float(trajectory.time[0]), float(trajectory.time[-1])
    if time is not None and not first <= time <= last:
        raise ResultError(f"{trajectory.path}: t = {time:g} s is not in the recorded time from {first:g} to {last:g} s")
    image = renderer.image(trajectory.nearest(0.5 * last if time is None else time))
    with replacing(path, "the picture") as new:
        Image.fromarray(image).save(new)
    save_names(renderer.names, path)


def render_animation(renderer: Renderer, path: Path, fps: float = 10.0, speed: float = 5.0) -> None:
    """Draw the whole run to an animated GIF, or to an MP4 film with the extra film."""
    _check_ending(path, FILMS)
    trajectory = renderer.trajectory
    count = number_of_pictures(trajectory, fps, speed)
    if path.suffix == ".mp4" and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ResultError(f'{path}: an MP4 film needs an extra: pip install "evac[film]", or write a .gif')
    frames = [trajectory.nearest(k * speed / fps) for k in range(count)]
    images = (renderer.image(k) for k in track("drawing the film", frames, count))
    with replacing(path, "the film") as new:
        if path.suffix == ".mp4":
            import imageio.v2 as imageio

            film: Any = imageio.get_writer(new, format="FFMPEG", fps=fps, macro_block_size=2)
            with film:
                for image in images:
                    film.append_data(image)
        else:
            # The palette of a GIF is that of the first picture, and of the first after each change of the building.
            first = {trajectory.building_at(float(trajectory.time[k])).condition: k for k in reversed(frames)}
            samples = np.concatenate([renderer.image(k) for k in first.values()])
            # One palette for all pictures avoids flickering.
            palette = Image.fromarray(samples).quantize(255, Image.Quantize.MAXCOVERAGE, 2, dither=Image.Dither.NONE)
            shown = (Image.fromarray(image).quantize(palette=palette, dither=Image.Dither.NONE) for image in images)
            next(shown).save(new, save_all=True, append_images=shown, duration=1000.0 / fps, loop=0)
    save_names(renderer.names, path)


def number_of_pictures(trajectory: Trajectory, fps: float, speed: float) -> int:
    """Return the number of pictures of a film of a whole run."""
    if not (0.0 < fps < math.inf and 0.0 < speed < math.inf):
        raise ResultError(f"fps and speed must be greater than 0, got {fps:g} and {speed:g}")
    pictures = 1.0 + float(trajectory.time[-1]) * fps / speed if len(trajectory) else 0.0
    if pictures > MOST_PICTURES:
        raise ResultError(f"{pictures:.3g} pictures are too many for a film; raise speed, or reduce fps")
    return math.ceil(pictures)


def _check_ending(path: Path, endings: tuple[str, ...]) -> None:
    if path.suffix not in endings:
        raise ResultError(f"{path}: unknown ending {path.suffix!r}; use {' or '.join(endings)}")
