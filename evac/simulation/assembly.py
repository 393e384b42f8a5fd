"""Assembly: read the building of a case and create its plugins."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from evac.base.errors import BuildingError, PluginError, ScenarioError, fault, naming, plugin_code, text_of, usable_path
from evac.building.model.building import Building
from evac.building.model.findings import Finding
from evac.building.options import BuildingOptions
from evac.building.surface.build import build_building
from evac.building.surface.surfacemesh import SurfaceMesh
from evac.contract.hooks import DEFAULT_DISPATCHER
from evac.contract.registry import Registry, built_in, create
from evac.people.behaviour import Behaviour
from evac.people.groups import check_people, opens_later
from evac.people.places import Places, with_places
from evac.people.population import Population, build_population
from evac.people.starts import with_numbers
from evac.people.ways import check_ways
from evac.physics.contact.model import ContactModel, SolvedContactModel, border_scene
from evac.physics.engine import CompiledEngine, Engine
from evac.physics.force import Force
from evac.simulation.needed import solve_fields
from evac.simulation.scene import Scene, SharedScene

if TYPE_CHECKING:
    from evac.building.importer import Importer
    from evac.building.plan.plan import Plan
    from evac.case.case import Case
    from evac.conditions.exposure import Exposure
    from evac.conditions.safety import Safety
    from evac.people.dispatcher import Dispatcher
    from evac.simulation.lifts import Lifts
    from evac.simulation.simulation import Simulation
    from evac.trajectory.recorder import Recorder


Found = TypeVar("Found")

#: The engine of all runs; nothing else chooses one.
ENGINE = CompiledEngine


def make_building(case: "Case") -> Building:
    """Return the building of a case, read from its file or its plan."""
    read = _plan_of(case) if case.mesh is None else read_file(_importer(case, case.mesh), case.mesh)
    return with_places(case, _built(read, case.registry, case.mesh or case.source, case.building))


def _plan_of(case: "Case") -> "Plan":
    """Return the plan that a case holds."""
    from evac.building.plan.plantable import plan_of

    assert case.building.plan is not None
    return plan_of(case.building.plan, case.source, case.folder, "building.plan.")


def read_building(
    path: str | Path, *, registry: Registry | None = None, need_exit: bool = True, **options: Any
) -> Building:
    """Return the building in a file, without a case.

    Parameters
    ----------
    path : str or Path
    registry : Registry, optional
        Registry whose importers may be used; by default the built-in and the installed ones.
    need_exit : bool
        Whether a building without exits is an error. Without exits, a building can be inspected but not simulated.
    **options
        Keys of ``[building]``.

    Returns
    -------
    Building

    Raises
    ------
    BuildingError
        The file cannot be read, or the building cannot be used.
    PluginError
        The importer fails.

    Examples
    --------
    >>> building = evac.read_building("hall.msh", scale=0.001)  # doctest: +SKIP
    """
    path = usable_path(path, BuildingError)
    own = BuildingOptions.read(options, BuildingError, f"{path}: building.")
    registry = registry or Registry(builtins=built_in("importer"))
    importer = create("importer", registry.importer_for(path), {})
    return _built(read_file(importer, path), registry, path, own, need_exit=need_exit)


def _built(
    read: "SurfaceMesh | Plan", registry: Registry, source: Path, options: BuildingOptions, *, need_exit: bool = True
) -> Building:
    """Return the building of what an importer has read, or of the plan of a case."""
    if isinstance(read, SurfaceMesh):
        return build_building(read, source, options, need_exit=need_exit)
    from evac.building.plan.faults import build

    return build(read_storeys(read, registry), source, options, need_exit=need_exit)


def files_of_building(case: "Case", importers: "Sequence[Importer]") -> Sequence[Path]:
    """Return the files that the building is read from."""
    if case.mesh is None:
        return _plan_of(case).files
    return _called(importers[0], case.mesh, importers[0].files)


def make_importers(case: "Case") -> "list[Importer]":
    """Return the importer of the building's file, with its parameters; none if the case holds the plan itself."""
    return [] if case.mesh is None else [_importer(case, case.mesh)]


def _importer(case: "Case", path: Path) -> "Importer":
    """Return the importer for a file, chosen among those that the case does not switch off."""
    off = {name for name, table in case.importers.items() if table is False}
    importer = case.registry.importer_for(path, off)
    made: Importer = create("importer", importer, case.importers.get(importer.name) or {})
    return made


def make_contact_model(case: "Case") -> ContactModel:
    """Return the contact model in use, with its parameters."""
    name = case.contact.model
    model = case.registry.get("contact_model", name)
    made: ContactModel = create("contact model", model, case.contact.tables.get(name, {}))
    if isinstance(made, SolvedContactModel):
        try:
            case.registry.get("solver", made.solver)
        except PluginError as error:
            raise ScenarioError(f"{case.source}: contact.{name}.solver: {error}") from None
    return made


def make_shared_scene(case: "Case", building: Building | None = None) -> SharedScene:
    """Return building and directions of a case, as its simulation computes them; `building`: without its places."""
    building = make_building(case) if building is None else with_places(case, building)
    check_people(case, building)
    case = with_numbers(case, building)
    with naming(case.source):
        return SharedScene(building, solve_fields(case, building, make_behaviours(case), full=False, workers=1))


def make_population(
    case: "Case", shared_scene: SharedScene, contact: ContactModel, behaviours: Sequence[Behaviour]
) -> tuple[Population, Places, tuple[Finding, ...], float]:
    """Draw the people of a case, and check all that depends on them before a run.

    The findings are places that are too narrow for some of them, the number is the greatest overlap [m] that the
    contact model promises them.
    """
    building, fields, world = shared_scene.building, shared_scene.fields, shared_scene.world
    people = build_population(case, building, fields, case.simulation.seed, behaviours)
    crowd = people.crowd
    places = Places(case, building, fields.routes, crowd)
    places.assign(fields)
    stopping = check_ways(case.source, building, fields, world, crowd, people.groups, places.full, opens_later(case))
    border = border_scene(crowd, case.simulation.step, case.simulation.is_explicit)
    with naming(case.source):
        with plugin_code(f"contact model {contact.name!r}: check_scene", contact):
            contact.check_scene(border)
        with plugin_code(f"contact model {contact.name!r}: promised_overlap", contact):
            promised = float(contact.promised_overlap(border))
    return people, places, stopping, promised


def make_exposure(case: "Case", scene: Scene, people: Population) -> "Exposure | None":
    """Return the exposure of people to smoke, gases and heat; nothing is imported in a case without them."""
    if not case.conditions:
        return None
    from evac.conditions.exposure import Exposure

    return Exposure(case, scene, people.crowd, people.groups)


def make_lifts(case: "Case", scene: Scene) -> "Lifts | None":
    """Return the cars of the lifts of a scene; nothing is imported for a building without lifts."""
    if not scene.building.lifts:
        return None
    from evac.simulation.lifts import Lifts

    return Lifts(scene, make_dispatcher(case))


def make_dispatcher(case: "Case") -> "Dispatcher":
    """Return the dispatcher in use."""
    made: list[Dispatcher] = _all_made(case, "dispatcher", case.dispatchers)
    if len(made) > 1:
        raise ScenarioError(f"{case.source}: dispatchers: {len(made)} are in use; set all but one of them to false")
    return (made or _all_made(case, "dispatcher", {DEFAULT_DISPATCHER: {}}))[0]


def make_safety(case: "Case", scene: SharedScene, people: Population, exposure: "Exposure | None") -> "Safety | None":
    """Return the times of compartments and the margins of people of a case with `[safety]`."""
    if case.safety is None:
        return None
    from evac.conditions.safety import Safety

    air = None if exposure is None else exposure.air
    return Safety(case, case.safety, scene.building, people.crowd, air, people.staying, scene.floors)


def make_engine(simulation: "Simulation", behaviours: Sequence[Behaviour]) -> Engine:
    """Return the engine of a simulation with its people and forces."""
    scene, people = simulation.scene, len(simulation.population.crowd.level)
    return ENGINE(
        scene.world,
        people,
        simulation.forces,
        simulation.full,
        [level.title for level in scene.building.levels],
        simulation.registry.solvers,
        any(behaviour.stands_firm for behaviour in behaviours),
    )


def make_forces(case: "Case") -> list[Force]:
    """Return the forces in use, in the order of the case."""
    return _all_made(case, "force", case.forces)


def make_behaviours(case: "Case") -> list[Behaviour]:
    """Return the behaviours in use, in the order of the case; those with `acts_last` come last."""
    made: list[Behaviour] = _all_made(case, "behaviour", case.behaviours)
    return sorted(made, key=lambda behaviour: behaviour.acts_last)


def make_recorders(case: "Case") -> "list[Recorder]":
    """Return the recorders in use: all registered recorders except those that the case switches off."""
    given = {name: case.recorders.get(name, {}) for name in case.registry.recorders}
    return _all_made(case, "recorder", given)


def providers(case: "Case") -> list[str]:
    """Return name and version of each plugin that a case uses, and of plugins whose hooks act in every run."""
    used = [*make_importers(case), make_contact_model(case), *make_forces(case), *make_behaviours(case)]
    return case.registry.providers([*used, *make_recorders(case), *_all_made(case, "dispatcher", case.dispatchers)])


def _all_made(case: "Case", kind: str, tables: Mapping[str, Any]) -> list[Any]:
    """Return the plugins of a kind that are not switched off, each with its parameters."""
    used = {name: table for name, table in tables.items() if table is not False}
    with naming(case.source):
        return [create(kind, case.registry.get(kind, name), table) for name, table in used.items()]


def read_surface(importer: "Importer", path: Path, registry: Registry | None = None) -> SurfaceMesh:
    """Return the surface that an importer reads from a file; a plan is converted to a surface."""
    read = read_file(importer, path)
    if isinstance(read, SurfaceMesh):
        return read
    return read_storeys(read, registry or Registry(builtins=built_in("importer"))).surface()


def read_storeys(plan: "Plan", registry: Registry) -> "Plan":
    """Return a plan whose storeys that are given as files have been read."""
    from evac.building.plan.plan import Plan

    for storey in [each for each in plan.storeys.values() if each.file is not None]:
        assert storey.file is not None
        try:
            read = read_file(registry.importer_for(storey.file)(**storey.options), storey.file)
        except (BuildingError, PluginError) as error:
            raise type(error)(f"{plan.source}: storey {storey.name!r}: {error}") from error
        if not isinstance(read, Plan):
            raise BuildingError(
                f"{plan.source}: storey {storey.name!r}: {storey.file} is a mesh; a storey needs a file with a plan"
            )
        if any(each.file is not None for each in read.storeys.values()):
            raise BuildingError(
                f"{plan.source}: storey {storey.name!r}: {storey.file} takes its own storeys from other files; name "
                "those files here"
            )
        plan.take(storey.name, read)
    return plan


def read_file(importer: "Importer", path: Path) -> "SurfaceMesh | Plan":
    """Return what an importer reads from a file: a plan, not yet converted to a surface, or a surface."""
    from evac.building.plan.plan import Plan

    read = _called(importer, path, importer.read)
    if not isinstance(read, SurfaceMesh | Plan):
        wrong = f"read() returns {'None' if read is None else f'an object of class {type(read).__name__}'}"
        raise fault(f"{path}: importer {importer.name!r}", wrong, "return a Plan or a SurfaceMesh", type(importer).read)
    return read


def _called(importer: "Importer", path: Path, method: Callable[[Path], Found]) -> Found:
    """Return what a method of an importer makes of a file."""
    if not usable_path(path, BuildingError).is_file():
        raise BuildingError(f"{path}: no such file; check the path")
    if path.stat().st_size == 0:
        raise BuildingError(f"{path}: the file is empty; export it again")
    with plugin_code(f"{path}: importer {importer.name!r}", importer):
        try:
            return method(path)
        except (ValueError, OSError) as error:
            text = text_of(error)
            remedy = "" if ";" in text else "; correct the file, or export it again"
            raise BuildingError(f"{path}: cannot be read: {text}{remedy}") from error
