"""Pictures of results: people out over time, and evacuation times over a parameter of a study."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import in_order
from evac.pictures.palette import TEXT, group_colours
from evac.pictures.writing import legible_figure
from evac.results.results import Results

MOST_GROUPS = 12  #: Maximum number of groups that are drawn as separate lines.
MOST_LINES = 12  #: Maximum number of lines of a study that a legend names.
SIZE = (8.0, 5.0)  #: Width and height of a picture [inches].


def egress_figure(results: Results, size: tuple[float, float] = SIZE, has_title: bool = True) -> Figure:
    """Return the egress curve of all people who are to leave, and of each group of them if there are several.

    Groups of one person have no curve, which the legend says, and there are none if there are too many. Sizes are in
    inches.
    """
    people = len(results.leaving)
    note = f"{results.evacuated} of {people} out"
    if results.last_out is not None:
        which = "the last one" if results.evacuated == people else "the last of these"
        note += f", {which} after {results.last_out:.1f} s"
    others = {"stay": results.staying, "at safe places": results.at_places, "have not come": results.not_arrived}
    others["have been stopped"] = len(results.stopped)
    note += "".join(f"; {number} {what}" for what, number in others.items() if number)
    title = f"{textwrap.fill(results.title, 90)}\n{note}" if has_title else ""
    figure, axes = new_axes(title, people, size)
    rows = {group.name: np.intersect1d(group.rows, results.leaving) for group in in_order(results.groups)}
    groups, end = {name: own for name, own in rows.items() if len(own)}, results.time

    def draw(own: IntArray | None, **style: Any) -> None:
        time, number = results.egress(own)
        axes.step([*time, end], [*number, number[-1]], where="post", **style)

    if 1 < len(groups) <= MOST_GROUPS:
        for (name, own), colour in zip(groups.items(), group_colours(len(groups)), strict=False):
            if len(own) > 1:
                draw(own, label=name, color=colour, linewidth=1.3)
    draw(None, linewidth=2.2, color=TEXT, label="everybody")
    axes.set_xlim(0.0, max(end, 1e-9))
    if axes.get_legend_handles_labels()[1] != ["everybody"]:
        single = sum(len(own) == 1 for own in groups.values())
        heading = f"without {single} {'group' if single == 1 else 'groups'}\nof one person" if single else None
        style = {"frameon": False, "fontsize": 8, "title": heading, "title_fontsize": 7, "alignment": "left"}
        legend = axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), **style)
        for text in legend.get_texts():
            text.set_parse_math(False)
        # Names that are too long for the picture are cut at the end.
        with legible_figure(figure):
            width = legend.get_window_extent().width
        figure.subplots_adjust(right=max(0.5, 0.98 - width / figure.bbox.width))
    return figure


def runs_figure(title: str, people: int, columns: Mapping[str, FloatArray]) -> Figure:
    """Return mean, median and range of percentiles over runs of the number of people out, over time.

    `columns` (k,): ``time`` [s], ``mean_over_runs``, and ``percentile_P_over_runs`` in ascending order, 50 among them.
    """
    figure, axes = new_axes(title, people)
    time, (low, *_, high) = columns["time"], [name for name in columns if name.startswith("percentile_")]
    median = "percentile_50_over_runs"
    words = [name.split("_")[1] for name in (low, high)]
    label = f"percentiles {' to '.join(words)} over runs"
    axes.fill_between(time, columns[low], columns[high], color="#9fb3c8", label=label)
    axes.plot(time, columns[median], color="#486581", linewidth=1.2, linestyle="--", label="median over runs")
    axes.plot(time, columns["mean_over_runs"], color=TEXT, linewidth=2.0, label="mean over runs")
    axes.set_xlim(0.0, max(float(time[-1]), 1e-9))
    axes.legend(frameon=False, loc="lower right")
    return figure


def designs_figure(title: str, people: int, curves: Mapping[str, Mapping[str, FloatArray]]) -> Figure:
    """Return the mean numbers of people out over time of designs, with bands over runs; columns as of `runs_figure`."""
    figure, axes = new_axes(title, people)
    for (name, columns), colour in zip(curves.items(), group_colours(len(curves)), strict=False):
        low, *_, high = (values for key, values in columns.items() if key.startswith("percentile_"))
        axes.fill_between(columns["time"], low, high, color=colour, alpha=0.2, linewidth=0.0)
        axes.plot(columns["time"], columns["mean_over_runs"], label=name, color=colour, linewidth=1.8)
    axes.set_xlim(0.0, max(float(columns["time"][-1]) for columns in curves.values()))
    for text in axes.legend(frameon=False, loc="lower right", fontsize=9).get_texts():
        text.set_parse_math(False)
    return figure


def points_figure(
    title: str, parameters: Sequence[Mapping[str, Any]], middle: FloatArray, greatest: FloatArray, note: str
) -> Figure:
    """Return a figure of a statistic with its interval, and of a high percentile, over the last numeric parameter.

    `parameters`: values of the parameters at each point, by key; `middle` (points, 3) [s]: value of the statistic and
    bounds of its interval; `greatest` (points,) [s]: the percentile; `note`: what is drawn.
    """
    keys = list(dict.fromkeys(key for of_point in parameters for key in of_point))
    values = {key: [of_point.get(key) for of_point in parameters] for key in keys}
    numeric = [key for key in keys if {*map(type, values[key])} <= {int, float} and len(set(values[key])) > 1]
    along = numeric[-1] if numeric else None
    place = np.array(values[along] if along else range(len(parameters)), dtype=np.float64)
    figure, axes = new_plain_axes(title, along or "point", "evacuation time [s]", 0.6)
    lines: dict[str, list[int]] = {}
    for k, of_point in enumerate(parameters):
        name = ", ".join(f"{key} = {of_point.get(key)}" for key in keys if key != along) if along else ""
        lines.setdefault(name, []).append(k)
    middle, greatest = (np.where(np.isfinite(times), times, np.nan) for times in (middle, greatest))  # NaN leaves a gap
    for number, (name, members) in enumerate(lines.items()):
        rows = np.array(members)[np.argsort(place[members], kind="stable")]
        value, low, high = middle[rows].T
        bars = np.nan_to_num(np.abs([value - low, high - value]))
        colour = f"C{number % 10}"
        line = "o-" if along else "o"
        axes.errorbar(place[rows], value, bars, fmt=line, color=colour, capsize=3, label=name or None)
        axes.plot(place[rows], greatest[rows], "^", color=colour, markerfacecolor="none")
    if not along:
        labels = [", ".join(f"{key} = {value}" for key, value in of_point.items()) for of_point in parameters]
        axes.set_xticks(
            range(len(labels)), [textwrap.fill(label, 24) for label in labels], fontsize=7, rotation=30, ha="right"
        )
    drawn = axes.get_tightbbox()
    assert drawn is not None
    low = drawn.transformed(figure.transFigure.inverted()).min
    left, bottom = np.maximum(0.01 - np.array(low), 0.0).tolist()  # labels need more room if they are long
    figure.subplots_adjust(figure.subplotpars.left + left, figure.subplotpars.bottom + bottom)
    axes.text(0.0, 1.01, note, transform=axes.transAxes, fontsize=8, color="#52606d")
    if any(lines) and len(lines) <= MOST_LINES:
        axes.legend(frameon=False, fontsize=8)
    return figure


def new_axes(title: str, people: int, size: tuple[float, float] = SIZE) -> tuple[Figure, Axes]:
    """Return a figure and axes for people out over time, up to `people`."""
    figure, axes = new_plain_axes(title, "time [s]", "people out", 0.37 + 0.09 * len(str(people)), size)
    axes.axhline(people, lw=0.8, ls=":", color="#7b8794")
    axes.set_ylim(0.0, 1.06 * max(people, 1))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    return figure, axes


def new_plain_axes(
    title: str, along: str, up: str, left: float, size: tuple[float, float] = SIZE
) -> tuple[Figure, Axes]:
    """Return a figure and axes with a title and axis labels; `left` is the space for numbers [inches]."""
    figure = Figure(figsize=size, dpi=150)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    # Fixed margins, because the automatic layouts of matplotlib take as long as drawing.
    top = 0.12 + 0.18 * (1 + title.count("\n"))
    figure.subplots_adjust(left / size[0], 0.48 / size[1], 1.0 - 0.2 / size[0], 1.0 - top / size[1])
    axes.set(xlabel=along, ylabel=up)
    axes.set_title(title, fontsize=11, loc="left", parse_math=False)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes
