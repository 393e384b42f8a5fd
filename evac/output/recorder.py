"""Recorders: what is kept while a run goes on. The base class of recorder plugins."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

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

    def state(self) -> dict[str, NDArray[Any]]:
        """Return arrays of what it keeps between two calls of `record`, for checkpoints.

        A recorder that keeps nothing but its parameters needs no method of its own. One that does, and has none, is
        refused by name where a checkpoint is asked for.

        Returns
        -------
        dict of str to array
            Of booleans, integers or floats, by names of its own; they are copied.
        """
        return {}

    def restore(self, simulation: "Simulation", state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what `state` returned; called in place of `start` in a run that is resumed.

        Parameters
        ----------
        simulation : Simulation
            At the time of the checkpoint; its folder is the one the recorder has written to.
        state : mapping of str to array
        """

    def files(self) -> Mapping[str, int]:
        """Return the files that it appends to, and how many bytes of each it has handed to the system.

        A run that is resumed cuts them to these lengths before `restore` is called, and a run that ends looks whether
        they are there.

        Returns
        -------
        mapping of str to int
            Names relative to ``simulation.folder``.
        """
        return {}
