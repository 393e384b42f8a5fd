"""Checkpoints: save the last state of a run in its folder, and resume the run from it."""

import hashlib
import json
import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evac import plan
from evac.behaviour import Behaviour
from evac.building.links import links_named
from evac.errors import EvacError, FolderWarning, PluginError, ResultError, ScenarioError, in_one_line
from evac.jit.digest import digest_of
from evac.jit.kernels import INTERPRETED
from evac.jit.processor import host
from evac.output.checkpoint import read_checkpoint, write_checkpoint
from evac.output.files import CHECKPOINT_NAME
from evac.output.header import building_to_json
from evac.output.recorder import Recorder
from evac.output.resultfolder import ResultFolder, find_result, is_within
from evac.output.results import plain, versions
from evac.parameters import Configurable
from evac.physics.contact_model import ContactModel
from evac.scenario.loading import case_from
from evac.scenario.trust import run_plugin_files
from evac.simulation import Simulation

if TYPE_CHECKING:
    from evac.building.model import Building
    from evac.registry import Registry
    from evac.scenario.case import Case

#: Keys of a case that must not change when a run is resumed in a changed case: the people, and the times of steps,
#: ticks and recorded states. Of ``building``, only ``closed`` may change.
FIXED = ("people", "presets", "simulation.seed", "simulation.step", "simulation.tick", "output.every")


class Checkpoints:
    """Saves the last state of a run in its folder.

    Parameters
    ----------
    simulation : Simulation
    place : ResultFolder
        Its ``running`` is the folder of the simulation.
    every : float or None
        Wall time between two checkpoints [s]; with None only `save_last` saves one.
    """

    def __init__(self, simulation: Simulation, place: ResultFolder, every: float | None) -> None:
        self._simulation = simulation
        self._place = place
        self._every = every
        self._saved_at = 0.0
        self._has_warned = False

    def begin(self) -> None:
        """If checkpoints are wanted, check that all plugins can save their state, and save the first checkpoint.

        Raises
        ------
        PluginError
            Plugins cannot save their state; names each of them.
        """
        if self._every is None:
            return
        if missing := without_state(self._simulation):
            raise PluginError("\n".join(f"no checkpoints: {line}" for line in missing))
        self._save()

    def save_if_due(self) -> None:
        """Save the state after a tick if a checkpoint is due; if it cannot be written, warn once."""
        if self._every is None or time.monotonic() - self._saved_at < self._every:
            return
        self._save()

    def save_last(self) -> None:
        """Save the state after the tick at which the run is stopped; if a plugin cannot save its state, warn."""
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
            "routes": [str(route) for route in simulation.fields.routes],
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
    """A checkpoint read from a file.

    Attributes
    ----------
    path : Path
    header : mapping
    arrays : mapping of str to array
    """

    path: Path
    header: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.header["time"])

    @property
    def every(self) -> float | None:
        """Requested wall time between two checkpoints [s]."""
        every: float | None = self.header["every"]
        return every

    @property
    def files(self) -> dict[str, int]:
        """Names of the files that recorders append to, and their lengths [bytes].

        Raises
        ------
        ResultError
            A file lies outside of the folder or is a link, so that truncating it would damage another file.
        """
        files: dict[str, int] = dict(self.header["files"])
        for name in files:
            if not is_within(name) or (self.path.parent / name).is_symlink():
                raise ResultError(f"{self.path}: {name} is not a file of this folder; run the case from its start")
        return files

    def case(
        self,
        overrides: Mapping[str, Any] | Iterable[str] = (),
        plugin_files: Iterable[str | Path] = (),
        registry: "Registry | None" = None,
        announce: Callable[[Path], None] | None = None,
    ) -> "Case":
        """Return the case of the run as it was at the start, with overrides applied.

        Parameters
        ----------
        overrides, plugin_files, registry
            As for `evac.load`. Plugin files that the run was given in addition to those of its case must be given
            again.
        announce : callable, optional
            Called with the path of each plugin file of the case before it is run.

        Raises
        ------
        ScenarioError
            The case cannot be loaded any more, or an override changes a key that must not change.
        """
        given = self.header["case"]
        source = Path(given["source"])
        files = [Path(path).resolve() for path in plugin_files]
        named = [(source.parent / name).resolve() for name in given["table"].get("plugins", {}).get("files", [])]
        if missing := [path for path in given["plugin_files"] if Path(path) not in (*files, *named)]:
            raise PluginError(
                f"{self.path}: the run was started with the plugin {', '.join(missing)} in addition to those of its "
                "case; give it again (--plugin)"
            )
        case = run_plugin_files(case_from(given["table"], source, (), files, registry), announce)
        changed = case.change(overrides)
        table, new = case.to_dict(), changed.to_dict()
        kept = [key for key in FIXED if _at(table, key) != _at(new, key)]
        kept += [f"building.{key}" for key, value in new["building"].items() if table["building"].get(key) != value]
        kept = [key for key in kept if key != "building.closed"]
        if kept:
            raise ScenarioError(
                f"{self.path}: {', '.join(kept)} cannot change when a run is resumed, because its people and time "
                "steps must stay the same; run the changed case from its start"
            )
        return changed

    def differences(self, case: "Case") -> list[str]:
        """Return what has changed in versions and files since the checkpoint was written, one line per difference.

        Parameters
        ----------
        case : Case
            As `case` returns it.
        """
        return _differences(self.header["made_with"], inputs_of(case))

    def simulation_differences(self, simulation: Simulation) -> list[str]:
        """Return what has changed in the building and the kernels, one line per difference."""
        before, now = self.header["made_with"], made_of(simulation)
        both = before["kernel"].keys() & now["kernel"].keys()  # a changed case may use others
        kept = {key: {name: now[key][name] for name in (both if key == "kernel" else now[key])} for key in now}
        return _differences({key: {name: before[key].get(name, "") for name in kept[key]} for key in kept}, kept)

    def restore(self, simulation: Simulation, case_before: "Case | None" = None) -> None:
        """Restore the state of a simulation, except that of the recorders.

        Parameters
        ----------
        simulation : Simulation
            A simulation of the same case, or of a changed one.
        case_before : Case, optional
            The case before it was changed, if it was: links that it closes and the new one does not are opened.

        Raises
        ------
        ScenarioError
            The changed case gives people other routes.
        ResultError
            An array is missing or has a wrong shape.
        """
        routes = [str(route) for route in simulation.fields.routes]
        if routes != self.header["routes"]:
            raise ScenarioError(
                f"{self.path}: the routes of the changed case are {'; '.join(routes)}, those of the checkpoint "
                f"{'; '.join(self.header['routes'])}; the run cannot be resumed, run the case from its start"
            )
        state = _part(self.arrays, "simulation.")
        if case_before is not None:
            state |= _closed_now(state, simulation.building, case_before, simulation.case)
        try:
            simulation.restore(state)
        except (KeyError, ValueError, IndexError) as error:
            raise ResultError(
                f"{self.path}: the state cannot be restored: {in_one_line(error)}; run the case from its start (in a "
                "plugin, state() must return everything that restore() reads)"
            ) from error
        simulation.resumed = list(self.header["resumed"])

    def restore_recorders(self, simulation: Simulation) -> None:
        """Truncate the files of the recorders to their lengths at the checkpoint and restore recorders and wall times.

        Raises
        ------
        ResultError
            A file is missing or shorter than at the checkpoint.
        """
        state, made = _part(self.arrays, "recorder."), self.header["plugin_files"]
        simulation.recording.restore(simulation, state, self.files, made)
        simulation.phases.add(self.header["wall_time"])


def find_checkpoint(folder: Path) -> Checkpoint:
    """Return the checkpoint in a result folder, of a running, killed or stopped run.

    Raises
    ------
    ResultError
        There is none, or it is damaged.
    """
    for place in dict.fromkeys((ResultFolder(folder).running, find_result(folder))):
        if (place / CHECKPOINT_NAME).is_file():
            return Checkpoint(place / CHECKPOINT_NAME, *read_checkpoint(place / CHECKPOINT_NAME))
    if not find_result(folder).exists():
        raise ResultError(f"{folder}: no such result folder; check the path")
    raise ResultError(
        f"{folder}: no checkpoint: the run has ended, or was killed and did not save checkpoints; "
        "evac run CASE --checkpoint 60 saves one every 60 s"
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
        if kept and type(plugin).state is base.state:  # type: ignore[attr-defined]
            lines.append(
                f"{kind} {plugin.name!r} has the attributes {', '.join(kept)} but no state() that saves them; add "
                "state() and restore() to the plugin (state() may return {} if they are recomputed before each use)"
            )
    return lines


def inputs_of(case: "Case") -> dict[str, dict[str, str]]:
    """Return versions, processor and file digests that the results depend on besides the case and the kernels."""
    files = {str(path): path for path in case.plugin_files}
    if case.mesh is not None:
        files[case.mesh.name] = case.mesh
    packages = [one for one in case.registry.provenance if one.source == "distribution"]
    return {
        "version": {**versions(), **{one.plugin: one.version for one in packages}},
        "processor": {"": f"{host()}"},
        "file": {name: _digest(path) for name, path in files.items()},
    }


def made_of(simulation: Simulation) -> dict[str, dict[str, str]]:
    """Return digests of the building, independent of its files, and of the kernels."""
    text = json.dumps({**building_to_json(simulation.building), "closed": []}, sort_keys=True)
    return {"building": {"": hashlib.sha256(text.encode()).hexdigest()}, "kernel": kernels_of(simulation)}


def kernels_of(simulation: Simulation) -> dict[str, str]:
    """Return digests of the kernels that a run uses or may need later, by name."""
    behaviours = [behaviour for behaviour, _ in simulation.behaviours]
    parts = simulation.case, simulation.building, simulation.contact, simulation.forces, behaviours
    entries = [*plan.set_up_kernels(), *plan.run_kernels(*parts, full=True)]
    found = {entry.label: digest_of(entry, f"{host()}") for entry in entries}
    return found | {"interpreted": str(INTERPRETED)}


def _differences(before: Mapping[str, Mapping[str, str]], now: Mapping[str, Mapping[str, str]]) -> list[str]:
    lines = []
    for kind, values in now.items():
        for name in sorted({*before.get(kind, {}), *values}):
            old, new = before.get(kind, {}).get(name), values.get(name)
            if old != new:
                what = f"{kind} {name}".strip()
                lines.append(f"{what}: {old or 'missing'} when the checkpoint was written, {new or 'missing'} now")
    return lines


def _closed_now(
    state: Mapping[str, NDArray[Any]], building: "Building", before: "Case", after: "Case"
) -> dict[str, NDArray[Any]]:
    """Return the scene's state with the links that the changed case closes or opens; empty if none changes."""
    closed, opened = (
        frozenset().union(*(links_named(building, name) for name in case.building.closed)) for case in (after, before)
    )
    links = set(state["scene.closed"].tolist())
    changed = links - (opened - closed) | (closed - opened)
    if changed == links:
        return {}
    return {"scene.closed": np.array(sorted(changed), np.int64), "scene.version": state["scene.version"] + 1}


def _part(arrays: Mapping[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    return {key[len(prefix) :]: value for key, value in arrays.items() if key.startswith(prefix)}


def _at(table: Mapping[str, Any], key: str) -> Any:
    value: Any = table
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    except OSError as error:
        raise EvacError(f"{path}: cannot be read: {error}; check the path") from error
