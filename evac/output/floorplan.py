"""Pictures of a building, level by level: everything with its name, and a numbered mark for each finding."""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from shapely.geometry.base import BaseGeometry

from evac.arrays import FloatArray
from evac.building.elevation import level_elevation
from evac.building.findings import Finding
from evac.building.model import Building, Level
from evac.errors import ResultError
from evac.output.files import writing

#: Endings of pictures that can be written.
PICTURES = (".png", ".svg", ".pdf")
#: Floors whose heights differ by less than this are one storey [m].
STOREY = 1.0
#: Only so many findings are listed under a picture.
MOST_LISTED = 40

FILL = {"floor": "#eef1f5", "flight": "#f3cf95", "landing": "#f7e2bf"}
WALL, TEXT, PORTAL, EXIT, CLOSED, AREA, OPENING = (
    "#27313d",
    "#27313d",
    "#3778bf",
    "#12a150",
    "#c0392b",
    "#7d5fb2",
    "#d9730d",
)
MARK = {"warning": "#c0392b", "repaired": "#1f77b4", "assumed": "#b8860b", "left out": "#6b7280"}

#: Paper behind names, and room for them beside a building, as a share of its size.
PAPER, NAMES = {"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.7}, 0.1

#: Width of a panel, least height of one, height of a line of the list, margins [inches].
PANEL, LEAST_PANEL, LINE, MARGIN = 8.0, 2.2, 0.17, 0.35


@dataclass(frozen=True)
class Mark:
    """A numbered segment, such as an opening that may become an exit: its label, level, and ends x1, y1, x2, y2."""

    label: str
    level: int
    segment: FloatArray


def draw_levels(
    building: Building, path: Path, findings: Sequence[Finding] = (), marks: Sequence[Mark] = (), title: str = ""
) -> None:
    """Draw every storey with walls, portals, exits, areas, stairs and their names to a PNG, SVG or PDF file.

    Stairs are drawn with the storey that they lead up from. Findings other than those of kind "found" are marked with
    numbers at their places and listed below, in their order.

    Parameters
    ----------
    building : Building
    path : Path
    findings : sequence of Finding
    marks : sequence of Mark
        Segments to number.
    title : str

    Raises
    ------
    ResultError
        The ending is unknown, or the file cannot be written.
    """
    if path.suffix.lower() not in PICTURES:
        raise ResultError(f"{path}: unknown ending {path.suffix!r}; use {', '.join(PICTURES)}")
    listed = list(enumerate((one for one in findings if one.kind != "found"), start=1))
    panels = storeys(building)
    columns = _columns(building, len(panels))
    rows = math.ceil(len(panels) / columns)
    width = columns * PANEL
    lines = _listing(listed, round(width * 13.5))
    width_of, height_of = np.ptp(building.vertices[:, :2], axis=0)
    panel_height = max(LEAST_PANEL, (PANEL - 2 * MARGIN) * min(height_of / width_of, 2.0)) + 2 * MARGIN
    below = LINE * len(lines) + MARGIN
    height = rows * panel_height + below + MARGIN
    figure = Figure(figsize=(width, height), dpi=120)
    FigureCanvasAgg(figure)
    figure.text(MARGIN / width, 1.0 - 0.6 * MARGIN / height, title, fontsize=11, color=TEXT, va="center", weight="bold")
    for number, levels in enumerate(panels):
        row, column = divmod(number, columns)
        bottom = height - MARGIN - (row + 1) * panel_height
        axes = figure.add_axes(
            (
                (column * PANEL + 1.4 * MARGIN) / width,
                (bottom + MARGIN) / height,
                (PANEL - 2 * MARGIN) / width,
                (panel_height - 2 * MARGIN) / height,
            )
        )
        _draw_storey(axes, building, levels)
        for mark in marks:
            if mark.level in levels:
                _draw_mark(axes, mark)
        for own in _by_place(building, panels, listed, number):
            _draw_findings(axes, own)
    for number, (text, colour) in enumerate(lines):
        y = below - 0.5 * MARGIN - LINE * (number + 0.5)
        figure.text(MARGIN / width, y / height, text, fontsize=8, color=colour, va="center")
    with writing("the picture", path):
        figure.savefig(path)


def storeys(building: Building) -> list[list[int]]:
    """Return the levels of each storey, from the ground up: floors at about one height, and what leads up from them."""
    floors = sorted((level for level in building.levels if level.kind == "floor"), key=lambda level: level.z_min)
    found: list[list[int]] = []
    heights: list[float] = []
    for level in floors or building.levels[:1]:
        if not found or level.z_min - heights[-1] >= STOREY:
            found.append([])
            heights.append(level.z_min)
        found[-1].append(level.index)
    for level in building.levels:
        if not any(level.index in own for own in found):
            found[_storey_at(heights, level.z_min + 0.5 * STOREY)].append(level.index)
    return found


def _storey_at(heights: Sequence[float], z: float) -> int:
    """Return the highest storey that is not above a height, or the lowest."""
    return max((k for k, height in enumerate(heights) if height <= z), default=0)


def _columns(building: Building, panels: int) -> int:
    """Return in how many columns panels make a page that is not too long."""
    width, height = np.ptp(building.vertices[:, :2], axis=0)
    return min(panels, max(1, round(math.sqrt(panels * height / width))), 4)


def _draw_storey(axes: Axes, building: Building, levels: Sequence[int]) -> None:
    """Draw the levels of one storey, and what is on them."""
    own = [building.levels[index] for index in levels]
    floors = [level for level in own if level.kind == "floor"]
    for level in own:
        axes.add_patch(_patch(level.polygon, facecolor=FILL[level.kind], edgecolor="none"))
    for area in building.areas:
        if area.level in levels:
            axes.add_patch(_patch(area.polygon, facecolor=AREA, edgecolor=AREA, alpha=0.12, lw=0.8, ls=":"))
            _name(axes, area.polygon, area.name, AREA)
    on = np.isin(building.wall_level, list(levels))
    axes.add_collection(LineCollection(building.walls[on].reshape(-1, 2, 2).tolist(), colors=WALL, linewidths=1.1))
    for portal in building.portals:
        if set(portal.levels) & set(levels):
            _line(axes, portal.segments, PORTAL if building.is_open(portal) else CLOSED, 1.6, "--")
            _beside(axes, portal.segments, f"{portal.width:.2f} m", PORTAL, 6.0)
    for way in building.exits:
        if way.level in levels:
            colour = EXIT if building.is_open(way) else CLOSED
            _line(axes, way.segments, colour, 3.5, "-")
            closed = "" if building.is_open(way) else " (closed)"
            _beside(axes, way.segments, f"{way.name}{closed} {way.width:.2f} m", colour, 8.0)
    for level in own:
        if level.kind == "flight":
            _arrow(axes, level)
        if level.kind == "floor" and len(floors) > 1:
            _name(axes, level.polygon, level.name, TEXT)
    for stair in dict.fromkeys(level.stair for level in own if level.stair is not None):
        flats = [level for level in own if level.stair == stair]
        _name(axes, max(flats, key=lambda level: (level.kind == "landing", level.polygon.area)).polygon, stair, TEXT)
    z = min(level.z_min for level in floors or own)
    names = ", ".join(level.name for level in floors[:4]) + (", ..." if len(floors) > 4 else "")
    axes.set_title(f"{textwrap.shorten(names, 80, placeholder=' ...')}, z = {z:z.2f} m", fontsize=9, loc="left")
    low, high = building.vertices[:, :2].min(axis=0), building.vertices[:, :2].max(axis=0)
    margin = NAMES * float((high - low).max())
    axes.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin / 2, high[1] + margin / 2), aspect="equal")
    axes.tick_params(labelsize=7)
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.spines[["top", "right"]].set_visible(False)


def _patch(polygon: BaseGeometry, **style: object) -> PathPatch:
    rings = [shapely.get_coordinates(ring) for ring in shapely.get_rings(shapely.get_parts(polygon))]
    path = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings))
    return PathPatch(path, **style)


def _line(axes: Axes, segments: FloatArray, colour: str, width: float, style: str) -> None:
    lines = segments.reshape(-1, 2, 2).tolist()
    axes.add_collection(LineCollection(lines, colors=colour, linewidths=width, linestyles=style, capstyle="butt"))


def _name(axes: Axes, polygon: BaseGeometry, text: str, colour: str) -> None:
    """Write a name where a polygon is widest."""
    part = max(shapely.get_parts(polygon), key=lambda one: one.area)
    if shapely.contains(part, part.centroid):
        x, y = part.centroid.coords[0]
    else:
        x, y = shapely.get_coordinates(shapely.maximum_inscribed_circle(part, tolerance=0.05))[0]
    axes.text(x, y, text, fontsize=6.5, color=colour, ha="center", va="center", bbox=PAPER, zorder=5)


def _beside(axes: Axes, segments: FloatArray, text: str, colour: str, distance: float) -> None:
    """Write a name outside the middle of a line, whose inside is on its left."""
    x1, y1, x2, y2 = segments[len(segments) // 2]
    along = np.array([x2 - x1, y2 - y1]) / math.hypot(x2 - x1, y2 - y1)
    outward = np.array([along[1], -along[0]])
    across = "center" if abs(outward[0]) < 0.5 else "left" if outward[0] > 0 else "right"
    upright = "center" if abs(outward[1]) < 0.5 else "bottom" if outward[1] > 0 else "top"
    axes.annotate(
        text,
        ((x1 + x2) / 2, (y1 + y2) / 2),
        xytext=tuple(distance * outward),
        textcoords="offset points",
        fontsize=6.5,
        color=colour,
        ha=across,
        va=upright,
        bbox=PAPER,
        zorder=6,
    )


def _arrow(axes: Axes, level: Level) -> None:
    """Draw an arrow up a flight."""
    corners = shapely.get_coordinates(level.polygon)
    reach = 0.35 * float(np.ptp(corners @ level.uphill))
    middle = shapely.get_coordinates(level.polygon.representative_point())[0]
    start, end = middle - reach * level.uphill, middle + reach * level.uphill
    axes.annotate("", tuple(end), xytext=tuple(start), arrowprops={"arrowstyle": "->", "color": "#a8842c", "lw": 0.9})


def _draw_mark(axes: Axes, mark: Mark) -> None:
    segment = np.asarray(mark.segment, dtype=np.float64).reshape(1, 4)
    _line(axes, segment, OPENING, 2.2, "-")
    _beside(axes, segment, mark.label, OPENING, 5.0)


def _by_place(
    building: Building, panels: list[list[int]], listed: list[tuple[int, Finding]], panel: int
) -> list[list[tuple[int, Finding]]]:
    """Return the findings at each place of a storey, with their numbers."""
    found: dict[tuple[float, float], list[tuple[int, Finding]]] = {}
    for number, finding in listed[:MOST_LISTED]:
        if finding.place is not None and panel_of(building, panels, finding) == panel:
            x, y = finding.place[:2]
            found.setdefault((round(x, 1), round(y, 1)), []).append((number, finding))
    return list(found.values())


def panel_of(building: Building, panels: list[list[int]], finding: Finding) -> int:
    """Return the storey that a finding is on: that of its level, or the one whose ground is nearest to its place."""
    assert finding.place is not None
    names = [level.name for level in building.levels]
    if finding.level is not None:
        own = [k for k, name in enumerate(names) if name == finding.level or name.startswith(f"{finding.level} (")]
        if own:
            return next(number for number, levels in enumerate(panels) if own[0] in levels)
    point = np.array([finding.place[:2]])
    off = []
    for level in building.levels:
        nearest = shapely.get_coordinates(shapely.shortest_line(level.polygon, shapely.points(point))[0])[:1]
        height = level_elevation(building.vertices, level, nearest)[0]
        rise = abs(float(height) - finding.place[2]) if len(finding.place) == 3 else 0.0
        off.append(float(level.polygon.distance(shapely.points(point)[0])) + rise)
    return next(number for number, levels in enumerate(panels) if int(np.argmin(off)) in levels)


def _draw_findings(axes: Axes, findings: list[tuple[int, Finding]]) -> None:
    """Put a ring at the place of findings, and their numbers beside it."""
    kinds = [finding.kind for _, finding in findings]
    colour = next(colour for kind, colour in MARK.items() if kind in kinds)
    labels = ",".join(str(number) for number, _ in findings)
    x, y = (findings[0][1].place or (0.0, 0.0))[:2]
    axes.plot(x, y, marker="o", ms=7, mfc="none", mec=colour, mew=1.4, zorder=8)
    box = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": colour, "lw": 0.6}
    axes.annotate(
        labels, (x, y), (6, 6), textcoords="offset points", fontsize=7, color=colour, weight="bold", bbox=box, zorder=9
    )


def _listing(listed: list[tuple[int, Finding]], width: int) -> list[tuple[str, str]]:
    """Return the lines under a picture, with their colours."""
    lines: list[tuple[str, str]] = []
    for number, finding in listed[:MOST_LISTED]:
        wrapped = textwrap.wrap(f"{number}  {finding.kind}: {finding}", width, subsequent_indent="     ")
        lines += [(line, MARK[finding.kind]) for line in wrapped]
    if len(listed) > MOST_LISTED:
        lines.append((f"and {len(listed) - MOST_LISTED} more", TEXT))
    return lines
