"""Base class of recorder plugins; and the recorders of a run: starting, calling and finishing them, and their state."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from evac.base.errors import EvacError, ResultError, plugin_code
from evac.base.parameters import Configurable
from evac.base.saved import Saved, part_of, state_of
from evac.folder.files import MANIFEST_NAME, RunningDigest, note_written, read_manifest, sync, writing
from evac.trajectory.trajectory import Recorded

if TYPE_CHECKING:
    from evac.contract.registry import Registry
    from evac.results.results import Results
    from evac.simulation.simulation import Simulation


class Recorder(Configurable, Saved, ABC):
    """Reads the simulation at the start, at every output time and at the end, without changing it.

    The simulation calls `record` every ``output.every`` seconds, beginning at time zero. ``simulation.folder`` is the
    result folder, or None for a run that writes no files. Attributes named in ``saved`` are part of checkpoints, as
    those of behaviours are.
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


#: Remedy for a recorder that has written to an array of the simulation.
READ = "only read the simulation, and copy arrays before changing them"


class Recording:
    """Calls the recorders of a run, once they have started (`is_started`); errors name the recorder.

    `memory` takes the trajectory of a run without a folder, if it is wanted.
    """

    def __init__(self, recorders: Sequence[Recorder], folder: Path | None, in_memory: bool = False) -> None:
        self.recorders = list(recorders)
        self.is_started = False
        self._folder = folder
        self.memory = Recorded() if in_memory else None
        self._made: set[str] = set()  # files created while plugins started or finished
        self._digests: dict[str, RunningDigest] = {}  # of the files

    def in_memory(self) -> Recorded | None:
        """Return the trajectory until now, if it is in memory."""
        return replace(self.memory, rows=[*self.memory.rows]) if self.memory and self.memory.header else None

    def start(self, simulation: "Simulation") -> None:
        """Start the recorders, and record the current state."""
        self.is_started = True
        with self._noting_files():
            for recorder in self.recorders:
                with reading(simulation, f"recorder {recorder.name!r}: start", recorder):
                    recorder.start(simulation)
        self.record(simulation)

    def record(self, simulation: "Simulation") -> None:
        """Check that the files exist, then call every recorder."""
        self.check_files()
        with read_only(simulation):
            for recorder in self.recorders:
                with plugin_code(f"t = {simulation.time:.3f} s: recorder {recorder.name!r}", recorder, READ):
                    recorder.record(simulation)

    def finish(
        self, simulation: "Simulation", registry: "Registry", results: "Results | None", error: BaseException | None
    ) -> None:
        """Call every recorder and plugin to finish; then raise the first error, unless the run has failed already."""
        calls: list[tuple[str, Any, Callable[[], Any]]] = []
        if self.is_started and error is None:
            calls.append(("recorders", self, self.check_files))
        for recorder in self.recorders if self.is_started else ():
            finish = partial(recorder.finish, simulation, results)
            calls.append((f"recorder {recorder.name!r}: finish", recorder, finish))
        for plugin, hook in registry.calls("evac_finish", simulation=simulation, results=results, error=error):
            calls.append((f"{plugin}: evac_finish", hook.func, hook))
        failures = []
        interrupt: KeyboardInterrupt | None = None
        with self._noting_files():
            for what, code, call in calls:
                if interrupt is not None and not isinstance(code, Recorder):
                    continue  # of recorders, which close their files, every one finishes
                try:
                    with reading(simulation, what, code):
                        call()
                except EvacError as failure:
                    failures.append(failure)
                except KeyboardInterrupt as caught:
                    interrupt = caught
        if interrupt is not None:
            raise interrupt
        for one in failures:
            if error is None:
                raise one
            error.add_note(f"then: {one}")

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of the recorders' states, by ``NAME.key``."""
        state: dict[str, NDArray[Any]] = {}
        for recorder in self.recorders:
            state |= state_of(recorder, f"recorder {recorder.name!r}", f"{recorder.name}.")
        return state

    def files(self) -> dict[str, int]:
        """Return the files that the recorders have written so far and their lengths [bytes]."""
        files: dict[str, int] = {}
        for recorder in self.recorders:
            with plugin_code(f"recorder {recorder.name!r}: files", recorder):
                files |= {str(name): int(length) for name, length in recorder.files().items()}
        return files

    def plugin_files(self) -> list[str]:
        """Return the files of plugins: those named by recorders, and those created when plugins started or finished.

        Files that evac writes itself, which are in the manifest, are not included.
        """
        own = set(read_manifest(self._folder).files) if self._folder is not None else set()
        return sorted({*self._made, *(name for name in self.files() if name not in own)})

    @contextmanager
    def _noting_files(self) -> Iterator[None]:
        """Record which files are created within the context."""
        before = self._files_there()
        try:
            yield
        finally:
            self._made |= self._files_there() - before
            if self._folder is not None and self._folder.is_dir():
                self._made.update(self.plugin_files())
                with writing("the manifest", self._folder):
                    note_written(self._folder / name for name in self._made)

    def _files_there(self) -> set[str]:
        """Return the files in the folder that evac has not written."""
        if self._folder is None:
            return set()
        own = {MANIFEST_NAME, *read_manifest(self._folder).files}
        there = (path.relative_to(self._folder).as_posix() for path in self._folder.rglob("*") if not path.is_dir())
        return {name for name in there if name not in own}

    def sync(self) -> dict[str, dict[str, Any]]:
        """Flush the files to disk and return the length [bytes] and the SHA-256 of each."""
        files: dict[str, dict[str, Any]] = {}
        if self._folder is None:
            return files
        for name, length in self.files().items():
            with writing(f"{name} at the checkpoint", self._folder):
                sync(self._folder / name)
            digest = self._digests.setdefault(name, RunningDigest()).extend(self._folder / name, length)
            files[name] = {"length": length, "sha256": digest}
        return files

    def check(
        self,
        simulation: "Simulation",
        state: Mapping[str, NDArray[Any]],
        folder: Path,
        files: Mapping[str, tuple[int, str]],
    ) -> None:
        """Check that the recorders can be restored, without changing anything."""
        lengths = {name: length for name, (length, _) in files.items()}
        check_lengths(folder, lengths)
        for name, (length, digest) in files.items():
            if self._digests.setdefault(name, RunningDigest()).extend(folder / name, length) != digest:
                raise ResultError(
                    f"{folder / name}: is not the file of the checkpoint, or was changed; run the case from its start"
                )
        for recorder in self.recorders:
            what = f"recorder {recorder.name!r}: check_state"
            with reading(simulation, what, recorder), part_of(state, f"{recorder.name}.") as own:
                recorder.check_state(simulation, own, folder, lengths)

    def check_files(self) -> None:
        """Check that the files of the recorders have the recorded lengths."""
        if self._folder is not None:
            check_lengths(self._folder, self.files())

    def restore(
        self,
        simulation: "Simulation",
        state: Mapping[str, NDArray[Any]],
        files: Mapping[str, int],
        plugin_files: Iterable[str] = (),
    ) -> None:
        """Truncate the files to their lengths at the checkpoint, and restore the recorders."""
        restored: list[Recorder] = []
        with nullcontext() if self._folder is None else _truncated(self._folder, files):
            try:
                for recorder in self.recorders:
                    what = f"recorder {recorder.name!r}: restore"
                    with reading(simulation, what, recorder), part_of(state, f"{recorder.name}.") as own:
                        recorder.restore(simulation, own)
                    restored.append(recorder)
                if self._folder is not None and self.files() != files:
                    raise ResultError(
                        f"{self._folder}: the checkpoint has the files {', '.join(files) or 'none'}, the recorders "
                        f"continue {', '.join(self.files()) or 'none'}, or other lengths; run the case from its start"
                    )
            except BaseException:
                for recorder in restored:  # close the files
                    with suppress(EvacError), reading(simulation, "", recorder):
                        recorder.finish(simulation, None)
                raise
        self.is_started = True
        self._made = set(plugin_files)


@contextmanager
def _truncated(folder: Path, files: Mapping[str, int]) -> Iterator[None]:
    """Truncate files to lengths [bytes]; if the code within fails, as a recorder may, append what was cut off again."""
    cut: list[tuple[Path, int, bytes]] = []
    for name, length in files.items():
        path = folder / name
        with writing(name, path.parent), path.open("r+b") as file:
            file.seek(length)
            cut.append((path, length, file.read()))
            file.truncate(length)
    try:
        yield
    except BaseException:
        for path, length, end in cut:
            with path.open("r+b") as file:
                file.truncate(length)
                file.seek(length)
                file.write(end)
        raise


@contextmanager
def reading(simulation: "Simulation", what: str, plugin: Any) -> Iterator[None]:
    """Run code of a plugin that only reads a simulation, whose arrays are read-only within the context."""
    with read_only(simulation), plugin_code(what, plugin, READ):
        yield


@contextmanager
def read_only(simulation: "Simulation") -> Iterator[None]:
    """Make the arrays of a simulation read-only within the context."""
    arrays = [*simulation.population.crowd.values().values(), simulation.displacement_velocity]
    arrays = [array for array in arrays if array.flags.writeable]
    simulation.population.is_read_only = True
    for array in arrays:
        array.flags.writeable = False
    try:
        yield
    finally:
        simulation.population.is_read_only = False
        for array in arrays:
            array.flags.writeable = True


def check_lengths(folder: Path, files: Mapping[str, int]) -> None:
    """Check that files exist in a folder and have at least certain lengths [bytes]."""
    for name, length in files.items():
        path = folder / name
        size = path.stat().st_size if path.is_file() else None
        if size is None or size < length:
            what = "removed" if size is None else f"truncated: {length} bytes were written, {size} are left"
            raise ResultError(
                f"{path}: the file was {what}; run the case again, and do not change the folder until it has ended"
            )
