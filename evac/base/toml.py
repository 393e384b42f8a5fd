"""Text of case.toml: a case, or parts of one, as TOML."""

import json
import math
import re
from collections.abc import Mapping
from typing import Any

BARE = re.compile(r"[A-Za-z0-9_-]+")  #: Names of keys that TOML lets stand without quotation marks.


#: A word with the blanks behind it, and a line break that is no part of a string, nor are blanks behind it.
WORD, BREAK = re.compile(r"^\s+|\S+\s*"), "\\\n"

WIDTH = 58  #: Greatest number of letters of a line where TOML lets it be broken, which fits half the width of a page.


def case_text(case: Mapping[str, Any]) -> str:
    """Return a case, as a summary has it, as the content of a case.toml."""
    return "\n".join(_table("", case)) + "\n"


def _table(path: str, table: Mapping[str, Any]) -> list[str]:
    """Return the lines of a table, with heads for those tables within it that do not fit a line."""
    own, below = list[str](), list[str]()
    for name, value in table.items():
        key = toml_key(name)
        place = f"{path}.{key}" if path else key
        if not _is_table(value) or (path and len(f"{key} = {toml_value(value)}") <= WIDTH):
            own += _pair(key, value)
        elif isinstance(value, Mapping):
            below += ["", f"[{place}]", *_table(place, value)]
        else:
            below += [line for row in value for line in ("", f"[[{place}]]", *_table(place, row))]
    return own + below


def toml_lines(table: Mapping[str, Any]) -> list[str]:
    """Return a line for each key of a table."""
    return [line for name, value in table.items() for line in _pair(toml_key(name), value)]


def _pair(key: str, value: Any) -> list[str]:
    """Return the lines of a key: one, or several that can be copied from a printed page if it is long."""
    line = f"{key} = {toml_value(value)}"
    if len(line) <= WIDTH:
        return [line]
    if isinstance(value, str):
        lines = [f'{key} = """']
        for word in WORD.findall(toml_value(value)[1:-1]):
            if len(lines[-1]) + len(word) > WIDTH:
                lines.append("")
            lines[-1] += word
        return f'{BREAK.join(lines)}"""'.split("\n")
    return f"{key} = {_broken(value, '')}".split("\n")


def _broken(value: Any, indent: str) -> str:
    """Return a value with the items of long lists on lines of their own, which TOML allows in lists only."""
    text = toml_value(value)
    if len(indent) + len(text) <= WIDTH:
        return text
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{toml_key(name)} = {_broken(item, indent)}" for name, item in value.items()) + " }"
    if not isinstance(value, list | tuple):
        return text
    inner, lines = f"{indent}  ", [""]
    for item in value:
        words = f"{_broken(item, inner)},"
        if "\n" in words or len(lines[-1]) + len(words) + 1 > WIDTH:
            lines.append(inner + words)
        else:
            lines[-1] += f" {words}" if lines[-1] else inner + words
    return "\n".join(["[", *(line for line in lines if line), f"{indent}]"])


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
        pairs = ", ".join(f"{toml_key(name)} = {toml_value(item)}" for name, item in value.items())
        return f"{{ {pairs} }}" if pairs else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    if value is None or (isinstance(value, float) and math.isinf(value)):
        return "inf"
    # Strings of JSON are those of TOML, but for one character.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
