"""Recorder "replay": the run as one HTML page, made from the trajectory when the run has ended, also after an error."""

from typing import TYPE_CHECKING

from evac.contract.hooks import hookimpl
from evac.folder.files import REPLAY_NAME
from evac.trajectory.recorder import Recorder

if TYPE_CHECKING:
    from evac.results.results import Results
    from evac.simulation.simulation import Simulation


class ReplayRecorder(Recorder):
    """Writes ``replay.html`` to the result folder, if there is one, unless ``output.replay`` is false.

    The page is made from the trajectory: without one (``output.trajectory = false``) there is none.
    """

    name = "replay"

    def record(self, simulation: "Simulation") -> None:
        """Record nothing, which the recorder of the trajectory does."""


@hookimpl
def evac_finish(simulation: "Simulation", results: "Results | None", error: BaseException | None) -> None:
    """Write the page, also of a failed run, unless the user chose not to wait for results."""
    output, folder = simulation.case.output, simulation.folder
    is_wanted = output.replay and output.trajectory and "replay" in [recorder.name for recorder in simulation.recorders]
    if folder is not None and is_wanted and (error is None or isinstance(error, Exception)):
        from evac.replay.writer import replay_run

        replay_run(simulation.results() if results is None else results, folder / REPLAY_NAME, error)
