"""Code shared by `evac run` and `evac resume`: run with a display, stop at signals, show tables."""

import signal
import sys
from typing import TYPE_CHECKING

from evac.base.display import Display
from evac.cli.streams import note, notify, wrapped

if TYPE_CHECKING:
    from evac.folder.resultfolder import ResultFolder
    from evac.results.results import Results
    from evac.simulation.simulation import Simulation

#: Signals that stop a run at the end of its tick; Windows has no SIGHUP, other systems no SIGBREAK.
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")


def run_shown(
    simulation: "Simulation", place: "ResultFolder", display: Display, checkpoint: float | None
) -> "tuple[Results, int]":
    """Show the warnings before a run, run it with a display, and write its results; return them with the exit status.

    The status is 0 if everybody is out, 3 if people are left, and 128 + the number of the signal that stopped the run.
    """
    from evac.base.interrupt import Interrupt
    from evac.results.ending import INTERRUPTED
    from evac.simulation.running import run_into

    def announce(number: int) -> None:
        hint = "; Ctrl-C again to stop at once" if number == signal.SIGINT else ""
        notify(f"\nevac: stopping at the end of this tick{hint}")

    before = simulation.warnings()
    for warning in before:
        display.line(wrapped(f"warning: {warning}", sys.stderr))
    display.phase("first tick")
    with Interrupt(SIGNALS, announce) as interrupt:

        def writing() -> None:
            interrupt.release(signal.SIGINT)
            display.phase("writing the results")

        results = run_into(simulation, place, display, interrupt, checkpoint, writing)
    for warning in results.warnings:
        if warning not in before:
            display.line(wrapped(f"warning: {warning}", sys.stderr))
    return results, 128 + interrupt.wanted if results.ended == INTERRUPTED else results.exit_status


def show_run(results: "Results", verbose: bool) -> None:
    """Show the answer of a run; if verbose, all tables before it, with quality warnings in full, as in logs."""
    from evac.cli.outcome import folder_line, show_answer, show_results
    from evac.cli.screen import height, say, show_warnings
    from evac.folder.files import CHECKPOINT_NAME
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
