"""evac new: write an example case with comments, a building of two storeys that can be run and changed."""

import argparse
import shutil
from importlib.resources import as_file, files
from pathlib import Path

from evac.base.errors import ScenarioError


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folder", metavar="FOLDER", type=Path, help="new folder for case.toml and its plan")


def execute(arguments: argparse.Namespace) -> int:
    """Copy the files of the example; raise an error if the folder exists and is not empty."""
    folder: Path = arguments.folder
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ScenarioError(f"{folder}: exists and is not empty; choose a new folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with as_file(files("evac.cli") / "example") as example:
            for path in example.iterdir():
                shutil.copyfile(path, folder / path.name)
    except OSError as error:
        raise ScenarioError(f"{folder}: cannot be written: {error.strerror}; choose another folder") from error
    print(f"{folder / 'case.toml'} and house.plan.toml written; next: evac run {folder}")
    return 0
