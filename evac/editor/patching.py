"""Changes in the text of a TOML file: only the spans of changed values are written, and the result is checked."""

import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from itertools import groupby
from typing import Any, TypeAlias

from evac.base.toml import BARE, toml_key, toml_value
from evac.folder.textfiles import plain

NEWLINE, BLANK, SKIPPED = re.compile(r"\r?\n"), re.compile(r"[ \t]*"), re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
SCALAR, REST = re.compile(r"[^,\]}\n#]*[^,\]}\n# \t\r]"), re.compile(r"[ \t]*(#[^\n]*|\r?)(?=\n|$)")
STRINGS = [
    re.compile(r'"""(?:\\.|[^\\])*?"{3,5}', re.S),
    re.compile(r"'''.*?'{3,5}", re.S),
    re.compile(r'"(?:\\.|[^"\\\n])*"'),
    re.compile(r"'[^'\n]*'"),
]
#: Keys by which a row of a list of tables is known when other rows are added or removed.
IDENTITY = ("name", "storey", "stair", "kind")

Key: TypeAlias = tuple[str, ...]


@dataclass
class Span:
    """A value in the text, or a table with its head; `first` is where its key, or the comments above its head, begin.

    `kind`: scalar, array, inline (table), table, tables (a list of them), or dotted (a table made by dotted keys).
    """

    kind: str
    first: int
    start: int
    end: int
    parts: dict[str, "Span"] = field(default_factory=dict)
    items: list["Span"] = field(default_factory=list)

    @property
    def last(self) -> int:
        """End of a table and of the tables within it."""
        heads = [one for one in self.parts.values() if one.kind in ("table", "tables")]
        return max([self.end, *(one.last for one in [*heads, *self.items])])


def patched(text: str, new: Mapping[str, Any]) -> str:
    """Return a TOML text with the content `new`, as plain data, in which all else, such as comments, is as it was.

    Raises ValueError if the table cannot be changed in the text.
    """
    body = text.removeprefix("\ufeff")
    before = tomllib.loads(body)
    for is_fine in (True, False):  # items of lists one by one; else lists as a whole
        try:
            result = _Patch(body, is_fine).result(before, new)
            if plain(tomllib.loads(result)) == plain(new):
                return text[: len(text) - len(body)] + result
        except (KeyError, IndexError, AttributeError, tomllib.TOMLDecodeError):
            continue
    raise ValueError("this change cannot be made in the text of the file without touching more of it; edit it by hand")


class _Patch:
    """The edits of one text: pieces of it that are replaced."""

    def __init__(self, text: str, is_fine: bool) -> None:
        self.text, self.is_fine = text, is_fine
        self.root = scanned(text)
        self.edits: list[tuple[int, int, str]] = []

    def result(self, before: Mapping[str, Any], new: Mapping[str, Any]) -> str:
        self._table(self.root, before, new, ())
        text, newline = self.text, "\r\n" if "\r\n" in self.text else "\n"
        for start, end, piece in sorted(self.edits, key=lambda edit: edit[:2])[::-1]:
            text = text[:start] + piece.replace("\n", newline) + text[end:]
        return text

    def _table(self, span: Span, old: Mapping[str, Any], new: Mapping[str, Any], place: Key) -> None:
        pairs = list(span.parts.items())
        if span.kind == "inline":
            gone = [k for k, (key, _) in enumerate(pairs) if key not in new]
            if len(gone) == len(pairs):
                self.edits.append((span.start, span.end, toml_value(new)))
                return
            self._remove([one for _, one in pairs], gone)
        for key, value in old.items():
            if key in new:
                self._change(span.parts[key], value, new[key], (*place, key))
            elif span.kind != "inline":
                self._erase(span.parts[key])
        added = [(key, value) for key, value in new.items() if key not in old]
        if span.kind == "inline":
            end = max(one.end for one in span.parts.values())
            self.edits += [(end, end, f", {toml_key(key)} = {toml_value(value)}") for key, value in added]
            return
        if span.kind not in ("table",) and added:
            raise KeyError(added[0][0])
        has_heads = span is self.root or any(one.kind == "tables" for one in span.parts.values())
        is_implied = span is not self.root and span.first == span.start == span.end  # by the heads of tables within it
        for key, value in added:
            is_list = isinstance(value, list) and isinstance(value[0], dict)
            if (is_list and has_heads) or (isinstance(value, Mapping) and (has_heads or is_implied)):
                at = len(self.text) if span is self.root else span.last
                self.edits.append((at, at, "".join(self._heads(at, (*place, key), value))))
            else:
                text = (
                    "[\n" + "".join(f"    {toml_value(row)},\n" for row in value) + "]"
                    if is_list
                    else toml_value(value)
                )
                self.edits.append((span.end, span.end, f"{self._break(span.end)}{toml_key(key)} = {text}\n"))

    def _change(self, span: Span, old: Any, new: Any, place: Key) -> None:
        if plain(old) == plain(new):
            return
        if span.kind == "tables":
            self._rows(span, old, new, place)
        elif isinstance(new, Mapping) and span.kind in ("inline", "table", "dotted"):
            self._table(span, old, new, place)
        elif isinstance(new, list) and span.kind == "array" and old and new and self.is_fine:
            self._list(span, old, new, place)
        elif span.kind in ("scalar", "array", "inline"):
            self.edits.append((span.start, span.end, toml_value(new)))
        else:
            raise KeyError(place[-1])

    def _rows(self, span: Span, old: Sequence[Any], new: Sequence[Any], place: Key) -> None:
        """Change a list of tables with heads."""
        at = span.items[0].first
        for changed, gone, added in _matched(old, new):
            for i, j in changed:
                self._table(span.items[i], old[i], new[j], place)
            for i in gone:
                self._erase(span.items[i])
            at = span.items[gone.stop - 1].last if gone.stop else at
            if added:
                text = "".join(self._head(at, place, row) for row in added)
                self.edits.append((at, at, text if gone.stop else f"{text[1:]}\n"))

    def _list(self, span: Span, old: Sequence[Any], new: Sequence[Any], place: Key) -> None:
        """Change an array item by item."""
        items = span.items
        for changed, gone, added in _matched(old, new):
            for i, j in changed:
                self._change(items[i], old[i], new[j], place)
            self._remove(items, gone)
            values = [toml_value(value) for value in added]
            if values and gone.start:
                self._insert_after(items, gone.start - 1, values)
            elif values:
                start = items[0].start
                line = self.text.rfind("\n", span.start, start) + 1
                glue = f",\n{self.text[line:start]}" if line else ", "
                self.edits.append((start, start, "".join(value + glue for value in values)))

    def _insert_after(self, items: Sequence[Span], k: int, values: Sequence[str]) -> None:
        end = items[k].end
        line = self.text.rfind("\n", 0, items[k].start) + 1
        comma = _past(SKIPPED, self.text, end)
        has_comma = self.text[comma] == ","
        rest = REST.match(self.text, comma + 1 if has_comma else end)
        if self.text[line : items[k].start].strip() or rest is None:
            self.edits.append((end, end, "".join(f", {value}" for value in values)))
            return
        if not has_comma:
            self.edits.append((end, end, ","))
        indent = self.text[line : items[k].start]
        self.edits.append((rest.end(), rest.end(), "".join(f"\n{indent}{value}," for value in values)))

    def _remove(self, items: Sequence[Span], gone: Sequence[int]) -> None:
        """Remove some items of an array, or pairs of an inline table, but not all of them: run after run."""
        for _, pairs in groupby(enumerate(gone), lambda pair: pair[1] - pair[0]):
            run = [k for _, k in pairs]
            first, last = items[run[0]], items[run[-1]]
            line = self.text.rfind("\n", 0, first.first) + 1
            comma = _past(SKIPPED, self.text, last.end)
            rest = REST.match(self.text, comma + 1 if self.text[comma] == "," else last.end)
            if not self.text[line : first.first].strip() and rest is not None:
                self.edits.append((line, min(rest.end() + 1, len(self.text)), ""))
            elif run[-1] + 1 < len(items):
                self.edits.append((first.first, items[run[-1] + 1].first, ""))
            else:
                self.edits.append((items[run[0] - 1].end, last.end, ""))

    def _erase(self, span: Span) -> None:
        """Remove a key with its line, or tables with their heads and the blank line that follows each."""
        if span.kind == "dotted":
            for part in span.parts.values():
                self._erase(part)
        for row in span.items if span.kind == "tables" else [span] if span.kind == "table" else []:
            self.edits.append((row.first, _past(NEWLINE, self.text, row.end), ""))
            for part in row.parts.values():
                if part.kind in ("table", "tables"):
                    self._erase(part)
        if span.kind in ("scalar", "array", "inline"):
            self.edits.append((self.text.rfind("\n", 0, span.first) + 1, _line_end(self.text, span.end), ""))

    def _head(self, at: int, place: Key, row: Mapping[str, Any], marks: str = "[[]]") -> str:
        pairs = "".join(f"{toml_key(key)} = {toml_value(value)}\n" for key, value in row.items())
        half = len(marks) // 2
        return f"{self._break(at)}\n{marks[:half]}{'.'.join(map(toml_key, place))}{marks[half:]}\n{pairs}"

    def _heads(self, at: int, place: Key, value: Any) -> list[str]:
        """Return the rows of a list with their heads; a table with its head, or, if it has only tables, these."""
        if isinstance(value, list):
            return [self._head(at, place, row) for row in value]
        if value and all(isinstance(part, Mapping) for part in value.values()):
            return [head for key, part in value.items() for head in self._heads(at, (*place, key), part)]
        return [self._head(at, place, value, "[]")]

    def _break(self, at: int) -> str:
        return "\n" if at and self.text[at - 1] != "\n" else ""


def _matched(old: Sequence[Any], new: Sequence[Any]) -> Iterator[tuple[list[tuple[int, int]], range, Sequence[Any]]]:
    """Yield, from the first place of a list to the last, which rows have become which, which are gone, and new ones."""

    def known(value: Any) -> str:
        by = [value[key] for key in IDENTITY if key in value] if isinstance(value, Mapping) else value
        return json.dumps(plain(by))

    blocks = SequenceMatcher(None, [*map(known, old)], [*map(known, new)], autojunk=False).get_opcodes()
    for _, i1, i2, j1, j2 in blocks:
        common = min(i2 - i1, j2 - j1)
        yield [(i1 + k, j1 + k) for k in range(common)], range(i1 + common, i2), new[j1 + common : j2]


# The spans of a text, which tomllib has read before.


def scanned(text: str) -> Span:
    """Return the spans of a TOML text."""
    root = Span("table", 0, 0, 0)
    table, at = root, 0
    while (at := _past(SKIPPED, text, at)) < len(text):
        if text[at] == "[":
            is_many = text[at + 1] == "["
            keys, end = _key(text, at + 1 + is_many)
            head, at = at, _line_end(text, end)
            table = _headed(root, keys, is_many, _with_comments(text, head), at)
        else:
            keys, equals = _key(text, at)
            value = _value(text, _past(BLANK, text, equals + 1), at)
            _put(table.parts, keys, value)
            at = value.end
            table.end = _line_end(text, at)
    return root


def _headed(root: Span, keys: list[str], is_many: bool, first: int, end: int) -> Span:
    """Return the table of a head."""
    within = root
    for key in keys[:-1]:
        within = within.parts.setdefault(key, Span("table", first, first, first))
        within = within.items[-1] if within.kind == "tables" else within
    own = Span("table", first, first, end)
    if is_many:
        within.parts.setdefault(keys[-1], Span("tables", first, first, first)).items.append(own)
        return own
    if keys[-1] in within.parts:  # a table of which a part came first
        own.parts = within.parts[keys[-1]].parts
    within.parts[keys[-1]] = own
    return own


def _with_comments(text: str, head: int) -> int:
    """Return where the comments right above a head begin."""
    start = text.rfind("\n", 0, head) + 1
    while start and text[:start].splitlines()[-1].lstrip().startswith("#"):
        start = text.rfind("\n", 0, start - 1) + 1
    return start


def _past(pattern: re.Pattern[str], text: str, at: int) -> int:
    """Return the end of what a pattern matches from a place on; the place itself if it matches nothing."""
    match = pattern.match(text, at)
    return match.end() if match else at


def _line_end(text: str, at: int) -> int:
    end = text.find("\n", at)
    return len(text) if end < 0 else end + 1


def _put(parts: dict[str, Span], keys: list[str], value: Span) -> None:
    for key in keys[:-1]:
        parts = parts.setdefault(key, Span("dotted", value.first, value.start, value.end)).parts
    parts[keys[-1]] = value


def _string(text: str, at: int) -> int:
    return next(match.end() for pattern in STRINGS if (match := pattern.match(text, at)))


def _key(text: str, at: int) -> tuple[list[str], int]:
    """Return the parts of a key, and where the sign after it is."""
    keys: list[str] = []
    while True:
        at = _past(BLANK, text, at)
        end = _string(text, at) if text[at] in "\"'" else _past(BARE, text, at)
        keys += tomllib.loads(f"{text[at:end]} = 0")
        at = _past(BLANK, text, end)
        if text[at] != ".":
            return keys, at
        at += 1


def _value(text: str, at: int, first: int) -> Span:
    if text[at] in "\"'":
        return Span("scalar", first, at, _string(text, at))
    if text[at] not in "[{":
        return Span("scalar", first, at, _past(SCALAR, text, at))
    span = Span("array" if text[at] == "[" else "inline", first, at, at)
    at = _past(SKIPPED, text, at + 1)
    while text[at] not in "]}":
        if span.kind == "array":
            value = _value(text, at, at)
            span.items.append(value)
        else:
            begin = at
            keys, equals = _key(text, at)
            value = _value(text, _past(SKIPPED, text, equals + 1), begin)
            _put(span.parts, keys, value)
        at = _past(SKIPPED, text, value.end)
        at = _past(SKIPPED, text, at + 1) if text[at] == "," else at
    span.end = at + 1
    return span
