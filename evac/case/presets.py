"""Shipped presets: properties of kinds of people, with their sources."""

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any

#: Keys of a shipped preset that describe it, besides those of `PeopleSettings`.
DESCRIPTION = ("about", "source")


@cache
def shipped_presets() -> dict[str, dict[str, Any]]:
    """Return the shipped presets by name, with their `DESCRIPTION`."""
    return tomllib.loads(files("evac.case").joinpath("presets.toml").read_text(encoding="utf-8"))


def with_preset(group: dict[str, Any], presets: dict[str, Any]) -> dict[str, Any]:
    """Return the table of a group with the keys of its preset that it does not have itself.

    Parameters
    ----------
    group : dict
    presets : dict
        Those of the case, which go before shipped ones of the same name.
    """
    name = group.get("preset")
    if not isinstance(name, str):
        return group
    preset = presets[name] if name in presets else shipped_presets().get(name)
    if not isinstance(preset, dict):
        return group
    return {key: value for key, value in preset.items() if name in presets or key not in DESCRIPTION} | group
