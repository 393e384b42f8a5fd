"""evac run: run a case and write its results.

Results go to ./CASE-result, or to --out: a new or empty folder, or the result folder of an earlier run,
whose files are replaced; other files are never touched. A run that is stopped by Ctrl-C keeps what it has.
"""

import argparse
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Self

from evac.cli.cases import case_of, declare_case, default_folder
from evac.cli.main import INTERRUPTED_STATUS
from evac.cli.progress import Display

if TYPE_CHECKING:
    from evac.phases import Progress


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_case(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="result folder (default: ./CASE-result)")
    parser.add_argument(
        "--full", action="store_true", help="do even what the scene does not need: the same trajectories, slower"
    )
    parser.add_argument("--vtk", action="store_true", help="write the VTK animation as well (output.animation=true)")
    parser.add_argument(
        "--tolerance",
        type=float,
        metavar="METRES",
        help="choose step and solver tolerances for this error of positions (instead of those of the case)",
    )


def execute(arguments: argparse.Namespace) -> int:
    """Run, write, report; return 0 if everybody is out, 3 if people are left, 130 if interrupted."""
    with Display() as display:
        display.phase("reading the case")
        from evac.scenario.tolerance import settings_for

        case = case_of(arguments)
        chosen = {} if arguments.tolerance is None else settings_for(case, arguments.tolerance)
        changes = chosen | ({"output.animation": True} if arguments.vtk else {})
        case = case.change(changes) if changes else case
        from evac.cli.report import show_results
        from evac.cli.screen import show_facts, show_warnings
        from evac.ending import INTERRUPTED
        from evac.running import check_folder, run_into
        from evac.simulation import Simulation

        folder = arguments.out or default_folder(case)
        check_folder(folder)
        display.phase("reading the building, computing directions")
        simulation = Simulation(case, folder, arguments.full, compiling=display.compiling)
        display.phase("first tick")
        with _Interrupt(display) as progress:

            def writing() -> None:
                progress.release()
                display.phase("writing the results")

            results = run_into(simulation, folder, progress, writing)
    show_warnings(results.warnings)
    show_facts({f"{key} (from --tolerance)": value for key, value in chosen.items()})
    show_results(results, folder)
    show_warnings(results.quality_warnings)
    return INTERRUPTED_STATUS if results.ended == INTERRUPTED else results.exit_status


class _Interrupt:
    """Takes the first Ctrl-C as a wish to stop at the end of the tick; the second stops at once, without results."""

    def __init__(self, display: Callable[["Progress"], None]) -> None:
        self.display = display
        self.is_wanted = False

    def __call__(self, state: "Progress") -> None:
        """Show the state of the run, or stop it."""
        from evac.ending import Stopped

        self.display(state)
        if self.is_wanted:
            raise Stopped

    def __enter__(self) -> Self:
        self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def release(self) -> None:
        """Let Ctrl-C mean again what it meant before."""
        signal.signal(signal.SIGINT, self._before)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.is_wanted = True
        os.write(sys.stderr.fileno(), b"\nevac: stopping at the end of this tick; Ctrl-C again to stop at once\n")
        self.release()
