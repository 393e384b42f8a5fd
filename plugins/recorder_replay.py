"""Recorder "replay": the run as one HTML page, written when the run ends, also after an error."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evac.base.saved import taken
from evac.building.model.elevation import gradients, in_space
from evac.contract.hooks import hookimpl
from evac.folder.files import REPLAY_NAME
from evac.trajectory.recorder import Recorder

if TYPE_CHECKING:
    from evac.replay.motion import MotionPacker
    from evac.results.results import Results
    from evac.simulation.simulation import Simulation


class ReplayRecorder(Recorder):
    """Writes ``replay.html`` to the result folder, if there is one, unless ``output.replay`` is false."""

    name = "replay"
    motion: "MotionPacker | None" = None
    _recorded = -1.0

    def start(self, simulation: "Simulation") -> None:
        """Prepare the page for the building and the people."""
        if simulation.folder is not None and simulation.case.output.replay:
            from evac.pictures.palette import SMOKE
            from evac.replay.motion import MotionPacker

            people, building = len(simulation.population.crowd.radius), simulation.scene.shared_scene.building
            self.motion = MotionPacker(
                people, building, simulation.scene.fields_of_behaviours.get(SMOKE), simulation.case.smoke.contrast
            )
        self._recorded = -1.0

    def record(self, simulation: "Simulation") -> None:
        """Record the present state."""
        if self.motion is not None:
            crowd = simulation.population.crowd
            rows = np.flatnonzero(crowd.level >= 0).astype(np.int32)
            level, time = crowd.level[rows], simulation.time
            velocity = in_space(gradients(self.motion.building), level, simulation.displacement_velocity[rows])
            started = (crowd.start_time[rows] <= time) & ~simulation.standing[rows]
            found = rows, level, crowd.position[rows], velocity, started, crowd.contact_force[rows]
            dose = None if simulation.dose is None else simulation.dose[rows]
            smoke = None if self.motion.field is None else self.motion.field.values
            self.motion.add(time, *found, dose=dose, smoke=smoke)
            self._recorded = simulation.time

    def finish(self, simulation: "Simulation", results: "Results | None") -> None:
        """Record the final state, unless it is already recorded."""
        if simulation.time > self._recorded:
            self.record(simulation)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the compressed record so far."""
        return {} if self.motion is None else {"recorded": np.array([self._recorded])} | self.motion.state()

    def check_state(
        self, simulation: "Simulation", state: Mapping[str, NDArray[Any]], folder: Path, files: Mapping[str, int]
    ) -> None:
        """Check the record by restoring it, which writes no file."""
        self.restore(simulation, state)

    def restore(self, simulation: "Simulation", state: Mapping[str, NDArray[Any]]) -> None:
        """Restore the record of a resumed run."""
        self.start(simulation)
        if self.motion is not None:
            self._recorded = float(taken(state, "recorded", np.float64, (1,), -1.0, simulation.time)[0])
            self.motion.restore(state)


@hookimpl
def evac_finish(simulation: "Simulation", results: "Results | None", error: BaseException | None) -> None:
    """Write the page, also of a failed run, unless the user chose not to wait for results."""
    if error is not None and not isinstance(error, Exception):
        return
    for recorder in simulation.recorders:
        if isinstance(recorder, ReplayRecorder) and recorder.motion is not None and simulation.folder is not None:
            from evac.replay.account import account_of_run
            from evac.replay.writer import write_page

            account = account_of_run(simulation.results() if results is None else results, error)
            write_page(simulation.folder / REPLAY_NAME, recorder.motion, account, simulation.scene.changes)
