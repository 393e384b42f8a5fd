"""Checks of plugins in a running case: reproducibility, recorders, behaviours, conditions, importers and exporters."""

import warnings
from collections.abc import Iterator
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
from evac.conditions.source import ConditionSource
from evac.conformance.failures import CheckError, examining, require, scene, with_remedy
from evac.export.exporter import Exporter, export
from evac.people.behaviour import DECLARE, Behaviour, BehaviourScene, check_written
from evac.simulation.assembly import make_building, make_importers, read_surface
from evac.simulation.checkpoints import without_state
from evac.simulation.running import run
from evac.simulation.simulation import Simulation
from evac.trajectory.recorder import Recorder
from evac.trajectory.recording import reading
from evac.trajectory.trajectory import read_trajectory

State = dict[str, NDArray[Any]]

#: Contact force on each person in an artificial crush [N].
CRUSH = 5000.0

RESUMED = "resumed in the middle"

#: Contents of files that no importer can read.
GARBAGE = (b"\n", b"\x00\xff\xfe\x80" * 16, b"0 1 2\nthis is no building\n")


def check_same_bits(plugin: Configurable, case: Case, ticks: int) -> None:
    """Check that results are bitwise equal: when repeated, resumed, and with all optional parts included."""
    title, half = f"{counted(ticks, 'tick')} of {case.title}", ticks // 2
    with scene(title):
        simulation = Simulation(case)
        middle = _advance(simulation, half)
        whole = _advance(simulation, ticks - half)
    with scene(f"{title}, repeated"):
        told = "two runs differ in {}; use only the generator scene.generator"
        _require_same(whole, _advance(Simulation(case), ticks), told)
    with scene(f"{title}, {RESUMED}"):
        resumed = Simulation(case)
        resumed.restore(middle)
        told = "a resumed run differs in {}; state() must return all private arrays"
        while resumed.step < simulation.step:
            resumed.advance_tick()
        _require_same(whole, resumed.state(), told)
        for line in without_state(resumed):
            raise PluginError(line)
    with scene(f"{title}, with all optional parts"):
        full = _advance(Simulation(case, full=True), ticks)
        people = {key for key in whole if key.startswith("population.") and key != "population.route"}
        told = "omitting parts that are not needed changes {}; correct is_needed()"
        _require_same({key: whole[key] for key in people}, full, told)


def check_recorder(recorder: Recorder, case: Case, ticks: int) -> None:
    """Check that a recorder changes nothing, also without a result folder, and that its files survive a resumed run.

    It can finish without a start. Its files are identical if a run is stopped and resumed.
    """

    def started(*recorders: Recorder) -> tuple[Simulation, list[Recorder]]:
        simulation = Simulation(case, folder)
        simulation.recording.recorders = [type(one)(**one.values()) for one in recorders]
        return simulation, simulation.recording.recorders

    title, half, folder = f"{counted(ticks, 'tick')} of {case.title}", ticks // 2, None
    state, files = _advance(started()[0], ticks), dict[str, dict[str, bytes]]()
    for what in ("without a result folder", "with a result folder", RESUMED):
        with TemporaryDirectory() as place:
            folder = None if what.startswith("without") else Path(place)
            with scene(f"{title}, {what}, finished before its start"):
                simulation, (made,) = started(recorder)
                made.finish(simulation, None)
            with scene(f"{title}, {what}"):
                simulation, (made,) = started(recorder)
                try:
                    middle = _advance(simulation, half)
                    if what == RESUMED:
                        kept, lengths = simulation.recording.state(), simulation.recording.files()
                        for line in without_state(simulation):
                            raise PluginError(line)
                        _advance(simulation, half)  # data written after the checkpoint must be truncated on resume
                        made.finish(simulation, None)
                        simulation, (made,) = started(recorder)
                        simulation.restore(middle)
                        simulation.recording.restore(simulation, kept, lengths)
                    told = "changes {}; only read the simulation, and copy arrays"
                    _require_same(state, _advance(simulation, ticks - half), told)
                    with reading(simulation, "finish()", recorder):
                        made.finish(simulation, simulation.results())
                except ResultError as error:
                    remedy = "files() must return existing files of the folder, with the numbers of bytes written"
                    raise with_remedy(error, f"{remedy} so far") from error
                paths = (path for path in Path(place).rglob("*") if path.is_file())
                files[what] = {str(path.relative_to(place)): path.read_bytes() for path in paths}
                remedy = "state() must return all that it keeps, and files() the lengths of files that it appends to"
                for name, content in files["with a result folder"].items() if what == RESUMED else ():
                    told = f"{name} differs in a run resumed from a checkpoint; {remedy}"
                    require(files[what].get(name) == content, told)


def check_source(source: ConditionSource, case: Case, ticks: int) -> None:
    """Check that a source gives values at people's heads, which `Air` checks, and the same ones each time."""
    simulation = Simulation(case, will_run=False)
    assert simulation.exposure is not None
    air, crowd = simulation.exposure.air, simulation.population.crowd
    heads = air.heads_at(crowd.level, crowd.position, crowd.height)
    with examining("its at()"):
        first, second = (air.at(air.quantities, 0.0, crowd.level, crowd.position, heads) for _ in range(2))
        told = "gives other values when it is asked again; compute them from place and time"
        require(np.array_equal(first, second), told)


def check_declared_arrays(behaviour: Behaviour, case: Case, ticks: int) -> None:
    """Check that a behaviour reads and writes only the arrays that it declares, and writes possible values.

    The case runs for a number of ticks. Then artificial scenes are made: a closed exit, a crush, also at the end of the
    run, and the last person inside.
    """
    for scenes in (_ticks, _made_scenes):
        simulation, used, view = _prepared(case, behaviour.name)
        crowd, routes = simulation.population.crowd, len(simulation.fields.routes)
        outside = None if simulation.outside is None else simulation.outside.arrays
        for title, time in scenes(simulation, ticks):
            with scene(f"{title} of {case.title}"):
                before = {key: array.copy() for key, array in crowd.values().items() if key not in used.writes}
                with plugin_code("its method", used, DECLARE):
                    used.act(view.crowd, time)
                for key, array in before.items():
                    is_same = np.array_equal(array, getattr(crowd, key), equal_nan=True)
                    require(is_same, f"writes {key!r} without declaring it; add it to `writes`")
                check_written(used, view.level_fields, view.crowd, outside, routes, time)


def _ticks(simulation: Simulation, ticks: int) -> Iterator[tuple[str, float]]:
    """Advance a simulation by a number of ticks; yield a name and the time [s] before each."""
    for _ in range(ticks):
        if not simulation.ended:
            yield f"t = {simulation.time:.1f} s", simulation.time
            simulation.advance_tick()


def _made_scenes(simulation: Simulation, _: int) -> Iterator[tuple[str, float]]:
    """Change a simulation to artificial scenes, one after the other; yield the name and the time [s] of each."""
    crowd, end = simulation.population.crowd, simulation.case.simulation.duration
    inside = np.flatnonzero(crowd.level >= 0)
    if len(simulation.building.exits) > 1:
        simulation.scene.set_open(simulation.building.exits[0].name, False)
        yield "a closed exit", simulation.time
    crowd.velocity[:] = 0.0
    crowd.contact_force[:] = CRUSH
    crowd.position[inside] = crowd.position[inside[0]] + 1e-3 * np.arange(len(inside))[:, None]
    crowd.level[inside] = crowd.level[inside[0]]
    yield "a crush", simulation.time
    yield "a crush at the end", end
    crowd.contact_force[:] = 0.0
    crowd.level[inside[1:]] = -1
    yield "the last person inside", end


def check_distance(behaviour: Behaviour, case: Case, ticks: int) -> None:
    """Check that a behaviour that keeps distances slows people down behind people who have left, inside and outside."""
    if not behaviour.keeps_distance:
        return
    simulation, used, view = _prepared(case, behaviour.name)
    crowd, building = simulation.population.crowd, simulation.building
    way = next((way for way in building.exits if building.link_of(way) not in building.closed), None)
    with scene(f"three people at an exit of {case.title}"):
        if simulation.outside is None or way is None or len(crowd.level) < 3:
            raise CheckError("the case has no open exit, or fewer than three people; give a case that has")
        outside, depth = simulation.outside.arrays, np.array([-0.4, 0.2, 0.8])
        begin, end = max(way.segments.reshape(-1, 2, 2), key=lambda ends: np.hypot(*(ends[1] - ends[0])))
        normal = (end - begin)[::-1] * (1.0, -1.0) / np.hypot(*(end - begin))
        outside.position[:3] = (begin + end) / 2 + depth[:, None] * normal
        outside.depth[:3], outside.direction[:3] = depth, normal
        crowd.level[:], crowd.start_time[:] = -1, -1.0
        crowd.level[0], crowd.position[0] = way.level, outside.position[0]
        inside, behind = [], []
        for number in range(3):
            outside.level[1 : 1 + number] = way.level
            crowd.speed_factor[:], crowd.extra_direction[:], outside.speed_factor[:] = 1.0, 0.0, 1.0
            used.act(view.crowd, 0.0)
            inside.append(crowd.speed_factor[0])
            behind.append(outside.speed_factor[1])
        remedy = "use scene.outside, and multiply its speed_factor; or do not set keeps_distance"
        told = f"does not slow down a person {{}}, 0.6 m ahead; {remedy}"
        require(inside[1] < inside[0], told.format("inside behind a person who has left"))
        require(behind[2] < behind[1], told.format("who has left behind another one"))


def _prepared(case: Case, name: str) -> tuple[Simulation, Behaviour, BehaviourScene]:
    """Return a simulation, and a prepared behaviour with its scene."""
    with scene(case.title):
        simulation = Simulation(case, full=True)
        found = next((pair for pair in simulation.behaviours if pair[0].name == name), None)
        if found is None:
            raise CheckError(f"the case does not use behaviour {name!r}; give a case that does")
        return simulation, *found


def _advance(simulation: Simulation, ticks: int) -> State:
    """Make a number of ticks, unless the run ends before, and return the state."""
    for _ in range(ticks):
        if not simulation.ended:
            simulation.advance_tick()
    return simulation.state()


def _require_same(first: State, second: State, told: str) -> None:
    """Raise a `CheckError` that names the first array that differs or is missing."""
    for key, value in first.items():
        is_same = key in second and np.array_equal(value, second[key], equal_nan=value.dtype.kind == "f")
        require(is_same, told.format(key))


def check_damaged_files(importer: Importer) -> None:
    """Check that damaged files are refused with ValueError."""
    with TemporaryDirectory() as place:
        for path, content in [(Path(place, f"damaged{end}"), text) for end in importer.suffixes for text in GARBAGE]:
            path.write_bytes(content)
            with scene(f"a damaged file {path.name} with the content {content!r}"):
                try:
                    mesh = checked(path, read_surface(importer, path))
                except BuildingError:
                    continue
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
        one, other = (checked(path, read_surface(make_importers(case)[0], path)) for _ in range(2))
        pairs = {"points": (one.points, other.points), "cells": (one.triangles, other.triangles)}
        for what in ("cell_tags", "edge_tags"):
            first, second = getattr(one, what), getattr(other, what)
            pairs |= {f"{what} {tag!r}": (first.get(tag, ()), second.get(tag, ())) for tag in first | second}
        for what, (first, second) in pairs.items():
            told = f"two readings of the file differ in {what}; keep no state between them"
            require(np.array_equal(first, second), told)
        make_building(case)


def check_exports(exporter: Exporter, case: Case, ticks: int) -> None:
    """Check that an exporter writes only to its path, returns the files, can overwrite them, and is reproducible.

    It exports a run of some ticks with at least three frames, twice, and then a run without frames, which it may refuse
    with `ResultError`.
    """
    with TemporaryDirectory() as made, TemporaryDirectory() as place:
        with scene(case.title), warnings.catch_warnings():
            warnings.simplefilter("ignore", RunWarning)  # of a case, not of the exporter
            tick = case.simulation.tick
            lengths = {"simulation.duration": ticks * tick, "output.every": max(1, ticks // 4) * tick}
            run(case.change(lengths | {"output.animation": False, "output.picture": False}), Path(made, "result"))
            trajectory = read_trajectory(Path(made, "result"))
        before, found, path = trajectory.path.read_bytes(), [], Path(place, f"export{exporter.suffix}")
        for again in ("", ", exported again to the same place"):
            with scene(f"a run of some ticks{again}"):
                export(trajectory, exporter, path)
                files = sorted(file for file in Path(place).rglob("*") if file.is_file())
                strays = [file.name for file in files if file != path and path not in file.parents]
                require(not strays, f"writes {', '.join(strays)} outside `path`; write to `path` only")
                found.append([(file, file.read_bytes()) for file in files])
                told = "the two exports differ; do not write the current time or random numbers"
                require(found[0] == found[-1], told)
                require(trajectory.path.read_bytes() == before, "the trajectory file has changed; only read it")
        with scene("a run without frames"):
            try:
                export(replace(trajectory, time=trajectory.time[:0], rows=()), exporter, path)
            except ResultError:
                return
            except PluginError as error:
                raise with_remedy(error, "write a file without rows, or raise ResultError") from error.__cause__
