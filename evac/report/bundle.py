"""A zip with all from which somebody else repeats a run: case, files that it read, summary, report and versions."""

import posixpath
import tomllib
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from evac.base.errors import ResultError
from evac.base.toml import case_text
from evac.folder.files import REPORT_NAME, SUMMARY_NAME, replacing
from evac.results.results import Results

#: Default file of `evac report --bundle`.
BUNDLE_NAME = "bundle.zip"

#: Keys of a case that name a file.
FILE_KEYS = ("mesh", "file")

#: Ending of the files that name other ones, relative to themselves.
PLAN = ".plan.toml"

README = """\
The run {title!r}, with seed {seed}, made by evac {evac}.

Versions (requirements.txt): install them with

    python -m pip install -r requirements.txt

Repeat the run in this folder with

    evac run case.toml --out repeated

people.csv and egress.csv in the folder "repeated" are then those of the run to the last bit, with these
versions and on the same kind of processor. summary.json and report.html are those of the run.
"""


def write_bundle(run: Results, report: str, path: Path) -> None:
    """Write a zip from which a run can be repeated; the files that it has read must be where they were."""
    folder = Path(run.source).parent.resolve()
    named = _names(folder, [Path(file) for file in run.files])
    settings = _renamed(run.settings, folder, named)
    plugins = [*settings["plugins"]["files"], *(name for path, name in named.items() if path.suffix == ".py")]
    settings["plugins"]["files"] = list(dict.fromkeys(plugins))
    words = {"title": run.title, "seed": run.seed, "evac": run.versions.get("evac", "")}
    packages = {name: version for name, version in run.versions.items() if name != "python"}
    texts = {
        "README.txt": README.format(**words),
        "requirements.txt": "".join(f"{name}=={version}\n" for name, version in packages.items()),
        "case.toml": case_text(settings),
        REPORT_NAME: report,
    }
    assert run.folder is not None
    with replacing(path, "the bundle") as new, zipfile.ZipFile(new, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in texts.items():
            archive.writestr(name, text)
        for file, name in {run.folder / SUMMARY_NAME: SUMMARY_NAME, **named}.items():
            if file.name.endswith(PLAN):
                archive.writestr(name, _plan(file, named))
            else:
                archive.write(file, name)


def _names(folder: Path, files: Iterable[Path]) -> dict[Path, str]:
    """Return the names in the zip of the files that a run has read.

    Those in the folder of the case keep their places; each other folder gets a number, below which files keep theirs.
    """
    named, roots = dict[Path, str](), {folder: ""}
    for path in sorted(files, key=lambda path: (len(path.parts), path)):
        if not path.is_file():
            raise ResultError(f"{path}: the run has read this file, but it is missing; put it back")
        root = next((root for root in roots if path.is_relative_to(root)), path.parent)
        below = roots.setdefault(root, f"files/{len(roots)}/")
        named[path] = below + path.relative_to(root).as_posix()
    return named


def _plan(file: Path, named: Mapping[Path, str]) -> str:
    """Return the text of a plan file, with the places that the files of its storeys have in the zip."""
    text, place = file.read_text(encoding="utf-8-sig"), PurePosixPath(named[file]).parent
    table, beside = tomllib.loads(text), {path: posixpath.relpath(name, place) for path, name in named.items()}
    renamed = _renamed(table, file.parent, beside)
    return text if renamed == table else case_text(renamed)


def _renamed(value: Any, folder: Path, named: Mapping[Path, str]) -> Any:
    """Return a value of a case or a plan with the names that files have in the zip."""
    if isinstance(value, Mapping):
        return {
            key: named.get((folder / item).resolve(), item)
            if key in FILE_KEYS and isinstance(item, str)
            else [named.get((folder / one).resolve(), one) for one in item]
            if key == "files"
            else _renamed(item, folder, named)
            for key, item in value.items()
        }
    return [_renamed(item, folder, named) for item in value] if isinstance(value, list) else value
