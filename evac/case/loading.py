"""Load case.toml and overrides as a checked `Case`; plugin files that a case names are code, executed only if asked."""

import copy
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from evac.base.errors import PluginError, ScenarioError, escaped, usable_path
from evac.base.keys import Fault, Key, with_own_classes
from evac.base.parameters import PATH, check_types, did_you_mean
from evac.case.case import DICTIONARY, Case, Origin
from evac.case.faults import checked
from evac.case.overrides import apply, content_faults, dotted, read_table
from evac.contract.registry import Registry


def named_files(content: Mapping[str, Any], folder: Path) -> tuple[Path, ...]:
    """Return the plugin files named in a case that exist; none is opened."""
    table = content.get("plugins")
    names = table.get("files") if isinstance(table, dict) else None
    words = [name for name in names if isinstance(name, str)] if isinstance(names, list) else []
    return tuple(dict.fromkeys((folder / name).resolve() for name in words if os.path.isfile(folder / name)))


def is_inside(path: Path, folder: Path) -> bool:
    """Return whether a file lies in a folder or below it, with symbolic links resolved."""
    return path.resolve().is_relative_to(folder.resolve())


def run_plugin_files(case: Case, announce: Callable[[Path], None] | None = None) -> Case:
    """Execute the plugin files of a case, and return the case with all its names checked.

    They are code by the author of the case, and executed only by this function, and only if they are inside the case's
    folder, so that a case cannot execute other files of the computer. Files given in addition to the case
    (``--plugin``, ``plugin_files``) have been executed when it was loaded.
    """
    if not case.unloaded_files:
        return case
    outside = [path for path in case.unloaded_files if not is_inside(path, case.folder)]
    if outside:
        raise ScenarioError(
            f"{case.source}: plugins.files: {outside[0]} is outside of the case's folder and is not executed; if you "
            f"trust it, give it with --plugin {outside[0]}, from Python with plugin_files"
        )
    for path in case.unloaded_files:
        if announce is not None:
            announce(path)
        case.registry.add_file(path)
    files = (*case.loaded_files, *case.unloaded_files)
    return case_from(case._origin.table, case.source, plugin_files=files, registry=case.registry)


MOST_SHOWN, LONGEST_SHOWN = 50, 1_000  #: Greatest number of faults in one error, and of characters of each.


def load_case(
    source: str | Path | Mapping[str, Any],
    overrides: Mapping[str, Any] | Iterable[str] = (),
    plugin_files: Iterable[str | Path] = (),
    registry: Registry | None = None,
) -> Case:
    """Read and check a case. The file is parsed as data; no code that it contains or names is executed.

    Plugin files named in the case are executed when the case is run (`evac.case.loading.run_plugin_files`). Names
    that they may provide are checked then; until then `Case.unchecked` lists them.

    Parameters
    ----------
    source : str, Path or mapping
        A case.toml, a folder that holds one, the name of a shipped case, or the content of a case.toml as a
        dictionary; paths in a dictionary are relative to the current folder. In a dictionary, the building, or its
        key ``plan``, may be an `evac.Plan`.
    overrides : mapping, or iterable of str
        Keys to change: ``{"people.class_1.number": 5}`` or ``["people.class_1.number=5"]``. Items of a list
        are selected by index or by name.
    plugin_files : iterable of path
        Plugin files in addition to those named in the case. They are executed here.
    registry : Registry
        Registry with which the case is checked; created if not given. Plugin files are added to it.

    Raises
    ------
    ScenarioError
        One line for each fault: file, dotted key, what is wrong, how to fix it.
    PluginError
        A plugin file cannot be loaded.

    Examples
    --------
    >>> case = evac.load("classroom", ["simulation.duration=60", "simulation.seed=7"])  # doctest: +SKIP
    """
    check_types(source=(source, PATH | Mapping), registry=(registry, Registry | None))
    registry = registry or Registry()
    files = _added(plugin_files, registry)
    if isinstance(source, Mapping):
        return case_from(source, Path.cwd() / DICTIONARY, overrides, plugin_files=files, registry=registry)
    path = _found(source, registry)
    if any(path.name.lower().endswith(importer.suffixes) for importer in registry.importers.values()):
        raise ScenarioError(
            f"{path}: a building file, not a case; name it in a case.toml as building.mesh, or create a case from it "
            f"with: evac import {source} --out FOLDER"
        )
    return case_from(read_table(path), path, overrides, plugin_files=files, registry=registry)


def as_case(case: Case | str | Path | Mapping[str, Any]) -> Case:
    """Return `case` if it is a `Case`, else load it with `load_case`."""
    check_types(case=(case, Case | PATH | Mapping))
    return case if isinstance(case, Case) else load_case(case)


def case_from(
    table: Mapping[str, Any],
    source: Path,
    overrides: Mapping[str, Any] | Iterable[str] = (),
    plugin_files: Iterable[str | Path] = (),
    registry: Registry | None = None,
    is_recorded: bool = False,
) -> Case:
    """Check the content of a case.toml, as `load_case` does; paths in it are relative to the folder of `source`.

    Files of a recorded case, which is that of a result, need not exist.
    """
    registry = registry or Registry()
    table = _with_plan(dict(table))
    _refuse(content_faults(table), table, source, [])
    content: dict[str, Any] = copy.deepcopy(table)
    overridden, faults = apply(content, overrides)
    _refuse(content_faults(content), content, source, overridden)
    content = with_own_classes(content)
    loaded = _added(plugin_files, registry)
    unloaded = tuple(path for path in named_files(content, source.parent) if path not in loaded)
    case, found = checked(content, None if is_recorded else source.parent, registry)
    unchecked = tuple(fault.key for fault in found if unloaded and fault.is_unknown_name)
    faults += [fault for fault in found if fault.key not in unchecked]
    _refuse(faults, content, source, overridden)
    assert case is not None
    case._origin = Origin(source, content, loaded, unloaded, unchecked, registry, is_recorded)
    return case


def _refuse(faults: list[Fault], content: Mapping[str, Any], source: Path, overridden: list[Key]) -> None:
    """Raise one error with all faults, if there are any."""
    if faults:
        lines = [_line(fault, content, source, overridden) for fault in faults[:MOST_SHOWN]]
        if len(faults) > MOST_SHOWN:
            lines.append(f"{source}: and {len(faults) - MOST_SHOWN:,} more")
        raise ScenarioError("\n".join(lines))


def _with_plan(content: dict[str, Any]) -> dict[str, Any]:
    """Replace an `evac.Plan`, given as the building or as its key ``plan``, by the table that a file would contain."""
    building = content.get("building")
    plan = building.get("plan") if isinstance(building, dict) else building
    if plan is None or isinstance(plan, dict | str):
        return content
    from evac.building.plan.plan import Plan
    from evac.building.plan.plantable import table_of

    if isinstance(plan, Plan):
        content["building"] = {**(building if isinstance(building, dict) else {}), "plan": table_of(plan)}
    return content


def _found(source: str | Path, registry: Registry) -> Path:
    """Return the path of the case.toml that `source` names."""
    path = usable_path(source, ScenarioError)
    if path.is_dir():
        if not (path / "case.toml").is_file():
            raise ScenarioError(f"{path}: the folder contains no case.toml; give a folder that does")
        return (path / "case.toml").resolve()
    if path.is_file():
        return path.resolve()
    if str(source) in registry.cases:
        return (registry.cases[str(source)] / "case.toml").resolve()
    raise ScenarioError(
        f"{source}: no such file, folder or shipped case; {did_you_mean(str(source), list(registry.cases))}"
    )


def _added(files: Iterable[str | Path], registry: Registry) -> tuple[Path, ...]:
    """Register plugin files and return their paths, resolved."""
    check_types(plugin_files=(files, Iterable))
    paths = tuple(usable_path(file, PluginError).resolve() for file in files)
    for path in paths:
        registry.add_file(path)
    return paths


def _line(fault: Fault, content: Mapping[str, Any], source: Path, overridden: list[Key]) -> str:
    """Return one line of the error: file, dotted key, fault, and whether the key was set by an override."""
    by_override = any(all(a == b for a, b in zip(fault.key, key, strict=False)) for key in overridden)
    note = " (set by an override)" if by_override else ""
    text = fault.text
    if len(text) > LONGEST_SHOWN:  # it contains a long value
        text = f"{text[: LONGEST_SHOWN // 2]} ... {text[-LONGEST_SHOWN // 2 :]}"
    return escaped(f"{source}: {dotted(fault.key, content)}: {text}{note}")
