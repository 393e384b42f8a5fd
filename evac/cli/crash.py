"""Unexpected errors: a one-line message, and a crash file with what is needed to find the cause; Python warnings."""

import errno
import importlib.metadata
import json
import logging
import os
import platform
import re
import shlex
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

from evac.base.errors import EvacWarning, in_one_line, text_of
from evac.cli.streams import note

if TYPE_CHECKING:
    from evac.case.case import Case

#: Exit status of an error in evac itself, EX_SOFTWARE of sysexits.h.
INTERNAL_ERROR = 70

#: Number of crash files that are kept; the oldest are removed.
KEPT = 20

#: What to do about errors of the system that the user alone can correct.
ADVICE = {
    errno.ENAMETOOLONG: "give a shorter path; names such as NAME.running are made from it",
    errno.ELOOP: "the link leads to itself; give another path",
    errno.EMFILE: "raise the limit of open files (ulimit -n)",
    errno.ENFILE: "close other programs",
    errno.EAGAIN: "raise the limit of processes (ulimit -u), or use fewer (--jobs)",
}

#: Libraries that log warnings to standard error by default.
LOGGING = ("matplotlib", "imageio", "PIL")

#: Maximum number of hidden warnings that are kept for crash files.
MOST_KEPT = 100


def fault_of_path(error: BaseException) -> str:
    """Return what is wrong with a path or the limits of the process that an error names; empty for other errors."""
    if isinstance(error, RuntimeError) and str(error).startswith("Symlink loop"):  # of pathlib, until Python 3.12
        return f"{text_of(error)}: the link leads to itself; give another path"
    if isinstance(error, RuntimeError) and str(error) == "can't start new thread":
        return f"no thread can be started; {ADVICE[errno.EAGAIN]}"
    if isinstance(error, FileNotFoundError):
        try:
            os.getcwd()
        except OSError:
            return "the current folder has been removed; change to another one"
    advice = ADVICE.get(error.errno or 0) if isinstance(error, OSError) else None
    if advice is None or not isinstance(error, OSError):
        return ""
    named = f"{text_of(os.fsdecode(error.filename))}: " if error.filename else ""
    return f"{named}{error.strerror}; {advice}"


def report_crash(error: BaseException, what: str, case: "Case | None" = None, notes: Sequence[str] = ()) -> None:
    """Print a one-line message on an unexpected error, of a kind such as "internal error", with its crash file.

    The case is the one that was loaded when the error occurred; the notes are warnings that were not shown.
    """
    advice = "please report it"
    if isinstance(error, MemoryError):
        what, advice = "not enough memory", "use fewer people, a coarser directions.spacing or fewer processes"
    note(f"evac: {what}: {in_one_line(error)}; {advice} ({crash_file(error, case, notes)})")


def crash_file(error: BaseException, case: "Case | None" = None, notes: Sequence[str] = ()) -> str:
    """Write a crash file to the folder of crash files, or to the temporary folder; return a sentence with its path.

    It contains the traceback, the command, versions and the settings of the case, but no environment variables and no
    values of variables. Only the newest `KEPT` files are kept, which only the user can read.
    """
    try:
        text = "".join(_report(error, case, notes))
    except Exception as failure:  # such as a MemoryError
        text = f"{in_one_line(error)}\nno report, {in_one_line(failure)}\n"
    stamp, why = f"evac-crash-{time.strftime('%Y%m%d-%H%M%S')}-", ""
    for folder in (_crash_folder, lambda: Path(tempfile.gettempdir())):
        try:
            descriptor, name = tempfile.mkstemp(".txt", stamp, folder())
            with open(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
                file.write(text)
        except OSError as failure:
            why = why or f"{failure.strerror or failure}"
        else:
            _prune(Path(name))
            return f"details are in {name}"
    return f"no crash file could be written: {why}"


def _crash_folder() -> Path:
    """Return the folder of crash files, ``crashes`` in the cache folder of the user, created if it is missing."""
    from evac.jit.store import cache_root

    root = cache_root()
    if root is None:
        raise OSError("there is no home folder")
    folder = root / "crashes"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder


def _prune(newest: Path) -> None:
    """Remove the oldest crash files in the folder of one, but for `KEPT` of them."""
    with suppress(OSError):
        others = [path for path in newest.parent.glob("evac-crash-*.txt") if path != newest]
        for path in sorted(others, key=lambda path: path.lstat().st_mtime)[: -(KEPT - 1)]:
            path.unlink(missing_ok=True)


def _report(error: BaseException, case: "Case | None", notes: Sequence[str]) -> Iterator[str]:
    """Yield the parts of a crash file; a part that cannot be determined is replaced by the reason."""
    yield "evac crash report\n\n"
    parts: dict[str, Callable[[], str]] = {
        "time": lambda: time.strftime("%Y-%m-%d %H:%M:%S %z"),
        "command": lambda: shlex.join(sys.argv),
        "folder": os.getcwd,
        "system": lambda: f"{platform.platform()}, {os.cpu_count()} processors, {sys.stdout.encoding} output",
        "python": lambda: sys.version.replace("\n", " "),
        "versions": _versions,
        "warnings": lambda: "\n  ".join(notes) or "none",
        "case": lambda: "none" if case is None else _settings(case),
    }
    for name, part in parts.items():
        try:
            text = part()
        except Exception as failure:
            text = f"unknown, {in_one_line(failure)}"
        yield f"{name}: {text}\n"
    yield "\n"
    yield from traceback.TracebackException.from_exception(error).format()


def _versions() -> str:
    """Return the versions of Python, evac and the packages that it depends on."""
    required = [line for line in importlib.metadata.requires("evac") or () if "extra ==" not in line]
    names = ["evac", *(re.split(r"[^\w.-]", line, maxsplit=1)[0] for line in required)]
    return ", ".join(f"{name} {importlib.metadata.version(name)}" for name in names)


def _settings(case: "Case") -> str:
    from evac.folder.jsonfile import plain

    return f"{case.source}\n{json.dumps(plain(case.to_dict()), indent=2)}"


@contextmanager
def shown_warnings() -> Iterator[list[str]]:
    """Show Python warnings of evac and of plugin files in one line; yield the list of others, which is filled later.

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
        from evac.contract.registry import is_plugin_file

        told = f"{filename}, line {lineno}: {category.__name__}: {message}"
        if issubclass(category, EvacWarning):
            note(f"warning: {message}")
        elif sys.warnoptions:
            before(message, category, filename, lineno, file, line)
        elif is_plugin_file(filename):
            note(f"warning: {told}")
        elif len(hidden) < MOST_KEPT:
            hidden.append(told)

    for library in LOGGING:
        logging.getLogger(library).addHandler(logging.NullHandler())
    with warnings.catch_warnings():
        before, warnings.showwarning = warnings.showwarning, show
        yield hidden


def refuse_to_leave() -> None:
    """Let `os._exit` raise SystemExit in this process, so that a plugin cannot end a run as if it had succeeded."""
    process, leave = os.getpid(), os._exit

    def refuse(status: int) -> NoReturn:
        if os.getpid() != process:  # a forked process ends by it
            leave(status)
        raise SystemExit(status)

    os._exit = refuse


def catch_the_rest() -> None:
    """Report errors in threads, destructors and exit handlers in one line, too."""

    def of_thread(args: threading.ExceptHookArgs) -> None:
        if args.exc_value is not None and not isinstance(args.exc_value, SystemExit):
            report_crash(args.exc_value, "a thread failed")

    def ignored(unraisable: Any) -> None:
        if unraisable.exc_value is not None:
            note(f"warning: ignored: {in_one_line(unraisable.exc_value)}")

    def of_process(kind: type[BaseException], error: BaseException, trace: Any) -> None:
        report_crash(error, "internal error")

    threading.excepthook, sys.unraisablehook, sys.excepthook = of_thread, ignored, of_process
