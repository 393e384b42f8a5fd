"""The pictures of a report, as parts of the page."""

import base64
import io
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from PIL import Image

from evac.analysis.lines import LineFlow
from evac.analysis.maps import QUANTITIES, LevelMaps
from evac.analysis.queues import Queue
from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import counted
from evac.base.progress import track
from evac.building.model.building import Building
from evac.pictures import palette
from evac.pictures.annotated import levels_figure
from evac.pictures.floorplan import Plans, draw_plans
from evac.pictures.map_pictures import FLOW_LABELS, draw_cut, draw_difference, draw_grids, draw_maps
from evac.pictures.palette import MAPS as SCALES
from evac.pictures.palette import Scale
from evac.pictures.pictures import egress_figure, runs_figure
from evac.pictures.render import Renderer
from evac.pictures.view import Camera
from evac.pictures.writing import legible_figure, listed
from evac.results.results import Results
from evac.results.verdict import LeastMargin, time_of_share
from evac.study.maps import LIMITS, MARGIN, MapsOverRuns
from evac.trajectory.trajectory import Trajectory

#: Greatest width and height of all plans together, so that they are printed as large as they are drawn [inches].
PLANS = (6.7, 5.4)

#: The same of maps, which have a colour bar beside them [inches].
MAPS = (5.4, 3.6)

#: Greatest number of storeys in a picture.
TOGETHER = 6

#: Shares of the people out at which the course of a run is shown [%].
SHARES_OUT = (25, 50, 75, 95)

#: Width and height of rendered pictures, of a cover with more storeys than are drawn together, and of the egress curve,
#: which has a table beside it [inches].
COVER, COURSE, TALL, CURVE = (3.3, 2.0), (3.4, 2.4), (4.2, 2.6), (4.5, 2.8)

#: Elevation of the view of so many storeys, which stand closer together and are wider in a picture then [degrees].
LOW = 20.0

#: Pixels of rendered pictures per inch, and size of their letters [pixels].
SHARPNESS, LETTERS = 200, 18

#: Distance from the middle of a bottleneck to the edges of its map [m].
REACH = 5.0

#: Of maps, which are made of cells, when they are printed [1/inch].
DPI = 150


class Picture(NamedTuple):
    """A figure whose picture is part of the page."""

    source: str  # address that contains the picture
    caption: str
    words: str  # what it shows, for those who cannot see it
    kind: str  # class of the page: "drawing", "plans", "map", "place", "cover" or "course"
    width: float | None = None  # where it is printed, if the picture does not have it [inches]


def _picture(
    file: io.BytesIO,
    kind: str,
    names: Sequence[str],
    caption: str,
    words: str,
    class_: str = "drawing",
    width: float | None = None,
) -> Picture:
    """Return a picture, whose caption lists the names that are numbers in it."""
    data = base64.b64encode(file.getvalue()).decode()
    return Picture(f"data:image/{kind};base64,{data}", " ".join([caption, *listed(names)]), words, class_, width)


def drawing(figure: Figure, caption: str, words: str, class_: str = "drawing") -> Picture:
    """Return a figure of lines as a drawing that is sharp at any size; the same figure gives the same bytes."""
    file = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "evac"}), legible_figure(figure) as names:
        figure.savefig(file, format="svg", metadata={"Date": None}, bbox_inches="tight", pad_inches=0.03)
    return _picture(file, "svg+xml", names, caption, words, class_)


def plans(building: Building) -> list[Picture]:
    """Return the plans of all storeys, a few in each picture, with the names and widths of exits, portals and areas."""
    caption = (
        "Plans of the storeys at one scale, with coordinates [m]. Green: exits with their names and clear widths;"
        " dashed lines: portals between levels with their clear widths; violet: areas in which people can start."
        " Flights, with an arrow that points upwards, and landings are drawn with the floor below them. Red: closed."
        " Names for which there is no room are in the tables."
    )
    if building.places:
        caption += " Blue areas: refuges; green areas: assembly areas; green squares: signs, with their exits."
    parts = [slice(first, first + TOGETHER) for first in range(0, len(building.storeys), TOGETHER)]
    drawn = [
        levels_figure(building, title=None, greatest=PLANS, part=part)
        for part in track("drawing plans", parts, len(parts))
    ]
    captions = [caption, *("Plans of the storeys above them." for _ in parts[1:])]
    return [drawing(figure, words, "plans", "plans") for figure, words in zip(drawn, captions, strict=True)]


def course(trajectory: Trajectory, exit_times: FloatArray) -> list[Picture]:
    """Return pictures of a run when `SHARES_OUT` of the people, with exit times (n,) [s], are out."""
    draw = _renderer(trajectory, COURSE)
    times = [(share, time_of_share(exit_times, share)) for share in SHARES_OUT]
    return [
        _rendered(draw, trajectory.nearest(time), f"{share} % of the people are out at {time:.1f} s", "course")
        for share, time in track("drawing the course", times, len(times))
        if time is not None
    ]


def cover(trajectory: Trajectory) -> Picture:
    """Return the picture of the building and the people at the first recorded time."""
    is_tall = len(trajectory.building.storeys) > TOGETHER
    draw = _renderer(trajectory, TALL, Camera(elevation=LOW)) if is_tall else _renderer(trajectory, COVER)
    return _rendered(draw, 0, f"The building at {trajectory.time[0]:g} s.", "cover")


def _renderer(trajectory: Trajectory, inches: tuple[float, float], camera: Camera | None = None) -> Renderer:
    width, height = (round(SHARPNESS * side) for side in inches)
    return Renderer(trajectory, (width, height), camera=camera, letters=LETTERS)


def _rendered(draw: Renderer, k: int, caption: str, class_: str) -> Picture:
    image, file = draw.image(k), io.BytesIO()
    Image.fromarray(image).save(file, format="png")
    return _picture(file, "png", draw.names, caption, caption, class_, image.shape[1] / SHARPNESS)


def inside(trajectory: Trajectory, rows: IntArray) -> Picture:
    """Return plans of the storeys with marks at the people of some rows at the last recorded time."""
    frame = trajectory[len(trajectory) - 1]
    of_these = np.isin(frame["person"], rows)
    place, level = frame["position"][of_these], frame["level"][of_these]
    plans_ = draw_plans(trajectory.building_at(frame["time"]), None, side=0.1, greatest=PLANS)
    for axes, name, levels in zip(plans_.axes, plans_.names, plans_.levels, strict=True):
        x, y = place[np.isin(level, [shown.index for shown in levels])].T
        axes.plot(x, y, "o", color=palette.CLOSED, markersize=2.5, markeredgewidth=0.0, zorder=6)
        name.set_text(f"{name.get_text()}: {len(x)} inside")
    caption = f"People who were still inside at {frame['time']:.1f} s, {len(place)} in all, as red marks."
    return drawing(plans_.figure, caption, caption)


#: Marks of people by their margins: up to so many seconds, with colour, shape, size, and both in words.
MARGINS = (
    (0.0, palette.CLOSED, "v", 5.0, "red triangles below 0 s"),
    (30.0, palette.GROUPS[1], "s", 4.0, "orange squares 0 to 30 s"),
    (120.0, palette.GROUPS[4], "D", 2.5, "blue diamonds 30 to 120 s"),
    (math.inf, palette.NOTHING, ".", 3.0, "grey dots from 120 s on"),
)


def margins(trajectory: Trajectory, least_margins: Sequence[LeastMargin]) -> Picture:
    """Return plans of the storeys with marks where people had their least margins."""
    plans_ = draw_plans(trajectory.building, None, side=0.1, greatest=PLANS)
    least, level = np.array([of.margin for of in least_margins]), np.array([of.level.index for of in least_margins])
    place, words, low = np.array([(of.x, of.y) for of in least_margins]), list[str](), -math.inf
    for high, colour, shape, size, what in MARGINS:
        is_such = (least >= low) & (least < high)
        for axes, levels in zip(plans_.axes, plans_.levels, strict=True):
            x, y = place[is_such & np.isin(level, [shown.index for shown in levels])].T
            axes.plot(x, y, shape, color=colour, markersize=size, markeredgewidth=0.0, zorder=6 + size)
        words.append(f"{what}: {counted(int(is_such.sum()), 'person', 'people')}")
        low = high
    if rest := trajectory.number_of_people - len(least_margins):
        words.append(
            f"without a mark, where no criterion is met as far as the air is known: {counted(rest, 'person', 'people')}"
        )
    caption = f"Where each person had the least margin on its way; {', '.join(words)}."
    return drawing(plans_.figure, caption, caption, "plans")


def egress(run: Results) -> Picture:
    """Return the egress curve of one run."""
    caption = (
        "Number of people out over time: all people, and each group of several people. The dotted line is the"
        " number of people who are to leave."
    )
    return drawing(egress_figure(run, CURVE, has_title=False), caption, "egress curve")


def doses(columns: Mapping[str, Sequence[float]]) -> Picture:
    """Return mean and greatest doses of gases and of heat over time."""
    figure = Figure(figsize=(6.8, 3.0))
    axes = figure.add_subplot()
    for name, colour in (("gas", palette.TEXT), ("heat", palette.CLOSED)):
        axes.plot(columns["time"], columns[f"greatest_{name}"], color=colour, label=f"{name}: greatest")
        axes.plot(columns["time"], columns[f"mean_{name}"], color=colour, linestyle="dashed", label=f"{name}: mean")
    _label_small(axes, columns["time"][-1], "dose")
    axes.legend(frameon=False, fontsize=8)
    return drawing(figure, "Mean and greatest doses of all people who have come, over time.", "doses over time")


def egress_over_runs(people: int, columns: Mapping[str, FloatArray]) -> Picture:
    """Return mean and percentiles over runs of the number of people out; see `runs_figure`."""
    caption = (
        "Number of people out over time: mean, median and percentiles over runs at each time. The dotted line is the"
        " total number of people."
    )
    return drawing(runs_figure("", people, columns), caption, "egress curves over runs")


def difference_picture(
    building: Building, maps: Mapping[str, LevelMaps], others: Mapping[str, LevelMaps], quantity: str, name: str
) -> Picture:
    """Return the map of the difference of a quantity, other - first."""
    caption = (
        f"{SCALES[quantity].label.capitalize()}: difference of {name} from the first design. Orange: more in {name},"
        " violet: less; where only one has a floor, nothing is drawn."
    )
    plans_ = _plans_of_maps(building)
    draw_difference(plans_, maps, others, quantity)
    return _mapped(plans_.figure, caption)


def _plans_of_maps(building: Building) -> Plans:
    return draw_plans(building, None, dpi=DPI, is_filled=False, greatest=MAPS)


def bottleneck(trajectory: Trajectory, queue: Queue, maps: Mapping[str, LevelMaps], number: int) -> Picture:
    """Return the map of the waiting around a queue, beside the number of those who waited in it over time."""
    figure = Figure((6.8, 1.8))
    draw_cut(figure, (0.0, 0.02, 0.33, 0.96), trajectory, "waiting", maps, queue.level, (queue.x, queue.y), REACH)
    axes = figure.add_axes((0.47, 0.24, 0.52, 0.7))
    axes.fill_between(trajectory.time, queue.at_once, step="post", color=palette.CLOSED, alpha=0.3, linewidth=0)
    axes.step(trajectory.time, queue.at_once, where="post", color=palette.CLOSED, linewidth=0.8)
    _label_small(axes, trajectory.time[-1], "people who wait")
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
    words = str(queue)
    return _mapped(figure, f"{number}. {words[0].upper()}{words[1:]}.", "place")


def _label_small(axes: Axes, end: float, up: str) -> None:
    """Label axes for a quantity over time in a small picture."""
    axes.set(xlim=(0.0, end), ylim=(0.0, None))
    axes.set_xlabel("time [s]", fontsize=8)
    axes.set_ylabel(up, fontsize=8)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def _mapped(figure: Figure, caption: str, class_: str = "map") -> Picture:
    """Return a figure with a map, which is made of cells."""
    file = io.BytesIO()
    with legible_figure(figure) as names:
        figure.savefig(file, format="png", dpi=DPI, metadata={"Software": None})
    return _picture(file, "png", names, caption, caption, class_, figure.get_figwidth())


def map_pictures(
    trajectory: Trajectory,
    quantities: Sequence[str],
    maps: Mapping[str, LevelMaps],
    flows: Sequence[LineFlow],
    service: str = "",
) -> list[Picture]:
    """Return the maps of some quantities."""
    figures = draw_maps(
        trajectory, quantities, maps, dpi=DPI, service=service, flows=flows, greatest=MAPS, has_title=False
    )
    captions = {name: f"{QUANTITIES[name].label.capitalize()}: {QUANTITIES[name].doc}" for name in quantities}
    if "flow" in captions:
        captions["flow"] += f"; {FLOW_LABELS}"
    return [_mapped(next(figures), f"{captions[name]}.") for name in track("drawing maps", quantities, len(quantities))]


#: The scale of shares of runs, and what is beyond each of the `evac.study.maps.LIMITS`.
SHARE = Scale("share of runs", "%", "density", 100.0, is_veiled=True)
BEYOND = {
    "max_density": "a density above {:g} per m²",
    "waiting": "more than {:g} s/m² of waiting",
    MARGIN: "margins below {:g} s",
}


def maps_of_runs(
    building: Building, maps: Mapping[str, MapsOverRuns], quantities: Sequence[str], service: str = ""
) -> tuple[list[Picture], list[str]]:
    """Return maps of means over runs, of least margins, and of shares of runs; and what no run goes beyond."""
    means, pictures, without = {name: own.maps for name, own in maps.items()}, list[Picture](), list[str]()

    def add(grids: Mapping[str, FloatArray], scale: Scale, caption: str) -> None:
        plans_ = _plans_of_maps(building)
        draw_grids(plans_, means, grids, scale)
        pictures.append(_mapped(plans_.figure, caption))

    for name in quantities:
        what = f"{QUANTITIES[name].label.capitalize()}, mean over runs: {QUANTITIES[name].doc}."
        add({key: own.array(name) for key, own in means.items()}, SCALES[name].with_service(service), what)
    what = "Least margin of those whose margin was least there, mean over the runs with such people."
    if any(np.isfinite(own.least_margin).any() for own in maps.values()):
        add({name: own.least_margin for name, own in maps.items()}, Scale("least margin", "s", "speed"), what)
    for name, limit in LIMITS.items():
        beyond, grids = BEYOND[name].format(limit), {key: own.shares[name] for key, own in maps.items()}
        if any((grid > 0.0).any() for grid in grids.values()):
            add(grids, SHARE, f"Share of the runs with {beyond}.")
        else:
            without.append(f"No run has {beyond} at any place.")
    return pictures, without
