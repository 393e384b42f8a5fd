"""What becomes of errors that evac does not expect: one line, and a file with what is needed to find the cause."""

import importlib.metadata
import json
import os
import platform
import re
import shlex
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.errors import in_one_line

if TYPE_CHECKING:
    from evac.scenario.case import Case

#: Exit status of an error in evac itself, EX_SOFTWARE of sysexits.h.
INTERNAL_ERROR = 70

#: So many names are tried for a file, if some are taken.
MOST_FILES = 100


def tell_crash(error: BaseException, what: str, case: "Case | None" = None, notes: list[str] | None = None) -> None:
    """Print one line on an unexpected error, and where its crash file is.

    Parameters
    ----------
    error : BaseException
    what : str
        What it is, such as ``"internal error"``.
    case : Case, optional
        That was being worked on.
    notes : list of str, optional
        Warnings that were not shown.
    """
    advice = "please report it"
    if isinstance(error, MemoryError):
        what, advice = "not enough memory", "use fewer people, a coarser directions.spacing or fewer processes"
    print(f"evac: {what}: {in_one_line(error)}; {advice} ({crash_file(error, case, notes)})", file=sys.stderr)


def crash_file(error: BaseException, case: "Case | None" = None, notes: list[str] | None = None) -> str:
    """Write a crash file to the current folder, or else to that of temporary files; return a sentence on it.

    It has the traceback, the command, versions and the settings of the case; nothing of the environment, and no values
    of variables.
    """
    try:
        text = "".join(_report(error, case, notes or []))
    except Exception as failure:  # memory, for example
        text = f"{in_one_line(error)}\nno report, {in_one_line(failure)}\n"
    stamp = f"evac-crash-{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"
    why = ""
    for folder in (Path.cwd, lambda: Path(tempfile.gettempdir())):
        try:
            return f"details are in {_written(folder(), stamp, text)}"
        except OSError as failure:
            why = why or f"{failure.strerror or failure}"
    return f"no crash file could be written: {why}"


def _written(folder: Path, stamp: str, text: str) -> Path:
    """Write a new file that nobody else may read, and return its path; leave none that is not whole."""
    for k in range(MOST_FILES):
        path = folder / f"{stamp}{f'-{k}' if k else ''}.txt"
        try:
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError:
            continue
        try:
            with open(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
                file.write(text)
        except OSError:
            path.unlink(missing_ok=True)
            raise
        return path
    raise FileExistsError(f"{folder / stamp}: too many crash files")


def _report(error: BaseException, case: "Case | None", notes: list[str]) -> Iterator[str]:
    """Yield the parts of a crash file; what cannot be found out is left out with the reason."""
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
    """Return evac and what it is installed with, with versions."""
    required = [line for line in importlib.metadata.requires("evac") or () if "extra ==" not in line]
    names = ["evac", *(re.split(r"[^\w.-]", line, maxsplit=1)[0] for line in required)]
    return ", ".join(f"{name} {importlib.metadata.version(name)}" for name in names)


def _settings(case: "Case") -> str:
    from evac.output.results import plain

    return f"{case.source}\n{json.dumps(plain(case.to_dict()), indent=2)}"


def catch_the_rest() -> None:
    """Tell what fails beside the command in one line too: threads, destructors, and what is called at the exit."""

    def of_thread(args: threading.ExceptHookArgs) -> None:
        if args.exc_value is not None and not isinstance(args.exc_value, SystemExit):
            tell_crash(args.exc_value, "a thread failed")

    def ignored(unraisable: Any) -> None:
        if unraisable.exc_value is not None:
            print(f"warning: ignored: {in_one_line(unraisable.exc_value)}", file=sys.stderr)

    def of_process(kind: type[BaseException], error: BaseException, trace: Any) -> None:
        tell_crash(error, "internal error")

    threading.excepthook, sys.unraisablehook, sys.excepthook = of_thread, ignored, of_process
