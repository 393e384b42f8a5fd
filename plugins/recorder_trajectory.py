"""Recorder "trajectory": where everybody is, frame by frame, in a file that survives a killed run."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from evac.hookspecs import hookimpl
from evac.output.files import TRAJECTORY_NAME
from evac.output.header import building_to_json
from evac.output.recorder import Recorder
from evac.output.results import versions
from evac.output.trajectory import TrajectoryWriter

if TYPE_CHECKING:
    from evac.output.results import Results
    from evac.simulation import Simulation


class TrajectoryRecorder(Recorder):
    """Writes ``trajectory.evac`` to the result folder (docs/trajectory.md); nothing without a folder, or where
    ``output.trajectory`` is false.
    """

    name = "trajectory"
    _writer: TrajectoryWriter | None = None

    def start(self, simulation: "Simulation") -> None:
        """Write the header: the building, the groups and what the run was made with."""
        if simulation.folder is not None and simulation.case.output.trajectory:
            corners = simulation.building.vertices[:, :2]
            origin = np.round(0.5 * (corners.min(axis=0) + corners.max(axis=0)))
            self._recorded = -1.0
            self._writer = TrajectoryWriter(simulation.folder / TRAJECTORY_NAME, _header(simulation), origin)

    def record(self, simulation: "Simulation") -> None:
        """Append one frame."""
        if self._writer is not None:
            self._writer.append(simulation.time, simulation.population.crowd, simulation.displacement_velocity)
            self._recorded = simulation.time

    def finish(self, simulation: "Simulation", results: "Results | None") -> None:
        """Append the state at the end, unless it is there already, and close the file."""
        if self._writer is not None:
            if simulation.time > self._recorded:
                self.record(simulation)
            self._writer.close()


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
        "radius": population.crowd.radius.tolist(),
        "building": building_to_json(simulation.building),
    }


evac_interface = 2


@hookimpl
def evac_recorders() -> Sequence[type[Recorder]]:
    """Return the recorder of trajectories."""
    return [TrajectoryRecorder]
