"""Python warnings: those from evac and plugin files are shown in one line, others are kept for crash files."""

import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from evac.base.errors import EvacWarning

#: Libraries that log warnings to standard error by default.
LOGGING = ("matplotlib", "imageio", "PIL")

#: Maximum number of warnings that are kept.
MOST_KEPT = 100


def _is_plugin_file(path: str) -> bool:
    from evac.contract.registry import is_plugin_file  # already loaded at this point

    return is_plugin_file(path)


@contextmanager
def shown_warnings() -> Iterator[list[str]]:
    """Show Python warnings in the format of the commands; yield the list of hidden ones, filled within the context.

    Warnings from libraries are hidden, because users can do nothing about them. If warnings are requested explicitly,
    with ``PYTHONWARNINGS=default`` for example, Python shows all of them as usual.
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
