"""CSV files: texts that programs would take for formulas are quoted."""

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from evac.base.errors import ResultError
from evac.folder.files import content_of, replacing

#: First characters of formulas in spreadsheet programs, and the apostrophe, which marks a quoted text.
FORMULAS = ("=", "+", "-", "@", "\t", "\r", "'")


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
