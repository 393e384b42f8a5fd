"""JSON and CSV files of result folders: written as a whole, and checked once when they are read back."""

import csv
import io
import json
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from evac.base.errors import ResultError
from evac.folder.files import content_of, replacing

#: First characters of formulas in spreadsheet programs, and the apostrophe, which marks a quoted text.
FORMULAS = ("=", "+", "-", "@", "\t", "\r", "'")

Count = Annotated[int, Field(ge=0)]
Amount = Annotated[float, Field(ge=0.0)]

Read = TypeVar("Read")


def plain(value: Any) -> Any:
    """Convert a value for JSON: arrays and scalars of numpy to plain data, NaN and infinity to None, others to text."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value if value is None or isinstance(value, (str, bool, int, float)) else repr(value)


def write_json(path: Path, data: Mapping[str, Any], what: str) -> None:
    """Write plain data as a JSON file."""
    text = json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False)
    with replacing(path, what) as new:
        new.write_text(text + "\n", encoding="utf-8")


def read_json(path: Path) -> dict[str, Any]:
    """Return the content of a JSON file that holds a table."""
    try:
        data = json.loads(content_of(path).decode())
    except FileNotFoundError as error:
        raise ResultError(
            f"{path}: no such file; results are read from a folder whose run has ended or was interrupted: see "
            "whether `evac resume` can end it"
        ) from error
    except (OSError, ValueError, RecursionError) as error:
        why = getattr(error, "strerror", None) or error
        raise ResultError(f"{path}: cannot be read: {why}; run the case again") from error
    if not isinstance(data, dict):
        raise ResultError(f"{path}: holds no table; run the case again")
    return data


@cache
def adapter(kind: Any) -> TypeAdapter[Any]:
    """Return what checks data that are read as a class of pydantic or a dataclass, and makes plain data of it."""
    return TypeAdapter(kind)


def checked(kind: type[Read], data: dict[str, Any], path: Path) -> Read:
    """Return checked data of a JSON file."""
    try:
        of: Any = kind
        read: Read = adapter(of).validate_python(data)
        return read
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        what = f"{path}: {'.'.join(map(str, first['loc']))}: {first['msg']}"
        raise ResultError(f"{what}; the file is damaged or of another version of evac: run the case again") from error


def cell_of(value: Any) -> Any:
    """Return a value for a cell of a CSV file: an apostrophe before texts that programs would take for formulas.

    Texts that start with an apostrophe get another one, so that `text_of_cell` is the inverse.

    >>> cell_of("=1+1"), cell_of("'a"), cell_of("hall"), cell_of(-1.5)
    ("'=1+1", "''a", 'hall', -1.5)
    """
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULAS) else value


def text_of_cell(cell: str) -> str:
    """Return the text that `cell_of` has written as a cell."""
    return cell.removeprefix("'")


def write_csv(path: Path, columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write a CSV file with a header; texts are quoted as by `cell_of`."""
    with replacing(path, "the results") as new, new.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(map(cell_of, columns))
        writer.writerows(map(cell_of, row) for row in rows)


def read_columns(path: Path, wanted: tuple[str, ...]) -> dict[str, list[str]]:
    """Return the columns of a CSV file as text."""
    try:
        head, *rows = list(csv.reader(io.StringIO(content_of(path).decode(), newline=""))) or [[]]
    except (OSError, ValueError, csv.Error) as error:
        why = getattr(error, "strerror", None) or error
        raise ResultError(f"{path}: cannot be read: {why}; run the case again") from error
    missing = [name for name in wanted if name not in head]
    if missing:
        raise ResultError(f"{path}: column {missing[0]!r} is missing; run the case again")
    for number, row in enumerate(rows, 2):
        if len(row) != len(head):
            raise ResultError(f"{path}: row {number} has {len(row)} fields instead of {len(head)}; run the case again")
    return {name: [text_of_cell(row[index]) for row in rows] for index, name in enumerate(head)}
