"""The simulation: all parts of a run, and its loop."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evac.base.distributions import MOST_WORDS, generator_for, generator_state, restore_generator
from evac.base.errors import naming, noting, plugin_code
from evac.base.phases import Phases, Progress
from evac.base.plugin_state import state_of
from evac.base.saved import SavedError, part_of, taken
from evac.building.model.building import Building
from evac.building.model.narrow import narrow_places
from evac.case.schema import LONGEST_RUN
from evac.case.trust import run_plugin_files
from evac.contract.registry import Registry
from evac.directions.fields import Fields
from evac.jit.loading import addresses_of
from evac.jit.workers import Progress as Compiling
from evac.people.behaviour import DECLARE, Behaviour, BehaviourScene, check_written, crowd_for, outside_for
from evac.people.groups import check_people
from evac.people.outside import PeopleOutside
from evac.people.unusual import late_starts, unusual
from evac.physics.force import Force
from evac.physics.state import copy_of
from evac.physics.threads.threads import unused_threads
from evac.results.ending import INTERRUPTED, Ending, Stopped
from evac.results.results import Results, results_of
from evac.results.watch import Watch
from evac.simulation import assembly, needed
from evac.simulation.scene import Ground, Scene, make_ground
from evac.trajectory.recorder import Recorder
from evac.trajectory.recording import Recording, metrics

if TYPE_CHECKING:
    from evac.case.case import Case


class Simulation:
    """A case that is ready to run.

    Parameters
    ----------
    case : Case
        A checked case; see `evac.load`.
    folder : Path, optional
        Result folder for the recorders; None writes no files.
    full : bool
        Include the parts that the scene does not need: identical results, slower.
    ground : Ground, optional
        Ground of a simulation whose case has the same `evac.simulation.assembly.ground_key`; computed if not given.
    will_run : bool
        False to inspect the state before the first step only: kernels of the step loop are then not loaded.
    threads : int, optional
        Number of threads that share the step loop and the directions, as for `evac.run`.
    compiling : callable, optional
        Called with the number of compiled kernels and the number of kernels to compile, if there are any.

    Raises
    ------
    EvacError
        The building, the directions, the people or a plugin are not valid for this case.

    Attributes
    ----------
    registry, scene, building, fields, population, contact, forces, engine, recording
        The parts of the simulation, see docs/architecture.md.
    behaviours : list of (Behaviour, BehaviourScene)
        The behaviours in use, each with the scene that it can access.
    outside : PeopleOutside or None
        The people who have left, if a behaviour keeps distances.
    plan : list of Part
        The parts that the scene needs and those that are left out, see `evac.simulation.needed.explain`.
    step, time : int, float
        Number of steps made, and simulated time [s].
    displacement_velocity : (n, 2) float64
        Displacement of each person in the last tick divided by the length of the tick, in plan [m/s]; before the
        first tick the initial velocity. This velocity is recorded; that of the crowd belongs to the contact model.
    phases : Phases
        Wall time of each phase.
    ended : str
        Why the run has ended; empty during the run.
    stopping : tuple of Finding
        Places that people do not fit through, although no other way leads to an exit.
    resumed : list of dict
        The checkpoints from which the run was resumed, see docs/results.md.
    """

    def __init__(
        self,
        case: "Case",
        folder: Path | None = None,
        full: bool = False,
        *,
        ground: Ground | None = None,
        will_run: bool = True,
        threads: int | None = 1,
        compiling: Compiling | None = None,
    ) -> None:
        self.case = case = run_plugin_files(case)
        self.registry: Registry = case.registry
        self.folder, self.full, self._threads = folder, full, threads
        self.seed, self.step = case.simulation.seed, 0
        self.phases, self.ended = Phases(), ""
        self.resumed: list[dict[str, Any]] = []
        with self.phases.enter("preparation"):
            self._make(ground, will_run, compiling)

    def _make(self, ground: Ground | None, will_run: bool, compiling: Compiling | None) -> None:
        """Create all parts of the run and call the hooks and `prepare` methods of the plugins."""
        case, full = self.case, self.full
        self.registry.call_all("evac_configure", case=case, registry=self.registry)
        self.contact = assembly.make_contact_model(case)
        self.recording = Recording(assembly.make_recorders(case), self.folder)
        forces, behaviours = assembly.make_forces(case), assembly.make_behaviours(case)
        self.forces = needed.needed_forces(forces, full)
        with self.phases.enter("building"):
            building = ground.building if ground else assembly.make_building(case)
            check_people(case, building)
        with self.phases.enter("kernels"):
            kernels = (
                needed.run_kernels(case, building, self.contact, self.forces, behaviours, full) if will_run else []
            )
            addresses_of([*needed.set_up_kernels(), *kernels], compiling)
        self._build(building, ground, behaviours)
        self._prepare()
        self.plan = self._plan(forces, behaviours)
        self.registry.call_all("evac_prepare", simulation=self)

    def _build(self, building: Building, ground: Ground | None, behaviours: list[Behaviour]) -> None:
        """Create scene, population, forces and engine for a building."""
        case = self.case
        with naming(case.source), self.phases.enter("directions"):
            solve = partial(needed.solve_fields, case, behaviours=behaviours, full=self.full, threads=self._threads)
            self.scene = Scene(ground or make_ground(building, solve(building)), solve)
        with noting(building.warnings), self.phases.enter("people"):
            self.population, self.stopping, border = assembly.make_population(case, self.scene.ground, self.contact)
            sees_outside = any(behaviour.keeps_distance for behaviour in behaviours)
            self.outside = PeopleOutside(building, self.population.crowd) if sees_outside else None
            scenes = [(behaviour, self._scene(behaviour)) for behaviour in behaviours]
            with naming(case.source):
                self.behaviours = needed.needed_behaviours(scenes, self.full)
        with naming(case.source), plugin_code(f"contact model {self.contact.name!r}: promised_overlap", self.contact):
            self._promised_overlap = float(self.contact.promised_overlap(border))
        n = len(self.population.crowd.level)
        self.engine = assembly.make_engine(case, self.scene, n, self.forces, self.full, self._threads)

    def _prepare(self) -> None:
        """Record the initial state of people and call `prepare` of the behaviours."""
        crowd = self.population.crowd
        self._start = (crowd.position.copy(), crowd.level.copy())
        self.displacement_velocity = crowd.velocity.copy()
        self._watch = Watch(crowd.radius, self.case.simulation.tick, self.case.output.every)
        self._ending = Ending(self.case.simulation, len(crowd.level), len(self.fields.routes))
        self._acts: dict[str, bool] = {}
        self._version, self._force_is_read = self.scene.version, False
        for behaviour, scene in self.behaviours:
            with naming(self.case.source), plugin_code(f"behaviour {behaviour.name!r}: prepare", behaviour, DECLARE):
                self._force_is_read |= "contact_force" in behaviour.reads
                behaviour.prepare(scene)
            self._check_written(behaviour)
            with plugin_code(f"behaviour {behaviour.name!r}: acts_at_ticks", behaviour):
                self._acts[behaviour.name] = behaviour.acts_at_ticks()

    def _plan(self, forces: list[Force], behaviours: list[Behaviour]) -> list[needed.Part]:
        """Return the plan, with the decisions on the forces and behaviours of the case."""
        effects = self.engine.explain_forces()
        acting = {force.name: effects.get(force.name) for force in forces}
        acts = {behaviour.name: self._acts.get(behaviour.name) for behaviour in behaviours}
        keepers = [behaviour.name for behaviour, _ in self.behaviours if behaviour.keeps_distance]
        loop = self.engine.explain(self.contact)
        return needed.explain(self.case, self.building, self.fields.routes, self.contact, loop, acting, acts, keepers)

    @property
    def building(self) -> Building:
        """The building with its current open and closed links."""
        return self.scene.building

    @property
    def fields(self) -> Fields:
        """The current directions."""
        return self.scene.fields

    @property
    def recorders(self) -> list[Recorder]:
        """The recorders in use."""
        return self.recording.recorders

    @property
    def time(self) -> float:
        """Simulated time [s]: the number of steps times h."""
        return self.step * self.case.simulation.step

    def warnings(self) -> tuple[str, ...]:
        """Return warnings that should be read before a run, one line each.

        Returns
        -------
        tuple of str
            About the building, places that are too narrow for some people, people for whom no way to an exit is wide
            enough, unusual properties of people, people who start only after the end of the run, and threads that are
            not used.
        """
        crowd = self.population.crowd
        narrow = narrow_places(self.building, 2.0 * crowd.radius)
        start = crowd.replace(position=self._start[0], level=self._start[1])
        people = (*unusual(start, self.population.groups), *late_starts(crowd, self.case.simulation.duration))
        unused = unused_threads(self._threads, len(crowd.level))
        return (*self.building.warnings, *map(str, (*narrow, *self.stopping)), *people, *unused)

    def run(
        self, progress: Callable[[Progress], None] | None = None, begun: Callable[[], None] | None = None
    ) -> Results:
        """Run to the end and return the results.

        ::

            while people remain and time < end:
                for behaviour in due(step): behaviour.act(crowd, time)    # Python, whole arrays, every tick = k h
                events = engine.advance(contact, crowd, step, k, ...)     # compiled: drive, forces, contact, move
                left = population.settle(events)                          # exits and portals crossed
                outside.advance(left, time, tick)                         # if behaviours keep distances to who has left
                watch.look_at_velocities(...)                             # for quality warnings
                for recorder in due(step): recorder.record(simulation)

        Parameters
        ----------
        progress : callable, optional
            Called with a `Progress` at every tick.
        begun : callable, optional
            Called before the first tick, once the recorders have started.

        Raises
        ------
        SimulationError
            A step fails; names time, person and place.
        PluginError
            A plugin fails; `results` returns the results until then.
        """
        results = None
        error: BaseException | None = None
        with self.phases.enter("output"):
            try:
                if not self.recording.is_started:
                    self._start_recording()
                if begun is not None:
                    begun()
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
                self.engine.close()
                self.recording.finish(self, self.registry, results, error)
        return replace(results, phases=self.phases.seconds())

    def advance_tick(self) -> None:
        """Advance by one tick: behaviours, k steps, exits and crossings, recording; set `ended` after the last tick.

        Raises
        ------
        SimulationError, PluginError
            As `run`.
        """
        settings = self.case.simulation
        if not self.recording.is_started:
            self._start_recording()
        steps = min(settings.steps_per_tick, settings.last_step - self.step)
        per_record = round(self.case.output.every / settings.tick) * settings.steps_per_tick
        is_output = (self.step + steps) % per_record == 0
        with self.phases.enter("behaviours"):
            self.scene.apply_waiting()
            self._act()
        crowd = self.population.crowd
        before = crowd.position.copy()
        reports = is_output or self.step + steps == settings.last_step or self._force_is_read
        with self.phases.enter("physics"):
            events = self.engine.advance(
                self.contact, crowd, self.step, steps, settings.step, settings.is_explicit, reports
            )
        with self.phases.enter("recording"):
            self.step += steps
            self.scene.time = self.time
            self.displacement_velocity[:] = (crowd.position - before) / (steps * settings.step)
            left = self.population.settle(events)
            if self.outside is not None:
                self.outside.advance(left, self.time, steps * settings.step)
            self._watch.look_at_velocities(self.time, crowd, self.displacement_velocity)
            if is_output:
                self._watch.look_at_forces(self.time, crowd)
                self.recording.record(self)
            self.ended = self._ending.reason(self.step, crowd, self.fields)

    def results(self) -> Results:
        """Return the results up to the present step."""
        results = results_of(
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
            stuck=tuple(self._ending.stuck(self.step, self.population.crowd).tolist()),
            warnings=self.warnings(),
            report=self.engine.contact_report(self.contact) | {"promised_overlap": self._promised_overlap},
            chatter=self._watch.chatter(),
            crushing=self._watch.crushing(),
            phases=self.phases.seconds(),
            plan=[part.as_row() for part in self.plan],
            plugins=self._plugins(),
            folder=self.folder,
            changes=tuple(self.scene.changes),
            resumed=self.resumed,
        )
        return replace(results, metrics=dict(metrics(self.registry, results)))

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of all data that are needed to continue a run from this tick with identical results.

        The state of recorders is not part of it, see `Recording.state`.
        """
        self.engine.load(self.contact)  # prepares the contact model, so that it has a state
        state = {f"population.{key}": value for key, value in self.population.state().items()}
        state |= {f"engine.{key}": value for key, value in self.engine.snapshot().items()}
        for behaviour, scene in self.behaviours:
            state |= state_of(behaviour, f"behaviour {behaviour.name!r}", f"behaviour.{behaviour.name}.")
            state[f"generator.{behaviour.name}"] = generator_state(scene.generator)
        state |= state_of(self.contact, f"contact model {self.contact.name!r}", f"contact.{self.contact.name}.")
        state |= {f"scene.{key}": value for key, value in self.scene.state().items()}
        if self.outside is not None:
            state |= {f"outside.{key}": value for key, value in self.outside.state().items()}
        state["simulation.clock"] = np.array([self.step, self._version])
        state["simulation.ending"] = self._ending.state()
        state["simulation.start_position"], state["simulation.start_level"] = self._start
        state["simulation.displacement_velocity"] = self.displacement_velocity.copy()
        state |= {f"watch.{key}": value for key, value in self._watch.state().items()}
        return state

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore the arrays that `state` returned in a simulation of the same case.

        Raises
        ------
        SavedError
            An array is missing, or is not what `state` returns.
        PluginError
            A plugin cannot restore its arrays.
        """
        with self.phases.enter("kernels"):
            self.engine.load(self.contact)
        with part_of(state, "simulation.") as own:
            self._restore_own(own)
        with part_of(state, "scene.") as own:
            self.scene.restore(own)
        with part_of(state, "population.") as own:
            self.population.restore(own, self.building, len(self.fields.routes))
        if self.outside is not None and any(key.startswith("outside.") for key in state):  # not if a change adds it
            with part_of(state, "outside.") as own:
                self.outside.restore(own)
        for behaviour, scene in self.behaviours:
            if f"generator.{behaviour.name}" in state:  # not if a changed case has added the behaviour
                what = f"behaviour {behaviour.name!r}: restore"
                with plugin_code(what, behaviour), part_of(state, f"behaviour.{behaviour.name}.") as own:
                    behaviour.restore(own)
                with part_of(state, "generator.") as own:
                    words = taken(own, behaviour.name, np.uint64, MOST_WORDS.shape, 0, MOST_WORDS)
                restore_generator(scene.generator, words)
        what = f"contact model {self.contact.name!r}: restore"
        with plugin_code(what, self.contact), part_of(state, f"contact.{self.contact.name}.") as own:
            self.contact.restore(own)
        with part_of(state, "engine.") as own:
            self.engine.restore(own)
        with part_of(state, "watch.") as own:
            self._watch.restore(own, len(self.building.levels))
        self.ended = self._ending.over(self.step, self.population.crowd)

    def _restore_own(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore the arrays that no part of the simulation owns."""
        settings, (position, level) = self.case.simulation, self._start
        step, self._version = taken(state, "clock", np.int64, (2,), 0, round(LONGEST_RUN / settings.step)).tolist()
        if step % settings.steps_per_tick and step < settings.last_step:
            raise SavedError(f"clock: step {step} is not at the end of a tick")
        self.step = step
        self.scene.time = self.time
        position[:] = taken(state, "start_position", np.float64, position.shape)
        level[:] = taken(state, "start_level", np.int32, level.shape, 0, len(self.building.levels) - 1)
        displaced = self.displacement_velocity
        displaced[:] = taken(state, "displacement_velocity", np.float64, displaced.shape)
        self._ending.restore(taken(state, "ending", np.float64, self._ending.state().shape, 0.0, np.inf))

    def _start_recording(self) -> None:
        """Load the kernels, start the recorders and record the initial state."""
        with self.phases.enter("kernels"):
            self.engine.load(self.contact)
        with self.phases.enter("recording"):
            self.recording.start(self)

    def _plugins(self) -> list[str]:
        """Return name and version of each plugin used in this run."""
        used = [*assembly.make_importers(self.case), self.contact, *self.forces, *self.recorders]
        return self.registry.providers([*used, *(behaviour for behaviour, _ in self.behaviours)])

    def _act(self) -> None:
        """Reset speed factors and extra directions, then call the behaviours; after a change of the scene, all."""
        changed, self._version = self.scene.version != self._version, self.scene.version
        acting = [one for one in self.behaviours if self._acts[one[0].name] or changed]
        renewed = {name for behaviour, _ in acting for name in behaviour.writes}
        crowd = self.population.crowd
        if "speed_factor" in renewed:
            crowd.speed_factor[:] = 1.0
        if "extra_direction" in renewed:
            crowd.extra_direction[:] = 0.0
        if self.outside is not None and any(behaviour.keeps_distance for behaviour, _ in acting):
            self.outside.arrays.speed_factor[:] = 1.0
        for behaviour, scene in self.behaviours if self.full else acting:
            with plugin_code(f"t = {self.time:.3f} s: behaviour {behaviour.name!r}", behaviour, DECLARE):
                behaviour.act(scene.crowd, self.time)
            self._check_written(behaviour)

    def _check_written(self, behaviour: Behaviour) -> None:
        outside = self.outside.arrays if self.outside is not None else None
        check_written(behaviour, self.population.crowd, outside, len(self.fields.routes), self.time)

    def _scene(self, behaviour: Behaviour) -> BehaviourScene:
        crowd, groups = crowd_for(behaviour, self.population.crowd), self.population.groups_for(behaviour.name)
        generator = generator_for(self.seed, "behaviour", behaviour.name)
        outside = outside_for(behaviour, self.outside.arrays) if self.outside is not None else None
        return BehaviourScene(crowd, self.scene, groups, generator, self.case.simulation.tick, outside)
