"""Pictures of maps: one quantity on the plans of all storeys, with one colour scale."""

import math
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import PathPatch
from matplotlib.transforms import Bbox

from evac.analysis.lines import LineFlow
from evac.analysis.maps import QUANTITIES, LevelMaps, level_maps
from evac.base.arrays import FloatArray, IntArray
from evac.base.change import LIFT
from evac.folder.files import map_name, writing
from evac.pictures import palette
from evac.pictures.floorplan import HEIGHT, WIDTH, Plans, draw_levels, draw_plans, outline_of
from evac.pictures.palette import MAPS as SCALES
from evac.pictures.palette import SERVICES, Scale, high_value, round_up
from evac.pictures.writing import save
from evac.results.reading import recorded_flows
from evac.trajectory.trajectory import Trajectory

#: Colours of floors where a map has no value, and of cells that are never cleared.
NO_VALUE, NEVER = "#eef0f3", "#7a0177"

LEAST_STEP = 0.03  #: Least distance of two ticks, as a share of a colour bar.
MOST_SAID = 80  #: Greatest number of letters of a title for changes of the scene.
LETTERS = 13  #: Number of letters per inch of a line of the title, and of the label of a colour bar.

#: What is written beside lines on maps of the flow.
FLOW_LABELS = "labels: people who passed the line, and people per second and metre"

FORMATS = (".png", ".svg", ".pdf", ".jpg", ".jpeg")  #: The formats that a picture of a map can have.


def draw_map(
    trajectory: Trajectory,
    quantity: str,
    maps: Mapping[str, LevelMaps] | None = None,
    levels: Sequence[str | int] | None = None,
    dpi: int = 120,
    service: str = "",
) -> Figure:
    """Draw the map of one quantity on the plans of the storeys, with links as they are at the end of its time.

    The title names what changed during this time, without the rides of lifts.

    >>> draw_map(evac.read_trajectory("school-result"), "density").savefig("density.png")  # doctest: +SKIP
    """
    return next(draw_maps(trajectory, [quantity], maps, levels, dpi, service))


def draw_maps(
    trajectory: Trajectory,
    quantities: Iterable[str],
    maps: Mapping[str, LevelMaps] | None = None,
    levels: Sequence[str | int] | None = None,
    dpi: int = 120,
    service: str = "",
    flows: Iterable[LineFlow] | None = None,
    greatest: tuple[float, float] = (WIDTH, HEIGHT),
    has_title: bool = True,
) -> Iterator[Figure]:
    """Draw the maps of several quantities on the same plans, one after the other.

    `trajectory`, `maps`, `levels`, `dpi`, `service`: as for `draw_map`; `flows`: passages through lines, for the map of
    the flow; by default those of the results beside the trajectory; `greatest`: greatest width and height of all plans
    together [inches]; `has_title`: without a title, what it says has to be said beside the picture.
    """
    if maps is None:
        maps = level_maps(trajectory, levels)
    any_map = next(iter(maps.values()))
    said = (change for change in trajectory.changes if change.kind != LIFT)  # the rides of cars are many
    changes = ", ".join(str(change) for change in said if any_map.start < change.time <= any_map.end)
    changes = textwrap.shorten(f"; {changes}", MOST_SAID, placeholder=" ...") if changes else ""
    title = f"{trajectory.header.get('title', '')}\n" if has_title else None
    building = trajectory.building_at(any_map.end)
    shown = None if levels is None else [building.with_cars(level) for level in levels]
    plans = draw_plans(building, title, shown, dpi=dpi, is_filled=False, greatest=greatest)
    nearest, images = {name: _nearest_cells(own) for name, own in maps.items()}, _images(plans, maps)
    lasting = set(_artists(plans))
    for quantity in quantities:
        for artist in set(_artists(plans)) - lasting:
            artist.remove()
        grids = {name: level_map.array(quantity) for name, level_map in maps.items()}
        what, scale = QUANTITIES[quantity], SCALES[quantity].with_service(service)
        explained = f"; {FLOW_LABELS}" if quantity == "flow" else ""
        words = f"{what.label} [{what.unit}], {any_map.start:g} to {any_map.end:g} s{explained}{changes}"
        for subtitle in plans.figure.texts[1:2]:
            subtitle.set_text(textwrap.fill(words, round(LETTERS * plans.figure.get_figwidth())))
        _draw_values(plans, grids, images, nearest, scale)
        if quantity == "flow":
            _label_lines(plans, recorded_flows(trajectory) if flows is None else flows)
        if any(np.isinf(grid).any() for grid in grids.values()):
            plans.figure.text(plans.side[0], 0.02, "not cleared", color=NEVER, fontsize=9, fontweight="bold")
        if scale.below:
            plans.figure.text(plans.side[0], 0.02, f"no colour: {scale.below}", color=palette.TEXT, fontsize=9)
        yield plans.figure


def _artists(plans: Plans) -> list[Artist]:
    """Return all parts of a figure with plans."""
    return [part for whole in (plans.figure, *plans.axes) for part in whole.get_children()]


def draw_cut(
    figure: Figure,
    box: tuple[float, float, float, float],
    trajectory: Trajectory,
    quantity: str,
    maps: Mapping[str, LevelMaps],
    level: str,
    middle: tuple[float, float],
    reach: float,
) -> None:
    """Draw the map of one quantity around a place, on the plan of its storey.

    `box`: left, bottom, width and height of the square plan with its colour bar, as fractions of the figure;
    `trajectory`, `quantity`, `maps`: as for `draw_map`; colours are the same for all places of the run; `middle` [m];
    `reach` [m]: distance from the middle to the edges.
    """
    left, bottom, width, height = box
    axes = figure.add_axes((left, bottom, 0.8 * width, height))
    axes.set(xlim=(middle[0] - reach, middle[0] + reach), ylim=(middle[1] - reach, middle[1] + reach), aspect="equal")
    axes.set(xticks=[], yticks=[])
    building = trajectory.building_at(next(iter(maps.values())).end)
    shown = next(levels for _, levels in building.storeys if level in [own.name for own in levels])
    draw_levels(axes, building, shown, is_filled=False, has_widths=False)
    for text in axes.texts:
        text.set(annotation_clip=True, clip_on=True, clip_box=axes.bbox)  # nothing over the colour bar
    plans = Plans(figure, (axes,), (tuple(shown),), (), (left + 0.8 * width, bottom, 0.2 * width, height))
    nearest = {own.name: _nearest_cells(maps[own.name]) for own in shown}
    grids, images = {name: own.array(quantity) for name, own in maps.items()}, _images(plans, maps)
    _draw_values(plans, grids, images, nearest, SCALES[quantity])


def draw_grids(plans: Plans, maps: Mapping[str, LevelMaps], grids: Mapping[str, FloatArray], scale: Scale) -> None:
    """Draw values in the cells of maps on plans of a building that are not filled, with the colours of a scale."""
    nearest = {name: _nearest_cells(own) for name, own in maps.items()}
    _draw_values(plans, grids, _images(plans, maps), nearest, scale)


def draw_difference(
    plans: Plans, maps: Mapping[str, LevelMaps], others: Mapping[str, LevelMaps], quantity: str
) -> None:
    """Draw the difference of two maps of a quantity, others - maps, on levels with the same name and equal cells."""
    grids = {
        name: _aligned(others[name].array(quantity), others[name], own) - own.array(quantity)
        for name, own in maps.items()
        if name in others
    }
    scale = SCALES[quantity]
    most = round_up(high_value([np.abs(grid) for grid in grids.values()]))
    colours, norm = colormaps["PuOr_r"], Normalize(-most, most)
    _draw_grids(_images(plans, maps), grids, colours, norm)
    _add_bar(plans, ScalarMappable(norm, colours), f"{scale.label}, difference [{scale.unit}]")


def _aligned(grid: np.ndarray, own: LevelMaps, wanted: LevelMaps) -> np.ndarray:
    """Return a map on the cells of another one with the same spacing; NaN where it has none."""
    aligned = np.full(wanted.shape, np.nan)
    column, row = np.rint((own.origin - wanted.origin) / own.spacing).astype(int).tolist()
    for y, values in enumerate(grid):
        low, high = max(0, -column), min(len(values), wanted.shape[1] - column)
        if 0 <= y + row < wanted.shape[0] and high > low:
            aligned[y + row, low + column : high + column] = values[low:high]
    return aligned


def write_maps(
    trajectory: Trajectory,
    maps: Mapping[str, LevelMaps],
    quantities: Iterable[str],
    path: Path,
    levels: Sequence[str | int] | None = None,
    service: str = "",
) -> list[Path]:
    """Write the pictures of maps: ``map_QUANTITY.png`` in a folder, or one file for one quantity."""
    written = []
    quantities = list(quantities)
    for quantity, figure in zip(
        quantities, draw_maps(trajectory, quantities, maps, levels, service=service), strict=True
    ):
        is_file = path.suffix.lower() in FORMATS
        place = path if is_file else path / map_name(quantity)
        with writing("the map", place):
            place.parent.mkdir(parents=True, exist_ok=True)
        save(figure, place, "the map")
        written.append(place)
    return written


def _draw_values(
    plans: Plans,
    grids: Mapping[str, FloatArray],
    images: Mapping[str, AxesImage],
    nearest: Mapping[str, IntArray],
    scale: Scale,
) -> None:
    """Draw the values of levels with the colours of a scale, and the scale at the right; infinity as 2 of 1."""
    top = scale.end(high_value([*grids.values()]))
    drawn = {}
    for name, (row, column) in nearest.items():
        filled = grids[name][row, column]
        drawn[name] = np.where(np.isinf(filled), 2.0, scale.share(filled, top))
    colours, norm = _colours(scale), Normalize(0.0, 1.0)
    _draw_grids(images, drawn, colours, norm)
    ticks = scale.ticks(top)
    ticks = [tick for k, tick in enumerate(ticks) if k == 0 or tick[0] >= ticks[k - 1][0] + LEAST_STEP]
    shares, texts = zip(*ticks, strict=True)
    source = f", {SERVICES[scale.service].source}" if scale.service else ""
    bar = _add_bar(plans, ScalarMappable(norm, colours), f"{scale.label} [{scale.unit}]{source}")
    bar.set_ticks(shares, labels=texts)


def _nearest_cells(maps: LevelMaps) -> IntArray:
    """Return the row and column of the nearest cell on the floor, (2, ny, nx): maps are clipped to the floor."""
    from scipy.ndimage import distance_transform_edt

    cells: IntArray = distance_transform_edt(np.isnan(maps.density), return_distances=False, return_indices=True)
    return cells


def _images(plans: Plans, maps: Mapping[str, LevelMaps]) -> dict[str, AxesImage]:
    """Draw the floors of plans; return an image for the values of each level with maps, clipped to its floor."""
    images: dict[str, AxesImage] = {}
    for axes, shown in zip(plans.axes, plans.levels, strict=True):
        for level in shown:
            floor = PathPatch(outline_of(level.polygon), facecolor=NO_VALUE, edgecolor="none", zorder=0.5)
            axes.add_patch(floor)
            if level.name in maps:
                style: dict[str, Any] = {"origin": "lower", "interpolation": "nearest", "zorder": 1}
                image = AxesImage(axes, extent=maps[level.name].extent, visible=False, **style)
                axes.add_image(image)
                image.set_clip_path(floor)
                images[level.name] = image
    return images


def _draw_grids(
    images: Mapping[str, AxesImage], grids: Mapping[str, FloatArray], colours: Colormap, norm: Normalize
) -> None:
    """Draw values in the cells of levels, instead of what the images show."""
    for name, grid in grids.items():
        if image := images.get(name):
            image.set(data=np.ma.masked_invalid(grid), cmap=colours, norm=norm, visible=True)


def _colours(scale: Scale) -> Colormap:
    """Return the colours of a map; where there is nothing, or little of some quantities, the floor shows through."""
    share = np.linspace(0.0, 1.0, 256)
    opacity = np.minimum(share / 0.4, 1.0) ** 0.8 if scale.is_veiled else (share > 0.0).astype(float)
    colours = ListedColormap(np.column_stack([scale.ramp(), 0.92 * opacity]))
    return colours.with_extremes(bad=(0, 0, 0, 0), over=NEVER)


def _add_bar(plans: Plans, colours: ScalarMappable, label: str) -> Colorbar:
    """Add a colour bar at the right."""
    left, bottom, _, height = plans.side
    inch = 1.0 / plans.figure.get_size_inches()
    tall = min(height - 0.2 * inch[1], 4.0 * inch[1])  # with room for the numbers at both ends
    axes = plans.figure.add_axes((left + 0.1 * inch[0], bottom + 0.5 * (height - tall), 0.16 * inch[0], tall))
    bar = plans.figure.colorbar(colours, cax=axes)
    bar.outline.set_linewidth(0.5)
    bar.ax.tick_params(labelsize=9, labelcolor=palette.TEXT, color=palette.TEXT)
    bar.set_label(textwrap.fill(label, max(12, int(LETTERS * height / inch[1]))), fontsize=9, color=palette.TEXT)
    return bar


def _label_lines(plans: Plans, flows: Iterable[LineFlow]) -> None:
    """Label lines with the number of people who passed, and per second and metre; if crowded, those most passed."""
    box = {"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": palette.EDGE, "linewidth": 0.5, "alpha": 0.9}
    ordered = sorted((flow for flow in flows if flow.people), key=lambda flow: -flow.people)
    renderer = FigureCanvasAgg(plans.figure).get_renderer()
    for axes, levels in zip(plans.axes, plans.levels, strict=True):
        rows, written = {level.index for level in levels}, list[Bbox]()
        for flow in ordered:
            if not rows & set(flow.levels):
                continue
            x1, y1, x2, y2 = flow.segments[len(flow.segments) // 2].tolist()
            length = math.hypot(x2 - x1, y2 - y1)
            # A line has its name in the middle, and an exit on its outside.
            place, off = 0.9 if flow.kind == "line" else 0.5, 14.0 if flow.kind == "exit" else 0.0
            rate = flow.flow_per_metre
            label = axes.annotate(
                f"{flow.people}" if rate is None else f"{flow.people}\n{rate:.2f}",
                (x1 + place * (x2 - x1), y1 + place * (y2 - y1)),
                xytext=(off * (y1 - y2) / length, off * (x2 - x1) / length),
                textcoords="offset points",
                ha="center",
                va="center",
                fontsize=7,
                color=palette.TEXT,
                bbox=box,
                zorder=7,
            )
            extent = label.get_window_extent(renderer)
            label.set_visible(not extent.count_overlaps(written))
            written += [extent] * label.get_visible()
