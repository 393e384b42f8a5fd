"""The recorders of a run: started, called and finished together; and what each needs to go on from a checkpoint."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from evac.errors import EvacError, PluginError, ResultError, plugin_code
from evac.output.files import sync_file, writing
from evac.output.recorder import Recorder
from evac.output.resultfolder import files_of_others, is_written

if TYPE_CHECKING:
    from evac.output.results import Results
    from evac.registry import Registry
    from evac.simulation import Simulation


class Recording:
    """Calls the recorders of a run, and names the one that fails.

    Parameters
    ----------
    recorders : sequence of Recorder
    folder : Path or None
        Where they write.

    Attributes
    ----------
    is_started : bool
        Whether they have recorded the start.
    """

    def __init__(self, recorders: Sequence[Recorder], folder: Path | None) -> None:
        self.recorders = list(recorders)
        self.is_started = False
        self._folder = folder
        self._made: set[str] = set()  # files that have appeared while plugins started or finished

    def start(self, simulation: "Simulation") -> None:
        """Start the recorders, and record the time at which the simulation is."""
        self.is_started = True
        with self._noting_files():
            for recorder in self.recorders:
                with plugin_code(f"recorder {recorder.name!r}: start"):
                    recorder.start(simulation)
        self.record(simulation)

    def record(self, simulation: "Simulation") -> None:
        """Let every recorder look, after a look whether what they have written is there."""
        self.check_files()
        for recorder in self.recorders:
            with plugin_code(f"t = {simulation.time:.3f} s: recorder {recorder.name!r}"):
                recorder.record(simulation)

    def finish(
        self,
        simulation: "Simulation",
        registry: "Registry",
        results: "Results | None",
        error: BaseException | None,
    ) -> None:
        """Let every recorder and plugin finish; then raise what failed first, unless the run has failed already."""
        calls: list[tuple[str, Callable[[], Any]]] = []
        if self.is_started and error is None:
            calls.append(("recorders", self.check_files))
        for recorder in self.recorders if self.is_started else ():
            calls.append((f"recorder {recorder.name!r}: finish", partial(recorder.finish, simulation, results)))
        for plugin, call in registry.calls("evac_finish", simulation=simulation, results=results, error=error):
            calls.append((f"{plugin}: evac_finish", call))
        failures = []
        with self._noting_files():
            for what, call in calls:
                try:
                    with plugin_code(what):
                        call()
                except EvacError as failure:
                    failures.append(failure)
        for one in failures:
            if error is None:
                raise one
            error.add_note(f"then: {one}")

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of what the recorders keep, by ``NAME.key``."""
        state: dict[str, NDArray[Any]] = {}
        for recorder in self.recorders:
            with plugin_code(f"recorder {recorder.name!r}: state"):
                state |= {f"{recorder.name}.{key}": value.copy() for key, value in recorder.state().items()}
        return state

    def files(self) -> dict[str, int]:
        """Return the files that the recorders have written so far and their lengths [bytes]."""
        files: dict[str, int] = {}
        for recorder in self.recorders:
            with plugin_code(f"recorder {recorder.name!r}: files"):
                files |= {str(name): int(length) for name, length in recorder.files().items()}
        return files

    def plugin_files(self) -> list[str]:
        """Return the files of plugins: those that recorders name, and those that appeared as they started or finished.

        Files that evac writes itself are not among them.
        """
        return sorted(name for name in {*self._made, *self.files()} if not is_written(name))

    @contextmanager
    def _noting_files(self) -> Iterator[None]:
        """Note which files of plugins appear."""
        before = self._files_there()
        try:
            yield
        finally:
            self._made |= self._files_there() - before

    def _files_there(self) -> set[str]:
        return files_of_others(self._folder) if self._folder is not None and self._folder.is_dir() else set()

    def sync(self) -> dict[str, int]:
        """As `files`, once what they say is on the disk."""
        files = self.files()
        if self._folder is not None:
            for name in files:
                with writing(f"{name} at the checkpoint", self._folder):
                    sync_file(self._folder / name)
        return files

    def check_files(self) -> None:
        """See that the files of the recorders are as long as these say.

        Raises
        ------
        ResultError
            One is missing or shorter, as where somebody has removed or cut it during the run.
        """
        if self._folder is not None:
            check_lengths(self._folder, self.files())

    def restore(
        self,
        simulation: "Simulation",
        state: Mapping[str, NDArray[Any]],
        files: Mapping[str, int],
        plugin_files: Iterable[str] = (),
    ) -> None:
        """Cut the files to the lengths that they had, and let the recorders go on from there.

        Parameters
        ----------
        simulation : Simulation
            Restored.
        state, files, plugin_files
            As the methods of these names returned them.

        Raises
        ------
        ResultError
            A file is missing or shorter than it was.
        """
        if self._folder is not None:
            check_lengths(self._folder, files)
            for name, length in files.items():
                with writing(name, self._folder):
                    os.truncate(self._folder / name, length)
        self.is_started = True
        self._made = set(plugin_files)
        for recorder in self.recorders:
            prefix = f"{recorder.name}."
            own = {key[len(prefix) :]: value for key, value in state.items() if key.startswith(prefix)}
            with plugin_code(f"recorder {recorder.name!r}: restore"):
                recorder.restore(simulation, own)


def metrics(registry: "Registry", results: "Results") -> Iterator[tuple[str, Any]]:
    """Yield what each plugin's evac_metrics returns; one that fails does not take the results with it."""
    for plugin, call in registry.calls("evac_metrics", results=results):
        try:
            with plugin_code(f"{plugin}: evac_metrics"):
                yield plugin, call()
        except PluginError as error:
            yield plugin, {"error": str(error)}


def check_lengths(folder: Path, files: Mapping[str, int]) -> None:
    """Refuse a folder in which a file is missing or shorter than it should be.

    Raises
    ------
    ResultError
        Naming the file.
    """
    for name, length in files.items():
        try:
            found = (folder / name).stat().st_size
        except OSError:
            raise ResultError(
                f"{folder / name}: the file has been removed during the run; run the case again, and leave the folder "
                "alone until it has ended"
            ) from None
        if found < length:
            raise ResultError(
                f"{folder / name}: {length} bytes were written, and {found} are there; something has cut the file: run "
                "the case again, and leave the folder alone until it has ended"
            )
