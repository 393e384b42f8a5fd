"""Checks of plugins in a case: reproducibility, recorders, behaviours, the air, importers and exporters."""

import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.errors import BuildingError, PluginError, ResultError, RunWarning, counted, plugin_code
from evac.base.parameters import Configurable
from evac.building.importer import Importer
from evac.building.surface.surfacemesh import checked
from evac.case.case import Case
from evac.conditions.law import SmokeLaw
from evac.conditions.source import ConditionSource
from evac.conformance.failures import CheckError, examining, require, scene
from evac.export.exporter import Exporter, export
from evac.people.behaviour import DECLARE, Behaviour, BehaviourScene, check_written
from evac.simulation.assembly import make_building, make_importers, read_surface
from evac.simulation.checkpoints import without_state
from evac.simulation.running import run
from evac.simulation.simulation import Simulation
from evac.trajectory.recorder import Recorder
from evac.trajectory.trajectory import read_trajectory

#: Desired speeds [m/s], and extinction coefficients [1/m] from clear air to smoke in which nothing is seen.
SPEEDS, SMOKE = (0.0, 0.2, 0.8, 1.25, 2.0), (0.0, 0.01, 0.1, 0.5, 1.0, 3.0, 10.0, 100.0)

#: Contents of files that no importer can read.
GARBAGE = (b"\n", b"\x00\xff\xfe\x80" * 16, b"0 1 2\nthis is no building\n")


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
        with scene(f"{title}, without a result folder"):
            simulation, made = started(None)
            made.finish(simulation, None)
            _advance(simulation, ticks)
            files_of(simulation)
        with scene(f"{title}, with a result folder"):
            simulation, _ = started(Path(place))
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
            again = files_of(simulation)
            remedy = "state() must return all that it keeps, and files() the lengths of files that it appends to"
            for path, content in files.items():
                require(again[path] == content, f"{path.name} differs in a run resumed from a checkpoint; {remedy}")


def check_source(source: ConditionSource, case: Case, ticks: int) -> None:
    """Check that a source gives values at people's heads, which `Air` checks, and the same ones each time."""
    simulation = Simulation(case, will_run=False)
    assert simulation.exposure is not None
    air, crowd = simulation.exposure.air, simulation.population.crowd
    heads = air.heads_at(crowd.level, crowd.position, crowd.height)
    with examining("its at()"):
        first, second = (air.at(air.quantities, 0.0, crowd.level, crowd.position, heads) for _ in range(2))
        failure = "gives other values when it is asked again; compute them from place and time"
        require(np.array_equal(first, second), failure)


def check_speeds(law: SmokeLaw) -> None:
    """Check that speeds in smoke are finite, the desired ones in clear air, and of each person alone."""
    desired, extinction = given = np.array(np.meshgrid(SPEEDS, SMOKE)).reshape(2, -1)
    before, is_clear = given.copy(), extinction == 0.0
    with examining("its speed()"):
        speed = np.asarray(law.speed(desired, extinction))
        failure = f"returns {speed.shape}, not {desired.shape}; return one for each person"
        require(speed.shape == desired.shape, failure)
        failure = "returns a speed that is not finite; check extinction coefficients of 0"
        require(np.isfinite(speed).all(), failure)
        require(np.array_equal(given, before), "changes its arguments; return a new array")
        failure = "slows people in clear air; return the desired speeds where K is 0"
        require((np.clip(speed, 0.0, desired) == desired)[is_clear].all(), failure)
        alone = [law.speed(desired[k : k + 1], extinction[k : k + 1])[0] for k in range(len(speed))]
        failure = "gives a person another speed if others are there; use only the values of each person"
        require(np.array_equal(speed, alone), failure)


def check_declared_arrays(behaviour: Behaviour, case: Case, ticks: int) -> None:
    """Check that a behaviour reads and writes only what it declares, at the start and in artificial scenes."""
    simulation, used, view = _prepared(case, behaviour.name)
    crowd, routes = simulation.population.crowd, len(simulation.fields.routes)
    outside = None if simulation.outside is None else simulation.outside.arrays
    for title, time in _artificial_scenes(simulation):
        with scene(f"{title} of {case.title}"):
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
    crowd.velocity[:], crowd.contact_force[:] = 0.0, 5000.0
    crowd.position[inside] = crowd.position[inside[0]] + 1e-3 * np.arange(len(inside))[:, None]
    crowd.level[inside] = crowd.level[inside[0]]
    yield "a crush", 0.0
    yield "a crush at the end", end
    crowd.contact_force[:], crowd.level[inside[1:]] = 0.0, -1
    yield "the last person inside", end


def check_distance(behaviour: Behaviour, case: Case, ticks: int) -> None:
    """Check that a behaviour that keeps distances slows people down behind people who have left, inside and outside."""
    if not behaviour.keeps_distance:
        return
    simulation, used, view = _prepared(case, behaviour.name)
    crowd, way = simulation.population.crowd, simulation.building.exits[0]
    with scene(f"three people at an exit of {case.title}"):
        assert simulation.outside is not None
        outside, depth = simulation.outside.arrays, np.array([-0.4, 0.2, 0.8])
        begin, end = way.segments[0].reshape(2, 2)
        normal = (end - begin)[::-1] * (1.0, -1.0) / np.hypot(*(end - begin))
        outside.position[:3] = (begin + end) / 2 + depth[:, None] * normal
        outside.depth[:3], outside.direction[:3] = depth, normal
        crowd.level[:], crowd.start_time[:] = -1, -1.0
        crowd.level[0], crowd.position[0] = way.level, outside.position[0]
        factors = []
        for number in range(3):
            outside.level[1 : 1 + number] = way.level
            crowd.speed_factor[:], crowd.extra_direction[:], outside.speed_factor[:] = 1.0, 0.0, 1.0
            used.act(view.crowd, 0.0)
            factors.append((crowd.speed_factor[0], outside.speed_factor[1]))
        remedy = "use scene.outside, and multiply its speed_factor; or do not set keeps_distance"
        failure = f"does not slow down a person {{}}, 0.6 m ahead; {remedy}"
        require(factors[1][0] < factors[0][0], failure.format("inside behind a person who has left"))
        require(factors[2][1] < factors[1][1], failure.format("who has left behind another one"))


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
    with TemporaryDirectory() as place:
        for path, content in [(Path(place, f"damaged{end}"), text) for end in importer.suffixes for text in GARBAGE]:
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
        for what in ("points", "triangles"):
            wrong = f"two readings of the file differ in {what}"
            same = np.array_equal(getattr(first, what), getattr(second, what))
            require(same, f"{wrong}; keep no state between them")
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
                failure = "the two exports differ; do not write the current time or random numbers"
                require(exported[0] == exported[-1], failure)
                require(trajectory.path.read_bytes() == before, "the trajectory file has changed; only read it")
        with scene("a run without frames"), suppress(ResultError):
            export(replace(trajectory, time=trajectory.time[:0], rows=()), exporter, path)
