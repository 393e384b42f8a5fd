"""The case.toml that an import writes, and the folder that it is written to."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.base.errors import EvacError, ScenarioError, usable_path
from evac.building.model.names import repaired
from evac.case.toml import toml_lines, toml_value
from evac.folder.digests import digest_of_file

if TYPE_CHECKING:
    from evac.importing.importing import Imported

#: Line of report.md that shows whether the case has been changed since the import.
DIGEST = re.compile(r"case\.toml as written: ([0-9a-f]{16}|none)")

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


def case_text(
    made: "Imported", exits: list[dict[str, Any]], building: dict[str, Any], spacing: float | None = None
) -> str:
    """Return the text of case.toml.

    Parameters
    ----------
    made : Imported
    exits : list of dict
        Exits made from openings.
    building : dict
        Keys of ``[building]``.
    spacing : float, optional
        Spacing of the grids of directions [m].
    """
    names = _one_line(", ".join(file.name for file in made.files))
    lines = [
        f"title = {toml_value(repaired(made.files[0].stem))}",
        "",
        f"# Written by evac import from {names}, with these options:",
    ]
    lines += [f"#   {key} = {toml_value(value)}" for key, value in made.options.items() if value is not None]
    assumed = [one for one in made.findings if one.kind == "assumed"]
    if assumed:
        lines += ["# and with these assumptions:", *(f"#   {_one_line(str(one))}" for one in assumed)]
    lines += ["", "[building]", *toml_lines(building)]
    for exit_ in exits:
        lines += ["", "[[building.exits]]", *toml_lines(exit_)]
    if not made.building.exits and made.openings:
        lines += ["", "# There is no exit yet. The widest opening:"]
        first = made.openings[0].exit()
        lines += ["# [[building.exits]]", *(f"# {line}" for line in toml_lines(first))]
    lines += PEOPLE.rstrip().splitlines()
    for room in made.rooms:
        comment = "" if room.number else "# "
        ground = f"  # {room.ground:.1f} m2, {room.number / max(room.ground, 1e-9):.2f} people per square metre"
        group = ["[[people]]", *toml_lines({"name": room.name, "preset": "person", room.key: room.name})]
        lines += ["", *(f"{comment}{line}" for line in [*group, f"number = {max(room.number, 1)}{ground}"])]
    if spacing is not None:
        lines += ["", "[directions]", *toml_lines({"spacing": spacing})]
    return "\n".join(lines) + "\n" + REST


def check_folder(folder: Path, case: str, report: str) -> str:
    """Check that a folder is missing, empty, or that of an import."""
    usable_path(folder, ScenarioError)
    if folder.exists() and not folder.is_dir():
        raise ScenarioError(f"{folder}: not a folder; choose another one for the case (--out)")
    if not folder.exists() or not any(folder.iterdir()):
        return ""
    try:
        written = DIGEST.search((folder / report).read_text(encoding="utf-8"))
        current = digest_of_file(folder / case)[:16] if (folder / case).exists() else "none"
    except (OSError, EvacError):
        written, current = None, ""
    if written is None:
        raise ScenarioError(f"{folder}: contains files other than an import; choose a new or empty folder (--out)")
    return "" if current in (written[1], "none") else written[1]


def _one_line(text: str) -> str:
    return " ".join(text.split())
