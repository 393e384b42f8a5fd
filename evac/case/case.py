"""A checked case: plain data, from a file, a dictionary or a sweep."""

import copy
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from pydantic import PrivateAttr, field_validator, model_validator

from evac.base.keys import Key, Parameters, Table, Title, key, wrong
from evac.base.toml import case_text
from evac.building.options import MOST_ITEMS
from evac.case import schema
from evac.contract.registry import Registry

DICTIONARY = "<dictionary>"  #: File name used for a case that was made from a dictionary.


@dataclass(frozen=True)
class Origin:
    """The origin of a case: its file, its content after overrides, plugin files, and the registry used to check it."""

    source: Path
    table: Mapping[str, Any]
    loaded_files: tuple[Path, ...]
    unloaded_files: tuple[Path, ...]
    unchecked: tuple[Key, ...]
    registry: Registry
    is_recorded: bool  # whether it is that of a result, whose files may be elsewhere now


class Case(Table):
    """A checked case, which is plain data; `evac.simulation.assembly` reads its building and creates its plugins.

    Returned by `evac.case.load_case`; frozen. `change` returns a changed copy.
    """

    title: Title = key("description of the case, in one line", "", "")
    building: schema.BuildingSettings = key("the building: a table [building] with mesh or plan")
    directions: schema.DirectionSettings = key("travel times and directions", "", schema.DirectionSettings())
    people: tuple[schema.GroupSettings, ...] = key(
        "the groups: a table [[people]] for each", "", min_length=1, max_length=MOST_ITEMS
    )
    place: tuple[schema.PlaceSettings, ...] = key(
        "areas with a task, such as refuges: a table [[place]] for each", "", (), max_length=MOST_ITEMS
    )
    line: tuple[schema.LineSettings, ...] = key(
        "lines through which people are counted: a table [[line]] for each", "", (), max_length=MOST_ITEMS
    )
    event: tuple[schema.EventSettings, ...] = key(
        "what changes during the run: a table [[event]] for each", "", (), max_length=MOST_ITEMS
    )
    phase: tuple[schema.PhaseSettings, ...] = key(
        "parts of the building with alarms of their own: a table [[phase]] for each", "", (), max_length=MOST_ITEMS
    )
    conditions: tuple[schema.ConditionSettings, ...] = key(
        "smoke, gases and heat: a table [[conditions]] for each source", "", (), max_length=MOST_ITEMS
    )
    smoke: schema.SmokeSettings = key("what people do in smoke", "", schema.SmokeSettings())
    dose: schema.DoseSettings | None = key("the dose that people take: a table [dose]", "", None)
    safety: schema.SafetySettings | None = key("when the building must have been left: a table [safety]", "", None)
    compartment: tuple[schema.CompartmentSettings, ...] = key(
        "parts of the building with their criteria: a table [[compartment]] for each", "", (), max_length=MOST_ITEMS
    )
    presets: dict[str, schema.PeopleSettings] = key("presets for groups of people, by name", "", {})
    contact: schema.ContactSettings = key("contact between bodies")
    forces: dict[str, Parameters] = key(
        "`[forces.NAME]`: parameters of a force on or between people, which enable it; `false` disables it", "", {}
    )
    behaviours: dict[str, Parameters] = key(
        "`[behaviours.NAME]`: parameters of a behaviour, which enable it; `false` disables it", "", {}
    )
    recorders: dict[str, Parameters] = key(
        "`[recorders.NAME]`: parameters of a recorder; `false` disables it; all others are enabled", "", {}
    )
    dispatchers: dict[str, Parameters] = key(
        "`[dispatchers.NAME]`: parameters of the dispatcher of lifts, which enable it; `false` disables it", "", {}
    )
    importers: dict[str, Parameters] = key(
        "`[importers.NAME]`: parameters of an importer of buildings; `false` disables it; all others are enabled",
        "",
        {},
    )
    simulation: schema.SimulationSettings = key("time, seed and scheme", "", schema.SimulationSettings())
    output: schema.OutputSettings = key("what is written", "", schema.OutputSettings())
    report: schema.ReportSettings = key("what a report contains", "", schema.ReportSettings())
    plugins: schema.PluginSettings = key("plugin files", "", schema.PluginSettings())

    _origin: Origin = PrivateAttr()

    @field_validator("people", mode="after")
    @classmethod
    def _sorted_by_name(cls, people: tuple[schema.GroupSettings, ...]) -> tuple[schema.GroupSettings, ...]:
        """Sort the groups by name, so that rows, routes and draws do not depend on the order of the tables."""
        return tuple(sorted(people, key=lambda group: group.name))

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        people = sum(group.count for group in self.people)
        if people > schema.MOST_PEOPLE:
            raise wrong("people", f"{people:,} people in all groups; use at most {schema.MOST_PEOPLE:,}")
        if self.dose is not None and not self.conditions:
            raise wrong("dose", "the case has no gases or heat; add a table [[conditions]], or remove [dose]")
        if self.compartment and self.safety is None:
            raise wrong("safety", "missing; [[compartment]] needs a table [safety], for example with factor = 1.5")
        return self

    @property
    def events(self) -> tuple[schema.EventSettings, ...]:
        """The events, and the alarms of the phases."""
        return (*self.event, *(alarm for phase in self.phase for alarm in phase.alarms))

    @property
    def source(self) -> Path:
        """The case.toml it was read from; of a dictionary `DICTIONARY` in the folder that its paths are relative to."""
        return self._origin.source

    @property
    def folder(self) -> Path:
        """The folder that paths in the case are relative to."""
        return self._origin.source.parent

    @property
    def name(self) -> str:
        """Name of its folder, or of its file if this is not called case.toml; results are named after it."""
        return self.folder.name if self.source.name == "case.toml" else self.source.stem

    def __repr__(self) -> str:
        return f"<Case {self.title or self.source.name!r}: {len(self.people)} groups, {self.contact.model}>"

    __str__ = __repr__

    @property
    def table(self) -> Mapping[str, Any]:
        """The content of case.toml, with overrides applied."""
        return self._origin.table

    @property
    def mesh(self) -> Path | None:
        """The building's file; None if the case holds its plan."""
        return self.folder / self.building.mesh if self.building.mesh is not None else None

    @property
    def plugin_files(self) -> tuple[Path, ...]:
        """Resolved paths of the plugin files: those given in addition to the case, and those named in it."""
        return (*self.loaded_files, *self.unloaded_files)

    @property
    def loaded_files(self) -> tuple[Path, ...]:
        """The plugin files that have been executed."""
        return self._origin.loaded_files

    @property
    def unloaded_files(self) -> tuple[Path, ...]:
        """The plugin files named in the case that have not been executed; loading a case executes none of them."""
        return self._origin.unloaded_files

    @property
    def unchecked(self) -> tuple[Key, ...]:
        """Keys that name plugins or parameters which may be provided by plugin files that are not executed yet."""
        return self._origin.unchecked

    @property
    def registry(self) -> Registry:
        """The registry with which the case was checked."""
        return self._origin.registry

    @property
    def keeps_distance(self) -> list[str]:
        """Names of the behaviours in use that keep distances, so that people slow down before bodies touch."""
        keepers = {name for name, behaviour in self.registry.behaviours.items() if behaviour.keeps_distance}
        return [name for name, table in self.behaviours.items() if table is not False and name in keepers]

    def change(self, overrides: Mapping[str, Any] | Iterable[str]) -> "Case":
        """Return a new checked case with some keys changed; see `evac.case.load_case`.

        Raises
        ------
        ScenarioError
            The changed case is not valid.
        """
        from evac.case.loading import case_from

        origin = self._origin
        return case_from(
            *(origin.table, origin.source, overrides, origin.loaded_files, origin.registry, origin.is_recorded)
        )

    def to_dict(self) -> dict[str, Any]:
        """Return all keys with their values as plain data, including known defaults of the plugins in use."""
        table = self.model_dump(mode="json", exclude_none=True, by_alias=True)
        registry, model = self.registry, self.contact.model
        if model in registry.contact_models:
            table["contact"][model] = _filled(registry.contact_models[model], table["contact"].get(model, {}))
        for kind in ("force", "behaviour", "recorder", "importer"):
            plugins = table[f"{kind}s"]
            for name, values in plugins.items():
                if values is not False and (f"{kind}s", name) not in self.unchecked:
                    plugins[name] = _filled(registry.get(kind, name), values)
        return table

    def write(self, path: str | Path) -> None:
        """Write the case, with its overrides and its plan, as a case.toml that is read as an equal case.

        Paths of the files that it names are written relative to the folder of `path`.
        """
        table, there = _given(self.table), Path(path).resolve().parent
        if there != self.folder.resolve():
            building, plugins = table.get("building", {}), table.get("plugins", {})
            for row in [building, *table.get("conditions", [])]:
                row.update({key: self._from(there, row[key]) for key in ("mesh", "file") if key in row})
            if "files" in plugins:
                plugins["files"] = [self._from(there, name) for name in plugins["files"]]
            for storey in building.get("plan", {}).get("storeys", []):
                storey.update({key: self._from(there, storey[key]) for key in ("file",) if key in storey})
        Path(path).write_text(case_text(table), encoding="utf-8")

    def _from(self, folder: Path, name: str) -> str:
        """Return the path of a file of the case relative to another folder."""
        return Path(os.path.relpath(self.folder.resolve() / name, folder)).as_posix()

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Self:
        """Return the case itself, which cannot be changed."""
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the content of the file; the case is checked again with the plugins of the other process."""
        from evac.case.loading import case_from

        origin = self._origin
        table = copy.deepcopy(dict(origin.table))
        return case_from, (table, origin.source, (), origin.loaded_files, None, origin.is_recorded)


def _given(value: Any) -> Any:
    """Return a value without the keys that are None: not given, which a file expresses by not having them."""
    if isinstance(value, Mapping):
        return {name: _given(one) for name, one in value.items() if one is not None}
    return [_given(one) for one in value] if isinstance(value, list | tuple) else value


def _filled(cls: type[Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a plugin class: given values, and defaults for the others."""
    return {name: given.get(name, parameter.default) for name, parameter in cls.declared().items()}
