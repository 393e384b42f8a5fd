"""What the page shows where it cannot play: a picture of the people at the start, and texts of the run."""

import html
import math
from collections.abc import Callable, Sequence

import numpy as np
import shapely

from evac.analysis.queues import Queue
from evac.base.arrays import FloatArray, IntArray
from evac.building.model.building import Building
from evac.building.model.storeys import storeys
from evac.pictures import palette
from evac.replay.account import Account
from evac.replay.motion import MotionPacker

#: Lines of floors are drawn with this tolerance [m], which keeps the picture small.
TOLERANCE = 0.05

#: Most letters of the name of a storey, and the width of a person [cm].
MOST_LETTERS, PERSON = 40, 45.0

#: At most so many people are drawn.
MOST_PEOPLE = 1500

#: Space between the plans of storeys, as a share of the longer side of the building, and at least [m].
GAP, LEAST_GAP = 0.1, 1.0


def texts(account: Account) -> dict[str, str]:
    """Return the parts of the page that tell about the run, as HTML, by their places in the template."""
    kind, banner = account.banner or ("", "")
    goes = {line: account.longest for line in account.answer if account.longest and line.endswith(str(account.longest))}
    facts = "".join(f"<dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd>" for name, value in account.facts)
    warnings = _list("Quality warnings", account.quality_warnings)
    warnings += _list("Warnings about building and people", account.warnings)
    return {
        "banner": f'<p id="banner" class="{kind}" role="alert"{"" if banner else " hidden"}>{html.escape(banner)}</p>',
        "answer": "".join(f"<p>{html.escape(line)}{_show(goes.get(line))}</p>" for line in account.answer),
        "facts": facts,
        "warnings": warnings or "<h3>No warnings</h3>",
    }


def poster(motion: MotionPacker, group: IntArray) -> str:
    """Return a picture of all storeys in plan side by side, with the people of the first state, as SVG.

    `motion`: with at least one state; `group` (n,): group of each person, -1 for none.
    """
    building = motion.building
    of = storeys(building)
    storey_of = {level.index: storey for storey, (_, levels) in enumerate(of) for level in levels}
    low, high = np.array(shapely.total_bounds([level.polygon for level in building.levels])).reshape(2, 2)
    cell = high - low + max(GAP * float((high - low).max()), LEAST_GAP)
    columns = max(1, round(math.sqrt(1.6 * len(of) * cell[1] / cell[0])))  # about as wide as a screen
    width, height = 100.0 * cell * [min(columns, len(of)), math.ceil(len(of) / columns)]
    gap = 100.0 * float((cell - high + low).min())

    def placed(level: int, points: FloatArray) -> FloatArray:
        """Return points [m] of a level as they are drawn [cm], y downwards."""
        row, column = divmod(storey_of[level], columns)
        at = points - [low[0], high[1]] + cell * [column, -row]
        drawn: FloatArray = np.rint(at * [100.0, -100.0])
        return drawn

    parts = [_floor(building, level, placed) for level in range(len(building.levels))]
    for storey, (name, _) in enumerate(of):
        x, y = 100.0 * cell * divmod(storey, columns)[::-1] - [0.0, 0.2 * gap]
        size, text = min(0.7 * gap, width / 40.0), html.escape(name[:MOST_LETTERS])
        parts.append(f'<text x="{x:.0f}" y="{y:.0f}" font-size="{size:.0f}">{text}</text>')
    for exit_ in building.exits:
        ends = placed(exit_.level, exit_.segments.reshape(-1, 2)).reshape(-1, 4)
        parts.append(f'<path class="exit" d="{"".join(f"M{a:.0f} {b:.0f}L{c:.0f} {d:.0f}" for a, b, c, d in ends)}"/>')
    person, level, position = motion.first_state()
    dot = max(PERSON, width / 200.0)  # seen on a narrow screen, too
    every = math.ceil(max(len(person), 1) / MOST_PEOPLE)
    colours = palette.group_colours(int(group.max(initial=-1)) + 1)
    for number in np.unique(group[person]):
        rows = np.flatnonzero(group[person] == number)[::every]
        at = [placed(int(level[row]), position[row]) for row in rows]
        dots = "".join(f"M{x:.0f} {y:.0f}h0" for x, y in at)
        parts.append(f'<path class="people" stroke="{colours[number]}" stroke-width="{dot:.0f}" d="{dots}"/>')
    label = "All storeys in plan, from the lowest, with the people at the start"
    box = f"-50 {-gap:.0f} {width:.0f} {height:.0f}"
    return f'<svg viewBox="{box}" role="img" aria-label="{label}">{"".join(parts)}</svg><p>{label}</p>'


def _floor(building: Building, index: int, placed: Callable[[int, FloatArray], FloatArray]) -> str:
    level = building.levels[index]
    parts = shapely.get_parts(level.polygon.simplify(TOLERANCE))
    rings = [ring for part in parts for ring in (part.exterior, *part.interiors)]
    outlines = (placed(index, np.array(ring.coords)[:-1]) for ring in rings)
    path = "".join(f"M{'L'.join(f'{x:.0f} {y:.0f}' for x, y in outline)}z" for outline in outlines)
    return f'<path class="{level.kind}" d="{path}"/>'


def _show(queue: Queue | None) -> str:
    return "" if queue is None else f' <button type="button" value="{queue.time!r}">Show</button>'


def _list(title: str, lines: Sequence[str]) -> str:
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    return f"<h3>{title}</h3><ul>{items}</ul>" if items else ""
