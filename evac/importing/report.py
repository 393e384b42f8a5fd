"""The report of an import: levels, openings, and everything found, assumed, repaired or left out, with its place."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from evac.building.model.findings import KINDS

if TYPE_CHECKING:
    from evac.importing.importing import Imported

#: Maximum number of openings in the picture and on the screen; the report lists all.
MOST_OPENINGS = 20
WALLS = "Where the file names no openings, these are pieces of the outer edges, which may be walls."
TITLES = {kind: kind.capitalize() for kind in KINDS} | {"found": "Found in the file", "warning": "Warnings"}


def report_text(made: "Imported", digest: str) -> str:
    """Return the text of report.md, with the digest of case.toml as it was written."""
    building = made.building
    names = ", ".join(f"`{file.name}`" for file in made.files)
    runs = "The case can be run." if not made.fault else f"The case cannot be run yet: {made.fault}."
    if not made.is_accepted:
        runs = "No case has been written, since the building is incomplete; `--partial` imports what there is."
    text = [f"# Import of {names}", "", runs, "", *_listed(made, KINDS[:1])]
    text += ["![every level](levels.png)", "", "## Levels", ""]
    number = {room.name: room.number for room in made.rooms}
    rows = [
        (level.name, level.kind, f"{level.z_min:z.2f}", f"{level.polygon.area:.2f}", f"{math.degrees(level.slope):.1f}")
        for level in building.levels
    ]
    text += table(("level", "kind", "z [m]", "area in plan [m2]", "slope [deg]"), rows)
    exits = [(way.name, building.levels[way.level].name, f"{way.width:.2f}") for way in building.exits]
    text += ["## Exits", "", *(table(("exit", "level", "width [m]"), exits) if exits else ["None.", ""])]
    openings = [opening_row(made, k) for k in range(len(made.openings))]
    if openings:
        more = "further exits" if exits else "exits"
        text += [f"## Openings that may be {more}", "", f"{WALLS} Choose {more} by number with `--exit 1,2`.", ""]
        text += table(("number", "level", "width [m]", "from", "to", "z [m]"), openings)
    text += ["## People", ""]
    rooms = [(room.name, room.key, f"{room.ground:.2f}", number[room.name]) for room in made.rooms]
    text += table(("room", "kind", "area [m2]", "people"), rooms) if rooms else ["None.", ""]
    text += _listed(made, KINDS[1:])
    text += ["## Options", "", *table(("option", "value"), [(key, repr(one)) for key, one in made.options.items()])]
    return "\n".join([*text, f"case.toml as written: {digest}", ""])


def _listed(made: "Imported", kinds: Sequence[str]) -> list[str]:
    """Return the sections of some kinds of findings."""
    text = []
    marked = [one for one in made.findings if one.kind != "found"]
    for kind in kinds:
        own = [one for one in made.findings if one.kind == kind]
        rows = [(marked.index(one) + 1 if kind != "found" else "", one.text, one.where) for one in own]
        if rows:
            text += [f"## {TITLES[kind]}", "", *table(("in the picture", "finding", "place"), rows)]
    return text


def opening_row(made: "Imported", row: int) -> tuple[object, ...]:
    """Return the row of an opening in a list."""
    opening = made.openings[row]
    x1, y1, x2, y2 = opening.segment.tolist()
    ends = (f"({x1:z.2f}, {y1:z.2f})", f"({x2:z.2f}, {y2:z.2f})")
    return opening.number, opening.level, f"{opening.width:.2f}", *ends, f"{opening.z:z.2f}"


def table(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """Return the lines of a Markdown table, followed by an empty line."""
    written = [[" ".join(str(value).replace("|", "\\|").split()) for value in row] for row in rows]
    lines = [f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}"]
    return [*lines, *(f"| {' | '.join(row)} |" for row in written), ""]
