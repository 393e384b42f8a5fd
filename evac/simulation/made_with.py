"""What the results of a run depend on besides its case: versions, processor, files, building and kernels."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from evac.base.errors import EvacError
from evac.jit.digest import digest_of
from evac.jit.kernels import INTERPRETED
from evac.jit.processor import host
from evac.results.results import versions
from evac.simulation import needed
from evac.simulation.simulation import Simulation
from evac.trajectory.header import building_to_json

if TYPE_CHECKING:
    from evac.case.case import Case


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
    """Return digests of the building, independent of its files, of the data files of behaviours, and of the kernels."""
    folder = simulation.case.folder.resolve()
    files = [path for _, scene in simulation.behaviours for path in scene.files]
    data = {path.relative_to(folder).as_posix(): _digest(path) for path in files}
    text = json.dumps({**building_to_json(simulation.building), "closed": []}, sort_keys=True)
    building = hashlib.sha256(text.encode()).hexdigest()
    return {"building": {"": building}, "data": data, "kernel": kernels_of(simulation)}


def kernels_of(simulation: Simulation) -> dict[str, str]:
    """Return digests of the kernels that a run uses or may need later, by name."""
    behaviours = [behaviour for behaviour, _ in simulation.behaviours]
    parts = simulation.case, simulation.building, simulation.contact, simulation.forces, behaviours
    entries = [*needed.set_up_kernels(), *needed.run_kernels(*parts, full=True)]
    found = {entry.label: digest_of(entry, f"{host()}") for entry in entries}
    return found | {"interpreted": str(INTERPRETED)}


def differences_of(before: Mapping[str, Mapping[str, str]], now: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Return a line for each difference."""
    lines = []
    for kind, values in now.items():
        then = before.get(kind, {})
        # A changed case may have other kernels and data.
        names = then.keys() & values if kind in ("kernel", "data") else then.keys() | values
        for name in sorted(names):
            old, new = then.get(name), values.get(name)
            if old != new:
                what = f"{kind} {name}".strip()
                lines.append(f"{what}: {old or 'missing'} when the checkpoint was written, {new or 'missing'} now")
    return lines


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    except OSError as error:
        raise EvacError(f"{path}: cannot be read: {error}; check the path") from error
