"""The files that an import writes for its reader: case.toml, the plan of the building, and report.md; the example."""

import math
from collections.abc import Mapping, Sequence
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.base.errors import ScenarioError
from evac.base.toml import toml_lines, toml_value
from evac.building.model.findings import FINDING_KINDS, account, listed, repaired
from evac.contract.hooks import BASES, DEFAULT_MOVEMENT
from evac.importing.rooms import groups_of

if TYPE_CHECKING:
    from evac.importing.importing import Imported

PLAN_HEAD = """# Written by evac import: the building of case.toml, in metres. Importing again to this folder keeps it
# if it has been changed. A wall is put into a room by an obstacle, and taken away by a polygon over it in its storey.
"""

PEOPLE = """
# Adapt the number of people in each room and their properties.
[presets.person]
speed = { normal = [1.34, 0.26], minimum = 0.5, maximum = 2.2 }
speed_up = { uniform = [0.5, 0.9] }
speed_down = { uniform = [0.5, 1.0] }
radius = { uniform = [0.2, 0.25] }
"""

REST = """
[contact]
model = "nsm2"

# People keep distances, anticipate and step aside. Without this behaviour they walk at full speed until bodies touch.
[behaviours.walking]

# Response (pre-movement) times in seconds.
[behaviours.response_time]
time = { uniform = [0.0, 10.0] }
per = "person"

[simulation]
duration = 1200.0
seed = 1
"""

#: Maximum number of openings in the picture and on the screen; the report lists all.
MOST_OPENINGS = 20
WALLS = "Where the file names no openings, these are pieces of the outer edges, which may be walls."
TITLES = {kind: kind.capitalize() for kind in FINDING_KINDS} | {"found": "Found in the file", "warning": "Warnings"}


def with_basis(text: str, basis: str) -> str:
    """Return the text of a case with the basis of how people walk, and its meaning."""
    table = f"[behaviours.{DEFAULT_MOVEMENT}]\n"
    return text.replace(table, f"{table}preset = {toml_value(basis)}  # {BASES[basis]}\n")


def write_example(folder: Path, basis: str = "measured") -> None:
    """Write an example case to a folder, which must be new or empty."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ScenarioError(f"{folder}: exists and is not empty; choose a new folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with as_file(files("evac.importing") / "example") as example:
            for path in example.iterdir():
                text = with_basis(path.read_text(encoding="utf-8"), basis)
                (folder / path.name).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"{folder}: cannot be written: {error.strerror}; choose another folder") from error


def case_text(
    made: "Imported",
    exits: list[dict[str, Any]],
    building: dict[str, Any],
    lines_of_case: list[dict[str, Any]],
    spacing: float | None = None,
    basis: str = "measured",
) -> str:
    """Return the text of case.toml, with the keys of ``[building]`` and the exits made from openings."""
    names = _one_line(", ".join(file.name for file in made.files))
    lines = [
        f"title = {toml_value(repaired(made.files[0].stem))}",
        "",
        f"# Written by evac import from {names}, with these options:",
    ]
    lines += [f"#   {key} = {toml_value(value)}" for key, value in made.options.items() if value is not None]
    assumed = [finding for finding in made.findings if finding.kind == "assumed"]
    if assumed:
        lines += ["# and with these assumptions:", *(f"#   {_one_line(str(one))}" for one in assumed)]
    lines += ["", "[building]", *toml_lines(building)]
    for exit_ in exits:
        lines += ["", "[[building.exits]]", *toml_lines(exit_)]
    for line in lines_of_case:
        lines += ["", "[[line]]", *toml_lines(line)]
    if not made.building.exits and made.openings:
        lines += ["", "# There is no exit yet. The first opening:"]
        first = made.openings[0].exit()
        lines += ["# [[building.exits]]", *(f"# {line}" for line in toml_lines(first))]
    lines += PEOPLE.rstrip().splitlines()
    for name, room in groups_of(made.building, made.rooms):
        comment = "" if room.number else "# "
        ground = f"  # {room.ground:.1f} m2, {room.number / max(room.ground, 1e-9):.2f} people per square metre"
        group = ["[[people]]", *toml_lines({"name": name, "preset": "person", room.key: room.name})]
        lines += ["", *(f"{comment}{line}" for line in [*group, f"number = {max(room.number, 1)}{ground}"])]
    if spacing is not None:
        lines += ["", "[directions]", *toml_lines({"spacing": spacing})]
    return "\n".join(lines) + "\n" + with_basis(REST, basis)


def _one_line(text: str) -> str:
    return " ".join(text.split())


def report_text(made: "Imported", digests: Mapping[str, str]) -> str:
    """Return the text of report.md, with the digests of files as they were written."""
    building = made.building
    names = ", ".join(f"`{file.name}`" for file in made.files)
    runs = "The case can be run." if not made.fault else f"The case cannot be run yet: {made.fault}."
    if not made.is_accepted:
        runs = "No case has been written, since the building is incomplete; `--partial` imports what there is."
    text = [f"# Import of {names}", "", runs, "", *_listed(made, ["missing"])]
    text += ["![every level](levels.png)", "", "## Levels", ""]
    number = {room.name: room.number for room in made.rooms}
    parts = {level.name: [level] for level in building.levels if level.stair is None}
    parts |= {name: [building.levels[index] for index in own] for name, own in building.stairs.items()}
    rows = [
        (
            *(name, "stair" if own[0].stair else own[0].kind, f"{min(one.z_min for one in own):z.2f}"),
            *(f"{sum(one.polygon.area for one in own):.2f}", f"{math.degrees(max(one.slope for one in own)):.1f}"),
        )
        for name, own in parts.items()
    ]
    text += table(("level", "kind", "z [m]", "area in plan [m2]", "steepest [deg]"), rows)
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
    elements = [(kind, read, number, "; ".join(why)) for kind, read, number, why in account(made.findings)]
    columns = ("kind", "read", "left out", "why")
    text += ["## Elements of the file", "", *table(columns, elements)] if elements else []
    text += _listed(made, [kind for kind in FINDING_KINDS if kind != "missing"])
    text += ["## Options", "", *table(("option", "value"), [(key, repr(one)) for key, one in made.options.items()])]
    return "\n".join([*text, *(f"{name} as written: {digest}" for name, digest in digests.items()), ""])


def _listed(made: "Imported", kinds: Sequence[str]) -> list[str]:
    """Return the sections of some kinds of findings."""
    text = []
    number = {id(one): k for k, group in listed(made.findings) for one in group}
    for kind in kinds:
        own = [finding for finding in made.findings if finding.kind == kind]
        rows = [(number.get(id(one), ""), one.text, one.where) for one in own]
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
