"""Printing of tables, facts and warnings; plain and wide if the output is not a terminal."""

import sys
from collections.abc import Iterable, Mapping, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from evac.cli.messages import note, wrapped

#: Width of tables written to a file or a pipe.
PLAIN_WIDTH = 160

#: Words up to this length are not divided in tables, if these fit the terminal.
MOST_WIDTH = 20

#: Columns between two columns of a table, and beside the first and the last one.
GAP, EDGES = 3, 2


def console() -> Console:
    """Return the console of standard output."""
    return Console(width=None if sys.stdout.isatty() else PLAIN_WIDTH, highlight=False, markup=False, emoji=False)


def show_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table, if it has rows; columns of numbers are aligned to the right."""
    rows, to = [list(row) for row in rows], console()
    if not rows:
        return
    table = Table(title=Text(title, style="bold"), title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    cells = [[column, *(shown(row[k]) for row in rows)] for k, column in enumerate(columns)]
    widths = _widths(cells, to.width - EDGES - GAP * (len(columns) - 1))
    for index, column in enumerate(columns):
        numeric = all(_is_numeric(row[index]) for row in rows)
        table.add_column(Text(column), justify="right" if numeric else "left", overflow="fold", width=widths[index])
    for row in rows:
        table.add_row(*(Text(shown(value)) for value in row))
    to.print(table)


def _is_numeric(value: object) -> bool:
    """Return whether a value is a number, in figures too, or nothing."""
    return value is None or isinstance(value, int | float) or str(value).lstrip("-").replace(".", "", 1).isdigit()


def _widths(cells: Sequence[Sequence[str]], room: int) -> list[int]:
    """Return widths of columns that fit; the widest ones are narrowed first, and words divided only if they must be."""
    widths = [max(map(len, column)) for column in cells]
    longest = [max(map(len, " ".join(column).split()), default=0) for column in cells]
    most = next((n for n in range(MOST_WIDTH, 1, -1) if sum(min(n, one) for one in longest) <= room), 1)
    while sum(widths) > room:
        wider = [k for k, width in enumerate(widths) if width > min(most, longest[k])]
        if not wider:
            break
        widths[max(wider, key=widths.__getitem__)] -= 1
    return widths


def show_facts(facts: Mapping[str, object]) -> None:
    """Print names and values, one line each, divided between words on a terminal."""
    indent = max(map(len, facts)) + 2
    for name, value in facts.items():
        text = wrapped(f"{name:{indent}}{shown(value)}", sys.stdout, indent=indent)
        console().print(Text.assemble((text[:indent], "bold"), text[indent:]), soft_wrap=True)


def show_warnings(warnings: Iterable[str]) -> None:
    """Print warnings to standard error."""
    for warning in warnings:
        note(f"warning: {warning}")


def say(line: str, lines: int | None = None, is_bold: bool = False, indent: int = 2) -> None:
    """Print a sentence, on a terminal with so many lines at most, of which the others hang by `indent`."""
    console().print(Text(wrapped(line, sys.stdout, lines, indent), style="bold" if is_bold else ""), soft_wrap=True)


def height(line: str) -> int:
    """Return the number of lines that a sentence takes; 0 if it is empty, 1 if the output is not a terminal."""
    return wrapped(line, sys.stdout).count("\n") + 1 if line else 0


def shown(value: object) -> str:
    """Format a value: floats with four digits, None, NaN and empty strings as a dash, booleans as yes or no."""
    if value in (None, "") or value != value:  # NaN
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
