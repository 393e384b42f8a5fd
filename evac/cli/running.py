"""Code shared by `evac run` and `evac resume`: run with a display, stop at signals, show tables."""

import signal
import sys
from collections.abc import Callable, Mapping
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any, Self

from evac.cli.streams import notify
from evac.display import Display

if TYPE_CHECKING:
    from evac.output.resultfolder import ResultFolder
    from evac.output.results import Results
    from evac.phases import Progress
    from evac.simulation import Simulation

#: Signals that stop a run at the end of its tick; Windows has no SIGHUP, other systems no SIGBREAK.
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")


def run_shown(
    simulation: "Simulation", place: "ResultFolder", display: Display, checkpoint: float | None
) -> "tuple[Results, int]":
    """Run a simulation with a display, and write its results; return them with the exit status.

    The status is 0 if everybody is out, 3 if people are left, and 128 + the number of the signal that stopped the run.
    """
    from evac.ending import INTERRUPTED
    from evac.running import run_into

    display.phase("first tick")
    with Interrupt(display) as progress:

        def writing() -> None:
            progress.release(signal.SIGINT)
            display.phase("writing the results")

        results = run_into(simulation, place, progress, checkpoint=checkpoint, writing=writing)
    return results, 128 + progress.wanted if results.ended == INTERRUPTED else results.exit_status


def show_run(results: "Results", chosen: Mapping[str, Any]) -> None:
    """Show the tables and warnings of a run; `chosen` are settings that the command has chosen."""
    from evac.cli.report import show_results
    from evac.cli.screen import show_facts, show_warnings
    from evac.ending import INTERRUPTED
    from evac.output.files import CHECKPOINT_NAME

    assert results.folder is not None
    show_warnings(results.warnings)
    show_facts(chosen)
    show_results(results, results.folder)
    show_warnings(results.quality_warnings)
    if results.ended == INTERRUPTED:
        folder = str(results.folder).removesuffix(".running")
        beside = "" if folder == str(results.folder) else f"; the earlier results stay in {folder}"
        has_state = (results.folder / CHECKPOINT_NAME).is_file()
        how = f"; continue with: evac resume {folder}" if has_state else "; no state was saved, it cannot be resumed"
        print(f"evac: interrupted at {results.time:.2f} s{beside}{how}", file=sys.stderr)


class Interrupt:
    """Stops the run at the end of the tick after the first signal; a second Ctrl-C stops at once, without results.

    Signals that were ignored before, such as SIGHUP under nohup, remain ignored.

    Attributes
    ----------
    wanted : int
        Number of the signal received; 0 if there was none.
    """

    def __init__(self, display: Callable[["Progress"], None]) -> None:
        self.display = display
        self.wanted = 0
        self._before: dict[int, Any] = {}

    def __call__(self, state: "Progress") -> None:
        """Show the state of the run, or stop it."""
        from evac.ending import Stopped

        self.display(state)
        if self.wanted:
            raise Stopped

    def __enter__(self) -> Self:
        numbers = [getattr(signal, name) for name in SIGNALS if hasattr(signal, name)]
        for number in numbers:
            if signal.getsignal(number) != signal.SIG_IGN:
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number in list(self._before):
            self.release(number)

    def release(self, number: int) -> None:
        """Restore the previous handler of a signal."""
        if number in self._before:
            signal.signal(number, self._before.pop(number))

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.wanted = number
        hint = "; Ctrl-C again to stop at once" if number == signal.SIGINT else ""
        notify(f"\nevac: stopping at the end of this tick{hint}")
        self.release(signal.SIGINT)
