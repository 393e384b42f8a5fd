"""Text of case.toml: a case, or parts of one, as TOML."""

import json
import math
import re
from collections.abc import Mapping
from typing import Any

#: Names of keys that TOML lets stand without quotation marks.
BARE = re.compile(r"[A-Za-z0-9_-]+")


def case_text(case: Mapping[str, Any]) -> str:
    """Return a case, as a summary has it, as the content of a case.toml.

    JSON has no infinity: what is null in a summary was infinite.
    """
    lines = toml_lines({key: value for key, value in case.items() if not _is_table(value)})
    for key, value in case.items():
        if isinstance(value, Mapping):
            lines += ["", f"[{toml_key(key)}]", *toml_lines(value)]
        elif _is_table(value):
            for row in value:
                lines += ["", f"[[{toml_key(key)}]]", *toml_lines(row)]
    return "\n".join(lines) + "\n"


def toml_lines(table: Mapping[str, Any]) -> list[str]:
    """Return a line for each key of a table."""
    return [f"{toml_key(name)} = {toml_value(value)}" for name, value in table.items()]


def _is_table(value: Any) -> bool:
    """Return whether a value has a head of its own in TOML: a table, or a list of tables."""
    is_list = isinstance(value, list) and bool(value) and all(isinstance(item, Mapping) for item in value)
    return isinstance(value, Mapping) or is_list


def toml_key(name: str) -> str:
    """Return a key, in quotation marks if it needs them."""
    return name if BARE.fullmatch(name) else toml_value(name)


def toml_value(value: Any) -> str:
    """Return a value; None stands for infinity, which JSON does not have."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{toml_key(name)} = {toml_value(item)}" for name, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    if value is None or (isinstance(value, float) and math.isinf(value)):
        return "inf"
    # Strings of JSON are those of TOML, but for one character.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
