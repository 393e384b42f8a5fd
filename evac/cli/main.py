"""The program ``evac COMMAND ...``: its parser, and the handling of errors."""

import argparse
import atexit
import errno
import gc
import importlib
import inspect
import os
import signal
import sys
import textwrap
from collections.abc import Sequence
from contextlib import chdir
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

from evac.base.display import Display
from evac.base.errors import EvacError, PluginError, in_one_line, text_of
from evac.base.progress import shown_by
from evac.cli.screen import crash_file, lasting, note, shown_warnings, told_loss, versions

#: Exit status for bad input, for an error in evac itself (EX_SOFTWARE of sysexits.h), and for an interrupt by Ctrl-C.
BAD_INPUT = 2
INTERNAL_ERROR = 70
INTERRUPTED_STATUS = 130

#: Commands in the order of the help, and the modules with the functions that declare and execute them.
COMMANDS = {
    **dict.fromkeys(("run", "resume"), "run"),
    **dict.fromkeys(("repeat", "sweep"), "studies"),
    "list": "cases",
    "check": "check",
    **dict.fromkeys(("import", "new"), "cases"),
    "edit": "cases",
    "explain": "check",
    **dict.fromkeys(("plugins", "schema", "cache"), "plugins"),
    "conditions": "check",
    **dict.fromkeys(("replay", "export", "render", "map", "report", "compare"), "results"),
    **dict.fromkeys(("verify", "evidence"), "verify"),
}

EPILOG = """\
Exit status:
  0    success; for a run: everybody is out
  1    evac verify: a standard test is failed
  2    invalid input: a case, building, plugin, file or command line; for a study: runs failed
  3    people are left inside
  70   internal error, or not enough memory; attach the file named in the message to a bug report
  130  interrupted by Ctrl-C; 128 + the number of the signal for SIGTERM and SIGHUP

The status does not depend on whether the reader of a pipe has closed it."""

GARBAGE_EVERY = 50_000  #: Number of allocated containers between two garbage collections, see `start_fast`.


def program() -> int:
    """Run `main` as a process of its own, which a closed pipe does not end."""
    sys.stdout, sys.stderr = output, _ = lasting(sys.stdout), lasting(sys.stderr)
    interrupt: BaseException | None = None
    try:
        status = main()
    except KeyboardInterrupt as error:
        status, interrupt = INTERRUPTED_STATUS, error
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # only quick clean-up is left
    if interrupt is not None:
        note("evac: interrupted")
    while interrupt is not None:  # a second one may have come while the first went up
        for line in getattr(interrupt, "__notes__", ()):
            note(line)
        interrupt = interrupt.__context__
    return status or BAD_INPUT * told_loss(output)


def main(argv: Sequence[str] | None = None) -> int:
    """Execute one command and return its exit status, see `EPILOG`; only Ctrl-C raises an error."""
    start_fast()
    use_shipped_settings()
    arguments: argparse.Namespace | None = None
    with shown_warnings():
        try:
            arguments = parser().parse_args(argv)
            shown_by[:] = [Display().steps]
            return int(arguments.execute(arguments))
        except EvacError as error:
            is_plugin = isinstance(error, PluginError) and error.__cause__ is not None
            details = f" ({crash_file(error)})" if is_plugin else ""
            for line in [*f"evac: {error}{details}".split("\n"), *getattr(error, "__notes__", ())]:
                note(line)
            return BAD_INPUT
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt) or (isinstance(error, SystemExit) and arguments is None):
                raise  # SystemExit is from argparse, which has printed the help or an error about the command line
            return _status_of(error)
        finally:
            shown_by.clear()


def _status_of(error: BaseException) -> int:
    """Tell an unexpected error in one line and return its status."""
    if isinstance(error, OSError) and error.errno in (errno.ENAMETOOLONG, errno.ELOOP):
        note(f"evac: {text_of(os.fsdecode(error.filename or ''))}: {error.strerror}; give another path")
        return BAD_INPUT
    what, advice = "internal error", "please report it"
    if isinstance(error, MemoryError):
        what, advice = "not enough memory", "use fewer people, a coarser directions.spacing or fewer processes"
    note(f"evac: {what}: {in_one_line(error)}; {advice} ({crash_file(error)})")
    return INTERNAL_ERROR


def start_fast() -> None:
    """Collect garbage less often and not at the exit, because most objects live until the end, and start no threads."""
    gc.set_threshold(GARBAGE_EVERY)
    atexit.register(gc.freeze)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small


def use_shipped_settings() -> None:
    """Have matplotlib draw with the settings that come with it, not those of the current folder or of the user."""
    os.environ["MPLBACKEND"] = "agg"  # pictures are drawn to files; that of a notebook need not be installed here
    spec = find_spec("matplotlib")
    assert spec is not None
    assert spec.origin is not None
    shipped = Path(spec.origin).parent / "mpl-data" / "matplotlibrc"
    os.environ["MATPLOTLIBRC"] = str(shipped)
    if os.path.exists("matplotlibrc"):  # would be read before that
        with chdir(shipped.parent):
            importlib.import_module("matplotlib")


class _Version(argparse.Action):
    """Show the versions that a bug report needs."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(versions())
        parser.exit()


class _Help(argparse.RawDescriptionHelpFormatter):
    """Help whose paragraphs are divided between words for the terminal; lines after the first hang by their indent."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return "\n\n".join(self._filled(part.strip("\n"), width) for part in text.split("\n\n"))

    def _filled(self, part: str, width: int) -> str:
        is_list = "\n  " in part
        lines = part.split("\n") if is_list else [" ".join(part.split())]
        return "\n".join(textwrap.fill(line, width, subsequent_indent=7 * " " if is_list else "") for line in lines)


class _Parser(argparse.ArgumentParser):
    """A parser whose errors fit the terminal."""

    def error(self, message: str) -> NoReturn:
        self.print_usage(sys.stderr)
        note(f"{self.prog}: {message}")
        self.exit(BAD_INPUT)


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    top = _Parser(
        prog="evac",
        description="Simulate the evacuation of buildings of several floors, person by person.",
        epilog=EPILOG,
        formatter_class=_Help,
    )
    top.add_argument("--version", action=_Version, nargs=0, help="show the versions of evac, Python and packages")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, file in COMMANDS.items():
        module = importlib.import_module(f"evac.cli.{file}")
        execute = getattr(module, f"execute_{name}")
        text = inspect.getdoc(execute) or ""
        summary = text.partition("\n\n")[0].removesuffix(".")
        sub = commands.add_parser(name, help=summary, description=text, formatter_class=_Help)
        getattr(module, f"declare_{name}")(sub)
        sub.set_defaults(execute=execute)
    return top
