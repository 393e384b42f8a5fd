"""JSON files that are read back: their content is checked once."""

import json
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from evac.errors import ResultError

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
    return data


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
