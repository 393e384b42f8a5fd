"""A script of a user, which names everything in `evac.__all__`; `.ci/run` checks it with ``mypy --strict``."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import evac
from evac.people.dispatcher import Car, StopCall
from evac.physics.state import Crowd


class Slow(evac.Behaviour):
    """People walk at a share of their speed."""

    name = "slow"
    writes = ("speed_factor",)
    share = evac.Parameter(0.5, "share of the speed", minimum=0.0, maximum=1.0)

    def prepare(self, scene: evac.BehaviourScene) -> None:
        self._field = scene.level_field("trail", "1", 1.0)

    def act(self, crowd: Crowd, time: float) -> None:
        crowd.speed_factor *= self.share
        self._field.values += time


class Kept(evac.Recorder):
    """Keeps the number of people inside."""

    name = "kept"

    def start(self, simulation: evac.Simulation) -> None:
        self.inside: list[int] = []

    def record(self, simulation: evac.Simulation) -> None:
        self.inside.append(int((simulation.population.crowd.level >= 0).sum()))


class Square(evac.Importer):
    """Reads the side of a square from a file."""

    name = "square"
    suffixes = (".square",)

    def read(self, path: Path) -> evac.SurfaceMesh | evac.Plan:
        return room(float(path.read_text()))


class Times(evac.Exporter):
    """Writes the recorded times."""

    name = "times"
    suffix = ".txt"

    def write(self, trajectory: evac.Trajectory, path: Path) -> Iterable[Path]:
        np.savetxt(path, trajectory.time)
        return [path]


class Haze(evac.SmokeLaw):
    """Half the speed in any smoke."""

    name = "haze"

    def speed(self, desired: NDArray[np.float64], extinction: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.where(extinction > 0.0, 0.5 * desired, desired)


class Lowest(evac.Dispatcher):
    """The lowest storey first."""

    name = "lowest"

    def next_stop(self, car: Car, calls: Sequence[StopCall], time: float) -> int | None:
        return calls[0].stop


class Steam(evac.ConditionSource):
    """The same extinction everywhere."""

    name = "steam"

    def open(self, scene: object) -> Sequence[str]:
        return ("extinction",)

    def at(
        self,
        quantities: Sequence[str],
        time: float,
        level: NDArray[np.int32],
        position: NDArray[np.float64],
        height: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        return np.full((len(quantities), len(level)), 0.2)


@evac.hookimpl
def evac_behaviours() -> list[type[evac.Behaviour]]:
    return [Slow]


def models(registry: evac.Registry) -> Iterator[tuple[str, bool]]:
    """Yield each contact model, force and solver, and whether it is of pairs."""
    contacts: Mapping[str, type[evac.ContactModel]] = registry.contact_models
    for name, contact in contacts.items():
        yield name, issubclass(contact, evac.PairContact)
    forces: Mapping[str, type[evac.Force]] = registry.forces
    solvers: Mapping[str, type[evac.Solver]] = registry.solvers
    yield from ((name, False) for name in (*forces, *solvers))


def room(side: float) -> evac.Plan:
    """Return a square room with a door."""
    plan = evac.Plan()
    plan.storey("room", [(0, 0), (side, 0), (side, side), (0, side)])
    plan.exit("door", "room", [(0, 1), (0, 2)])
    return plan


def few(now: evac.Progress) -> None:
    """End a run when half of the people are out."""
    if 2 * now.out > now.people:
        raise evac.Stopped


def main(folder: Path) -> None:
    """Load, change, run, read, repeat, compare."""
    group = {"name": "people", "positions": [[2.0, 1.5], [3.0, 1.5]], "z": 0.0}
    case: evac.Case = evac.load({"building": room(4.0), "people": [group], "contact": {"model": "nsm2"}})
    results: evac.Results = evac.run(case.change({"simulation.seed": 3}), folder / "result", progress=few)
    time, number = results.egress()
    print(time[-1] + 1.0, number.sum(), results.ended, results.last_out, results.people["exit"])
    trajectory: evac.Trajectory = evac.read_trajectory(folder / "result")
    print(np.hypot(trajectory.velocity[..., 0], trajectory.velocity[..., 1]).mean(), trajectory[0]["position"])
    maps: Mapping[str, evac.LevelMaps] = trajectory.maps()
    print([own.density.max() for own in maps.values()], evac.read_results(folder / "result").evacuated)
    study: evac.Study = evac.repeat(case, 2, workers=1, folder=folder / "study")
    print([row["exit_time"] for row in study.rows(columns=["exit_time"])], study.statistics[0].mean.value)
    sweep = evac.sweep(case, {"people.people.speed": [1.0, 1.5]}, 2, workers=1)
    comparison: evac.Comparison = evac.compare(evac.read_study(folder / "study"), (sweep, 1))
    print(comparison.to_pandas())
    to_door = evac.Route(exits=("door",))
    simulation = evac.Simulation(case, routes=[to_door], in_memory=True)
    simulation.scene.apply(evac.Change(0.5, "close", "door", {"value": "bodies"}))
    simulation.scene.send(simulation.scene.people_in([(0, 0), (4, 0), (4, 4)]), to_door)
    simulation.scene.remove(simulation.scene.people_in("people")[:0])
    while not simulation.ended:
        simulation.advance_tick()
    findings: Sequence[evac.Finding] = simulation.findings
    print(findings, simulation.results().changes, *models(case.registry))
    room(5.0).write(folder / "room.plan.toml")
    with evac.edit(folder / "room.plan.toml") as page:
        plan: evac.Plan = page.plan
    print(page.address, plan)
    building: evac.Building = evac.read_building(folder / "room.plan.toml")
    print([level.name for level in building.levels], evac.import_building([folder / "room.plan.toml"], folder / "case"))
    try:
        evac.resume(folder / "result")
    except (evac.ResultError, evac.SimulationError, evac.PluginError) as error:
        print(error)
    except (evac.BuildingError, evac.ScenarioError, evac.EvacError):
        raise


#: What a caller turns into errors.
WARNINGS: tuple[type[Warning], ...] = (evac.EvacWarning, evac.RunWarning)
