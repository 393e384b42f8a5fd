"""``evac COMMAND ...``: the parser, and what becomes of errors."""

import argparse
import atexit
import gc
import importlib
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TextIO

from evac.errors import CacheWarning, EvacError

#: Exit status of bad input, and of what Ctrl-C stopped.
BAD_INPUT = 2
INTERRUPTED_STATUS = 130

#: Commands in the order of the help, and the module that declares and executes each.
COMMANDS = {
    "run": "evac.cli.run",
    "repeat": "evac.cli.repeat",
    "sweep": "evac.cli.sweep",
    "list": "evac.cli.catalogue",
    "check": "evac.cli.check",
    "explain": "evac.cli.explain",
    "plugins": "evac.cli.plugins",
    "cache": "evac.cli.cache",
    "export": "evac.cli.export",
    "render": "evac.cli.render",
    "evidence": "evac.cli.evidence",
}


#: Containers that are made between two looks for garbage, see `start_fast`.
GARBAGE_EVERY = 50_000


def main(argv: Sequence[str] | None = None) -> int:
    """Execute one command and return the exit status: 0, 2 for bad input, 3 for people left, 130 if interrupted."""
    start_fast()
    arguments = parser().parse_args(argv)
    try:
        with _cache_warnings():
            status: int = arguments.execute(arguments)
    except EvacError as error:
        print("\n".join([f"evac: {error}", *getattr(error, "__notes__", ())]), file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("evac: interrupted", file=sys.stderr)
        return INTERRUPTED_STATUS
    return status


@contextmanager
def _cache_warnings() -> Iterator[None]:
    """Show what the library warns of as commands show other warnings; those of other libraries stay as they are."""

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if issubclass(category, CacheWarning):
            print(f"warning: {message}", file=sys.stderr)
        else:
            before(message, category, filename, lineno, file, line)

    with warnings.catch_warnings():
        before, warnings.showwarning = warnings.showwarning, show
        yield


def start_fast() -> None:
    """Leave out work of Python and numpy that takes a good part of a short command and does nothing for it.

    Packages make hundreds of thousands of objects when they are loaded, which stay until the end: they are looked
    through for garbage less often, and not once more at the end. And the threads of numpy's linear algebra, which is
    used for small matrices only, are not started unless the environment asks for them.
    """
    gc.set_threshold(GARBAGE_EVERY)
    atexit.register(gc.freeze)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    top = argparse.ArgumentParser(
        prog="evac",
        description="Evacuation of multi-floor buildings, person by person.",
        epilog="Exit status: 0 everybody out or done, 2 bad input, 3 people left, 130 interrupted.",
    )
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, home in COMMANDS.items():
        module = importlib.import_module(home)
        summary = (module.__doc__ or "").partition(": ")[2].partition("\n")[0]
        sub = commands.add_parser(name, help=summary, description=module.__doc__)
        sub.formatter_class = argparse.RawDescriptionHelpFormatter
        module.declare(sub)
        sub.set_defaults(execute=module.execute)
    return top
