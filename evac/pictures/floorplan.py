"""Plans of storeys drawn with matplotlib at one scale, for maps, plans with findings, and views in plan."""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IntArray
from evac.building.model.building import Building, Exit, Level, Place, Portal
from evac.building.model.marks import marks_of
from evac.pictures import palette
from evac.pictures.view import View
from evac.pictures.writing import legible_figure, round_length

#: Greatest width and height of all plans together, and the margin around them [inches].
WIDTH, HEIGHT = 10.0, 7.0
MARGIN, TITLE, HEAD, BAR, SIDE = 0.3, 0.75, 0.3, 0.45, 1.3
LINES, LINE = 2, 10.2  # by which the name of an exit is moved at most, and their height [points]
NAMES = 0.26  # height of the names of exits and their distance from the plan [inches]
MARKERS = {"sign": ("s", 5.0), "fire": ("*", 14.0)}  # of places that are points, and their sizes [points]
NORTH = 0.85  # from the scale bar to the arrow to the north [inches]


@dataclass(frozen=True)
class Plans:
    """A figure with a plan of each storey."""

    figure: Figure
    axes: tuple[Axes, ...]  # axes of each storey, from the bottom to the top, with x and y in plan [m]
    levels: tuple[tuple[Level, ...], ...]  # the levels in each of them
    names: tuple[Text, ...]  # of the storeys
    # (4,) float: left, bottom, width and height of the space for a legend or a colour bar, as fractions of the figure
    side: tuple[float, float, float, float]


def draw_plans(
    building: Building,
    title: str | None,
    levels: Sequence[Sequence[Level]] | None = None,
    *,
    dpi: int = 120,
    is_filled: bool = True,
    side: float = SIDE,
    has_scale_bar: bool = True,
    has_widths: bool = False,
    greatest: tuple[float, float] = (WIDTH, HEIGHT),
    part: slice = slice(None),
) -> Plans:
    """Draw the plan of each storey, with walls, exits and their names, and a scale bar.

    `title`: the first line is bold. With None, no space is left for a title; `levels`: the levels of each plan, which
    has the name of the first; by default all levels, grouped by storey (`Building.storeys`); `is_filled`: whether
    floors are filled with the colours of their kinds; maps fill them themselves; `side`: width of the space at the
    right for a legend or a colour bar [inches]; `has_widths`: whether the widths of portals and exits are written
    beside them; `greatest`: greatest width and height of all plans together [inches]; `part`: which of the plans,
    counted from the lowest storey.
    """
    if levels is None:
        panels = [(name, tuple(shown)) for name, shown in building.storeys]
    else:
        panels = [(shown[0].name, tuple(shown)) for shown in levels]
    panels = panels[part]
    # All plans have the same limits, so that places above one another have the same position in each.
    x1, y1, x2, y2 = shapely.total_bounds([level.polygon for _, shown in panels for level in shown]).tolist()
    pad = 0.03 * max(x2 - x1, y2 - y1) + 0.2  # for the names of exits
    if has_widths:  # in a frame
        pad = max(pad, NAMES / _arrangement(len(panels), x2 - x1 + 2.0 * pad, y2 - y1 + 2.0 * pad, greatest)[2])
    width, height = x2 - x1 + 2.0 * pad, y2 - y1 + 2.0 * pad
    columns, rows, scale = _arrangement(len(panels), width, height, greatest)
    above = TITLE if title is not None else 0.0
    cell = scale * float(width) + MARGIN, scale * float(height) + HEAD
    size = MARGIN + columns * cell[0] + side, above + rows * cell[1] + BAR
    figure = Figure(figsize=size, dpi=dpi)
    FigureCanvasAgg(figure)
    axes, names = [], []
    for k, (name, shown) in enumerate(panels):
        column, row = k % columns, k // columns
        left, top = MARGIN + column * cell[0], above + row * cell[1] + HEAD
        box = left / size[0], 1.0 - (top + scale * height) / size[1], scale * width / size[0], scale * height / size[1]
        panel = figure.add_axes(box)
        panel.set_axis_off()
        panel.set(xlim=(x1 - pad, x2 + pad), ylim=(y1 - pad, y2 + pad))
        draw_levels(panel, building, shown, is_filled, has_widths)
        names.append(_name(panel, name))
        axes.append(panel)
    if title is not None:
        _write_title(figure, title, size)
    if has_scale_bar:
        _draw_scale_bar(figure, scale, size, building.northward)
    room = 1.0 - (side - 0.2) / size[0], BAR / size[1], (side - 0.3) / size[0], rows * cell[1] / size[1]
    return Plans(figure, tuple(axes), tuple(shown for _, shown in panels), tuple(names), room)


def _name(axes: Axes, name: str) -> Text:
    """Write the name of a storey above its plan, at the first of three places where it covers no other text.

    Before that, names of exits that cover others are moved outward by lines, at most `LINES`.
    """
    renderer = FigureCanvasAgg(axes.figure).get_renderer()
    style: dict[str, Any] = {"fontsize": 10, "color": palette.TEXT, "y": 1.0, "pad": 3, "parse_math": False}
    titles = [axes.set_title(name, loc=place, **style) for place in ("left", "right", "center")]
    with legible_figure(axes):
        written: list[Bbox] = []
        for text in axes.texts:
            for _ in range(LINES if isinstance(text, Annotation) and text.get_fontweight() == "bold" else 0):
                if not text.get_window_extent(renderer).count_overlaps(written):
                    break
                x, y = text.get_position()
                text.set_position((x + LINE * x / math.hypot(x, y), y + LINE * y / math.hypot(x, y)))
            written.append(text.get_window_extent(renderer))
        free = [title for title in titles if not title.get_window_extent(renderer).count_overlaps(written)]
    chosen = (free or titles)[0]
    for title in titles:
        title.set_visible(title is chosen)
    return chosen


def _arrangement(count: int, width: float, height: float, greatest: tuple[float, float]) -> tuple[int, int, float]:
    """Return the columns, rows and inches per metre for which `count` plans are largest."""
    best = (1, count, 0.0)
    for columns in range(1, count + 1):
        rows = math.ceil(count / columns)
        scale = min((greatest[0] / columns - MARGIN) / width, (greatest[1] / rows - HEAD) / height)
        if scale > best[2]:
            best = columns, rows, scale
    return best


def draw_levels(axes: Axes, building: Building, levels: Sequence[Level], is_filled: bool, has_widths: bool) -> None:
    """Draw floors, walls, portals, exits and the names of exits."""
    rows = [level.index for level in levels]
    if is_filled:
        for level in levels:
            style = {"facecolor": palette.LEVELS[level.kind], "edgecolor": "none", "zorder": 0.5}
            axes.add_patch(PathPatch(outline_of(level.polygon), **style))
    _draw_conditions(axes, building, rows)
    for place in building.places:
        if place.level in rows:
            _draw_place(axes, place)
    walls = building.walls[np.isin(building.wall_level, rows)]
    axes.add_collection(LineCollection(_ends(walls), colors=palette.EDGE, linewidths=1.1, zorder=3))
    for link in (link for link in building.links if not {*link.levels}.isdisjoint(rows)):
        is_open, lines = building.is_open(link), _ends(link.segments)
        width = f"{link.width:.2f} m" if has_widths else ""
        if isinstance(link, Exit):
            colour = palette.EXIT if is_open else palette.CLOSED
            axes.add_collection(LineCollection(lines, colors=colour, linewidths=3.5, zorder=4))
            beside(axes, link.segments, f"{building.label_of(link)} {width}".strip(), colour, size=8.5, weight="bold")
        elif not is_open:
            axes.add_collection(LineCollection(lines, colors=palette.CLOSED, linewidths=2.5, zorder=4))
        elif isinstance(link, Portal):
            dashed = LineCollection(lines, colors=palette.PORTAL, linewidths=0.8, linestyles=(0, (2, 2)), zorder=3)
            axes.add_collection(dashed)
        if isinstance(link, Portal) and width:
            beside(axes, link.segments, width, palette.EDGE, size=6.5)


def _draw_conditions(axes: Axes, building: Building, rows: Sequence[int]) -> None:
    """Draw what changes of the scene do to areas and to the directions of links: hatched areas, and arrows."""
    hatched = {"facecolor": "none", "linewidth": 0.0, "alpha": 0.5, "zorder": 0.8}
    styles = {
        "slow": hatched | {"hatch": "///"},
        "barred": hatched | {"hatch": "xxx"},
        "one_way": {"facecolor": palette.CLOSED, "zorder": 5},
        "control": hatched | {"hatch": "|||", "zorder": 5},
    }
    for mark in marks_of(building):
        if mark.level in rows:
            axes.add_patch(PathPatch(outline_of(mark.shape), edgecolor=palette.CLOSED, **styles[mark.kind]))


def _draw_place(axes: Axes, place: Place) -> None:
    """Draw a refuge, an assembly area, a line or a fire with its name, or a sign with the exit that it shows."""
    colour, middle = palette.PLACES[place.kind], place.shape.representative_point()
    is_point = place.kind in MARKERS
    if is_point:
        marker, size = MARKERS[place.kind]
        axes.plot(middle.x, middle.y, marker=marker, markersize=size, color=colour, zorder=5)
    elif place.kind == "line":
        axes.plot(*place.shape.xy, color=colour, linewidth=1.4, linestyle=(0, (4, 1.5)), zorder=5)
    else:
        style = {"facecolor": colour, "edgecolor": colour, "alpha": 0.25, "linewidth": 1.2, "zorder": 0.7}
        axes.add_patch(PathPatch(outline_of(place.shape), **style))
    axes.annotate(
        str(place),
        (middle.x, middle.y),
        xytext=(0.0, -5.0 if is_point else 0.0),
        textcoords="offset points",
        ha="center",
        va="top" if is_point else "center",
        color=colour,
        fontsize=7.5,
        zorder=6,
        parse_math=False,
    )


def beside(
    axes: Axes, segments: FloatArray, text: str, colour: str, *, size: float = 6.5, weight: str = "normal"
) -> None:
    """Write a text outside the middle of a line, which has the inside on its left; upright where the line is."""
    x1, y1, x2, y2 = segments[len(segments) // 2].tolist()
    length = math.hypot(x2 - x1, y2 - y1)
    outward = (y2 - y1) / length, -(x2 - x1) / length
    axes.annotate(
        text,
        (0.5 * (x1 + x2), 0.5 * (y1 + y2)),
        xytext=(6.0 * outward[0], 6.0 * outward[1]),
        textcoords="offset points",
        ha="center" if abs(outward[0]) <= 0.5 else "left" if outward[0] > 0.0 else "right",
        va="center" if abs(outward[1]) <= 0.5 else "bottom" if outward[1] > 0.0 else "top",
        rotation=90 if abs(outward[0]) > abs(outward[1]) else 0,
        color=colour,
        fontsize=size,
        fontweight=weight,
        zorder=6,
        annotation_clip=False,
        parse_math=False,
    )


def _ends(segments: FloatArray) -> list[FloatArray]:
    return list(segments.reshape(-1, 2, 2))


def outline_of(polygon: BaseGeometry) -> Outline:
    """Return polygons with their holes as a path for clipping and filling in matplotlib."""
    rings = [ring for part in shapely.get_parts(polygon) for ring in shapely.get_rings(shapely.orient_polygons(part))]
    return Outline.make_compound_path(*(Outline(shapely.get_coordinates(ring), closed=True) for ring in rings))


def _write_title(figure: Figure, title: str, size: tuple[float, float]) -> None:
    """Write the first line in bold and the others below it."""
    first, _, rest = title.partition("\n")
    letters = 9.4 * (size[0] - 2.0 * MARGIN)  # number of letters of 12 points per line
    first = textwrap.shorten(first, int(1.4 * letters), placeholder=" ...")
    style: dict[str, Any] = {"color": palette.TEXT, "va": "top", "ha": "left", "parse_math": False}
    small: dict[str, Any] = {"fontsize": min(12.0, 12.0 * letters / max(len(first), 1)), "fontweight": "bold"}
    figure.text(MARGIN / size[0], 1.0 - 0.12 / size[1], first, **small, **style)
    figure.text(MARGIN / size[0], 1.0 - 0.38 / size[1], rest, fontsize=9.5, **style)


def _draw_scale_bar(figure: Figure, scale: float, size: tuple[float, float], northward: FloatArray | None) -> None:
    """Draw a bar of a round length of about an inch, and an arrow to the north if that is known."""
    length = round_length(1.2 / scale)
    left, low = MARGIN / size[0], 0.22 / size[1]
    right = left + length * scale / size[0]
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), facecolor="none", zorder=5)
    axes.set_axis_off()
    axes.set(xlim=(0, 1), ylim=(0, 1))
    axes.plot([left, right], [low, low], color=palette.TEXT, linewidth=2.0, solid_capstyle="butt")
    for end in (left, right):
        axes.plot([end, end], [low - 0.05 / size[1], low + 0.05 / size[1]], color=palette.TEXT, linewidth=1.2)
    axes.text(right + 0.08 / size[0], low, f"{length:g} m", va="center", fontsize=9, color=palette.TEXT)
    if northward is not None:
        middle = np.array([right * size[0] + NORTH, 0.22])
        tip, tail = (middle + 0.17 * sign * northward for sign in (1, -1))
        arrow = {"arrowstyle": "-|>", "color": palette.TEXT, "shrinkA": 0.0, "shrinkB": 0.0}
        axes.annotate("", tuple(tip / size), tuple(tail / size), arrowprops=arrow)
        axes.text((middle[0] + 0.2) / size[0], low, "N", va="center", fontsize=9, color=palette.TEXT)


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


def plan_view(
    building: Building,
    size: tuple[int, int],
    levels: Sequence[Sequence[Level]] | None,
    side: float,
    numbered: list[str],
) -> View:
    """Draw the plans of all storeys or of given levels, fitted into a size [pixels], see `draw_plans`.

    `side`: width of the space at the right for a legend [inches], for a picture 10 inches wide; `numbered`: words that
    are numbers in the picture, see `legible`.
    """
    plans = draw_plans(building, "", levels, side=side, has_scale_bar=False)
    inches = plans.figure.get_size_inches()
    dpi = min(size[0] / inches[0], size[1] / inches[1])
    # Some film formats require even numbers of pixels.
    plans.figure.set_size_inches(2 * np.floor(0.5 * dpi * inches) / dpi)
    plans.figure.set_dpi(dpi)
    canvas = plans.figure.canvas
    with legible_figure(plans.figure, numbered):
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
        north=None if building.northward is None else building.northward * [1.0, -1.0],
    )
