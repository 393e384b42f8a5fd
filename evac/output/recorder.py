"""Recorders: what is kept while a run goes on. The base class of recorder plugins."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from evac.parameters import Configurable

if TYPE_CHECKING:
    from evac.output.results import Results
    from evac.simulation import Simulation


class Recorder(Configurable, ABC):
    """Looks at the simulation at start, at every output time, and at the end; changes nothing.

    The simulation calls `record` every ``output.every`` seconds, at time zero first.
    ``simulation.folder`` is the result folder, or None for a run that writes nothing.
    """

    def start(self, simulation: "Simulation") -> None:
        """Set up before the first step.

        Parameters
        ----------
        simulation : Simulation
            Ready to run; to be looked at only.
        """

    @abstractmethod
    def record(self, simulation: "Simulation") -> None:
        """Take what is wanted at ``simulation.time`` [s].

        Parameters
        ----------
        simulation : Simulation
            Its ``population.crowd`` has the arrays of everybody, and ``displacement_velocity`` how fast they move;
            copy what is kept, for they go on changing.
        """

    def finish(self, simulation: "Simulation", results: "Results | None") -> None:
        """Close what `start` opened.

        Parameters
        ----------
        simulation : Simulation
        results : Results or None
            None where the run ended in an error.
        """
