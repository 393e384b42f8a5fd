"""New cases to edit: an empty storey, the example, the building of a file, or a copy under another name."""

import shutil
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain, count
from os.path import isfile
from pathlib import Path
from typing import Any

from evac.base.errors import EvacError, ScenarioError
from evac.case.loading import is_inside
from evac.editor.patching import patched
from evac.folder.files import writing
from evac.importing import import_building
from evac.importing.documents import write_example
from evac.importing.importing import PLAN

EMPTY = """# Drawn with evac edit. Lengths are in metres.

[[storeys]]
name = "ground"
z = 0.0
wall = 0.1
"""


def new_folder(name: str) -> Path:
    """Return a folder in the current one by its name, which may be a path; ScenarioError if it leads out of that."""
    folder = Path(name)
    if not folder.parts or ".." in folder.parts or not is_inside(folder, Path()):
        raise ScenarioError(f"{name}: give the name of a new folder in {Path.cwd()}")
    return folder


def write_copy(folder: Path, home: Path, texts: Mapping[Path, str], others: Iterable[Path]) -> None:
    """Write files with their new texts, and copies of others, to a new folder; all must be in `home`."""
    files = [*dict.fromkeys([*texts, *others])]
    if outside := [file for file in files if not is_inside(file, home)]:
        raise ScenarioError(
            f"{outside[0]}: is outside of {home}, of which this is a copy; put it there, or copy by hand"
        )
    with writing("the copy", folder):
        folder.mkdir(parents=True)
        for file in files:
            copy = folder / file.resolve().relative_to(home.resolve())
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)
            if file in texts:
                copy.write_bytes(texts[file].encode())


def files_named(value: Any, folder: Path) -> Iterator[Path]:
    """Yield the files that a case or a plan in a folder names by paths relative to it."""
    if isinstance(value, Mapping | list):
        for part in value.values() if isinstance(value, Mapping) else value:
            yield from files_named(part, folder)
    elif isinstance(value, str) and not Path(value).is_absolute() and isfile(folder / value):
        yield folder / value


def begin(folder: Path, what: str, name: str = "", content: bytes = b"") -> tuple[Path, list[str]]:
    """Write a case to a new folder, with a number if its name is taken; return the folder, and what is to be told.

    `what`: empty, example, or file, whose `name` and `content` are given; it must be a plan.
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
