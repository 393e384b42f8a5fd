"""The content of a case.toml as plain data, and checks of its size before single keys are checked."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from evac.base.errors import ScenarioError, quoted_line
from evac.base.keys import Fault, Key

#: Greatest size of a case.toml [bytes]: some 200,000 positions.
MOST_BYTES = 8_000_000

#: Greatest depth of nested tables and lists: a case needs seven.
MOST_NESTED = 20

#: Integers of TOML have 64 bits.
_LEAST_WHOLE, _GREATEST_WHOLE = -(2**63), 2**63 - 1


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
