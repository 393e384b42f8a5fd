"""Warnings of Python: those of evac and of plugin files are shown in one line, others are kept for crash files."""

import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from evac.errors import EvacWarning

#: Libraries that log warnings, to standard error if nobody has told them where.
LOGGING = ("matplotlib", "imageio", "PIL")

#: So many warnings are kept.
MOST_KEPT = 100


def _is_plugin_file(path: str) -> bool:
    from evac.registry import is_plugin_file  # which is loaded by then

    return is_plugin_file(path)


@contextmanager
def shown_warnings() -> Iterator[list[str]]:
    """Show warnings as commands show others; yield a list of those that are hidden, which grows.

    Warnings of libraries are no help to users, who cannot do anything about them. Those who ask for them, with
    ``PYTHONWARNINGS=default`` for example, see them all, as Python shows them.
    """
    hidden: list[str] = []

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if issubclass(category, EvacWarning):
            print(f"warning: {message}", file=sys.stderr)
        elif sys.warnoptions:
            before(message, category, filename, lineno, file, line)
        elif _is_plugin_file(filename):
            print(f"warning: {filename}, line {lineno}: {category.__name__}: {message}", file=sys.stderr)
        elif len(hidden) < MOST_KEPT:
            hidden.append(f"{filename}, line {lineno}: {category.__name__}: {message}")

    for library in LOGGING:
        logging.getLogger(library).addHandler(logging.NullHandler())
    with warnings.catch_warnings():
        before, warnings.showwarning = warnings.showwarning, show
        yield hidden
