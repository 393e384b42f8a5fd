"""New cases to edit: an empty storey, the example, or the building of a file."""

import tempfile
import tomllib
from itertools import chain, count
from pathlib import Path

from evac.base.errors import EvacError, ScenarioError
from evac.editor.patching import patched
from evac.importing import import_building
from evac.importing.documents import write_example
from evac.importing.importing import PLAN

EMPTY = """# Drawn with evac edit. Lengths are in metres.

[[storeys]]
name = "ground"
z = 0.0
wall = 0.1
"""


def begin(folder: Path, what: str, name: str = "", content: bytes = b"") -> tuple[Path, list[str]]:
    """Write a case to a new folder, with a number if its name is taken; return the folder, and what is to be told.

    `what`: empty, example, or file, whose `name` and `content` are given.

    Raises
    ------
    EvacError
        The file is not read, or its building is no plan.
    """
    names = chain([folder], (folder.with_name(f"{folder.name}-{number}") for number in count(2)))
    folder = next(path for path in names if not path.exists())
    if what != "file":
        write_example(folder)
        if what == "empty":
            _clear(folder / "case.toml", folder / "house.plan.toml")
        return folder, []
    with tempfile.TemporaryDirectory() as place:
        source = Path(place) / Path(name).name
        source.write_bytes(content)
        try:
            made = import_building([source], folder, partial=True)
        except EvacError as error:  # names the copy
            raise ScenarioError(str(error).replace(str(source), source.name)) from error
    if not (folder / PLAN).exists():
        text = "its floors are not level, so that it cannot be drawn on; it can be run"
        raise ScenarioError(f"{source.name}: {text}: `evac run {folder}`")
    told = [f"incomplete: {missing}" for missing in made.missing]
    return folder, told + [str(one) for one in made.findings if one.kind in ("warning", "left out")]


def _clear(case_file: Path, plan_file: Path) -> None:
    """Take away what the example has of a building."""
    text = case_file.read_text(encoding="utf-8")
    case = tomllib.loads(text)
    case |= {"title": "New building", "people": case["people"][:1], "building": {"mesh": "building.plan.toml"}}
    case_file.write_text(patched(text, case), encoding="utf-8")
    plan_file.unlink()
    plan_file.with_name("building.plan.toml").write_text(EMPTY, encoding="utf-8")
