"""Recorder "trajectory": positions of all people in each frame, in a file that stays readable if a run is killed."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evac.base.saved import SavedError, taken
from evac.folder.files import TRAJECTORY_NAME
from evac.results.results import versions
from evac.trajectory.header import building_to_json
from evac.trajectory.recorder import Recorder

if TYPE_CHECKING:  # evac.trajectory.writer imports Arrow, which a run without a folder does not need
    from evac.results.results import Results
    from evac.simulation.simulation import Simulation
    from evac.trajectory.writer import TrajectoryWriter


class TrajectoryRecorder(Recorder):
    """Writes ``trajectory.evac`` to the result folder, if there is one, unless ``output.trajectory`` is false."""

    name = "trajectory"
    _writer: "TrajectoryWriter | None" = None

    def start(self, simulation: "Simulation") -> None:
        """Write the header: the building, the groups and the settings of the run."""
        if simulation.folder is not None and simulation.case.output.trajectory:
            from evac.trajectory.writer import TrajectoryWriter

            corners = simulation.scene.shared_scene.building.vertices[:, :2]
            origin = np.round(0.5 * (corners.min(axis=0) + corners.max(axis=0)))
            self._recorded = -1.0
            path, fields = simulation.folder / TRAJECTORY_NAME, simulation.scene.fields_of_behaviours.values()
            self._writer = TrajectoryWriter(path, _header(simulation), origin, [*fields], simulation.dose is not None)

    def record(self, simulation: "Simulation") -> None:
        """Append one frame."""
        if self._writer is not None:
            crowd, scene = simulation.population.crowd, simulation.scene
            changes, fields = scene.changes[self._writer.changes :], [*scene.fields_of_behaviours.values()]
            velocity = simulation.displacement_velocity
            self._writer.append(simulation.time, crowd, velocity, changes, fields, simulation.dose, simulation.standing)
            self._recorded = simulation.time

    def finish(self, simulation: "Simulation", results: "Results | None") -> None:
        """Append the final state, unless it is already recorded, and close the file."""
        if self._writer is not None:
            if simulation.time > self._recorded:
                self.record(simulation)
            self._writer.close()

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the time of the last frame [s] and the length of the file [bytes]."""
        if self._writer is None:
            return {}
        return {"recorded": np.array(self._recorded), "length": np.array(self._writer.length)}

    def check_state(
        self, simulation: "Simulation", state: Mapping[str, NDArray[Any]], folder: Path, files: Mapping[str, int]
    ) -> None:
        """Check that the file is one of this run, with a frame that ends at its length at the checkpoint."""
        is_written = simulation.folder is not None and simulation.case.output.trajectory
        if (TRAJECTORY_NAME in files) != is_written or bool(state) != is_written:
            raise SavedError("length: the checkpoint does not say where the trajectory ends")
        if is_written:
            from evac.trajectory.writer import read_to_continue

            length = files[TRAJECTORY_NAME]
            taken(state, "recorded", np.float64, (), -1.0, simulation.time)
            taken(state, "length", np.int64, (), length, length)
            before = read_to_continue(folder / TRAJECTORY_NAME, length)
            if not np.array_equal(before.radius, simulation.population.crowd.radius):
                raise SavedError(f"length: {TRAJECTORY_NAME} is of other people")
            if list(before.changes) != simulation.scene.changes[: len(before.changes)]:
                raise SavedError(f"length: {TRAJECTORY_NAME} has other changes")
            sizes = [(field.name, field.size) for field in before.level_fields]
            if before.has_dose != (simulation.dose is not None):
                raise SavedError(f"length: {TRAJECTORY_NAME} has doses, or lacks them")
            if sizes != [(field.name, field.size) for field in simulation.scene.fields_of_behaviours.values()]:
                raise SavedError(f"length: {TRAJECTORY_NAME} has other fields")

    def restore(self, simulation: "Simulation", state: Mapping[str, NDArray[Any]]) -> None:
        """Open the file again, after its last frame."""
        if simulation.folder is not None and state:
            from evac.trajectory.writer import TrajectoryWriter

            self._writer = TrajectoryWriter.reopen(simulation.folder / TRAJECTORY_NAME, int(state["length"]))
            self._recorded = float(state["recorded"])

    def files(self) -> Mapping[str, int]:
        """Return the length of the trajectory."""
        return {TRAJECTORY_NAME: self._writer.length} if self._writer is not None else {}


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
