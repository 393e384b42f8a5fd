"""Files of a result folder that are read back: their content is checked once."""

import csv
import json
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from evac.base.errors import ResultError
from evac.folder.cells import text_of_cell

#: Greatest depth of tables and lists in each other, so that code that follows them does not end in an error.
MOST_NESTED = 60

Read = TypeVar("Read", bound=BaseModel)


def read_json(path: Path) -> dict[str, Any]:
    """Return the content of a JSON file that holds a table.

    Raises
    ------
    ResultError
        It is not there, or holds something else.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ResultError(
            f"{path}: no such file; a report is made of a result folder whose run has ended or was interrupted: see "
            "whether `evac resume` can end it"
        ) from error
    except (OSError, ValueError, RecursionError) as error:
        raise ResultError(f"{path}: cannot be read: {error}; run the case again") from error
    if not isinstance(data, dict):
        raise ResultError(f"{path}: holds no table; run the case again")
    if _is_nested(data, MOST_NESTED):
        raise ResultError(f"{path}: is nested deeper than {MOST_NESTED} tables; run the case again")
    return data


def _is_nested(value: Any, deeper_than: int) -> bool:
    items = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return deeper_than == 0 or any(_is_nested(item, deeper_than - 1) for item in items)


def checked(kind: type[Read], data: dict[str, Any], path: Path) -> Read:
    """Return checked data of a JSON file.

    Raises
    ------
    ResultError
        A key is missing or of the wrong kind; names it.
    """
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        key = ".".join(map(str, first["loc"]))
        raise ResultError(
            f"{path}: {key}: {first['msg']}; the file is damaged or of another version of evac: run the case again"
        ) from error


def read_columns(path: Path, wanted: tuple[str, ...]) -> dict[str, list[str]]:
    """Return the columns of a CSV file as text.

    Raises
    ------
    ResultError
        The file is not there, a column is missing, or a row is cut short.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            head, *rows = list(csv.reader(file)) or [[]]
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
