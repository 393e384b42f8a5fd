"""The simulation: everything put together, and the loop."""

import time as wall_clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evac.behaviour import Behaviour, BehaviourScene, check_writes, check_written
from evac.directions.build import build_fields
from evac.directions.fields import Fields
from evac.errors import EvacError, PluginError, naming, noting, plugin_code
from evac.output.recorder import Recorder
from evac.output.results import Results
from evac.people.distributions import generator_for, generator_state, restore_generator
from evac.people.groups import check_people, default_clearance, reference_speeds
from evac.people.population import build_population
from evac.physics.bundles import copy_of
from evac.physics.contact_model import BorderScene
from evac.physics.engine import Engine
from evac.physics.world import make_world
from evac.plan import explain, needed_forces, needed_routes
from evac.registry import Registry

if TYPE_CHECKING:
    from evac.scenario.schema import Case

FloatArray = NDArray[np.float64]

#: A person makes progress when its remaining travel time changes by this much [s].
PROGRESS = 0.25

#: How often progress is looked at [s].
PROGRESS_EVERY = 1.0

EVERYBODY_OUT = "everybody out"
DURATION_OVER = "duration over"
NO_PROGRESS = "no progress"
INTERRUPTED = "interrupted"


class Stopped(KeyboardInterrupt):
    """To be raised by a progress display that wants the run to end at this tick, with its results."""


@dataclass(frozen=True)
class Progress:
    """What a progress display needs, once a tick."""

    time: float  # simulated [s]
    duration: float  # [s]
    people: int
    out: int


class Simulation:
    """A case made ready to run.

    Parameters
    ----------
    case : Case
        Checked; see `evac.load`.
    folder : Path, optional
        Result folder for the recorders; None keeps nothing on disk.
    full : bool
        Do even what the scene does not need; gives the same bits, slower.

    Raises
    ------
    EvacError
        Where building, directions, people or plugins do not fit together.

    Attributes
    ----------
    building, fields, population, contact, behaviours, forces, engine
        The stations of the main path.
    step, time : int, float
        Steps made, and the time reached [s].
    """

    def __init__(self, case: "Case", folder: Path | None = None, full: bool = False) -> None:
        self.case = case
        self.registry: Registry = case.registry
        self.folder = folder
        self.full = full
        self.seed = case.simulation.seed
        self.step = 0
        self.phases: dict[str, float] = {}
        self.ended = ""
        with plugin_code("evac_configure"):
            self.registry.hook.evac_configure(scenario=case, registry=self.registry)
        self.contact = case.make_contact_model(self.registry)
        all_forces = case.make_forces(self.registry)
        self.forces = needed_forces(all_forces, full)
        all_behaviours = case.make_behaviours(self.registry)
        with self._phase("building"):
            self.building = self.registry.read_building(case.mesh, **case.building.options())
            check_people(case, self.building)
        with naming(case.source), self._phase("directions"):
            self.fields = self._build_fields(all_behaviours)
        with noting(self.building.warnings), self._phase("people"):
            self.population = build_population(case, self.building, self.fields, self.seed)
            scenes = [(behaviour, self._scene(behaviour)) for behaviour in all_behaviours]
            with naming(case.source), plugin_code("behaviours: is_needed"):
                self.behaviours = [pair for pair in scenes if full or pair[0].is_needed(pair[1])]
        with naming(case.source):
            self.contact.check_scene(self._border_scene())
        world = make_world(self.building, self.fields)
        names = [level.name for level in self.building.levels]
        self.engine = Engine(world, len(self.population.crowd.level), self.forces, full, names)
        self.recorders: list[Recorder] = case.make_recorders(self.registry)
        self._is_recording = False
        self._force_is_read = any("contact_force" in behaviour.reads for behaviour, _ in self.behaviours)
        crowd = self.population.crowd
        self._start = (crowd.position.copy(), crowd.level.copy())
        self._seen_time = np.full(len(crowd.level), np.inf)
        self._moved_at = np.zeros(len(crowd.level))
        for behaviour, scene in self.behaviours:
            with naming(case.source), plugin_code(f"behaviour {behaviour.name!r}: prepare"):
                behaviour.prepare(scene)
            check_written(behaviour, crowd, len(self.fields.routes), 0.0)
        self.plan = explain(case, self.building, self.contact, all_forces, scenes, self.fields.routes)
        with plugin_code("evac_prepare"):
            self.registry.hook.evac_prepare(simulation=self)

    @property
    def time(self) -> float:
        """Simulated time [s]: always step times h, never summed up."""
        return self.step * self.case.simulation.step

    def run(self, progress: Callable[[Progress], None] | None = None) -> Results:
        """Run to the end and return the results.

        ::

            while people remain and time < end:
                for behaviour in due(step): behaviour.act(crowd, time)    # Python, whole arrays, every tick = k h
                events = engine.advance(contact, crowd, step, k, ...)     # compiled: drive, forces, contact, move
                population.settle(events)                                 # exits and portals crossed
                for recorder in due(step): recorder.record(simulation)

        Raises
        ------
        SimulationError
            A step cannot be made; names time, person and place.
        PluginError
            A plugin has failed; `results` knows what has been run.
        """
        results = None
        error: BaseException | None = None
        try:
            while not self.ended:
                self.advance_tick()
                if progress is not None:
                    people, inside = len(self.population.crowd.level), self.population.inside
                    progress(Progress(self.time, self.case.simulation.duration, people, people - inside))
            results = self.results()
        except Stopped:
            self.ended = self.ended or INTERRUPTED
            results = self.results()
        except BaseException as caught:
            error = caught
            raise
        finally:
            self._finish(results, error)
        return results

    def advance_tick(self) -> None:
        """Make one tick: behaviours, k steps, settling, recording; sets ``ended`` when it was the last.

        Raises
        ------
        SimulationError, PluginError
            As `run`.
        """
        settings = self.case.simulation
        if not self._is_recording:
            with self._phase("kernels"):
                explicit = settings.driving == "explicit"
                self.engine.load(self.contact, self.population.crowd, settings.step, explicit)
            self._is_recording = True
            for recorder in self.recorders:
                with plugin_code(f"recorder {recorder.name!r}: start"):
                    recorder.start(self)
            self._record()
        per_tick = round(settings.tick / settings.step)
        last = round(settings.duration / settings.step)
        steps = min(per_tick, last - self.step)
        per_record = round(self.case.output.every / settings.tick) * per_tick
        is_output = (self.step + steps) % per_record == 0
        with self._phase("behaviours"):
            self._act()
        with self._phase("physics"):
            events = self.engine.advance(
                self.contact,
                self.population.crowd,
                self.step,
                steps,
                settings.step,
                settings.driving == "explicit",
                is_output or self.step + steps == last or self._force_is_read,
            )
        self.step += steps
        with self._phase("recording"):
            if events.count[0]:
                self.population.settle(events)
            if is_output:
                self._record()
        self._look_for_end(per_tick, last)

    def results(self) -> Results:
        """Return the results of what has been run so far."""
        report: dict[str, Any] = self.engine.report()
        overlaps, total = report.pop("overlaps"), report.pop("overlap_sum")
        report["mean_overlap"] = total / overlaps if overlaps else 0.0
        report["energy"] = {key: report.pop(key) for key in ("driving_work", "contact_dissipation", "contact_creation")}
        report["model"] = self.contact.name
        report["parameters"] = self.contact.values()
        results = Results(
            case=self.case,
            building=self.building,
            crowd=copy_of(self.population.crowd),
            groups=self.population.groups,
            routes=self.fields.routes,
            start_position=self._start[0],
            start_level=self._start[1],
            crossings=self.population.crossings,
            ended=self.ended,
            time=self.time,
            steps=self.step,
            seed=self.seed,
            stuck=tuple(np.flatnonzero(self.population.crowd.level >= 0)) if self.ended == NO_PROGRESS else (),
            report=report,
            phases=dict(self.phases),
            plan=[part.as_row() for part in self.plan],
            plugins=self._plugins(),
            folder=self.folder,
        )
        return replace(results, metrics=dict(self._metrics(results)))

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of everything that a run needs to go on from this tick to the same bits."""
        state = {f"population.{key}": value for key, value in self.population.state().items()}
        state |= {f"engine.{key}": value for key, value in self.engine.state().items()}
        for behaviour, scene in self.behaviours:
            for key, value in behaviour.state().items():
                state[f"behaviour.{behaviour.name}.{key}"] = value.copy()
            state[f"generator.{behaviour.name}"] = generator_state(scene.generator)
        state["simulation.step"] = np.array([self.step])
        state["simulation.progress"] = np.stack([self._seen_time, self._moved_at])
        return state

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Take up what `state` returned, in a simulation of the same case."""
        self.population.restore(_part(state, "population."))
        for behaviour, scene in self.behaviours:
            behaviour.restore(_part(state, f"behaviour.{behaviour.name}."))
            restore_generator(scene.generator, state[f"generator.{behaviour.name}"])
        self.step = int(state["simulation.step"][0])
        self.engine.restore(_part(state, "engine."))
        self._seen_time[:], self._moved_at[:] = state["simulation.progress"]
        self.ended = ""

    def _record(self) -> None:
        for recorder in self.recorders:
            with plugin_code(f"t = {self.time:.3f} s: recorder {recorder.name!r}"):
                recorder.record(self)

    def _finish(self, results: Results | None, error: BaseException | None) -> None:
        """Let every recorder and plugin finish; then raise what failed first, unless the run has failed already."""
        calls: list[tuple[str, Callable[[], object]]] = []
        for recorder in self.recorders if self._is_recording else ():
            calls.append((f"recorder {recorder.name!r}: finish", partial(recorder.finish, self, results)))
        given = {"simulation": self, "results": results, "error": error}
        for hook in self.registry.hook.evac_finish.get_hookimpls():
            arguments = [given[name] for name in hook.argnames]
            calls.append((f"{hook.plugin_name}: evac_finish", partial(hook.function, *arguments)))
        failures = []
        for what, call in calls:
            try:
                with plugin_code(what):
                    call()
            except EvacError as failure:
                failures.append(failure)
        for one in failures:
            if error is None:
                raise one
            error.add_note(f"then: {one}")

    def _metrics(self, results: Results) -> Iterator[tuple[str, Any]]:
        """Yield what each plugin's evac_metrics returns; one that fails does not take the results with it."""
        for hook in self.registry.hook.evac_metrics.get_hookimpls():
            try:
                with plugin_code(f"{hook.plugin_name}: evac_metrics"):
                    yield hook.plugin_name, hook.function(*[results for _ in hook.argnames])
            except PluginError as error:
                yield hook.plugin_name, {"error": str(error)}

    def _plugins(self) -> list[str]:
        """Return name and version of each plugin that has a part in this run."""
        used = [("contact_model", self.contact), *(("force", force) for force in self.forces)]
        used += [("behaviour", behaviour) for behaviour, _ in self.behaviours]
        used += [("recorder", recorder) for recorder in self.recorders]
        return self.registry.providers([(kind, item.name) for kind, item in used])

    def _act(self) -> None:
        """Let the behaviours act on factors set back to neutral."""
        acting = [behaviour for behaviour, _ in self.behaviours if self.full or behaviour.acts_at_ticks()]
        renewed = {name for behaviour in acting if behaviour.acts_at_ticks() for name in behaviour.writes}
        crowd = self.population.crowd
        if "speed_factor" in renewed:
            crowd.speed_factor[:] = 1.0
        if "extra_direction" in renewed:
            crowd.extra_direction[:] = 0.0
        for behaviour, scene in self.behaviours:
            if behaviour in acting:
                with plugin_code(f"t = {self.time:.3f} s: behaviour {behaviour.name!r}"):
                    behaviour.act(scene.crowd, self.time)
                check_written(behaviour, self.population.crowd, len(self.fields.routes), self.time)

    def _look_for_end(self, per_tick: int, last: int) -> None:
        if self.population.inside == 0:
            self.ended = EVERYBODY_OUT
        elif self.step >= last:
            self.ended = DURATION_OVER
        else:
            between = max(1, round(PROGRESS_EVERY / self.case.simulation.tick)) * per_tick
            if self.step % between == 0 and self._is_stuck():
                self.ended = NO_PROGRESS

    def _is_stuck(self) -> bool:
        """Say whether nobody inside has made progress for ``simulation.no_progress`` seconds."""
        crowd = self.population.crowd
        inside = np.flatnonzero(crowd.level >= 0)
        remaining = self.fields.travel_time_at(crowd.level[inside], crowd.position[inside], crowd.route[inside])
        with np.errstate(invalid="ignore"):  # somebody pushed where no way leads out compares inf with inf
            changed = np.abs(remaining - self._seen_time[inside]) > PROGRESS
        changed |= crowd.start_time[inside] > self.time
        self._seen_time[inside[changed]] = remaining[changed]
        self._moved_at[inside[changed]] = self.time
        latest = max(self._moved_at[inside].max(), np.nanmax(crowd.exit_time, initial=0.0))
        return bool(self.time - latest >= self.case.simulation.no_progress)

    def _build_fields(self, behaviours: list[Behaviour]) -> Fields:
        settings = self.case.directions
        return build_fields(
            self.building,
            needed_routes(self.case, behaviours, self.full),
            spacing=settings.spacing,
            clearance=default_clearance(self.case) if settings.clearance is None else settings.clearance,
            speeds=reference_speeds(self.case),
            comfort=settings.comfort,
            order=settings.order,
        )

    def _scene(self, behaviour: Behaviour) -> BehaviourScene:
        """Return what one behaviour sees: arrays it may not write are read-only views."""
        check_writes(behaviour)
        crowd = self.population.crowd
        views = {name: array.view() for name, array in crowd._asdict().items()}
        for name, view in views.items():
            view.flags.writeable = name in behaviour.writes
        return BehaviourScene(
            crowd=type(crowd)(**views),
            building=self.building,
            fields=self.fields,
            groups=self.population.groups_for(behaviour.name),
            generator=generator_for(self.seed, "behaviour", behaviour.name),
            tick=self.case.simulation.tick,
        )

    def _border_scene(self) -> BorderScene:
        crowd = self.population.crowd
        settings = self.case.simulation
        return BorderScene(
            step=settings.step,
            explicit=settings.driving == "explicit",
            radius=crowd.radius,
            mass=crowd.mass,
            tau=crowd.tau,
            speed=float(crowd.speed.max()),
        )

    @contextmanager
    def _phase(self, name: str) -> Iterator[None]:
        """Add the wall time of a phase."""
        start = wall_clock.perf_counter()
        try:
            yield
        finally:
            self.phases[name] = self.phases.get(name, 0.0) + wall_clock.perf_counter() - start


def _part(state: dict[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    return {key[len(prefix) :]: value for key, value in state.items() if key.startswith(prefix)}
