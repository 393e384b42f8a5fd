"""Pictures of a building: annotated plans of all storeys with a numbered mark for each finding."""

import itertools
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.errors import ResultError
from evac.base.progress import track
from evac.building.model.building import Building, Level
from evac.building.model.elevation import level_elevation
from evac.building.model.findings import PART, Finding, and_more, listed
from evac.pictures import palette
from evac.pictures.floorplan import HEIGHT, WIDTH, beside, draw_plans, outline_of
from evac.pictures.writing import legible_figure, save

#: Supported file name endings of pictures.
PICTURES = (".png", ".svg", ".pdf")
MOST_LISTED = 40  #: Maximum number of findings listed below a picture.

AREA, OPENING, UPHILL = "#7d5fb2", "#d9730d", "#a8842c"
MARK = dict.fromkeys(("error", "missing", "warning", "left out"), "#c0392b")
MARK |= {"repaired": "#1f77b4", "assumed": "#b8860b"}

#: Half the width of the ring at a finding [pixels], and how far texts are moved off others, in halves of their size.
RING, REACH = 8.0, 6
#: Area of a letter of the names of areas [points2]: an area that is smaller than its name has none.
LETTER = 29.0
PAPER = {"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.7}  #: Background of names.

#: Height of a line of the list and margin around it [inches], and number of letters per inch.
LINE, MARGIN, LETTERS = 0.17, 0.3, 13.5


@dataclass(frozen=True)
class Mark:
    """A labelled segment, such as a possible exit: label, level, and ends x1, y1, x2, y2 [m]."""

    label: str
    level: int
    segment: FloatArray


def draw_levels(
    building: Building, path: Path, findings: Sequence[Finding] = (), marks: Sequence[Mark] = (), title: str = ""
) -> None:
    """Draw the plan of every storey to a PNG, SVG or PDF file, see `levels_figure`."""
    if path.suffix.lower() not in PICTURES:
        raise ResultError(f"{path}: unknown ending {path.suffix!r}; use {', '.join(PICTURES)}")
    save(levels_figure(building, findings, marks, title), path)


def levels_figure(
    building: Building,
    findings: Sequence[Finding] = (),
    marks: Sequence[Mark] = (),
    title: str | None = "",
    greatest: tuple[float, float] = (WIDTH, HEIGHT),
    part: slice = slice(None),
) -> Figure:
    """Return the plan of every storey: walls, portals, exits, doors, areas and stairs, with names and widths.

    Stairs are drawn with the storey that they lead up from. Findings other than those of kind "found" are marked with
    numbers at their places and listed below; those that repeat each other have one number. Areas that are smaller on
    the picture than their names have none, nor have doors that are narrower than a letter.
    """
    plans = draw_plans(building, title, side=MARGIN, has_widths=True, greatest=greatest, part=part)
    groups = listed(findings)
    panels = [[level.index for level in levels] for levels in plans.levels]
    places = _by_place(building, panels, groups)
    drawn = zip(plans.axes, plans.levels, strict=True)
    for number, (axes, levels) in enumerate(track("drawing every level", drawn, len(panels))):
        _show_coordinates(axes)
        _name_parts(axes, building, levels)
        for mark in marks:
            if mark.level in panels[number]:
                segment = np.asarray(mark.segment, dtype=np.float64).reshape(1, 4)
                _line(axes, segment, OPENING, 2.2)
                beside(axes, segment, mark.label, OPENING)
        with legible_figure(axes):
            taken = _numbered(plans.figure, axes, [*places[number].values()])
            _keep_apart(plans.figure, axes, taken)
    _list_below(plans.figure, groups)
    return plans.figure


def _show_coordinates(axes: Axes) -> None:
    """Show the coordinates that messages name."""
    axes.set_axis_on()
    axes.patch.set_alpha(0.0)
    axes.tick_params(labelsize=6.5, direction="in", pad=2, colors=palette.EDGE)
    axes.ticklabel_format(useOffset=False, style="plain")
    for spine in axes.spines.values():
        spine.set_color("#d5dae0")


def _name_parts(axes: Axes, building: Building, levels: Sequence[Level]) -> None:
    """Draw areas, doors and the ways up stairs, and the names of all of them."""
    rows = [level.index for level in levels]
    areas = [area for area in building.areas if area.level in rows]
    outlines = [outline_of(area.polygon) for area in areas]
    axes.add_collection(PathCollection(outlines, color=AREA, alpha=0.12, linewidths=0.8, linestyles=":"))
    scale = 72.0 / axes.figure.dpi * axes.bbox.width / np.ptp(axes.get_xlim())
    for area in areas:
        lines = area.name, f"{area.polygon.area:.1f} m2"
        if scale**2 * area.polygon.area > len(lines) * LETTER * max(map(len, lines)):
            _name(axes, area.polygon, "\n".join(lines), AREA)
    doors = [door for door in building.doors if door.level in rows]
    _line(axes, np.array([door.segment for door in doors]), palette.PORTAL, 0.8)
    for door in (door for door in doors if scale * door.width > LETTER**0.5):
        beside(axes, door.segment[None], f"{door.name} {door.width:.2f} m", palette.EDGE)
        axes.texts[-1].set_bbox(PAPER)  # it lies over walls of small rooms
    for level in levels:
        if level.kind == "flight":
            _arrow(axes, level)
    for stair in dict.fromkeys(level.stair for level in levels if level.stair is not None):
        flats = [level for level in levels if level.stair == stair]
        flat = max(flats, key=lambda level: (level.kind == "landing", level.polygon.area))
        _name(axes, flat.polygon, stair, palette.TEXT)


def _numbered(figure: Figure, axes: Axes, places: list[list[tuple[int, Finding]]]) -> list[Bbox]:
    """Mark findings with rings and numbers that cover neither each other nor names of exits; return the boxes.

    Names of exits and places that are longer than the plan get smaller letters, and those that cover others are moved.
    """
    axes.apply_aspect()
    renderer, taken = FigureCanvasAgg(figure).get_renderer(), list[Bbox]()
    for text in (text for text in axes.texts if text.get_text() and _rank(text) == 0):
        room = 0.95 * np.divide(axes.bbox.size, text.get_window_extent(renderer).size)  # letters have whole pixels
        text.set_fontsize(text.get_fontsize() * min(1.0, *room))
        box = _moved_inside(axes, text, text.get_window_extent(renderer))
        taken.append(_moved_free(axes, text, box, taken) if box.count_overlaps(taken) else box)
    rings = [_draw_ring(axes, findings) for findings in places]
    middles = axes.transData.transform(np.reshape([ring.xy for ring in rings], (-1, 2)))
    taken += [Bbox([middle - RING, middle + RING]) for middle in middles]
    for ring in rings:
        box = ring.get_window_extent(renderer).padded(2.0)
        taken.append(_moved_free(axes, ring, box, taken))
    return taken


def _moved_free(axes: Axes, text: Text, box: Bbox, taken: Sequence[Bbox]) -> Bbox:
    """Move a text as little as is needed to cover nothing that is taken, if it can; return its box [pixels]."""
    shifts = sorted(itertools.product(range(-REACH, REACH + 1), repeat=2), key=lambda one: one[0] ** 2 + one[1] ** 2)
    low = box.min + 0.5 * np.array(shifts) * box.size
    high, others = low + box.size, np.reshape([one.get_points() for one in taken], (-1, 2, 2))
    is_inside = ((low >= axes.bbox.min) & (high <= axes.bbox.max)).all(axis=1)
    covers = ((low[:, None] < others[:, 1]) & (high[:, None] > others[:, 0])).all(axis=2)
    for row in np.flatnonzero(is_inside & ~np.any(covers, axis=1))[:1]:
        _shift(axes, text, *(low[row] - box.min).tolist())
        return Bbox([low[row], high[row]])
    return box


def _keep_apart(figure: Figure, axes: Axes, taken: list[Bbox]) -> None:
    """Keep names within their plan and off what is taken; leave out those that cover others."""
    renderer = FigureCanvasAgg(figure).get_renderer()
    written = [*taken]
    for text in sorted((text for text in axes.texts if text.get_text() and _rank(text)), key=_rank):
        box = _moved_inside(axes, text, text.get_window_extent(renderer))
        if _rank(text) in (1, 3):  # of stairs and areas, which may be written anywhere near
            box = _moved_free(axes, text, box, written)
        text.set_visible(not box.count_overlaps(written))
        written += [box] * text.get_visible()


def _rank(text: Text) -> int:
    """Return 0 for names of exits and marks, which are always shown, and more for what gives way to them."""
    is_width = len(text.get_text().split()) == 2
    return {palette.TEXT: 1, palette.EDGE: 4 if is_width else 2, AREA: 3}.get(str(text.get_color()), 0)


def _moved_inside(axes: Axes, text: Text, box: Bbox) -> Bbox:
    """Move a text by as much as its box [pixels] is outside a plan; return its box then."""
    frame = axes.bbox
    dx = max(frame.x0 - box.x0, 0.0) - max(box.x1 - frame.x1, 0.0)
    dy = max(frame.y0 - box.y0, 0.0) - max(box.y1 - frame.y1, 0.0)
    _shift(axes, text, dx, dy)
    return box.translated(dx, dy)


def _shift(axes: Axes, text: Text, dx: float, dy: float) -> None:
    """Move a text [pixels]."""
    if isinstance(text, Annotation):
        points = 72.0 / axes.figure.dpi
        text.xyann = text.xyann[0] + points * dx, text.xyann[1] + points * dy
    else:
        x, y = axes.transData.transform(text.get_position())
        text.set_position(axes.transData.inverted().transform((x + dx, y + dy)).tolist())


def _list_below(figure: Figure, groups: list[tuple[int, list[Finding]]]) -> None:
    """Enlarge a figure at the bottom and list findings there."""
    width, height = figure.get_size_inches().tolist()
    lines = list[tuple[str, str]]()
    for number, group in groups[:MOST_LISTED]:
        words = f"{number}  {group[0].kind}: {group[0]}{and_more(group)}"
        letters = round(LETTERS * (width - 2 * MARGIN))
        lines += [(line, MARK[group[0].kind]) for line in textwrap.wrap(words, letters, subsequent_indent="     ")]
    if not lines:
        return
    if len(groups) > MOST_LISTED:
        lines.append((f"and {len(groups) - MOST_LISTED} more", palette.TEXT))
    below = LINE * len(lines) + MARGIN
    total = height + below
    for axes in figure.axes:
        box = axes.get_position(original=True)
        axes.set_position((box.x0, (box.y0 * height + below) / total, box.width, box.height * height / total))
    for text in figure.texts:
        text.set_y((text.get_position()[1] * height + below) / total)
    figure.set_size_inches(width, total)
    for number, (line, colour) in enumerate(lines):
        y = (below - 0.5 * MARGIN - LINE * (number + 0.5)) / total
        figure.text(MARGIN / width, y, line, fontsize=8, color=colour, va="center", parse_math=False)


def _line(axes: Axes, segments: FloatArray, colour: str, width: float) -> None:
    axes.add_collection(LineCollection(segments.reshape(-1, 2, 2).tolist(), colors=colour, linewidths=width))


def _name(axes: Axes, polygon: BaseGeometry, text: str, colour: str) -> None:
    """Write a name at the widest place of a polygon."""
    part = max(shapely.get_parts(polygon), key=lambda part_of: part_of.area)
    if shapely.contains(part, part.centroid):
        x, y = part.centroid.coords[0]
    else:
        x, y = shapely.get_coordinates(shapely.maximum_inscribed_circle(part, tolerance=0.05))[0]
    axes.text(x, y, text, fontsize=6.5, color=colour, ha="center", va="center", bbox=PAPER, zorder=5, parse_math=False)


def _arrow(axes: Axes, level: Level) -> None:
    """Draw an arrow up a flight."""
    corners = shapely.get_coordinates(level.polygon)
    reach = 0.35 * float(np.ptp(corners @ level.uphill))
    middle = shapely.get_coordinates(level.polygon.representative_point())[0]
    start, end = middle - reach * level.uphill, middle + reach * level.uphill
    axes.annotate("", tuple(end), xytext=tuple(start), arrowprops={"arrowstyle": "->", "color": UPHILL, "lw": 0.9})


def _by_place(
    building: Building, panels: list[list[int]], groups: list[tuple[int, list[Finding]]]
) -> list[dict[tuple[float, float], list[tuple[int, Finding]]]]:
    """Return the findings at each place of each storey, with their numbers."""
    by_place: list[dict[tuple[float, float], list[tuple[int, Finding]]]] = [{} for _ in panels]
    for number, finding in ((number, finding) for number, group in groups[:MOST_LISTED] for finding in group):
        if finding.place is not None:
            x, y = finding.place[:2]
            own = by_place[panel_of(building, panels, finding)]
            own.setdefault((round(x, 1), round(y, 1)), []).append((number, finding))
    return by_place


def panel_of(building: Building, panels: list[list[int]], finding: Finding) -> int:
    """Return the storey of a finding: that of its level, or else the one whose ground is nearest to its place."""
    assert finding.place is not None
    own = [one for one in building.levels if finding.level in (one.name, one.title, PART.sub("", one.name))]
    point, off, levels = np.array([finding.place[:2]]), list[float](), own or building.levels
    for level in levels:
        nearest = shapely.get_coordinates(shapely.shortest_line(level.polygon, shapely.points(point))[0])[:1]
        height = level_elevation(building.vertices, level, nearest)[0]
        rise = abs(float(height) - finding.place[2]) if len(finding.place) == 3 else 0.0
        off.append(float(level.polygon.distance(shapely.points(point)[0])) + rise)
    nearest_level = levels[int(np.argmin(off))].index
    return next(number for number, shown in enumerate(panels) if nearest_level in shown)


def _draw_ring(axes: Axes, findings: list[tuple[int, Finding]]) -> Annotation:
    """Draw a ring at the place of findings and return their numbers beside it."""
    kinds = [finding.kind for _, finding in findings]
    colour = next(colour for kind, colour in MARK.items() if kind in kinds)
    labels = ",".join(dict.fromkeys(str(number) for number, _ in findings))
    place = (findings[0][1].place or (0.0, 0.0))[:2]
    x, y = np.clip(place, *np.transpose([axes.get_xlim(), axes.get_ylim()]))  # what is off the plan is at its border
    axes.plot(x, y, clip_on=False, marker="o", ms=7, mfc="none", mec=colour, mew=1.4, zorder=8)
    box = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": colour, "lw": 0.6}
    style: dict[str, Any] = {"fontsize": 7, "color": colour, "weight": "bold", "bbox": box, "zorder": 9}
    return axes.annotate(labels, (x, y), (6, 6), textcoords="offset points", **style)
