"""Commands that run a case into a result folder: evac run, evac resume."""

import argparse
import math
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from evac.base.display import Display
from evac.cli import inputs
from evac.cli.screen import STYLES, height, note, notify, say, show_facts, show_table, show_warnings, wrapped
from evac.folder.files import ANIMATION_NAME, CHECKPOINT_NAME, REPLAY_NAME, read_manifest

if TYPE_CHECKING:
    from evac.folder.resultfolder import ResultFolder
    from evac.physics.state import Crowd
    from evac.results.results import Results
    from evac.simulation.simulation import Simulation


#: Signals that stop a run at the end of its tick; Windows has no SIGHUP, other systems no SIGBREAK.
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")


def declare_run(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac run`."""
    inputs.declare_case(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="result folder (default: ./CASE-result)")
    what = "compute also the parts that the case does not need: slower, with the same trajectories"
    parser.add_argument("--full", action="store_true", help=what)
    watch = "open the page of `evac edit` in the browser, on which people move while the run is computed"
    parser.add_argument("--watch", action="store_true", help=watch)
    parser.add_argument("--vtk", action="store_true", help="write the VTK animation as well (output.animation=true)")
    declare_checkpoint(parser, "none")
    declare_verbose(parser)


def declare_checkpoint(parser: argparse.ArgumentParser, default: str) -> None:
    """Add --checkpoint to a command."""
    what = f"save a checkpoint every S seconds of wall time, for `evac resume` (default: {default})"
    parser.add_argument("--checkpoint", type=_seconds, metavar="S", help=what)


def declare_verbose(parser: argparse.ArgumentParser) -> None:
    """Add --verbose to a command."""
    what = "show tables of exits, stairs, contacts and wall time, and quality warnings in full"
    parser.add_argument("--verbose", action="store_true", help=what)


def execute_run(arguments: argparse.Namespace) -> int:
    """Run a case and write its results.

    Results are written to ./CASE-result, or to --out: a new or empty folder, or the result folder of an earlier run,
    which is replaced when this run has ended; other files in it are kept. During the run, results are in
    RESULT.running. A run that is stopped by Ctrl-C, SIGTERM or SIGHUP saves its tables and its state: `evac resume
    RESULT` continues it.
    """
    with Display() as display:
        display.phase("reading the case")
        case = inputs.case_to_run(arguments)
        if arguments.watch:
            display.line(_watched(case.source, arguments.out or inputs.default_folder(case)))
        if arguments.vtk:
            case = case.change({"output.animation": True})
        from evac.folder.resultfolder import ResultFolder
        from evac.simulation.simulation import Simulation

        with ResultFolder(arguments.out or inputs.default_folder(case)) as place:
            if place.is_left_over:
                has_state = (place.running / CHECKPOINT_NAME).is_file()
                hint = f" (evac resume {place.path} would have continued it)" if has_state else ""
                display.line(f"evac: replacing {place.running} of an unfinished run{hint}")
            display.phase("reading the building, computing directions")
            simulation = Simulation(case, place.running, arguments.full, workers=None, compiling=display.compiling)
            place.start()
            results, status = run_shown(simulation, place, display, arguments.checkpoint)
    show_run(results, arguments.verbose)
    return status


def _watched(case_file: Path, folder: Path) -> str:
    """Open the page on a run in a process of its own, which ends some time after the page is closed; return a line."""
    command = [sys.executable, "-m", "evac", "edit", str(case_file), "--out", str(folder)]
    null = subprocess.DEVNULL  # so that nobody who reads what the run prints waits for the page
    page = subprocess.Popen(command, stdin=null, stdout=subprocess.PIPE, stderr=null, start_new_session=True)
    assert page.stdout is not None
    with page.stdout:
        address = next((line.split()[-1].decode() for line in page.stdout if line.startswith(b"address")), None)
    return f"the run is shown at {address}" if address else f"no page is shown: evac edit {case_file} tells why"


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not seconds >= 0.0 or math.isinf(seconds):
        raise argparse.ArgumentTypeError("must be a number of seconds, at least 0")
    return seconds


def declare_resume(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac resume`."""
    parser.add_argument("result", type=Path, metavar="RESULT", help="result folder of the interrupted run")
    case = "case of the run; needed if it names plugin files and is not beside RESULT"
    parser.add_argument("--case", type=Path, metavar="FILE", help=case)
    declare_checkpoint(parser, "as the interrupted run")
    declare_verbose(parser)
    differences = "continue, with a note, even if versions, kernels, plugins or the file of the building have changed"
    parser.add_argument("--allow-differences", action="store_true", help=differences)
    inputs.declare_plugin(parser)


def execute_resume(arguments: argparse.Namespace) -> int:
    """Continue a run that was killed or stopped, from its last checkpoint.

    On the same machine, with the same versions, plugins and building, the results are bitwise those of a run without
    interruption, except wall times.
    """
    with Display() as display:
        display.phase("reading the checkpoint")
        from evac.folder.resultfolder import ResultFolder
        from evac.simulation.running import resumed

        with ResultFolder(arguments.result) as place:
            simulation, every = resumed(
                place,
                arguments.plugins,
                allow_differences=arguments.allow_differences,
                case_file=arguments.case,
                compiling=display.compiling,
                announce=inputs.announce_plugin_file,
            )
            display.line(f"evac: resuming at {simulation.time:.2f} s in {place.running}")
            checkpoint = every if arguments.checkpoint is None else arguments.checkpoint
            results, status = run_shown(simulation, place, display, checkpoint)
    show_run(results, arguments.verbose)
    return status


def run_shown(
    simulation: "Simulation", place: "ResultFolder", display: Display, checkpoint: float | None
) -> "tuple[Results, int]":
    """Show warnings, run with a display, and write the results; return them with the status (see EPILOG of main.py)."""
    from evac.results.ending import INTERRUPTED
    from evac.simulation.running import Interrupt, run_into

    def announce(number: int) -> None:
        hint = "; Ctrl-C again to stop at once" if number == signal.SIGINT else ""
        notify(f"\nevac: stopping at the end of this tick{hint}")

    before = simulation.warnings()
    for warning in before:
        display.line(wrapped(f"warning: {warning}", sys.stderr))
    display.phase("first tick")
    with Interrupt(SIGNALS, announce) as interrupt:
        results = run_into(
            simulation, place, display, interrupt, checkpoint, lambda: display.phase("writing the results")
        )
    for warning in results.warnings:
        if warning not in before:
            display.line(wrapped(f"warning: {warning}", sys.stderr))
    _ = results.answer  # which is kept, and whose measurements the display shows
    return results, 128 + interrupt.wanted if results.ended == INTERRUPTED else results.exit_status


def show_run(results: "Results", verbose: bool) -> None:
    """Show the answer of a run; if verbose, all tables before it, with quality warnings in full, as in logs."""
    from evac.results.ending import INTERRUPTED

    assert results.folder is not None
    if verbose:
        show_results(results)
    if verbose or not sys.stderr.isatty():
        for line in results.remarks:
            note(f"evac: {line}")
        show_warnings(results.quality_warnings)
    folder_shown = folder_line(results.folder)
    show_answer(results, height(folder_shown))
    say(folder_shown)
    if results.ended == INTERRUPTED:
        folder = str(results.folder).removesuffix(".running")
        beside = "" if folder == str(results.folder) else f"; the earlier results stay in {folder}"
        has_state = (results.folder / CHECKPOINT_NAME).is_file()
        how = f"; continue with: evac resume {folder}" if has_state else "; no state was saved, it cannot be resumed"
        note(f"evac: interrupted at {results.time:.2f} s{beside}{how}")


MOST_LISTED = 20  #: Maximum number of listed people without progress; summary.json has all of them.


MOST_LINES = 12  #: Maximum number of lines that the answer takes on a terminal, with the line of the result folder.


def show_answer(results: "Results", below: int = 1) -> None:
    """Show verdict, who is out and the times, and as many other lines as `MOST_LINES` has room for, less `below`."""
    from evac.base.change import changes_in_words

    answer, title = results.answer, results.title or Path(results.source).name
    told = "; ".join(f"{words} at {time:g} s" for time, words in changes_in_words(results.changes))
    changes = f"Changes: {told}" if told else ""
    warnings = f"{answer.warnings}; --verbose shows all" if answer.warnings else ""
    full = answer.verdict, answer.outcome, answer.times
    others = warnings, *answer.exits, answer.queue, *answer.remarks, changes, title, answer.movement
    kept = {*[line for line in others if line][: MOST_LINES - below - sum(map(height, full))]}
    kept |= {line for line in full if line}
    styles = {answer.verdict: STYLES[results.verdict["status"]], title: "bold", answer.outcome: "bold"}
    notes = *answer.exits, changes, *answer.remarks, answer.queue, answer.movement, warnings
    for line in (answer.verdict, title, answer.outcome, answer.times, *notes):
        if line in kept:
            say(line, None if line in full else 1, styles.get(line, ""))


def show_results(results: "Results") -> None:
    """Show all tables: those of reports, people left inside, contact, and wall time by phase."""
    from evac.results.tables import TABLES

    summary = results.summary()
    simulated = f"{summary['simulated_time']:.2f} s in {summary['steps']} steps, seed {summary['seed']}"
    starts = response_times(results.crowd)
    show_facts({"people": summary["people"], "response times": starts, "simulated": simulated})
    if results.safety is not None:
        from evac.results.verdict import judged

        heads = ("compartment", "required [s]", "available [s]", "margin [s]", "with the factor [s]")
        keys = ("name", "required", "limit", "margin", "margin_with_factor")
        times = [[row[key] for key in keys] for row in judged(results.safety)]
        show_table("Available and required times", heads, times)
    for name, kind in TABLES.items():
        own = results.tables.get(name, ())
        show_table(kind.caption, kind.head, [[kind.never if cell == math.inf else cell for cell in row] for row in own])
    stuck = summary["stuck"]
    rows = [(own["person"], own["level"], round(own["x"], 2), round(own["y"], 2)) for own in stuck[:MOST_LISTED]]
    more = "" if len(stuck) <= MOST_LISTED else f", the first {MOST_LISTED} of {len(stuck)} (all in summary.json)"
    show_table(f"Without progress at the end{more}", ("person", "level", "x [m]", "y [m]"), rows)
    contact = summary["contact"]
    parts = [(name.replace("_", " "), value) for name, value in contact.items() if isinstance(value, int | float | str)]
    parts += [(f"{name.replace('_', ' ')} [J]", value) for name, value in contact["energy"].items()]
    show_table("Contact; see summary.json", ("quantity", "value"), parts)
    wall = summary["wall_time"]
    phases = [*wall.items(), ("all", sum(wall.values()))]
    show_table("Wall time", ("phase", "s"), [(name, round(seconds, 3)) for name, seconds in phases])


def folder_line(folder: Path) -> str:
    """Return the line that names the result folder and the files in it that are played, shown last."""
    shown = {REPLAY_NAME: "browser", ANIMATION_NAME: "ParaView"}
    written = read_manifest(folder).files
    files = [f", {name} ({where})" for name, where in shown.items() if name in written and (folder / name).is_file()]
    return f"results in  {folder}{''.join(files)}"


def response_times(crowd: "Crowd") -> str:
    """Describe when people start to walk."""
    import numpy as np

    times = crowd.start_time
    times = times[np.isfinite(times)]  # of those who start
    if not times.any():
        return "none: everybody starts at 0 s"
    return f"{times.min():.4g} to {times.max():.4g} s"
