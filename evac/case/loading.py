"""Load case.toml and overrides as a checked `Case`; all faults are reported together."""

import copy
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from evac.base.errors import PluginError, ScenarioError, escaped, usable_path
from evac.base.keys import Fault, Key, faults_of, is_multiple, with_own_classes
from evac.base.parameters import Configurable, did_you_mean
from evac.case.case import DICTIONARY, Case, Origin
from evac.case.content import content_faults, read_table
from evac.case.events import event_faults
from evac.case.fire import ConditionSettings, SmokeSettings
from evac.case.overrides import apply, dotted
from evac.case.places import place_faults
from evac.case.presets import with_presets
from evac.case.schema import MOST_STATES
from evac.case.trust import named_files
from evac.contract.registry import Registry

#: Greatest number of faults in one error, and of characters of each.
MOST_SHOWN, LONGEST_SHOWN = 50, 1_000


def load_case(
    source: str | Path | Mapping[str, Any],
    overrides: Mapping[str, Any] | Iterable[str] = (),
    plugin_files: Iterable[str | Path] = (),
    registry: Registry | None = None,
) -> Case:
    """Read and check a case. The file is parsed as data; no code that it contains or names is executed.

    Plugin files named in the case are executed when the case is run (`evac.case.trust.run_plugin_files`). Names
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
    return case if isinstance(case, Case) else load_case(case)


def case_from(
    table: Mapping[str, Any],
    source: Path,
    overrides: Mapping[str, Any] | Iterable[str] = (),
    plugin_files: Iterable[str | Path] = (),
    registry: Registry | None = None,
) -> Case:
    """Check the content of a case.toml; paths in it are relative to the folder of `source`.

    Raises the errors of `load_case`.
    """
    registry = registry or Registry()
    table = _with_plan(dict(table))
    _refuse(content_faults(table), table, source, [])
    content: dict[str, Any] = copy.deepcopy(table)
    overridden, faults = apply(content, overrides)
    _refuse(content_faults(content), content, source, overridden)
    content = with_own_classes(content)
    loaded = _added(plugin_files, registry)
    named, missing = named_files(content, source.parent)
    unloaded = tuple(path for path in named if path not in loaded)
    faults += missing
    filled, unknown = with_presets(content)
    faults += unknown
    case: Case | None = None
    try:
        case = Case.model_validate(filled)
    except ValidationError as error:
        faults += _without_repeats(faults_of(error, Case), content)
    of_plugins = _plugin_faults(content, registry)
    said = {fault.key for fault in of_plugins}
    unchecked = tuple(fault.key for fault in of_plugins if unloaded and fault.is_unknown_name)
    faults = [fault for fault in faults if fault.key not in said]
    faults += [fault for fault in of_plugins if fault.key not in unchecked]
    faults += _scene_faults(content, case, source.parent, registry)
    _refuse(faults, content, source, overridden)
    assert case is not None
    case._origin = Origin(source, content, loaded, unloaded, unchecked, registry)
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


def _without_repeats(faults: list[Fault], content: dict[str, Any]) -> list[Fault]:
    """Remove faults of groups that repeat a fault of their preset."""
    of_presets = {fault.key[1:3] for fault in faults if fault.key[0] == "presets"}

    def is_repeat(key: Key) -> bool:
        if key[0] != "people" or len(key) < 3:
            return False
        group = content["people"][key[1]]
        return key[2] not in group and (group.get("preset"), key[2]) in of_presets

    return [fault for fault in faults if not is_repeat(fault.key)]


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
    paths = tuple(usable_path(file, PluginError).resolve() for file in files)
    for path in paths:
        registry.add_file(path)
    return paths


def _plugin_faults(content: dict[str, Any], registry: Registry) -> list[Fault]:
    """Check the tables of plugins against the parameters that their classes declare."""
    faults: list[Fault] = []
    contact = content.get("contact")
    if contact is None or (isinstance(contact, dict) and "model" not in contact):
        key: Key = ("contact",) if contact is None else ("contact", "model")
        names = ", ".join(sorted(registry.contact_models))
        how = "add the table [contact] with" if contact is None else "write"
        faults.append(Fault(key, f'missing; {how} model = "NAME", where NAME is one of {names}'))
    if isinstance(contact, dict):
        model = contact.get("model")
        if isinstance(model, str) and model not in registry.contact_models:
            hint = _known_or_plugin(model, registry.contact_models)
            faults.append(Fault(("contact", "model"), f"unknown contact model {model!r}; {hint}", True))
        tables = {name: table for name, table in contact.items() if name != "model"}
        faults += _table_faults(("contact",), tables, registry.contact_models, "contact model", ("model",))
        faults += _solver_faults(tables, registry)
    faults += _fire_faults(content, registry)
    for kind, classes, word in (
        ("forces", registry.forces, "force"),
        ("behaviours", registry.behaviours, "behaviour"),
        ("recorders", registry.recorders, "recorder"),
        ("importers", registry.importers, "importer"),
    ):
        if isinstance(content.get(kind), dict):
            faults += _table_faults((kind,), content[kind], classes, word)
    for key, table in _tables_of_people(content):
        if isinstance(table.get("behaviours"), dict):
            faults += _group_faults((*key, "behaviours"), table["behaviours"], content, registry)
    return faults


def _known_or_plugin(name: str, known: Iterable[str]) -> str:
    """Return a hint for an unknown name that a plugin could provide."""
    hint = did_you_mean(name, list(known))
    is_close = hint.endswith("?")
    return hint if is_close else f"{hint}; or name the file of its plugin with --plugin FILE or [plugins] files"


def _tables_of_people(content: dict[str, Any]) -> list[tuple[Key, dict[str, Any]]]:
    """Return the tables of groups and presets, each with its key."""
    groups, presets = content.get("people"), content.get("presets")
    tables: list[tuple[Key, Any]] = []
    if isinstance(groups, list):
        tables += [(("people", index), group) for index, group in enumerate(groups)]
    if isinstance(presets, dict):
        tables += [(("presets", name), preset) for name, preset in presets.items()]
    return [(key, table) for key, table in tables if isinstance(table, dict)]


def _solver_faults(tables: dict[str, Any], registry: Registry) -> list[Fault]:
    """Check that the solvers named in tables of contact models are registered."""
    from evac.physics.contact.model import SolvedContactModel

    faults: list[Fault] = []
    for name, table in tables.items():
        cls = registry.contact_models.get(name)
        if cls is not None and issubclass(cls, SolvedContactModel) and isinstance(table, dict):
            solver = table.get("solver")
            if isinstance(solver, str) and solver not in registry.solvers:
                hint = _known_or_plugin(solver, registry.solvers)
                faults.append(Fault(("contact", name, "solver"), f"unknown solver {solver!r}; {hint}", True))
    return faults


def _fire_faults(content: dict[str, Any], registry: Registry) -> list[Fault]:
    """Check the sources of conditions and the law of speed in smoke that a case names, and their parameters."""
    faults: list[Fault] = []
    tables, sources = content.get("conditions"), registry.condition_sources
    for index, table in enumerate(tables if isinstance(tables, list) else []):
        name = table.get("source") if isinstance(table, dict) else None
        if isinstance(name, str) and name not in sources:
            text = f"unknown source {name!r}; {_known_or_plugin(name, sources)}"
            faults.append(Fault(("conditions", index, "source"), text, True))
        elif isinstance(name, str):
            cls, own = sources[name], ("source", "start", "hold")
            allowed = [*own, *cls.keys, *cls.declared()]
            for key in (key for key in table if key not in (*own, *cls.keys)):
                value, field = table[key], ConditionSettings.model_fields.get(key)
                if (tuple(value) if isinstance(value, list) else value) != (field.default if field else None):
                    faults += _parameter_faults(("conditions", index, key), value, cls, allowed)
    smoke = content.get("smoke")
    if isinstance(smoke, dict):
        law, keys = smoke.get("law"), SmokeSettings.model_fields
        used = bool(content.get("conditions")) or law != keys["law"].default
        if used and isinstance(law, str) and law not in registry.smoke_laws:
            text = f"unknown law {law!r}; {_known_or_plugin(law, registry.smoke_laws)}"
            faults.append(Fault(("smoke", "law"), text, True))
        tables = {name: table for name, table in smoke.items() if name not in keys}
        faults += _table_faults(("smoke",), tables, registry.smoke_laws, "law", tuple(keys))
    return faults


def _table_faults(
    key: Key, tables: dict[str, Any], classes: Mapping[str, type[Configurable]], word: str, beside: tuple[str, ...] = ()
) -> list[Fault]:
    """Check tables named by plugins; `beside` are the other keys of the table."""
    faults: list[Fault] = []
    for name, table in tables.items():
        if name not in classes:
            what = word if isinstance(table, dict) or not beside else "key"
            names = [*classes, *beside]
            hint = _known_or_plugin(name, names) if what == word else did_you_mean(name, names)
            faults.append(Fault((*key, name), f"unknown {what}; {hint}", is_unknown_name=what == word))
        elif isinstance(table, dict):
            declared = classes[name].declared()
            for parameter, value in table.items():
                faults += _parameter_faults((*key, name, parameter), value, classes[name], list(declared))
    return faults


def _parameter_faults(key: Key, value: Any, cls: type[Configurable], allowed: list[str]) -> list[Fault]:
    """Check one parameter of a plugin, or one setting of a group for it."""
    parameter = str(key[-1])
    if parameter not in allowed:
        return [Fault(key, f"{cls.name!r} has no such parameter; {did_you_mean(parameter, allowed)}")]
    declared = cls.declared()
    if parameter in declared:
        try:
            declared[parameter].check("", value)
        except PluginError as error:
            return [Fault(key, str(error).removeprefix(": "))]
    return []


def _group_faults(key: Key, settings: dict[str, Any], content: dict[str, Any], registry: Registry) -> list[Fault]:
    """Check the settings of a group for behaviours: each must be registered and in the case, and accept these keys."""
    faults: list[Fault] = []
    in_use = content.get("behaviours", {})
    for name, table in settings.items():
        if name not in registry.behaviours:
            hint = _known_or_plugin(name, registry.behaviours)
            faults.append(Fault((*key, name), f"unknown behaviour; {hint}", True))
        elif isinstance(in_use, dict) and name not in in_use:
            faults.append(Fault((*key, name), f"the behaviour is not in use; add [behaviours.{name}]"))
        elif isinstance(table, dict):
            cls = registry.behaviours[name]
            for parameter, value in table.items():
                faults += _parameter_faults((*key, name, parameter), value, cls, list(cls.group_keys))
    return faults


def _scene_faults(content: dict[str, Any], case: Case | None, folder: Path, registry: Registry) -> list[Fault]:
    """Check conditions that involve more than one table."""
    faults: list[Fault] = []
    groups = content.get("people")
    names = [group.get("name") for group in groups if isinstance(group, dict)] if isinstance(groups, list) else []
    seen: set[str] = set()
    for index, name in enumerate(names):
        if isinstance(name, str) and name in seen:
            faults.append(Fault(("people", index, "name"), f"{name!r} names two groups; rename one"))
        seen |= {name} if isinstance(name, str) else set()
    if case is not None:
        used = [name for name, table in case.behaviours.items() if table is not False]
        known = registry.behaviours
        faults += event_faults(case, any(name not in known or known[name].hears_alarms for name in used))
        faults += place_faults(case, names, any(name not in known or known[name].follows_signs for name in used))
    building = content.get("building")
    mesh = building.get("mesh") if isinstance(building, dict) else None
    if isinstance(mesh, str) and mesh and not os.path.exists(folder / mesh):
        faults.append(Fault(("building", "mesh"), f"no such file {folder / mesh}; check the path"))
    if case is not None and not is_multiple(case.output.every, case.simulation.tick):
        every, tick = case.output.every, case.simulation.tick
        below = max(1, int(every / tick))
        faults.append(
            Fault(
                ("output", "every"),
                f"{every:g} s is not a multiple of simulation.tick {tick:g} s; "
                f"use {below * tick:.6g} or {(below + 1) * tick:.6g}",
            )
        )
    if case is not None and case.simulation.duration > MOST_STATES * case.output.every:
        faults.append(
            Fault(
                ("output", "every"),
                f"{case.output.every:g} s gives {case.simulation.duration / case.output.every:.2g} states in a run of "
                f"{case.simulation.duration:g} s, more than {MOST_STATES:,}; record less often, or shorten the run",
            )
        )
    return faults


def _line(fault: Fault, content: Mapping[str, Any], source: Path, overridden: list[Key]) -> str:
    """Return one line of the error: file, dotted key, fault, and whether the key was set by an override."""
    by_override = any(all(a == b for a, b in zip(fault.key, key, strict=False)) for key in overridden)
    note = " (set by an override)" if by_override else ""
    text = fault.text
    if len(text) > LONGEST_SHOWN:  # it contains a long value
        text = f"{text[: LONGEST_SHOWN // 2]} ... {text[-LONGEST_SHOWN // 2 :]}"
    return escaped(f"{source}: {dotted(fault.key, content)}: {text}{note}")
