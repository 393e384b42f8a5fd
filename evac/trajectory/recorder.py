"""Base class of recorder plugins, which record data during a run."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from evac.base.parameters import Configurable
from evac.base.saved import Saved

if TYPE_CHECKING:
    from evac.results.results import Results
    from evac.simulation.simulation import Simulation


class Recorder(Configurable, Saved, ABC):
    """Reads the simulation at the start, at every output time and at the end, without changing it.

    The simulation calls `record` every ``output.every`` seconds, beginning at time zero. ``simulation.folder`` is the
    result folder, or None for a run that writes no files. Attributes named in ``saved`` are part of checkpoints, within
    the bounds of ``bounds()``, as those of behaviours are.
    """

    def start(self, simulation: "Simulation") -> None:
        """Set up before the first step.

        Parameters
        ----------
        simulation : Simulation
            A simulation that is ready to run; must not be modified.
        """

    @abstractmethod
    def record(self, simulation: "Simulation") -> None:
        """Record the state at ``simulation.time`` [s].

        Parameters
        ----------
        simulation : Simulation
            ``population.crowd`` contains the arrays of all people, ``displacement_velocity`` their velocities. The
            arrays change during the run: copy those that are kept.
        """

    def finish(self, simulation: "Simulation", results: "Results | None") -> None:
        """Finish recording: write the remaining data and close files.

        Parameters
        ----------
        simulation : Simulation
        results : Results or None
            None if the run ended with an error.
        """

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the data kept between two calls of `record` as arrays, for checkpoints.

        By default those that `saved` names. A recorder with other attributes than its parameters must name them, or
        override this method, or checkpoints raise an error.

        Returns
        -------
        dict of str to array
            Arrays of booleans, integers or floats, by any names; they are copied.
        """
        return super().state()

    def restore(  # type: ignore[override]
        self, simulation: "Simulation", state: Mapping[str, NDArray[Any]]
    ) -> None:
        """Restore what `state` returned; called instead of `start` in a run that is resumed.

        Parameters
        ----------
        simulation : Simulation
            The simulation at the time of the checkpoint; its folder contains the files of the recorder.
        state : mapping of str to array
        """
        super().restore(dict(state))

    def check_state(
        self, simulation: "Simulation", state: Mapping[str, NDArray[Any]], folder: Path, files: Mapping[str, int]
    ) -> None:
        """Raise an error if a saved state cannot be restored; called before a run that is resumed changes its folder.

        By default, every state is accepted.

        Parameters
        ----------
        simulation : Simulation
            The simulation at the time of the checkpoint.
        state : mapping of str to array
            As for `restore`; `evac.base.saved.taken` checks an array.
        folder : Path
            Where the files are now; they may be longer than at the checkpoint.
        files : mapping of str to int
            What `files` returned at the checkpoint.
        """

    def files(self) -> Mapping[str, int]:
        """Return the files that the recorder appends to, and the number of bytes written to each.

        When a run is resumed, they are truncated to these lengths before `restore` is called. When a run ends, it
        checks that they exist.

        Returns
        -------
        mapping of str to int
            Names relative to ``simulation.folder``.
        """
        return {}
