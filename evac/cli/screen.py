"""Printing of tables, facts and warnings; plain and wide if the output is not a terminal."""

import sys
from collections.abc import Iterable, Mapping, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from evac.cli.streams import wrapped

#: Width of tables written to a file or a pipe.
PLAIN_WIDTH = 160

#: Words up to this length are not divided in tables.
MOST_WIDTH = 20


def console() -> Console:
    """Return the console of standard output."""
    return Console(width=None if sys.stdout.isatty() else PLAIN_WIDTH, highlight=False, markup=False, emoji=False)


def show_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table; columns of numbers are aligned to the right."""
    rows = [list(row) for row in rows]
    table = Table(title=Text(title, style="bold"), title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for index, column in enumerate(columns):
        numeric = bool(rows) and all(isinstance(row[index], (int, float)) for row in rows)
        words = [word for row in [columns, *rows] for word in shown(row[index]).split()]
        width = min(MOST_WIDTH, max(map(len, words), default=0))
        table.add_column(Text(column), justify="right" if numeric else "left", overflow="fold", min_width=width)
    for row in rows:
        table.add_row(*(Text(shown(value)) for value in row))
    console().print(table)


def show_facts(facts: Mapping[str, object]) -> None:
    """Print names and values, one line each."""
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in facts.items():
        table.add_row(Text(name), Text(shown(value)))
    console().print(table)


def show_warnings(warnings: Iterable[str]) -> None:
    """Print warnings to standard error."""
    for warning in warnings:
        print(wrapped(f"warning: {warning}", sys.stderr), file=sys.stderr)


def say(line: str, lines: int, is_bold: bool = False) -> int:
    """Print a sentence, on a terminal with so many lines at most; return their number."""
    text = wrapped(line, sys.stdout, lines)
    console().print(Text(text, style="bold" if is_bold else ""), soft_wrap=True)
    return text.count("\n") + 1


def shown(value: object) -> str:
    """Format a value: floats with four digits, None, NaN and empty strings as a dash, booleans as yes or no."""
    if value in (None, "") or value != value:  # NaN
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
