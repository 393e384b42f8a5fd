"""Recorders "trajectory", positions of all people in each frame, and "replay", the page that shows them.

The file of the trajectory stays readable if a run is killed.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evac.base.saved import SavedError
from evac.contract.hooks import hookimpl
from evac.folder.files import REPLAY_NAME, TRAJECTORY_NAME
from evac.results.results import Results, versions
from evac.trajectory.recorder import Recorder
from evac.trajectory.trajectory import IN_MEMORY, TrajectoryWriter, building_to_json

if TYPE_CHECKING:
    from evac.simulation.simulation import Simulation


class TrajectoryRecorder(Recorder):
    """Writes ``trajectory.evac`` to the result folder, or to memory, unless ``output.trajectory`` is false."""

    name = "trajectory"
    saved = ("_recorded", "_changes")
    _writer: TrajectoryWriter | None = None
    _recorded = -1.0  # time of the last frame [s]
    _changes = 0  # number of changes that have been written

    def start(self, simulation: "Simulation") -> None:
        """Write the header: the building, the groups and the settings of the run."""
        self._open(simulation)

    def record(self, simulation: "Simulation") -> None:
        """Append one frame."""
        if self._writer is not None:
            crowd, scene = simulation.population.crowd, simulation.scene
            changes, fields = scene.changes[self._changes :], [*scene.fields_of_behaviours.values()]
            velocity = simulation.displacement_velocity
            self._writer.append(simulation.time, crowd, velocity, changes, fields, simulation.dose, simulation.standing)
            self._recorded, self._changes = simulation.time, len(scene.changes)

    def finish(self, simulation: "Simulation", results: Results | None) -> None:
        """Append the final state, unless it is already recorded, and close the file."""
        if self._writer is not None:
            if simulation.time > self._recorded:
                self.record(simulation)
            self._writer.close()

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the time of the last frame [s] and the number of changes written, if there is a file."""
        return {} if self._writer is None else super().state()

    def check_state(
        self, simulation: "Simulation", state: Mapping[str, NDArray[Any]], folder: Path, files: Mapping[str, int]
    ) -> None:
        """Check that the state is that of a run with, or without, a trajectory."""
        is_written = simulation.folder is not None and simulation.case.output.trajectory
        if (TRAJECTORY_NAME in files) != is_written:
            raise SavedError(f"{TRAJECTORY_NAME}: the checkpoint does not say where it ends")
        if is_written:
            super().restore(simulation, state)

    def restore(  # type: ignore[override]
        self, simulation: "Simulation", state: Mapping[str, NDArray[Any]]
    ) -> None:
        """Open the file again, whose last frame is that of the checkpoint, which has been checked."""
        if simulation.folder is not None and state:
            self._open(simulation, (simulation.folder / TRAJECTORY_NAME).stat().st_size)

    def files(self) -> Mapping[str, int]:
        """Return the length of the trajectory."""
        if self._writer is None or self._writer.memory is not None:
            return {}
        return {TRAJECTORY_NAME: self._writer.length}

    def _open(self, simulation: "Simulation", length: int = 0) -> None:
        """Write a new file, or continue one after so many bytes."""
        memory = None if simulation.folder is not None else simulation.recording.memory
        if (simulation.folder is not None or memory is not None) and simulation.case.output.trajectory:
            corners = simulation.scene.shared_scene.building.vertices[:, :2]
            origin = np.round(0.5 * (corners.min(axis=0) + corners.max(axis=0)))
            path = (simulation.folder or IN_MEMORY) / TRAJECTORY_NAME
            fields = [*simulation.scene.fields_of_behaviours.values()]
            has_dose = simulation.dose is not None
            self._writer = TrajectoryWriter(path, _header(simulation), origin, fields, has_dose, length, memory)


class ReplayRecorder(Recorder):
    """Writes ``replay.html`` to the result folder, if there is one, unless ``output.replay`` is false.

    The page is made from the trajectory: without one (``output.trajectory = false``) there is none.
    """

    name = "replay"

    def record(self, simulation: "Simulation") -> None:
        """Record nothing, which the recorder of the trajectory does."""


@hookimpl
def evac_finish(simulation: "Simulation", results: Results | None, error: BaseException | None) -> None:
    """Write the page, also of a failed run, unless the user chose not to wait for results."""
    output, folder = simulation.case.output, simulation.folder
    is_wanted = output.replay and output.trajectory and "replay" in [recorder.name for recorder in simulation.recorders]
    if folder is not None and is_wanted and (error is None or isinstance(error, Exception)):
        from evac.replay.writer import replay_run

        replay_run(simulation.results() if results is None else results, folder / REPLAY_NAME, error)


def _header(simulation: "Simulation") -> dict[str, Any]:
    population = simulation.population
    group = np.full(len(population.crowd.radius), -1)
    for index, members in enumerate(population.groups):
        group[members.rows] = index
    return {
        "title": simulation.case.title,
        "seed": simulation.seed,
        "versions": dict(versions()),
        "groups": [members.name for members in population.groups],
        "group": group.tolist(),
        "arriving": [one.name for one in simulation.case.people if one.arrive is not None],
        "radius": population.crowd.radius.tolist(),
        "height": population.crowd.height.tolist(),
        "contrast": simulation.case.smoke.contrast,
        "building": building_to_json(simulation.scene.shared_scene.building),
    }
