"""What the results of a run depend on besides its case, by which it is told from others.

These are versions, processor, files, building and kernels; and for runs that share a building, its ground.
"""

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from evac.folder.digests import differences, digest_of_data, digest_of_file
from evac.jit.digest import digest_of
from evac.jit.kernels import INTERPRETED
from evac.jit.processor import host
from evac.results.results import versions
from evac.simulation import needed
from evac.simulation.assembly import files_of_building, make_behaviours, make_importers
from evac.simulation.simulation import Simulation
from evac.trajectory.header import building_to_json

if TYPE_CHECKING:
    from evac.case.case import Case


def inputs_of(case: "Case") -> dict[str, dict[str, str]]:
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


def ground_key(case: "Case") -> str:
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
