"""Texts in the cells of CSV files: those that programs would take for formulas are quoted."""

from typing import Any

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
