"""Plugin files named in a case: they are code, executed only when the case is run and only from inside its folder."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.base.errors import ScenarioError

if TYPE_CHECKING:
    from evac.case.case import Case


def named_files(content: Mapping[str, Any], folder: Path) -> tuple[Path, ...]:
    """Return the plugin files named in a case that exist; none is opened."""
    table = content.get("plugins")
    names = table.get("files") if isinstance(table, dict) else None
    words = [name for name in names if isinstance(name, str)] if isinstance(names, list) else []
    return tuple(dict.fromkeys((folder / name).resolve() for name in words if os.path.isfile(folder / name)))


def is_inside(path: Path, folder: Path) -> bool:
    """Return whether a file lies in a folder or below it, with symbolic links resolved."""
    return path.resolve().is_relative_to(folder.resolve())


def run_plugin_files(case: "Case", announce: Callable[[Path], None] | None = None) -> "Case":
    """Execute the plugin files of a case, and return the case with all its names checked.

    Plugin files named in a case are code by the author of the case. They are executed only by this function, and only
    if they are inside the case's folder, so that a case cannot execute other files of the computer. Files given in
    addition to the case (``--plugin``, ``plugin_files``) have been executed when it was loaded.
    """
    if not case.unloaded_files:
        return case
    outside = [path for path in case.unloaded_files if not is_inside(path, case.folder)]
    if outside:
        raise ScenarioError(
            f"{case.source}: plugins.files: {outside[0]} is outside of the case's folder and is not executed; if you "
            f"trust it, give it with --plugin {outside[0]}, from Python with plugin_files"
        )
    from evac.case.loading import case_from

    for path in case.unloaded_files:
        if announce is not None:
            announce(path)
        case.registry.add_file(path)
    files = (*case.loaded_files, *case.unloaded_files)
    return case_from(case._origin.table, case.source, plugin_files=files, registry=case.registry)
