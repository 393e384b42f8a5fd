"""Conformance checks for plugins, which plugin authors call in their own tests.

A failed check raises `PluginError`, which names the plugin, the check and the scene, and says what is wrong, by how
much, and what to change. The same checks are applied to all built-in plugins.
"""

import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from cProfile import Profile
from dataclasses import replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from types import CodeType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.errors import BuildingError, PluginError, ResultError, RunWarning, counted, plugin_code
from evac.base.parameters import Configurable, Parameter
from evac.building.importer import Importer
from evac.building.surface.surfacemesh import checked
from evac.case.case import Case
from evac.case.loading import load_case
from evac.conditions.law import SmokeLaw
from evac.conditions.source import ConditionSource
from evac.conformance import physics
from evac.conformance.physics import CheckError, examining, require, run_check, scene
from evac.contract.registry import HOOKS, Registry, check_class, check_interface, kind_of
from evac.export.exporter import Exporter, export
from evac.people.behaviour import DECLARE, Behaviour, BehaviourScene, check_written
from evac.people.dispatcher import Car, Dispatcher, StopCall
from evac.physics.contact.model import ContactModel
from evac.physics.contact.pair_contact import PairContact
from evac.physics.contact.rows import Solver
from evac.physics.force import Force
from evac.simulation.assembly import make_building, make_importers, read_surface
from evac.simulation.checkpoints import without_state
from evac.simulation.running import run
from evac.simulation.simulation import Simulation
from evac.trajectory.recorder import Recorder
from evac.trajectory.trajectory import read_trajectory

__all__ = ["check_plugin"]


def check_plugin(cls: type[Configurable], case: Case | None = None, ticks: int = 20, **values: Any) -> None:
    """Run all checks that apply to a plugin class."""
    run_check(cls, check_contract, cls)
    run_check(cls, check_construction, cls, values)
    for kind, check in ALONE:
        if issubclass(cls, kind):
            run_check(cls, check, cls(**values))
    if case is None and issubclass(cls, Importer):
        return  # no shipped case has such files
    advice = "" if case else "; if it needs areas, groups or files of its own, give a case that has them (--case CASE)"
    case = case or run_check(cls, check_registration, cls, values)
    for kind, check in IN_A_CASE:
        if issubclass(cls, kind):
            run_check(cls, check, cls(**values), case, ticks, advice=advice)


def check_contract(cls: Any) -> None:
    """Check the interface version, the base class, the name and the docstring."""
    require(isinstance(cls, type), f"{cls!r} is not a class; pass a class, such as {type(cls).__name__}")
    module = sys.modules.get(cls.__module__)
    if module is not None and any(hasattr(module, name) for name in ("evac_interface", *HOOKS)):
        with examining(f"the module {cls.__module__}"):
            check_interface(module, cls.__module__)
    check_class(cls, cls.__module__)
    require(bool((cls.__doc__ or "").strip()), f"{cls.__name__} has no docstring; add one, which `evac plugins` shows")


def check_construction(cls: type[Configurable], values: dict[str, Any]) -> None:
    """Check that a plugin can be made with its defaults and with given parameters, which are described."""
    for key, parameter in cls.declared().items():
        with examining(f"the parameter {key}", "change its default or its range"):
            require(bool(parameter.doc.strip()), "it has no description; add doc to its declaration")
            parameter.check(f"{cls.name}.{key}", parameter.default)
    with examining("the class with its defaults"):
        is_set = not any(isinstance(value, Parameter) for value in cls().values().values())
        require(is_set, "__init__ does not set the parameters; call super().__init__(**values) first")
    given = ", ".join(f"{key} = {value!r}" for key, value in values.items())
    with examining(f"the class with {given}", "give other values, or correct the plugin"):
        cls(**values)


def check_registration(cls: type[Configurable], values: dict[str, Any]) -> Case:
    """Check that a plugin can be registered; return a shipped case, changed to use the plugin."""
    registry = Registry()
    registry.add_class(cls)
    kind, solved, smoke = kind_of(cls), physics.SOLVED.name, {"source": "prescribed", "values": {"extinction": 1.0}}
    using: dict[str, dict[str, Any]] = {
        "contact_model": {"contact.model": cls.name, f"contact.{cls.name}": values},
        "solver": {"contact.model": solved, f"contact.{solved}.solver": cls.name},
        "smoke_law": {"smoke.law": cls.name, f"smoke.{cls.name}": values, "conditions": [smoke]},
        "condition_source": {"smoke.law": "none", "conditions": [{"source": cls.name, **values}]},
        "exporter": {},
    }
    return load_case("square_room", using.get(kind, {f"{kind}s.{cls.name}": values}), registry=registry)


def check_same_bits(plugin: Configurable, case: Case, ticks: int) -> None:
    """Check that results are bitwise equal: when repeated, resumed, and with all optional parts included."""
    title, half = f"{counted(ticks, 'tick')} of {case.title}", ticks // 2
    with scene(title):
        simulation = Simulation(case)
        middle, whole = _advance(simulation, half), _advance(simulation, ticks - half)
    with scene(f"{title}, repeated"):
        failure = "two runs differ in {}; use only the generator scene.generator"
        _require_same(whole, _advance(Simulation(case), ticks), failure)
    with scene(f"{title}, resumed in the middle"):
        resumed = Simulation(case)
        resumed.restore(middle)
        failure = "a resumed run differs in {}; state() must return all private arrays"
        _require_same(whole, _advance(resumed, ticks - half), failure)
        for line in without_state(resumed):
            raise PluginError(line)
    with scene(f"{title}, with all optional parts"):
        people = {key for key in whole if key.startswith("population.") and key != "population.route"}
        failure = "omitting parts that are not needed changes {}; correct is_needed()"
        _require_same({key: whole[key] for key in people}, _advance(Simulation(case, full=True), ticks), failure)


def _advance(simulation: Simulation, ticks: int) -> dict[str, NDArray[Any]]:
    """Make a number of ticks, unless the run ends before, and return the state."""
    for _ in range(ticks):
        if not simulation.ended:
            simulation.advance_tick()
    return simulation.state()


def _require_same(first: dict[str, NDArray[Any]], second: dict[str, NDArray[Any]], failure: str) -> None:
    """Raise a `CheckError` that names the first array that differs or is missing."""
    for key, value in first.items():
        is_same = key in second and np.array_equal(value, second[key], equal_nan=value.dtype.kind == "f")
        require(is_same, failure.format(key))


def check_recorder(recorder: Recorder, case: Case, ticks: int) -> None:
    """Check that a recorder works without a folder and a start, and that its files survive a resumed run."""

    def started(folder: Path | None) -> tuple[Simulation, Recorder]:
        simulation, made = Simulation(case, folder), type(recorder)(**recorder.values())
        simulation.recording.recorders = [made]
        return simulation, made

    def files_of(simulation: Simulation) -> dict[Path, bytes]:
        simulation.recording.finish(simulation, case.registry, simulation.results(), None)
        return {path: path.read_bytes() for path in sorted(Path(place).rglob("*")) if path.is_file()}

    title, half = f"{counted(ticks, 'tick')} of {case.title}", ticks // 2
    with TemporaryDirectory() as place:
        for what, folder in (("without", None), ("with", Path(place))):
            with scene(f"{title}, {what} a result folder"):
                simulation, made = started(folder)
                made.finish(simulation, None)
                middle = _advance(simulation, half)
                kept, lengths = simulation.recording.state(), simulation.recording.files()
                for line in without_state(simulation):
                    raise PluginError(line)
                _advance(simulation, ticks - half)
                files = files_of(simulation)
        with scene(f"{title}, resumed in the middle"):
            simulation, _ = started(Path(place))
            simulation.restore(middle)
            simulation.recording.restore(simulation, kept, lengths)
            _advance(simulation, ticks - half)
            remedy = "state() must return all that it keeps, and files() the lengths of files that it appends to"
            for path, content in files_of(simulation).items():
                require(files[path] == content, f"{path.name} differs from that of a run in one piece; {remedy}")


def check_source(source: ConditionSource, case: Case, ticks: int) -> None:
    """Check that a source gives values at people's heads, which `Air` checks, and the same ones each time."""
    simulation = Simulation(case, will_run=False)
    assert simulation.exposure is not None
    air, crowd = simulation.exposure.air, simulation.population.crowd
    heads = air.heads_at(crowd.level, crowd.position, crowd.height)
    with examining("its at()"):
        first, second = (air.at(air.quantities, 0.0, crowd.level, crowd.position, heads) for _ in range(2))
        require(np.array_equal(first, second), "differs when it is asked again; compute values from place and time")


def check_speeds(law: SmokeLaw) -> None:
    """Check that speeds in smoke are finite, the desired ones in clear air, and of each person alone."""
    smoke = (0.0, 0.01, 0.1, 0.5, 1.0, 3.0, 10.0, 100.0)  # from clear air to smoke in which nothing is seen
    desired, extinction = given = np.array(np.meshgrid((0.0, 0.2, 0.8, 1.25, 2.0), smoke)).reshape(2, -1)
    before = given.copy()
    with examining("its speed()"):
        speed = np.asarray(law.speed(desired, extinction))
        require(speed.shape == desired.shape, f"returns {speed.shape}, not {desired.shape}; return one for each person")
        require(np.isfinite(speed).all(), "returns a speed that is not finite; check extinction coefficients of 0")
        require(np.array_equal(given, before), "changes its arguments; return a new array")
        is_kept = (speed.clip(0.0, desired) == desired)[extinction == 0.0].all()
        require(is_kept, "slows people in clear air; return the desired speeds where K is 0")
        alone = [law.speed(desired[k : k + 1], extinction[k : k + 1])[0] for k in range(len(speed))]
        require(np.array_equal(speed, alone), "differs if others are there; use only the values of each person")


def check_stops(dispatcher: Dispatcher) -> None:
    """Check that the next stops of cars are those of calls, or none, and follow from the arguments alone."""
    heights = tuple(3.5 * stop for stop in range(6))
    storeys = tuple(f"storey {stop}" for stop in range(6))
    with examining("its next_stop()"):
        for stop, stops in product(range(6), ((1,), (5,), (2, 4), (1, 2, 3, 4, 5))):
            car = Car("car", storeys, heights, stop, 0, 13)
            calls = tuple(StopCall(at, at + 1, 10.0 * at) for at in stops)
            first, second = (dispatcher.next_stop(car, calls, 60.0) for _ in range(2))
            require(first is None or first in stops, f"returns {first!r}; return the stop of a call, or None")
            require(first == second, "differs when it is asked again; choose from the arguments alone")


def check_declared_arrays(behaviour: Behaviour, case: Case, ticks: int) -> None:
    """Check that a behaviour reads and writes only what it declares, at the start and in artificial scenes."""
    simulation, used, view = _prepared(case, behaviour.name)
    crowd, routes = simulation.population.crowd, len(simulation.fields.routes)
    outside = None if simulation.outside is None else simulation.outside.arrays
    for title, time in _artificial_scenes(simulation):
        with scene(f"{title} of {case.title}"), simulation.population.writable():
            before = {key: array.copy() for key, array in crowd.values().items() if key not in used.writes}
            with plugin_code("its method", used, DECLARE):
                used.act(view.crowd, time)
            for key, array in before.items():
                is_same = np.array_equal(array, getattr(crowd, key), equal_nan=True)
                require(is_same, f"writes {key!r} without declaring it; add it to `writes`")
            check_written(used, view.level_fields, view.crowd, outside, routes, time)


def _artificial_scenes(simulation: Simulation) -> Iterator[tuple[str, float]]:
    """Change a simulation to one scene after the other; yield the name and the time [s] of each."""
    crowd, end = simulation.population.crowd, simulation.case.simulation.duration
    yield "the start", 0.0
    inside = np.flatnonzero(crowd.level >= 0)
    with simulation.population.writable():
        crowd.velocity[:], crowd.contact_force[:] = 0.0, 5000.0
    crowd.position[inside] = crowd.position[inside[0]] + 1e-3 * np.arange(len(inside))[:, None]
    crowd.level[inside] = crowd.level[inside[0]]
    yield "a crush", 0.0
    yield "a crush at the end", end
    with simulation.population.writable():
        crowd.contact_force[:], crowd.level[inside[1:]] = 0.0, -1
    yield "the last person inside", end


def _prepared(case: Case, name: str) -> tuple[Simulation, Behaviour, BehaviourScene]:
    """Return a simulation, and a prepared behaviour with its scene."""
    with scene(case.title):
        simulation = Simulation(case, full=True)
        for used, view in simulation.behaviours:
            if used.name == name:
                return simulation, used, view
        raise CheckError(f"the case does not use behaviour {name!r}; give a case that does")


def check_damaged_files(importer: Importer) -> None:
    """Check that damaged files are refused with ValueError."""
    garbage = b"\n", b"\x00\xff\xfe\x80" * 16, b"0 1 2\nthis is no building\n"
    with TemporaryDirectory() as place:
        for path, content in [(Path(place, f"damaged{end}"), text) for end in importer.suffixes for text in garbage]:
            path.write_bytes(content)
            with scene(f"a damaged file {path.name} with the content {content!r}"), suppress(BuildingError):
                mesh = checked(path, read_surface(importer, path))
                wrong = f"it is read as a surface of {counted(len(mesh.triangles), 'triangle')}"
                raise CheckError(f"{wrong}; raise ValueError for files that are not of this format")


def check_surface(importer: Importer, case: Case, ticks: int) -> None:
    """Check that the file of a case is read twice to the same surface, from which a building can be made."""
    with scene(case.title):
        used, path = make_importers(case), case.mesh
        if path is None or used[0].name != importer.name:
            what = f"read by {used[0].name!r}" if used else "not read from a file"
            raise CheckError(f"the building of the case is {what}; give a case that uses {importer.name!r}")
    with scene(f"{case.title}, the file {path.name}"):
        first, second = (checked(path, read_surface(make_importers(case)[0], path)) for _ in range(2))
        same = np.array_equal(first.points, second.points) and np.array_equal(first.triangles, second.triangles)
        require(same, "two readings of the file differ in points or cells; keep no state between them")
        make_building(case)


def check_exports(exporter: Exporter, case: Case, ticks: int) -> None:
    """Check that an exporter writes only to its path, the same when it is repeated, also for a run without frames."""
    with TemporaryDirectory() as made, TemporaryDirectory() as place:
        with scene(case.title), warnings.catch_warnings(action="ignore", category=RunWarning):
            tick = case.simulation.tick
            lengths = {"simulation.duration": ticks * tick, "output.every": max(1, ticks // 4) * tick}
            run(case.change(lengths | {"output.animation": False, "output.picture": False}), Path(made, "result"))
            trajectory = read_trajectory(Path(made, "result"))
        before, exported, path = trajectory.path.read_bytes(), [], Path(place, f"export{exporter.suffix}")
        for again in ("", ", exported again to the same place"):
            with scene(f"a run of some ticks{again}"):
                export(trajectory, exporter, path)
                files = sorted(file for file in Path(place).rglob("*") if file.is_file())
                strays = [file.name for file in files if file != path and path not in file.parents]
                require(not strays, f"writes {', '.join(strays)} outside `path`; write to `path` only")
                exported.append([(file, file.read_bytes()) for file in files])
                require(exported[0] == exported[-1], "the two exports differ; do not write times or random numbers")
                require(trajectory.path.read_bytes() == before, "the trajectory file has changed; only read it")
        with scene("a run without frames"), suppress(ResultError):
            export(replace(trajectory, time=trajectory.time[:0], rows=()), exporter, path)


#: Checks of a plugin by itself, and of one that a case uses for a number of ticks, by base class.
ALONE: tuple[tuple[type, Callable[..., None]], ...] = (
    (PairContact, physics.check_pair_law),
    (ContactModel, physics.check_free_walk),
    (ContactModel, physics.check_collision),
    (ContactModel, physics.check_room),
    (ContactModel, physics.check_crowd),
    (Solver, physics.check_solver),
    (Force, physics.check_force),
    (SmokeLaw, check_speeds),
    (Dispatcher, check_stops),
    (Importer, check_damaged_files),
)
IN_A_CASE: tuple[tuple[type, Callable[..., None]], ...] = (
    (Importer, check_surface),
    (Exporter, check_exports),
    (ConditionSource, check_source),
    (Behaviour, check_declared_arrays),
    (Recorder, check_recorder),
    (Configurable, check_same_bits),
)


#: Tables of case.toml with plugins without which a case can be run.
OPTIONAL = {"behaviour": "behaviours", "force": "forces"}

#: Arrays of people that are compared at the ends of two runs.
COMPARED = ("position", "velocity", "exit_time", "exit_used", "distance", "start_time")


def tried_in(case: Case, plugins: list[tuple[str, str]]) -> Iterator[str]:
    """Run a case, and yield lines on plugins of one file, each given as kind and name."""
    classes = {name: case.registry.get(kind, name) for kind, name in plugins}
    with Profile() as profile:
        whole = Simulation(case)
        whole.run()
    calls = {entry.code: entry.callcount for entry in profile.getstats()}
    for kind, name in plugins:
        yield from (f"{kind} {name}: {line}" for line in _methods(classes[name], calls))
        if kind in OPTIONAL and getattr(case, OPTIONAL[kind]).get(name, False) is False:
            yield f"{kind} {name}: the case does not use it; add [{OPTIONAL[kind]}.{name}]"
        elif kind in OPTIONAL:
            without = Simulation(case.change({f"{OPTIONAL[kind]}.{name}": False}))
            without.run()
            first, second = whole.population.crowd, without.population.crowd
            pairs = [(whole.step, without.step), *((getattr(first, key), getattr(second, key)) for key in COMPARED)]
            if all(np.array_equal(one, other, equal_nan=True) for one, other in pairs):
                yield f"{kind} {name}: had no effect; the run without it is the same in all bits"


def _methods(cls: type, calls: Mapping[Any, int]) -> Iterator[str]:
    """Yield a line for each method of a class that is written in Python."""
    for method in vars(cls).values():
        code = getattr(getattr(method, "__func__", method), "__code__", None)
        if isinstance(code, CodeType):
            often = calls.get(code, 0)
            yield f"{code.co_name} {'never ran' if not often else 'ran once' if often == 1 else f'ran {often} times'}"
