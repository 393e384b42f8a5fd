"""JSON files of result folders: written as a whole, and checked once when they are read back."""

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from evac.base.errors import ResultError
from evac.folder.files import content_of, replacing

#: Greatest depth of tables and lists in each other, so that code that follows them does not end in an error.
MOST_NESTED = 60

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
        raise ResultError(f"{path}: cannot be read: {error}; run the case again") from error
    if not isinstance(data, dict):
        raise ResultError(f"{path}: holds no table; run the case again")
    if _is_nested(data, MOST_NESTED):
        raise ResultError(f"{path}: is nested deeper than {MOST_NESTED} tables; run the case again")
    return data


def _is_nested(value: Any, deeper_than: int) -> bool:
    items = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return deeper_than == 0 or any(_is_nested(item, deeper_than - 1) for item in items)


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
        what = f"{path}: {first_fault(error)}"
        raise ResultError(f"{what}; the file is damaged or of another version of evac: run the case again") from error


def first_fault(error: ValidationError) -> str:
    """Return the first key that was refused, and why."""
    first = error.errors(include_url=False, include_context=False, include_input=False)[0]
    return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
