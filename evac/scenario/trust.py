"""Plugin files that a case names: code, so they are run when the case is, and only from inside its folder."""

import copy
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.errors import ScenarioError
from evac.scenario.problems import Key, Problem

if TYPE_CHECKING:
    from evac.scenario.case import Case


def named_files(content: Mapping[str, Any], folder: Path) -> tuple[tuple[Path, ...], list[Problem]]:
    """Return the plugin files that a case names, and those that are not there; none is opened."""
    section = content.get("plugins")
    names = section.get("files") if isinstance(section, dict) else None
    paths: list[Path] = []
    problems: list[Problem] = []
    for index, name in enumerate(names if isinstance(names, list) else []):
        if isinstance(name, str) and (folder / name).is_file():
            paths.append((folder / name).resolve())
        elif isinstance(name, str):
            problems.append(Problem(("plugins", "files", index), f"no such file {folder / name}; check the path"))
    return tuple(dict.fromkeys(paths)), problems


def is_inside(path: Path, folder: Path) -> bool:
    """Return whether a file lies in a folder or below it, links followed."""
    return path.resolve().is_relative_to(folder.resolve())


def run_plugin_files(case: "Case", announce: Callable[[Path], None] | None = None) -> "Case":
    """Return a case whose plugin files have been run, and whose every name has been checked.

    The files that a case names are code of whoever wrote it. They are run here and nowhere else, and only from inside
    the case's folder, so that somebody else's case runs nothing that did not come with it. Those given beside the
    case (``--plugin``, ``plugin_files``) have been run when it was loaded.

    Parameters
    ----------
    case : Case
    announce : callable, optional
        Called with the path of each file before it is run.

    Returns
    -------
    Case
        The same one, if there is nothing to run.

    Raises
    ------
    ScenarioError
        A file lies outside of the folder, and nothing is run; or a name that could not be checked before is unknown.
    PluginError
        A plugin file cannot be loaded.
    """
    if not case.unloaded_files:
        return case
    outside = [path for path in case.unloaded_files if not is_inside(path, case.folder)]
    if outside:
        raise ScenarioError(
            f"{case.source}: plugins.files: {outside[0]} is outside of the case's folder, and is not run; if you trust "
            f"it, name it yourself: --plugin {outside[0]}, from Python plugin_files"
        )
    from evac.scenario.loading import case_from

    for path in case.unloaded_files:
        if announce is not None:
            announce(path)
        case.registry.add_file(path)
    files = (*case.loaded_files, *case.unloaded_files)
    return case_from(case._origin.table, case.source, plugin_files=files, registry=case.registry)


def without_unknown(case: "Case") -> "Case":
    """Return a case without its plugin files and without every name that only they can know.

    Raises
    ------
    ScenarioError
        The contact model is one of these names: without it there is no case.
    """
    from evac.scenario.loading import case_from

    content = copy.deepcopy(dict(case._origin.table))
    content.pop("plugins", None)
    for key in case.unchecked:
        _remove(content, key)
    return case_from(content, case.source, plugin_files=case.loaded_files, registry=case.registry)


def _remove(content: Any, key: Key) -> None:
    for step in key[:-1]:
        content = content[step]
    content.pop(key[-1], None)
