"""From a case, which is data, to what a run is made of: its building is read, its plugins are made."""

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.building.build import build_building
from evac.building.surfacemesh import SurfaceMesh
from evac.errors import BuildingError, PluginError, ScenarioError, plugin_code
from evac.plan import field_settings
from evac.registry import BUILTIN_IMPORTERS, Registry

if TYPE_CHECKING:
    from evac.behaviour import Behaviour
    from evac.building.importer import Importer
    from evac.building.model import Building
    from evac.output.recorder import Recorder
    from evac.physics.contact_model import ContactModel
    from evac.physics.force import Force
    from evac.scenario.case import Case


def make_building(case: "Case") -> "Building":
    """Return the building of a case, read from its file.

    Raises
    ------
    BuildingError
        The file cannot be read, or the building cannot be used.
    PluginError
        The importer fails.
    """
    return _building(make_importer(case), case.mesh, case.building.options())


def read_building(path: str | Path, *, registry: Registry | None = None, **options: Any) -> "Building":
    """Return the building in a file, without a case.

    Parameters
    ----------
    path : str or Path
    registry : Registry, optional
        Whose importers may read it; by default the built-in and the installed ones.
    **options
        As `evac.building.build.build_building`, the keys of ``[building]`` among them.

    Returns
    -------
    Building

    Raises
    ------
    BuildingError, PluginError
        As `make_building`.

    Examples
    --------
    >>> building = read_building("hall.msh", scale=0.001)  # doctest: +SKIP
    """
    path = Path(path)
    importer = (registry or Registry(builtins=BUILTIN_IMPORTERS)).importer_for(path)
    return _building(importer(), path, options)


def ground_key(case: "Case") -> str:
    """Return a digest that two cases have in common only where their building and directions are the same.

    It covers the file of the building and how it is read, and everything that the directions depend on. What groups
    of people, contact models and behaviours do not share with these may differ, as may the seed.

    Raises
    ------
    BuildingError
        The file of the building cannot be read.
    """
    importer = make_importer(case)
    try:
        content = hashlib.sha256(case.mesh.read_bytes()).hexdigest()
    except OSError as error:
        raise BuildingError(f"{case.mesh}: cannot be read: {error.strerror}; check the path") from error
    parts = (
        str(case.mesh),
        content,
        case.registry.providers([importer]),
        importer.values(),
        case.building.options(),
        field_settings(case, make_behaviours(case), full=False),
    )
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def make_importer(case: "Case") -> "Importer":
    """Return the importer of the building's file, with its parameters.

    Raises
    ------
    BuildingError
        No importer reads files of this name.
    """
    off = {name for name, table in case.importers.items() if table is False}
    importer = case.registry.importer_for(case.mesh, off)
    made: Importer = importer(**(case.importers.get(importer.name) or {}))
    return made


def make_contact_model(case: "Case") -> "ContactModel":
    """Return the contact model in use, with its parameters.

    Raises
    ------
    ScenarioError
        It names a solver that is not registered.
    """
    from evac.physics.contact_model import SolvedContactModel

    name = case.contact.model
    made: ContactModel = case.registry.get("contact_model", name)(**case.contact.tables.get(name, {}))
    if isinstance(made, SolvedContactModel):
        try:
            case.registry.get("solver", made.solver)
        except PluginError as error:
            raise ScenarioError(f"{case.source}: contact.{name}.solver: {error}") from None
    return made


def make_forces(case: "Case") -> "list[Force]":
    """Return the forces in use, in the order of the case."""
    return [case.registry.get("force", name)(**table) for name, table in case.forces.items() if table is not False]


def make_behaviours(case: "Case") -> "list[Behaviour]":
    """Return the behaviours in use, in the order of the case; those that act last behind the others."""
    made: list[Behaviour] = [
        case.registry.get("behaviour", name)(**table) for name, table in case.behaviours.items() if table is not False
    ]
    return sorted(made, key=lambda behaviour: behaviour.acts_last)


def make_recorders(case: "Case") -> "list[Recorder]":
    """Return the recorders in use: all that are registered but those switched off."""
    given = {name: case.recorders.get(name, {}) for name in case.registry.recorders}
    return [case.registry.get("recorder", name)(**table) for name, table in given.items() if table is not False]


def providers(case: "Case") -> list[str]:
    """Return name and version of each plugin that a case names, and of those with a part in every run."""
    used = [make_importer(case), make_contact_model(case), *make_forces(case), *make_behaviours(case)]
    return case.registry.providers([*used, *make_recorders(case)])


def read_surface(importer: "Importer", path: Path) -> SurfaceMesh:
    """Return the surface that an importer reads from a file.

    Raises
    ------
    BuildingError
        The file is missing, empty or damaged.
    PluginError
        The importer fails, or returns something else than a surface.
    """
    if not path.is_file():
        raise BuildingError(f"{path}: no such file; check the path")
    if path.stat().st_size == 0:
        raise BuildingError(f"{path}: the file is empty; write it again")
    with plugin_code(f"{path}: importer {importer.name!r}"):
        try:
            mesh = importer.read(path)
        except (ValueError, OSError) as error:
            raise BuildingError(
                f"{path}: cannot be read: {error}; write the file again, or in another format"
            ) from error
    if not isinstance(mesh, SurfaceMesh):
        raise PluginError(f"{path}: importer {importer.name!r} returned {type(mesh).__name__}, not a SurfaceMesh")
    return mesh


def _building(importer: "Importer", path: Path, options: dict[str, Any]) -> "Building":
    """Read a file and make a building of its surface."""
    return build_building(read_surface(importer, path), path, **options)
