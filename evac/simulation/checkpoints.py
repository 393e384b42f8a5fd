"""Checkpoints: save the last state of a run in a file of its folder, and resume the run from it."""

import hashlib
import io
import json
import os
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from evac.base.errors import FolderWarning, PluginError, ResultError, in_one_line
from evac.base.parameters import Configurable
from evac.base.saved import Saved, SavedError, part_of, taken
from evac.case.case import Case
from evac.case.loading import case_from, named_files, run_plugin_files
from evac.contract.registry import Registry
from evac.folder.files import CHECKPOINT_NAME, content_of, differences, digest_of_data, digest_of_file, replacing
from evac.folder.resultfolder import ResultFolder, find_result, is_link, is_within
from evac.folder.textfiles import checked, plain
from evac.jit.kernels import INTERPRETED
from evac.jit.loading import host
from evac.jit.store import digest_of
from evac.people.behaviour import Behaviour
from evac.physics.contact.model import ContactModel
from evac.results.ending import INTERRUPTED
from evac.results.results import versions
from evac.simulation import needed
from evac.simulation.loop import Operation
from evac.simulation.simulation import Simulation
from evac.trajectory.recorder import Recorder
from evac.trajectory.trajectory import building_to_json

#: First bytes of an archive, and the number of the format of its header and arrays.
ARCHIVE = b"PK"
FORMAT = 3

#: Name of the array that is the header, and kinds of the others: booleans, integers and floats.
HEADER = "header"
DTYPE_KINDS = "biuf"

DIGEST_BYTES = hashlib.sha256().digest_size

#: A path; no system has one with this character.
FileName = Annotated[str, Field(pattern=r"^[^\x00]+$")]


class _Table(BaseModel):
    """A table of the header of a checkpoint."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)


class RecordedFile(_Table):
    """A file that a recorder appends to: its length [bytes] and its SHA-256 up to there."""

    length: int = Field(ge=0)
    sha256: str


class CaseAtStart(_Table):
    """The case as it was at the start of the run, its file, and the plugin files given in addition."""

    table: dict[str, Any]
    source: FileName
    plugin_files: list[FileName]


class Header(_Table):
    """The header of a checkpoint, checked; docs/folder.md explains it."""

    title: str
    case: CaseAtStart
    every: float | None = Field(ge=0.0)
    full: bool
    made_with: dict[str, dict[str, str]]
    resumed: list[dict[str, Any]]
    time: float
    step: int
    wall_time: dict[str, Annotated[float, Field(ge=0.0)]]
    files: dict[FileName, RecordedFile]
    plugin_files: list[FileName]


def write_checkpoint(path: Path, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write a checkpoint to a temporary file, flush it to disk, and then replace the previous one atomically."""
    for name, array in arrays.items():
        if array.dtype.kind not in DTYPE_KINDS:
            raise ResultError(f"{path}: array {name!r} has type {array.dtype}; use booleans, integers or floats")
    text = json.dumps({**header, "format": FORMAT}, default=_plain)
    archive = io.BytesIO()
    np.savez(archive, **{**arrays, HEADER: np.frombuffer(text.encode(), np.uint8)})  # type: ignore[arg-type]
    with replacing(path, "the checkpoint") as new, new.open("wb") as file:
        file.write(archive.getbuffer())
        file.write(hashlib.sha256(archive.getbuffer()).digest())


def read_checkpoint(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return header and arrays of a checkpoint after verifying its checksum."""
    try:
        data = content_of(path)
    except OSError as error:
        raise ResultError(f"{path}: cannot read the checkpoint: {error}") from error
    if not data.startswith(ARCHIVE):
        raise ResultError(f"{path}: not a checkpoint of this evac (it does not start with {ARCHIVE.decode()})")
    archive = memoryview(data)[:-DIGEST_BYTES]
    if hashlib.sha256(archive).digest() != data[-DIGEST_BYTES:]:
        raise ResultError(f"{path}: the checkpoint is damaged (its checksum does not match); run the case again")
    try:
        with np.load(io.BytesIO(archive), allow_pickle=False) as file:
            arrays = {name.removesuffix(".npy"): file[name] for name in file.zip.namelist()}
        header = json.loads(arrays.pop(HEADER).tobytes())
    except (ValueError, LookupError) as error:
        raise ResultError(f"{path}: the checkpoint is not valid: {error}; run the case again") from error
    if (written := header.pop("format", None)) != FORMAT:
        raise ResultError(
            f"{path}: unknown checkpoint format {written!r:.40}, this version reads format {FORMAT}; "
            "resume with the version of evac that wrote it, or run the case again"
        )
    return header, arrays


def _plain(value: Any) -> Any:
    """Convert a number or an array of numpy to plain data for JSON."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise ResultError(
        f"{value!r} in a case cannot be saved in a checkpoint; use plain numbers, strings, lists and tables"
    )


class Checkpoints:
    """Saves the last state of a run in its folder.

    `every` is the wall time between two checkpoints [s]; with None one is saved only when the run is interrupted.
    """

    def __init__(self, simulation: Simulation, place: ResultFolder, every: float | None) -> None:
        self._simulation, self._place, self._every = simulation, place, every
        self._saved_at, self._has_warned = 0.0, False

    def operation(self) -> Operation:
        """Return the operation that saves them after a tick."""
        return Operation("checkpoints", "recording", self._save_or_warn, self._is_due, self._begin)

    def _begin(self) -> None:
        """If checkpoints are wanted, check that all plugins can save their state, and save the first checkpoint."""
        if self._every is None:
            return
        if missing := without_state(self._simulation):
            raise PluginError("\n".join(f"no checkpoints: {line}" for line in missing))
        self._save()

    def _is_due(self) -> bool:
        """Return whether a checkpoint is due; a run that has ended without an interruption cannot be resumed."""
        if self._simulation.ended:
            return self._simulation.ended == INTERRUPTED
        return self._every is not None and time.monotonic() - self._saved_at >= self._every

    def _save_or_warn(self) -> None:
        """Save the state; if a plugin cannot save its state, warn."""
        if missing := without_state(self._simulation):
            warnings.warn("; ".join(f"no checkpoint: {line}" for line in missing), FolderWarning, stacklevel=2)
        else:
            self._save()

    @cached_property
    def _header(self) -> dict[str, Any]:
        """Return the part of a checkpoint that does not change during the run."""
        simulation = self._simulation
        case = simulation.case
        return {
            "title": case.title,
            "case": {
                "table": case.table,
                "source": str(case.source),
                "plugin_files": [str(path) for path in case.plugin_files],
            },
            "every": self._every,
            "full": simulation.full,
            "made_with": {**inputs_of(case), **made_of(simulation)},
            "resumed": plain(simulation.resumed),
        }

    def _save(self) -> None:
        simulation = self._simulation
        with simulation.phases.enter("recording"):
            try:
                files = simulation.recording.sync()
                arrays = {f"simulation.{key}": value for key, value in simulation.state().items()}
                arrays |= {f"recorder.{key}": value for key, value in simulation.recording.state().items()}
                header = {
                    **self._header,
                    "time": simulation.time,
                    "step": simulation.step,
                    "wall_time": simulation.phases.seconds(),
                    "files": files,
                    "plugin_files": simulation.recording.plugin_files(),
                }
                write_checkpoint(self._place.running / CHECKPOINT_NAME, header, arrays)
            except ResultError as error:
                self._place.check()  # a missing folder ends the run; a checkpoint that cannot be written does not
                if not self._has_warned:
                    text = f"t = {simulation.time:.3f} s: {error}; the run continues"
                    warnings.warn(text, FolderWarning, stacklevel=3)
                self._has_warned = True
            self._saved_at = time.monotonic()


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint read from a file."""

    path: Path
    header: Header
    arrays: Mapping[str, NDArray[Any]]

    @property
    def files(self) -> dict[str, tuple[int, str]]:
        """Names of the files that recorders append to, their lengths [bytes], and their SHA-256 up to there."""
        folder = self.path.parent
        for name in (*self.header.files, *self.header.plugin_files):
            if not is_within(name) or is_link(folder, name):
                raise ResultError(f"{self.path}: {name} is not a file of this folder; run the case from its start")
        return {name: (file.length, file.sha256) for name, file in self.header.files.items()}

    def case(
        self,
        plugin_files: Iterable[str | Path] = (),
        registry: Registry | None = None,
        case_file: str | Path | None = None,
        announce: Callable[[Path], None] | None = None,
    ) -> Case:
        """Return the case of the run."""
        given = self.header.case
        source = Path(given.source)
        files = [Path(path).resolve() for path in plugin_files]
        named = named_files(given.table, source.parent)
        if missing := [path for path in given.plugin_files if Path(path) not in (*files, *named)]:
            raise PluginError(
                f"{self.path}: the run was started with the plugin {', '.join(missing)} in addition to those of its "
                "case; give it again with --plugin or plugin_files"
            )
        if set(named) - set(files):
            self._check_place(source, case_file)
        return run_plugin_files(case_from(given.table, source, (), files, registry), announce)

    def restore(self, simulation: Simulation) -> None:
        """Restore the state of a simulation of the same case, except for the recorders."""
        with self._naming(), part_of(self.arrays, "simulation.") as state:
            simulation.restore(state)
            taken({"time": np.array(self.header.time)}, "time", np.float64, (), simulation.time, simulation.time)
        simulation.resumed = list(self.header.resumed)

    def check_recorders(self, simulation: Simulation) -> None:
        """Check that the recorders of a restored simulation can be restored, without changing anything."""
        with self._naming(), part_of(self.arrays, "recorder.") as state:
            simulation.recording.check(simulation, state, self.path.parent, self.files)
            simulation.phases.add(self.header.wall_time)

    def restore_recorders(self, simulation: Simulation) -> None:
        """Truncate the files of the recorders to their lengths at the checkpoint and restore the recorders."""
        lengths = {name: file.length for name, file in self.header.files.items()}
        with self._naming(), part_of(self.arrays, "recorder.") as state:
            simulation.recording.restore(simulation, state, lengths, self.header.plugin_files)

    @contextmanager
    def _naming(self) -> Iterator[None]:
        """Name the checkpoint in errors about its content."""
        try:
            yield
        except SavedError as error:
            raise ResultError(f"{self.path}: the state cannot be restored: {error}; run the case again") from error
        except (KeyError, ValueError, IndexError) as error:
            raise ResultError(
                f"{self.path}: the state cannot be restored: {in_one_line(error)}; run the case from its start (in a "
                "plugin, state() must return everything that restore() reads)"
            ) from error

    def _check_place(self, source: Path, case_file: str | Path | None) -> None:
        """Refuse to run plugin files of a case that does not lie where the user has named it."""
        folder, beside = source.resolve().parent, self.path.resolve().parent.parent
        given = None if case_file is None else Path(case_file).resolve()
        if beside in (folder, folder.parent) if given is None else given in (source.resolve(), folder):
            return
        raise PluginError(
            f"{self.path}: its case {source} names plugin files and is not beside the result folder; if you trust "
            f"it, name {source} with --case or case_file"
        )


def checkpoint_at(path: Path) -> Checkpoint:
    """Return the checkpoint of a file."""
    header, arrays = read_checkpoint(path)
    return Checkpoint(path, checked(Header, header, path), arrays)


def find_checkpoint(folder: Path) -> Checkpoint:
    """Return the checkpoint in a result folder, of a running, killed or stopped run."""
    for place in dict.fromkeys((ResultFolder(folder).running, find_result(folder))):
        if (place / CHECKPOINT_NAME).is_file():
            return checkpoint_at(place / CHECKPOINT_NAME)
    if not find_result(folder).exists():
        raise ResultError(f"{folder}: no such result folder; check the path")
    raise ResultError(
        f"{folder}: no checkpoint: the run has ended, or was killed and did not save checkpoints; "
        "--checkpoint 60, or checkpoint=60 of evac.run, saves one every 60 s"
    )


def without_state(simulation: Simulation) -> list[str]:
    """Return a line for each plugin of a started run whose state cannot be saved."""
    used: list[tuple[str, Configurable, type]] = [("behaviour", one, Behaviour) for one, _ in simulation.behaviours]
    used += [("recorder", one, Recorder) for one in simulation.recording.recorders]
    used.append(("contact model", simulation.contact, ContactModel))
    lines = []
    for kind, plugin, base in used:
        kept = sorted(set(vars(plugin)) - set(plugin.values()))
        if plugin is simulation.contact:
            kept += simulation.engine.own_arrays()
        if isinstance(plugin, Saved):
            kept = kept if not plugin.saved else []
        if kept and type(plugin).state is base.state:  # type: ignore[attr-defined]
            lines.append(
                f"{kind} {plugin.name!r} has the attributes {', '.join(kept)} but no state() that saves them; add "
                "state() and restore() to the plugin (state() may return {} if they are recomputed before each use)"
            )
    return lines


def inputs_of(case: Case) -> dict[str, dict[str, str]]:
    """Return versions, processor and file digests that the results depend on besides the case and the kernels."""
    files = {str(path): path for path in case.plugin_files}
    if case.mesh is not None:
        files[case.mesh.name] = case.mesh
    packages = [source for source in case.registry.provenance if source.source == "distribution"]
    return {
        "version": {**versions(), **{source.plugin: source.version for source in packages}},
        "processor": {"": f"{host()}"},
        "file": {name: digest_of_file(path)[:16] for name, path in files.items()},
    }


def made_of(simulation: Simulation) -> dict[str, dict[str, str]]:
    """Return digests of the building, independent of its files, of data files that are read, and of the kernels."""
    folder = simulation.case.folder.resolve()
    data = {
        Path(os.path.relpath(path, folder)).as_posix(): digest_of_file(path)[:16] for path in simulation.data_files()
    }
    # Links that were closed during the run are open before it is restored, and warnings follow from them.
    building = digest_of_data({**building_to_json(simulation.building), "closed": [], "warnings": []})
    return {"building": {"": building}, "data": data, "kernel": kernels_of(simulation)}


def kernels_of(simulation: Simulation) -> dict[str, str]:
    """Return digests of the kernels that a run uses or may need later, by name."""
    behaviours = [behaviour for behaviour, _ in simulation.behaviours]
    parts = type(simulation.engine), simulation.building, simulation.contact, simulation.forces, behaviours
    entries = [*needed.SET_UP, *needed.run_kernels(simulation.case, *parts, full=True)]
    digests = {entry.label: digest_of(entry, f"{host()}") for entry in entries}
    return digests | {"interpreted": str(INTERPRETED)}


def differences_of(before: Mapping[str, Mapping[str, str]], now: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Return a line for each difference; of kernels and data only where both have them."""
    return [
        f"{f'{kind} {name}'.strip()}: {old or 'missing'} when the checkpoint was written, {new or 'missing'} now"
        for kind, values in now.items()
        for (name,), old, new in sorted(differences(before.get(kind, {}), values))
        if kind not in ("kernel", "data") or None not in (old, new)
    ]
