"""Faults of a case: one list of checks, each of which yields what is wrong, with its key and the remedy."""

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from evac.base.change import REMEDIES, is_legal
from evac.base.errors import PluginError, is_one_line, text_of
from evac.base.keys import Fault, Key, faults_of, is_multiple
from evac.base.parameters import Configurable, did_you_mean
from evac.case.case import Case
from evac.case.schema import MOST_STATES, ConditionSettings, SmokeSettings, shipped_presets, with_presets
from evac.contract.registry import Registry
from evac.directions.routes import STRATEGIES

Classes = Mapping[str, type[Configurable]]


#: Text of the fault of an alarm that nobody hears.
NOT_HEARD = "no behaviour of the case acts on an alarm; add one, such as [behaviours.response_time]"


class Draft(NamedTuple):
    """What is checked: the content of a case.toml, which may have any types, and the case if its keys are valid."""

    content: dict[str, Any]
    folder: Path | None  # of its files; None if they need not exist
    registry: Registry
    case: Case | None = None


def checked(content: dict[str, Any], folder: Path | None, registry: Registry) -> tuple[Case | None, list[Fault]]:
    """Return the case, if its keys are valid, and all faults: of each key the last one that a check finds."""
    draft, found = Draft(content, folder, registry), list[Fault]()
    try:
        draft = draft._replace(case=Case.model_validate(with_presets(content)))
    except ValidationError as error:
        found += _without_repeats(faults_of(error, Case), content)
    found += [fault for check in CHECKS for fault in check(draft)]
    if draft.case is not None:
        found += [fault for check in CHECKS_OF_CASE for fault in check(draft, draft.case)]
    return draft.case, [*{fault.key: fault for fault in found}.values()]


def _without_repeats(faults: list[Fault], content: dict[str, Any]) -> Iterator[Fault]:
    """Yield faults without those of groups that repeat a fault of their preset."""
    of_presets = {fault.key[1:3] for fault in faults if fault.key[0] == "presets"}
    for fault in faults:
        if fault.key[0] == "people" and len(fault.key) > 2:
            group, key = content["people"][fault.key[1]], fault.key[2]
            if key not in group and (group.get("preset"), key) in of_presets:
                continue
        yield fault


def _table(value: object) -> dict[str, Any]:
    """Return a table, or an empty one if the value is none."""
    return value if isinstance(value, dict) else {}


def _list(value: object) -> list[Any]:
    """Return a list, or an empty one if the value is none."""
    return value if isinstance(value, list) else []


def _groups(draft: Draft) -> Iterator[tuple[Key, dict[str, Any]]]:
    """Yield the tables of groups and presets, each with its key."""
    yield from ((("people", index), _table(group)) for index, group in enumerate(_list(draft.content.get("people"))))
    yield from ((("presets", name), _table(own)) for name, own in _table(draft.content.get("presets")).items())


def _known_or_plugin(name: str, known: Iterable[str]) -> str:
    """Return a hint for an unknown name that a plugin could provide."""
    hint = did_you_mean(name, list(known))
    is_close = hint.endswith("?")
    return hint if is_close else f"{hint}; or name the file of its plugin in [plugins], plugin_files or --plugin"


def _name(key: Key, name: object, known: Mapping[str, Any], word: str) -> Iterator[Fault]:
    """Check a name that is a value."""
    if isinstance(name, str) and name not in known:
        yield Fault(key, f"unknown {word} {name!r}; {_known_or_plugin(name, known)}", True)


def _tables(
    key: Key, tables: Mapping[str, Any], classes: Classes, word: str, beside: tuple[str, ...] = ()
) -> Iterator[Fault]:
    """Check tables that are named like plugins; `beside` are the other keys of the table."""
    for name, table in tables.items():
        if name in classes:
            declared = list(classes[name].declared())
            for parameter, value in _table(table).items():
                yield from _parameter((*key, name, parameter), value, classes[name], declared)
        elif isinstance(table, dict) or not beside:
            yield Fault((*key, name), f"unknown {word}; {_known_or_plugin(name, [*classes, *beside])}", True)
        else:
            yield Fault((*key, name), f"unknown key; {did_you_mean(name, [*classes, *beside])}")


def _parameter(key: Key, value: Any, cls: type[Configurable], allowed: list[str]) -> Iterator[Fault]:
    """Check one parameter of a plugin, or one setting of a group for it."""
    parameter, declared = str(key[-1]), cls.declared()
    if parameter not in allowed:
        yield Fault(key, f"{cls.name!r} has no such parameter; {did_you_mean(parameter, allowed)}")
    elif parameter in declared:
        try:
            declared[parameter].check("", value)
        except PluginError as error:
            yield Fault(key, str(error).removeprefix(": "))


def _presets(draft: Draft) -> Iterator[Fault]:
    own = draft.content.get("presets", {})
    if isinstance(own, dict):
        known = own | shipped_presets() | own  # in the order in which they are proposed
        for key, group in _groups(draft):
            name = group.get("preset") if key[0] == "people" else None
            if isinstance(name, str) and name not in known:
                yield Fault((*key, "preset"), f"unknown preset {name!r}; {did_you_mean(name, list(known))}")


def _contact(draft: Draft) -> Iterator[Fault]:
    """Check the contact model in use, the parameters of all, and the solvers that they name."""
    from evac.physics.contact.model import SolvedContactModel

    given, models = _table(draft.content.get("contact")), draft.registry.contact_models
    if "model" not in given:
        names = f'model = "NAME", where NAME is one of {", ".join(sorted(models))}'
        yield Fault(("contact", "model"), f"missing; write {names}")
    yield from _name(("contact", "model"), given.get("model"), models, "contact model")
    tables = {name: table for name, table in given.items() if name != "model"}
    yield from _tables(("contact",), tables, models, "contact model", ("model",))
    for name, table in tables.items():
        if issubclass(models.get(name, object), SolvedContactModel):
            yield from _name(("contact", name, "solver"), _table(table).get("solver"), draft.registry.solvers, "solver")


def _conditions(draft: Draft) -> Iterator[Fault]:
    """Check the sources of conditions and their parameters."""
    sources = draft.registry.condition_sources
    for index, table in enumerate(map(_table, _list(draft.content.get("conditions")))):
        place, name = ("conditions", index), table.get("source")
        yield from _name((*place, "source"), name, sources, "source")
        if isinstance(name, str) and name in sources:
            cls = sources[name]
            own = ("source", "start", "hold", *cls.keys)
            for key, value in table.items():
                field = ConditionSettings.model_fields.get(key)
                plain = tuple(value) if isinstance(value, list) else value
                if key not in own and plain != (field.default if field else None):
                    yield from _parameter((*place, key), value, cls, [*own, *cls.declared()])


def _smoke(draft: Draft) -> Iterator[Fault]:
    """Check the law of the speed in smoke, if it is in use, and the parameters of all."""
    smoke, laws, keys = _table(draft.content.get("smoke")), draft.registry.smoke_laws, SmokeSettings.model_fields
    law = smoke.get("law")
    if draft.content.get("conditions") or law != keys["law"].default:
        yield from _name(("smoke", "law"), law, laws, "law")
    tables = {name: table for name, table in smoke.items() if name not in keys}
    yield from _tables(("smoke",), tables, laws, "law", tuple(keys))


def _plugins(draft: Draft) -> Iterator[Fault]:
    """Check the tables of forces, behaviours, recorders, dispatchers and importers."""
    for kind in ("force", "behaviour", "recorder", "dispatcher", "importer"):
        yield from _tables(
            (f"{kind}s",), _table(draft.content.get(f"{kind}s")), getattr(draft.registry, f"{kind}s"), kind
        )


def _settings_of_groups(draft: Draft) -> Iterator[Fault]:
    """Check the settings of groups for behaviours: each must be registered, in the case, and accept these keys."""
    known, in_use = draft.registry.behaviours, draft.content.get("behaviours", {})
    for place, group in _groups(draft):
        for name, table in _table(group.get("behaviours")).items():
            key: Key = (*place, "behaviours", name)
            if name not in known:
                yield Fault(key, f"unknown behaviour; {_known_or_plugin(name, known)}", True)
            elif isinstance(in_use, dict) and name not in in_use:
                yield Fault(key, f"the behaviour is not in use; add [behaviours.{name}]")
            else:
                for parameter, value in _table(table).items():
                    yield from _parameter((*key, parameter), value, known[name], list(known[name].group_keys))


def _files(draft: Draft) -> Iterator[Fault]:
    """Check that the file of the building and the plugin files exist; none is opened."""
    if draft.folder is None:
        return
    for index, name in enumerate(_list(_table(draft.content.get("plugins")).get("files"))):
        if isinstance(name, str) and not os.path.isfile(draft.folder / name):  # also if the name is too long
            yield Fault(("plugins", "files", index), f"no such file {text_of(draft.folder / name)}; check the path")
    mesh = _table(draft.content.get("building")).get("mesh")
    if isinstance(mesh, str) and mesh and not os.path.exists(draft.folder / mesh):
        yield Fault(("building", "mesh"), f"no such file {draft.folder / mesh}; check the path")


def _unique_names(draft: Draft) -> Iterator[Fault]:
    """Check that no two groups, places, lines or events have the same name."""
    seen = set[str]()
    kinds = ("people", "groups"), ("place", "places"), ("line", "lines"), ("event", "events"), ("phase", "phases")
    for kind, word in kinds:
        seen = seen if kind == "phase" else set()  # names of phases are those of events
        for index, table in enumerate(map(_table, _list(draft.content.get(kind)))):
            if isinstance(name := table.get("name"), str):
                if name in seen:
                    yield Fault((kind, index, "name"), f"{name!r} names two {word}; rename one")
                seen.add(name)


def _has_behaviour(draft: Draft, trait: str) -> bool:
    """Return whether a behaviour in use has a trait; those of plugin files that are not executed yet may have it."""
    behaviours, known = _table(draft.content.get("behaviours")), draft.registry.behaviours
    used = [name for name, table in behaviours.items() if table is not False]
    return any(name not in known or getattr(known[name], trait) for name in used)


def _places(draft: Draft, case: Case) -> Iterator[Fault]:
    """Check places, and groups and events that name them."""
    follows_signs, areas = _has_behaviour(draft, "follows_signs"), [place.area for place in case.place]
    for index, place in enumerate(case.place):
        if place.area is not None and place.area in areas[:index]:
            yield Fault(("place", index, "area"), f"{place.area!r} is the area of two places; change one")
        if place.kind == "sign" and not follows_signs:
            text = "no behaviour of the case follows signs; add one, such as [behaviours.familiarity]"
            yield Fault(("place", index, "kind"), text)
    known = [place.name for place in case.place if place.kind == "assembly"]
    names = [group["name"] for group in draft.content["people"]]  # the case sorts its groups
    for group in case.people:
        for name in group.assembly:
            if name not in known:
                text = f"there is no place {name!r} of kind assembly; {did_you_mean(name, known)}"
                yield Fault(("people", names.index(group.name), "assembly"), text)
    for index, event in enumerate(case.event):
        named = set(event.value) if event.kind == "strategy" and isinstance(event.value, tuple) else set()
        if named & {*known} and not named <= {*known}:
            yield Fault(("event", index, "value"), "name either exits or assembly areas, not both")


def _events(draft: Draft, case: Case) -> Iterator[Fault]:
    """Check what events refer to: others, groups and behaviours of the case."""
    names, groups = [one.name for one in case.events], [group.name for group in case.people]
    hears_alarms = _has_behaviour(draft, "hears_alarms")
    for index, one in enumerate(case.event):
        key: Key = ("event", index)
        if not is_legal(one.kind, one.value):
            yield Fault((*key, "value"), f"is {one.value!r}; use {REMEDIES[one.kind]}")
        elif one.kind == "strategy" and isinstance(one.value, str) and one.value not in STRATEGIES:
            yield Fault((*key, "value"), f"unknown strategy {one.value!r}; {did_you_mean(one.value, STRATEGIES)}")
        if one.kind == "strategy" and one.target not in groups:
            yield Fault((*key, "target"), f"there is no group {one.target!r}; {did_you_mean(one.target, groups)}")
        if one.kind == "alarm" and not hears_alarms:
            yield Fault((*key, "kind"), NOT_HEARD)
        if one.kind != "alarm" and not one.target:
            yield Fault((*key, "target"), f"missing; name what to {one.kind.replace('_', '-')}")
        if not is_one_line(one.target):
            yield Fault((*key, "target"), f"{one.target!r:.80} is not one line; correct the name")
        other = None if one.when is None else one.when.event
        if other is not None and (other not in names or other == one.name):
            known = [name for name in names if name is not None and name != one.name]
            text = f"there is no other event {other!r}; {did_you_mean(other, known)}"
            yield Fault((*key, "when", "event"), text)


def _phases(draft: Draft, case: Case) -> Iterator[Fault]:
    """Check that a behaviour acts on the alarms of phases, and that their cues exist."""
    hears_alarms = _has_behaviour(draft, "hears_alarms")
    for index, phase in enumerate(case.phase):
        if not hears_alarms:
            yield Fault(("phase", index, "name"), NOT_HEARD)
        known = [one.name for one in case.events if one.name is not None and one.name != phase.name]
        if phase.cue is not None and phase.cue not in known:
            hint = did_you_mean(phase.cue, known)
            yield Fault(("phase", index, "cue"), f"there is no other event or phase {phase.cue!r}; {hint}")


def _states(draft: Draft, case: Case) -> Iterator[Fault]:
    """Check the time between recorded states."""
    every, settings = case.output.every, case.simulation
    if not is_multiple(every, settings.tick):
        below = max(1, int(every / settings.tick))
        how = f"use {below * settings.tick:.6g} or {(below + 1) * settings.tick:.6g}"
        text = f"{every:g} s is not a multiple of simulation.tick {settings.tick:g} s; {how}"
        yield Fault(("output", "every"), text)
    elif settings.duration > MOST_STATES * every:
        text = (
            f"{every:g} s gives {settings.duration / every:.2g} states in a run of {settings.duration:g} s, more than "
            f"{MOST_STATES:,}; record less often, or shorten the run"
        )
        yield Fault(("output", "every"), text)


#: The checks of a case in the order in which their faults are told; the last ones need valid keys.
CHECKS = (_presets, _contact, _conditions, _smoke, _plugins, _settings_of_groups, _files, _unique_names)
CHECKS_OF_CASE = (_places, _events, _phases, _states)
