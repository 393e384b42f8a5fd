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

#: Greatest number of keys in a table, and of characters in a key or a string.
MOST_KEYS = 10_000
LONGEST_KEY = 200
LONGEST_WORD = 4_000
#: Longest text of a shape of a plan, under these keys.
LONGEST_SHAPE, SHAPES = 4_000_000, {"polygon", "polygons"}

#: Integers of TOML have 64 bits.
_LEAST_WHOLE, _GREATEST_WHOLE = -(2**63), 2**63 - 1

#: Byte order marks of encodings other than UTF-8; UTF-32 comes before UTF-16, whose mark is a prefix of it.
_MARKS = {b"\xff\xfe\0\0": "UTF-32", b"\0\0\xfe\xff": "UTF-32", b"\xff\xfe": "UTF-16", b"\xfe\xff": "UTF-16"}


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
    for mark, encoding in _MARKS.items():
        if content.startswith(mark):
            raise ScenarioError(f"{path}: not valid TOML: written in {encoding}; save the file as UTF-8")
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
    """Return a fault for deep nesting, long keys and strings, large tables and integers.

    Later checks may then recurse, copy and compare without bounds. A mapping that contains itself is nested deeply.
    """
    faults: dict[str, Fault] = {}
    open_: list[tuple[Key, Any]] = [((), content)]
    while open_ and not faults:
        key, value = open_.pop()
        if isinstance(value, Mapping):
            if len(value) > MOST_KEYS:
                faults["keys"] = Fault(key, f"a table of {len(value):,} keys; at most {MOST_KEYS:,} are allowed")
            long = next((name for name in value if isinstance(name, str) and len(name) > LONGEST_KEY), None)
            if long is not None:
                text = f"a key of {len(long):,} characters; at most {LONGEST_KEY} are allowed"
                faults["key"] = Fault((*key, _shortened(long)), text)
            other = next((name for name in value if not isinstance(name, str)), None)
            if other is not None:
                faults["name"] = Fault((*key, repr(other)), "a key must be a string")
        if isinstance(value, (Mapping, list, tuple)):
            if len(key) >= MOST_NESTED:
                text = f"tables and lists nested more than {MOST_NESTED} deep"
                faults["nested"] = Fault(tuple(_shortened(step) for step in key[:3]), text)
            else:
                items = value.items() if isinstance(value, Mapping) else enumerate(value)
                open_ += [((*key, step), item) for step, item in items if _may_be_wrong(item)]
        elif isinstance(value, str):
            longest = LONGEST_SHAPE if key[:2] == ("building", "plan") and not SHAPES.isdisjoint(key) else LONGEST_WORD
            if len(value) > longest:
                text = f"{len(value):,} characters; at most {longest:,} are allowed"
                faults["word"] = Fault(key, text)
            elif "\0" in value:
                faults["zero"] = Fault(key, "contains a NUL character; remove it")
        elif not _LEAST_WHOLE <= value <= _GREATEST_WHOLE:
            faults["whole"] = Fault(key, "an integer beyond 64 bits; write a smaller one, or a decimal point")
    return list(faults.values())


def _may_be_wrong(item: Any) -> bool:
    """Return whether a value can be faulty; floats and booleans, the most frequent values, cannot."""
    return not isinstance(item, (float, bool)) and isinstance(item, (str, int, list, tuple, Mapping))


def _shortened(step: str | int) -> str | int:
    return f"{step[:40]}..." if isinstance(step, str) and len(step) > LONGEST_KEY else step
