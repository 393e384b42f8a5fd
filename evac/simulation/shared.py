"""Building and directions, computed once for all runs that share them, and read by processes without copies.

A `SharedScene` is written to a file that every process maps into memory: its arrays one after another, and behind them
the rest, pickled without the arrays. The digest of the pickle is part of each task, so that a process unpickles only
what was written by the process that submitted the task. A process that cannot read the file, for example on another
machine, computes the scene itself.
"""

import hashlib
import mmap
import pickle
from collections import OrderedDict
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evac.case.case import Case
from evac.folder.files import digest_of_file
from evac.simulation import needed
from evac.simulation.assembly import files_of_building, make_behaviours, make_importers, make_shared_scene
from evac.simulation.scene import SharedScene
from evac.simulation.simulation import Simulation

#: Number of shared scenes that a process keeps.
MOST_SCENES = 8

#: Alignment of the arrays [bytes].
ALIGNMENT = 64


@dataclass(frozen=True)
class SharedSceneFile:
    """Location of a shared scene on disk."""

    path: str
    digest: str  # of the pickle
    spans: tuple[tuple[int, int], ...]  # first byte and length of each array, and of the pickle behind them


def write_shared_scene(scene: SharedScene, folder: Path) -> SharedSceneFile:
    """Write a shared scene to a folder, to which other users must not have write access."""
    buffers: list[pickle.PickleBuffer] = []
    scene.world  # noqa: B018 - made once here, for all processes
    frame = pickle.dumps(scene, protocol=5, buffer_callback=buffers.append)
    digest = hashlib.sha256(frame).hexdigest()
    path, spans = folder / f"{digest}.scene", []
    with path.open("wb") as stream:
        for part in (*(buffer.raw() for buffer in buffers), memoryview(frame)):
            stream.seek(-(-stream.tell() // ALIGNMENT) * ALIGNMENT)
            spans.append((stream.tell(), len(part)))
            stream.write(part)
    return SharedSceneFile(str(path), digest, tuple(spans))


def read_shared_scene(file: SharedSceneFile) -> SharedScene:
    """Return a shared scene with arrays that are mapped read-only from the file."""
    with Path(file.path).open("rb") as stream:
        mapped = memoryview(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
    *arrays, rest = (mapped[start : start + length] for start, length in file.spans)
    frame = bytes(rest)
    if hashlib.sha256(frame).hexdigest() != file.digest:
        raise OSError(f"{file.path}: changed since it was written")
    scene: SharedScene = pickle.loads(frame, buffers=arrays)
    return scene


def shared_key(case: Case) -> str:
    """Return a digest that is equal for two cases only if their building and directions are the same.

    It covers the files of the building, how they are read, and everything that the directions depend on. Other settings
    of groups, contact models and behaviours may differ, as may the seed.
    """
    importers = make_importers(case)
    parts = (
        str(case.mesh or case.source),
        [(str(path), digest_of_file(path)) for path in files_of_building(case, importers)],
        case.registry.providers(importers),
        [importer.values() for importer in importers],
        case.building.model_dump(),
        case.place,
        needed.field_settings(case, make_behaviours(case), full=False),
    )
    return hashlib.sha256(repr(parts).encode()).hexdigest()


#: The shared scenes of this process, by key.
SCENES: OrderedDict[str, SharedScene] = OrderedDict()


def _kept(key: str, file: SharedSceneFile | None) -> SharedScene | None:
    """Return a cached scene, or else that of a file if it can be read, or else None."""
    if key not in SCENES and file is not None:
        with suppress(OSError):
            return _keep(key, read_shared_scene(file))
    return SCENES.get(key)


def _keep(key: str, scene: SharedScene) -> SharedScene:
    """Cache a shared scene; discard the oldest if there are too many."""
    SCENES[key] = scene
    if scene.columns is None:
        scene.columns = {}
    if len(SCENES) > MOST_SCENES:
        SCENES.popitem(last=False)
    return scene


def shared_scene(case: Case, key: str, file: SharedSceneFile | None = None) -> SharedScene:
    """Return the scene of a case, from the cache or the file, or computed and cached; errors as `make_shared_scene`."""
    return _kept(key, file) or _keep(key, make_shared_scene(case))


def simulation_of(case: Case, key: str = "", file: SharedSceneFile | None = None, **options: Any) -> Simulation:
    """Return a simulation of a case; its shared scene is taken from the cache or the file, or computed and cached."""
    key = key or shared_key(case)
    scene = _kept(key, file)
    simulation = Simulation(case, shared_scene=scene, **options)
    if scene is None:
        _keep(key, simulation.scene.shared_scene)
    return simulation
