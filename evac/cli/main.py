"""``evac COMMAND ...``: the parser, and what becomes of errors."""

import argparse
import atexit
import gc
import importlib
import os
import signal
import sys
from collections.abc import Sequence

from evac.cli.cases import loaded_case
from evac.cli.crash import INTERNAL_ERROR, catch_the_rest, crash_file, tell_crash
from evac.cli.streams import guard_streams, tell_lost_output
from evac.cli.warned import shown_warnings
from evac.errors import EvacError, PluginError

#: Exit status of bad input, and of what Ctrl-C stopped.
BAD_INPUT = 2
INTERRUPTED_STATUS = 130

#: Commands in the order of the help, and the module that declares and executes each.
COMMANDS = {
    "run": "evac.cli.run",
    "resume": "evac.cli.resume",
    "repeat": "evac.cli.repeat",
    "sweep": "evac.cli.sweep",
    "list": "evac.cli.catalogue",
    "check": "evac.cli.check",
    "import": "evac.cli.importing",
    "new": "evac.cli.new",
    "explain": "evac.cli.explain",
    "plugins": "evac.cli.plugins",
    "cache": "evac.cli.cache",
    "replay": "evac.cli.replay",
    "export": "evac.cli.export",
    "render": "evac.cli.render",
    "map": "evac.cli.map",
    "evidence": "evac.cli.evidence",
}

EPILOG = """\
Exit status:
  0    everybody is out, or what was asked for is done
  2    bad input: a case, a building, a plugin, a file or the words of the command; the message names it
  3    people are left
  70   an error in evac itself, or not enough memory; the message names a file to send with a report
  130  interrupted by Ctrl-C; 128 + the number of the signal for SIGTERM and SIGHUP

The status does not depend on whether what is printed can be read by anybody."""

#: Containers that are made between two looks for garbage, see `start_fast`.
GARBAGE_EVERY = 50_000


def program() -> int:
    """Be the process of a command: `main`, with streams that never fail and nothing that prints a traceback."""
    guard_streams()
    catch_the_rest()
    try:
        return main()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # what is left takes no time
        tell_lost_output()


def main(argv: Sequence[str] | None = None) -> int:
    """Execute one command and return its exit status, see `EPILOG`.

    Raises
    ------
    SystemExit
        After --help, and where the words of the command are wrong.
    """
    start_fast()
    arguments: argparse.Namespace | None = None
    with shown_warnings() as hidden:
        try:
            arguments = parser().parse_args(argv)
            return int(arguments.execute(arguments))
        except EvacError as error:
            lines = [f"evac: {error}", *getattr(error, "__notes__", ())]
            if isinstance(error, PluginError) and error.__cause__ is not None:
                lines.append(crash_file(error, loaded_case(arguments), hidden))
            print("\n".join(lines), file=sys.stderr)
            return BAD_INPUT
        except KeyboardInterrupt:
            print("evac: interrupted", file=sys.stderr)
            return INTERRUPTED_STATUS
        except BaseException as error:
            if isinstance(error, SystemExit) and arguments is None:
                raise  # of argparse, which has shown the help or what is wrong with the words of the command
            tell_crash(error, "internal error", loaded_case(arguments), hidden)
            return INTERNAL_ERROR


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
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
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
