"""Shipped presets: properties of kinds of people, with their sources."""

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any

from evac.base.keys import Fault
from evac.base.parameters import did_you_mean

#: Keys of a shipped preset that describe it, besides those of `PeopleSettings`.
DESCRIPTION = ("about", "source")


@cache
def shipped_presets() -> dict[str, dict[str, Any]]:
    """Return the shipped presets by name, with their `DESCRIPTION`."""
    return tomllib.loads(files("evac.case").joinpath("presets.toml").read_text(encoding="utf-8"))


def with_presets(content: dict[str, Any]) -> tuple[dict[str, Any], list[Fault]]:
    """Return the content of a case whose groups have the keys of their presets, and faults for unknown presets.

    Presets of the case go before shipped ones of the same name, and keys of a group before those of its preset.
    """
    own, groups = content.get("presets", {}), content.get("people")
    if not isinstance(own, dict) or not isinstance(groups, list):
        return content, []
    shipped = {
        name: {key: value for key, value in preset.items() if key not in DESCRIPTION}
        for name, preset in shipped_presets().items()
    }
    known = own | shipped | own  # in the order in which they are proposed
    filled, faults = list(groups), []
    for index, group in enumerate(groups):
        name = group.get("preset") if isinstance(group, dict) else None
        if not isinstance(name, str):
            continue
        if name not in known:
            hint = did_you_mean(name, list(known))
            faults.append(Fault(("people", index, "preset"), f"unknown preset {name!r}; {hint}"))
        elif isinstance(known[name], dict):
            filled[index] = known[name] | group
    return {**content, "people": filled}, faults
