"""The content of a case.toml as plain data, and overrides of single keys, such as `people.class_1.number=5`."""

import copy
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from evac.base.errors import ScenarioError, quoted_line
from evac.base.keys import Fault, Key
from evac.base.parameters import check_types, did_you_mean
from evac.building.model.findings import repaired

MOST_BYTES = 8_000_000  #: Greatest size of a case.toml [bytes]: some 200,000 positions.
MOST_NESTED = 20  #: Greatest depth of nested tables and lists: a case needs seven.
_LEAST_WHOLE, _GREATEST_WHOLE = -(2**63), 2**63 - 1  #: Integers of TOML have 64 bits.


def read_table(path: Path) -> dict[str, Any]:
    """Return the content of a TOML file; a byte order mark of UTF-8 is allowed."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ScenarioError(
                f"{path}: {path.stat().st_size / 1e6:.3g} MB is more than a case can hold ({MOST_BYTES / 1e6:g} MB); "
                "give people an area and a number instead of positions, and draw polygons with fewer corners"
            )
        content = path.read_bytes()
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}; check the file") from error
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ScenarioError(
            f"{path}: not valid TOML: line {line} contains byte 0x{content[error.start]:02x}, which is not UTF-8; "
            "save the file as UTF-8"
        ) from error
    try:
        return parse(text)
    except ValueError as error:
        raise ScenarioError(f"{path}: not valid TOML: {error}{quoted_line(text, str(error))}") from error


def parse(text: str) -> dict[str, Any]:
    """Return the content of a text in TOML."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # Python does not convert integers with more than some thousand digits
        raise ValueError("an integer beyond 64 bits") from None
    except RecursionError:
        raise ValueError(f"tables and lists nested more than {MOST_NESTED} deep") from None


def content_faults(content: Mapping[str, Any]) -> list[Fault]:
    """Return a fault for deep nesting, keys that are no strings, NUL characters and large integers.

    Later checks may then recurse, copy and compare without bounds. A mapping that contains itself is nested deeply.
    """
    open_: list[tuple[Key, Any]] = [((), content)]
    while open_:
        key, value = open_.pop()
        if isinstance(value, (Mapping, list, tuple)):
            if len(key) >= MOST_NESTED:
                return [Fault(key[:3], f"tables and lists nested more than {MOST_NESTED} deep")]
            items = value.items() if isinstance(value, Mapping) else enumerate(value)
            for step, item in items:
                if isinstance(value, Mapping) and not isinstance(step, str):
                    return [Fault((*key, repr(step)), "a key must be a string")]
                # Floats and booleans, the most frequent values, cannot be faulty.
                if not isinstance(item, (float, bool)) and isinstance(item, (str, int, list, tuple, Mapping)):
                    open_.append(((*key, step), item))
        elif isinstance(value, str):
            if "\0" in value:
                return [Fault(key, "contains a NUL character; remove it")]
        elif not _LEAST_WHOLE <= value <= _GREATEST_WHOLE:
            return [Fault(key, "an integer beyond 64 bits; write a smaller one, or a decimal point")]
    return []


def parsed(overrides: Mapping[str, Any] | Iterable[str]) -> tuple[list[tuple[str, Any]], list[Fault]]:
    """Read overrides given as a mapping, or as strings ``dotted.key=value``.

    A value is read as TOML; if it is not valid TOML, it is taken as a string, unless it begins like a quoted string,
    an array or a table.
    """
    if isinstance(overrides, Mapping):
        return list(overrides.items()), []
    pairs: list[tuple[str, Any]] = []
    faults: list[Fault] = []
    for text in [overrides] if isinstance(overrides, str) else overrides:
        check_types(override=(text, str))
        key, sign, word = (part.strip() for part in text.partition("="))
        if not (key and sign and word):
            faults.append(Fault((text,), "write the override as dotted.key=value"))
            continue
        try:
            pairs.append((key, value_of(word)))
        except ValueError as error:
            hint = "; text in a list needs quotes, as in '[\"door\"]'" if word[0] == "[" else ""
            faults.append(Fault((key,), f"{word} is not valid TOML: {error}{hint}"))
    return pairs, faults


def value_of(word: str) -> Any:
    """Return the value of a word read as TOML, or the word itself."""
    try:
        return parse(f"value = {word}")["value"]
    except ValueError:
        if word[0] in "\"'[{":
            raise
        return word


def split_values(text: str) -> list[str]:
    """Split a text at commas, except commas within quotes, brackets and braces."""
    words, depth, quote = [""], 0, ""
    for sign in text:
        if sign == "," and not depth and not quote:
            words.append("")
            continue
        if quote:
            quote = "" if sign == quote else quote
        elif sign in "\"'":
            quote = sign
        else:
            depth += (sign in "[{") - (sign in "]}")
        words[-1] += sign
    return [word.strip() for word in words]


def apply(table: dict[str, Any], overrides: Mapping[str, Any] | Iterable[str]) -> tuple[list[Key], list[Fault]]:
    """Change `table` in place; return the keys that were set, and the faults."""
    check_types(overrides=(overrides, str | Iterable))
    pairs, faults = parsed(overrides)
    keys: list[Key] = []
    for name, value in pairs:
        check_types(key=(name, str))
        wrong = content_faults({"value": value})  # before it is copied
        outcome = Fault((name,), wrong[0].text) if wrong else _set(table, name.split("."), value)
        if isinstance(outcome, Fault):
            faults.append(outcome)
        else:
            keys.append(outcome)
    return keys, faults


def _set(table: dict[str, Any], parts: list[str], value: Any) -> Key | Fault:
    """Set one key; missing tables are created, items of lists must exist."""
    here: Any = table
    key: Key = ()
    for depth, part in enumerate(parts):
        is_last = depth == len(parts) - 1
        step: str | int = part
        if isinstance(here, list):
            index = _index(here, part)
            if index is None:
                names = [str(item["name"]) for item in here if isinstance(item, dict) and "name" in item]
                return Fault((*key, part), f"no item has this name or number; {did_you_mean(part, names)}")
            step = index
        elif not isinstance(here, dict):
            hint = f"set {dotted(key, table)} as a whole"
            return Fault((*key, part), f"{dotted(key, table)} is {here!r}, not a table; {hint}")
        key = (*key, step)
        if is_last:
            here[step] = copy.deepcopy(value)  # a later override may change it
        else:
            here = here.setdefault(step, {}) if isinstance(here, dict) else here[step]
    return key


def _index(items: list[Any], part: str) -> int | None:
    """Return the index of an item of a list, given by number or by name; None if there is none."""
    if part.isdecimal():
        return int(part) if int(part) < len(items) else None
    return next(
        (index for index, item in enumerate(items) if isinstance(item, dict) and item.get("name") == part), None
    )


def dotted(key: Key, table: Any) -> str:
    """Return a key in the form of an override; items of a list by name if the name is unique."""
    words: list[str] = []
    here = table
    for step in key:
        word = str(step)
        if isinstance(step, int) and isinstance(here, list):
            names = [item.get("name") for item in here if isinstance(item, dict)]
            name = here[step].get("name") if step < len(here) and isinstance(here[step], dict) else None
            if isinstance(name, str) and name == repaired(name) != "" and "." not in name and names.count(name) == 1:
                word = name
        words.append(word)
        try:
            here = here[step]
        except (KeyError, IndexError, TypeError):
            here = None
    return ".".join(words)
