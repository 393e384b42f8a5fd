"""evac run: run a case and write its results.

Results are written to ./CASE-result, or to --out: a new or empty folder, or the result folder of an earlier run, which
is replaced when this run has ended; other files in it are kept. During the run, results are in RESULT.running. A run
that is stopped by Ctrl-C, SIGTERM or SIGHUP saves its tables and its state: `evac resume RESULT` continues it.
"""

import argparse
import math
from pathlib import Path

from evac.base.display import Display
from evac.cli.inputs import case_to_run, declare_case, default_folder, note_unused_plugins, positive


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_case(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="result folder (default: ./CASE-result)")
    what = "compute also the parts that the case does not need: slower, with the same trajectories"
    parser.add_argument("--full", action="store_true", help=what)
    parser.add_argument("--vtk", action="store_true", help="write the VTK animation as well (output.animation=true)")
    declare_checkpoint(parser, "none")
    declare_threads(parser)
    declare_verbose(parser)


def declare_checkpoint(parser: argparse.ArgumentParser, default: str) -> None:
    """Add --checkpoint to a command."""
    what = f"save a checkpoint every S seconds of wall time, for `evac resume` (default: {default})"
    parser.add_argument("--checkpoint", type=_seconds, metavar="S", help=what)


def declare_verbose(parser: argparse.ArgumentParser) -> None:
    """Add --verbose to a command."""
    what = "show tables of exits, stairs, contacts and wall time, and quality warnings in full"
    parser.add_argument("--verbose", action="store_true", help=what)


def declare_threads(parser: argparse.ArgumentParser) -> None:
    """Add --threads to a command."""
    parser.add_argument(
        "--threads",
        type=positive,
        metavar="N",
        help="number of threads, at most one for each core and, in steps, for each 25,000 people; the results do not"
        " depend on it (default: by the number of people)",
    )


def execute(arguments: argparse.Namespace) -> int:
    """Run the case, write and show the results; return 0 if everybody is out, 3 if not, 128 + signal if stopped."""
    with Display() as display:
        display.phase("reading the case")
        case = case_to_run(arguments)
        if arguments.vtk:
            case = case.change({"output.animation": True})
        note_unused_plugins(case)
        from evac.cli.running import run_shown, show_run
        from evac.folder.files import CHECKPOINT_NAME
        from evac.folder.resultfolder import ResultFolder
        from evac.simulation.simulation import Simulation

        with ResultFolder(arguments.out or default_folder(case)) as place:
            if place.is_left_over:
                has_state = (place.running / CHECKPOINT_NAME).is_file()
                hint = f" (evac resume {place.path} would have continued it)" if has_state else ""
                display.line(f"evac: replacing {place.running} of an unfinished run{hint}")
            display.phase("reading the building, computing directions")
            simulation = Simulation(
                case, place.running, arguments.full, threads=arguments.threads, compiling=display.compiling
            )
            place.start()
            results, status = run_shown(simulation, place, display, arguments.checkpoint)
    show_run(results, arguments.verbose)
    return status


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not seconds >= 0.0 or math.isinf(seconds):
        raise argparse.ArgumentTypeError("must be a number of seconds, at least 0")
    return seconds
