"""A zip with all from which somebody else repeats a run: case, files that it names, summary, report and versions."""

import zipfile
from pathlib import Path
from typing import Any

from evac.base.errors import ResultError
from evac.case.toml import case_text
from evac.folder.files import REPORT_NAME, SUMMARY_NAME, replacing
from evac.results.results import Results

#: Default file of `evac report --bundle`.
BUNDLE_NAME = "bundle.zip"

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
    """Write a zip from which a run can be repeated; the files that its case names must be where they were.

    Parameters
    ----------
    run : Results
    report : str
        The page.
    path : Path

    Raises
    ------
    ResultError
        A file that the case names is missing, two have the same name, or the zip cannot be written.
    """
    record = run.record
    settings, named = _flat(run.settings, Path(record.source).parent, record.plugin_files)
    words = {"title": record.title, "seed": record.seed, "evac": record.versions.get("evac", "")}
    packages = {name: version for name, version in record.versions.items() if name != "python"}
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
        for name, file in {SUMMARY_NAME: run.folder / SUMMARY_NAME, **named}.items():
            archive.write(file, name)


def _flat(settings: Any, folder: Path, plugins: Any) -> tuple[dict[str, Any], dict[str, Path]]:
    """Return a case with all files in its own folder, and these files by their new names."""
    named = dict[str, Path]()

    def taken(name: str) -> str:
        path = (folder / name).resolve()
        if not path.is_file():
            raise ResultError(f"{path}: the case of the run names this file, but it is missing; put it back")
        if named.setdefault(path.name, path) != path:
            raise ResultError(f"{path}: another file of the case has this name too; rename one and run the case again")
        return path.name

    changed = dict(settings)
    if "mesh" in settings["building"]:
        changed["building"] = {**settings["building"], "mesh": taken(settings["building"]["mesh"])}
    if settings.get("conditions"):
        changed["conditions"] = [
            {**one, "file": taken(one["file"])} if "file" in one else one for one in settings["conditions"]
        ]
    files = [taken(name) for name in dict.fromkeys([*settings["plugins"]["files"], *plugins])]
    changed["plugins"] = {**settings["plugins"], "files": list(dict.fromkeys(files))}
    return changed, named
