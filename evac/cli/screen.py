"""Output of the commands: tables, facts, warnings, notes, and the file with an unexpected traceback."""

import errno
import io
import logging
import os
import platform
import shlex
import shutil
import sys
import tempfile
import textwrap
import traceback
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import version
from typing import Any, TextIO

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from evac.base.errors import EvacWarning, in_one_line

LOGGING = ("matplotlib", "imageio", "PIL")  #: Libraries that log warnings to standard error by default.

#: Packages on which numbers, kernels and pictures depend, for reports of faults.
PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "shapely", "scikit-fmm", "pyvista", "pyarrow")


class Lasting(io.TextIOWrapper):
    """A standard stream that a plugin cannot close; once writing has failed, it leads to the null device."""

    failure: OSError | None = None

    def write(self, text: str, /) -> int:
        """Write a text; return its length."""
        try:
            super().write(text)
        except OSError as error:
            self._give_up(error)
        return len(text)

    def flush(self) -> None:
        """Flush, as far as that is possible."""
        try:
            super().flush()
        except OSError as error:
            self._give_up(error)

    def close(self) -> None:
        """Flush only."""
        self.flush()

    def _give_up(self, error: OSError) -> None:
        self.failure = self.failure or error
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, self.fileno())
        os.close(null)


def lasting(stream: TextIO | None) -> TextIO:
    """Return a standard stream as one that lasts; a closed one is the null device."""
    if not isinstance(stream, io.TextIOWrapper):
        return stream or open(os.devnull, "w")
    by_line, encoding = stream.line_buffering, stream.encoding
    return Lasting(stream.detach(), encoding, errors="backslashreplace", line_buffering=by_line)


def told_loss(stream: TextIO) -> bool:
    """Flush standard output; tell and return whether text was lost, unless its reader closed the pipe."""
    with suppress(ValueError, AttributeError):  # a plugin may have closed or replaced it
        stream.flush()
    failure = getattr(stream, "failure", None)
    if failure is None or failure.errno == errno.EPIPE:
        return False
    note(f"evac: standard output: {failure.strerror}: what was printed is incomplete; files are not affected")
    return True


def wrapped(line: str, stream: TextIO, lines: int | None = None, indent: int = 2) -> str:
    """Return a line divided between words for the terminal of a stream, cut to so many lines; as it is for others."""
    if not stream.isatty():
        return line
    return textwrap.fill(
        line,
        shutil.get_terminal_size().columns,
        subsequent_indent=" " * indent,
        break_long_words=False,
        break_on_hyphens=False,
        max_lines=lines,
        placeholder=" ...",
    )


def note(line: str) -> None:
    """Print a line to standard error, divided between words if that is a terminal."""
    print(wrapped(line, sys.stderr), file=sys.stderr, flush=True)


def notify(line: str) -> None:
    """Write a line to standard error without buffering, which is safe in signal handlers; failures are ignored."""
    with suppress(OSError, ValueError, AttributeError):
        os.write(sys.stderr.fileno(), f"{line}\n".encode())


def versions() -> str:
    """Return the versions of evac, of the packages on which its numbers depend, of Python and of the system."""
    packages = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return f"evac {version('evac')}\n{packages}\nPython {sys.version}\n{platform.platform()}"


def crash_file(error: BaseException) -> str:
    """Write traceback, command and versions to a new temporary file; return a sentence that names it."""
    head = f"{shlex.join(sys.argv)}\n{versions()}\n\n"
    try:
        descriptor, name = tempfile.mkstemp(".txt", "evac-crash-")
        with open(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.writelines([head, *traceback.format_exception(error)])
    except OSError as failure:
        return f"its traceback could not be written: {in_one_line(failure)}"
    return f"details are in {name}"


@contextmanager
def shown_warnings() -> Iterator[None]:
    """Show Python warnings of evac and of plugin files in one line, and no others unless PYTHONWARNINGS is set."""

    def show(message: Warning | str, category: type[Warning], filename: str, lineno: int, *more: Any) -> None:
        from evac.contract.registry import is_plugin_file

        if issubclass(category, EvacWarning):
            note(f"warning: {message}")
        elif sys.warnoptions:
            before(message, category, filename, lineno, *more)
        elif is_plugin_file(filename):
            note(f"warning: {filename}, line {lineno}: {category.__name__}: {message}")

    for library in LOGGING:
        logging.getLogger(library).addHandler(logging.NullHandler())
    with warnings.catch_warnings():
        before: Any = warnings.showwarning
        warnings.showwarning = show  # type: ignore[assignment]
        yield


PLAIN_WIDTH = 160  #: Width of tables written to a file or a pipe.


def console() -> Console:
    """Return the console of standard output."""
    return Console(width=None if sys.stdout.isatty() else PLAIN_WIDTH, highlight=False, markup=False, emoji=False)


def show_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table, if it has rows; columns of numbers are aligned to the right."""
    rows, to = [list(row) for row in rows], console()
    if not rows:
        return
    table = Table(title=Text(title, style="bold"), title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for index, column in enumerate(columns):
        numeric = all(_is_numeric(row[index]) for row in rows)
        table.add_column(Text(column), justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        table.add_row(*(Text(shown(value)) for value in row))
    to.print(table)


def _is_numeric(value: object) -> bool:
    """Return whether a value is a number, in figures too, or nothing."""
    return value is None or isinstance(value, int | float) or str(value).lstrip("-").replace(".", "", 1).isdigit()


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


#: Styles of verdicts by their status.
STYLES = {"green": "bold green", "amber": "bold yellow", "red": "bold red", "none": ""}


def say(line: str, lines: int | None = None, style: str = "", indent: int = 2) -> None:
    """Print a sentence, on a terminal with so many lines at most, of which the others hang by `indent`."""
    console().print(Text(wrapped(line, sys.stdout, lines, indent), style=style), soft_wrap=True)


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
