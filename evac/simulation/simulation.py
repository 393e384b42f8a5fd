"""The simulation: all parts of a run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.change import LIFT
from evac.base.errors import EvacError, PluginError, naming, noting, plugin_code
from evac.base.parameters import PATH, check_types
from evac.base.progress import Phases, Progress
from evac.base.saved import Saved, SavedError, part_of, state_of
from evac.building.model.building import Building
from evac.building.model.findings import Finding, as_findings, keyed, warnings_of
from evac.building.model.narrow import narrow_places
from evac.case.case import Case
from evac.case.loading import as_case, run_plugin_files
from evac.contract.registry import Registry
from evac.directions.fields import Fields
from evac.directions.routes import Route
from evac.jit.loading import Compiling, addresses_of
from evac.people.groups import check_people, unusual
from evac.people.outside import PeopleOutside
from evac.people.population import INITIAL
from evac.people.starts import with_numbers
from evac.people.ways import cut_off, without_way
from evac.physics.state import copy_of
from evac.results.ending import INTERRUPTED, Ending, Watch
from evac.results.results import Results, results_of
from evac.simulation import assembly, needed
from evac.simulation.deciding import Deciding
from evac.simulation.loop import Loop
from evac.simulation.scene import Scene, SharedScene, doorway_warning
from evac.simulation.timetable import Timetable
from evac.trajectory.recorder import Recorder, Recording


class Simulation(Saved):
    """A case that is ready to run.

    Parameters
    ----------
    case : Case, str, Path or mapping
        A case from `evac.load`, or an argument of `evac.load`.
    folder : str or Path, optional
        Folder for the trajectory and the replay, and for files of other recorders; None writes no files. Tables and
        summary.json are written by `Results.write`, a whole result folder by `evac.run`.
    full : bool
        Include the parts that the scene does not need: identical results, slower.
    routes : sequence of Route
        Routes on which `Scene.send` can send people, in addition to those that the case needs.
    in_memory : bool
        Keep the trajectory in memory if there is no folder, for `Results.trajectory`.
    shared_scene : SharedScene, optional
        That of a simulation whose case has the same `evac.simulation.shared.shared_key`; computed if not given.
    will_run : bool
        False to inspect the state before the first step only: kernels of the step loop are then not loaded.
    workers : int, optional
        Greatest number of processes that share the directions of a large building, at most one for each core; None
        means one for each core. The directions are identical.
    compiling : callable, optional
        Called with the number of compiled kernels and the number of kernels to compile, if there are any.

    Raises
    ------
    EvacError
        The building, the directions, the people or a plugin are not valid for this case.

    Attributes
    ----------
    registry, scene, building, fields, population, contact, forces, engine, recording, deciding, watch, ending
        The parts of the simulation, see docs/architecture.md.
    timetable : Timetable
        The events of the case.
    loop : Loop
        What happens at each tick.
    behaviours : list of (Behaviour, BehaviourScene)
        The behaviours in use, each with the scene that it can access.
    places : Places
        The people who go to refuges and assembly areas, and those who have arrived.
    lifts : Lifts or None
        The cars of the lifts of the building.
    exposure : Exposure or None
        The doses that people take, and the speed that smoke leaves them, if the case has conditions of the air.
    safety : Safety or None
        When compartments become unsafe and are left, and the margins of people, if the case has a table [safety].
    outside : PeopleOutside or None
        The people who have left, if a behaviour keeps distances.
    plan : list of PlanRow
        The parts that the scene needs and those that are left out, see `evac.simulation.needed.explain`.
    step, time : int, float
        Number of steps made, and simulated time [s].
    start_position, start_level : (n, 2) float64 [m], (n,) int32
    displacement_velocity : (n, 2) float64
        Displacement of each person in the last tick divided by the length of the tick, in plan [m/s]; before the
        first tick the initial velocity. This velocity is recorded; that of the crowd belongs to the contact model.
    phases : Phases
        Wall time of each phase.
    ended : str
        Why the run has ended; empty during the run.
    findings : tuple of Finding
        What is known of building and people before the first step: those of the building, places that are too narrow,
        ground on which nobody starts, and warnings about people.
    stopping : tuple of Finding
        Places that are too narrow for people who have no other way to an exit.
    resumed : list of dict
        The checkpoints from which the run was resumed, see docs/summary.md.
    """

    saved = (
        *("step", "start_position", "start_level", "displacement_velocity", "timetable", "scene", "population"),
        *("places", "lifts", "outside", "exposure", "safety", "deciding", "watch", "ending", "engine"),
    )

    def __init__(
        self,
        case: Case | str | Path | Mapping[str, Any],
        folder: str | Path | None = None,
        full: bool = False,
        *,
        routes: Sequence[Route] = (),
        in_memory: bool = False,
        shared_scene: SharedScene | None = None,
        will_run: bool = True,
        workers: int | None = 1,
        compiling: Compiling | None = None,
    ) -> None:
        check_types(folder=(folder, PATH | None), full=(full, bool), workers=(workers, Integral | None))
        check_types(in_memory=(in_memory, bool), compiling=(compiling, Callable | None), routes=(routes, Sequence))
        for route in routes:
            check_types(routes=(route, Route))
        self.case = case = run_plugin_files(as_case(case))
        self.registry: Registry = case.registry
        self.folder, self.full = None if folder is None else Path(folder), full
        self.seed, self.step, self._in_memory = case.simulation.seed, 0, in_memory and folder is None
        self.phases, self.ended = Phases(), ""
        self.resumed: list[dict[str, Any]] = []
        with self.phases.enter("preparation"):
            self._make(shared_scene, will_run, workers, compiling, routes)

    def _make(
        self,
        shared_scene: SharedScene | None,
        will_run: bool,
        workers: int | None,
        compiling: Compiling | None,
        routes: Sequence[Route],
    ) -> None:
        """Create the parts of the run, each from those before it, and call the hooks and `prepare` of plugins."""
        case, settings = self.case, self.case.simulation
        self.registry.call_all("evac_configure", case=case, registry=self.registry)
        self.contact = assembly.make_contact_model(case)
        self.recording = Recording(assembly.make_recorders(case), self.folder, self._in_memory)
        forces, behaviours = assembly.make_forces(case), assembly.make_behaviours(case)
        self.forces = needed.needed_forces(forces, self.full)
        importers = assembly.make_importers(case)
        with self.phases.enter("building"):
            self._building_files = assembly.files_of_building(case, importers)
            building = shared_scene.building if shared_scene else assembly.make_building(case)
            check_people(case, building)
            self.case = case = with_numbers(case, building)
        with self.phases.enter("kernels"):
            used = assembly.ENGINE, building, self.contact, self.forces, behaviours
            kernels = needed.run_kernels(case, *used, self.full) if will_run else []
            addresses_of([*needed.SET_UP, *kernels], compiling)
        solve = partial(
            needed.solve_fields, case, behaviours=behaviours, full=self.full, workers=workers, routes=routes
        )
        with naming(case.source), self.phases.enter("directions"):
            shared_scene = shared_scene or SharedScene(building, solve(building))
        with noting(building.warnings), self.phases.enter("people"):
            self.population, self.places, self.stopping, promised = assembly.make_population(
                case, shared_scene, self.contact, behaviours
            )
            crowd = self.population.crowd
            self.start_position, self.start_level = crowd.position.copy(), crowd.level.copy()
            self.displacement_velocity = crowd.velocity.copy()
            everywhere, keeps = partial(solve, anywhere=True), any(behaviour.keeps_distance for behaviour in behaviours)
            self.scene = Scene(
                shared_scene, self.population, self.places, everywhere, self.let_in, case.directions.quickest, keeps
            )
            self.timetable = Timetable(case, self.scene)
            self.lifts = assembly.make_lifts(case, self.scene)
            self.exposure = assembly.make_exposure(case, self.scene, self.population)
            self.safety = assembly.make_safety(case, shared_scene, self.population, self.exposure)
            self.outside = PeopleOutside(building, crowd) if keeps else None
            self.deciding = Deciding(self, behaviours)
            self.behaviours = self.deciding.used
        self.engine = assembly.make_engine(self, behaviours)
        self.watch = Watch(crowd.radius, settings.tick, case.output.every, promised)
        stopped = None if self.exposure is None else self.exposure.stopped
        ways, staying = len(self.fields.routes), self.population.staying
        reserve = self.population.reserve
        self.ending = Ending(settings, len(crowd.level), ways, self.places.arrived, staying, stopped, reserve)
        self.deciding.prepare()
        self.loop = Loop(self)
        self.plan = needed.explain(self, forces, behaviours)
        plugins = [*importers, self.contact, *self.forces, *self.recorders, *(one for one, _ in self.behaviours)]
        self._providers = self.registry.providers(plugins)
        self.registry.call_all("evac_prepare", simulation=self)
        self.findings = self._found_at_start()
        self.population.protect(INITIAL)
        self.displacement_velocity.flags.writeable = False

    @property
    def dose(self) -> FloatArray | None:
        """The greater of the doses of gases and heat of each person, (n,); None in a case without doses."""
        doses = None if self.exposure is None else self.exposure.doses_at(self.time)
        return None if doses is None else doses.max(axis=0)

    @property
    def can_grow(self) -> bool:
        """Whether the doses of people inside can still grow."""
        return self.exposure is not None and self.exposure.can_grow(self.time)

    @property
    def standing(self) -> NDArray[np.bool_]:
        """Whether people are in no queue, (n,): at a refuge or assembly area, stopped by gases, held by a behaviour."""
        standing = self.places.arrived | self.deciding.held
        return standing if self.exposure is None else standing | self.exposure.stopped

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
            enough, unusual properties of people, people who start only after the end of the run, several behaviours
            that keep distances, people who stood in a closing doorway, and, before the run, people without a way.
        """
        changes = [change for change in self.scene.changes if change.kind != LIFT]
        shut = [doorway_warning(change) for change in changes if change.values.get("let_through")]
        return (*warnings_of(self.findings), *shut, *(() if self.step else self._shut_in()))

    def _shut_in(self) -> tuple[str, ...]:
        """Return a line for the people of each group whose ways have closed, with the changes that did it."""
        if not (self.scene.changes or self.building.closed):
            return ()
        crowd, since = self.population.crowd, self.scene.cut_off_at
        since = np.where(without_way(self.fields, crowd), np.fmin(since, self.time), np.nan)
        return cut_off(self.building, self.fields, crowd, self.population.groups, since, self.scene.changes)

    def _found_at_start(self) -> tuple[Finding, ...]:
        """Return the findings about building and people before the first step; those without a place are warnings."""
        crowd, groups = self.population.crowd, self.population.groups
        air = () if self.exposure is None else self.exposure.warnings()
        lifts = () if self.lifts is None else self.lifts.warnings()
        narrow = narrow_places(self.building, 2.0 * crowd.contact_radius)
        start = crowd.replace(level=np.where(crowd.arrival_time == 0.0, crowd.level, np.int32(-1)))
        people, out = unusual(start, groups), self.population.left_out
        found = as_findings((*self.building.findings, *air, *narrow, *self.stopping, *lifts, *people, *out))
        return tuple(keyed(found, self.building.keys))

    def run(self, progress: Callable[[Progress], None] | None = None) -> Results:
        """Run to the end and return the results: `advance_tick` until the run has ended.

        Parameters
        ----------
        progress : callable, optional
            Called with a `Progress` at every tick.

        Raises
        ------
        SimulationError
            A step fails; names time, person and place.
        PluginError
            A plugin fails; `results` returns the results until then.
        """
        check_types(progress=(progress, Callable | None))
        results = None
        error: BaseException | None = None
        self.loop.progress = progress
        with self.phases.enter("output"):
            try:
                self.loop.begin()
                with self.population.writable():  # once, since it takes time
                    while not self.ended:
                        self.advance_tick()
                results = self.results()
            except BaseException as caught:
                error = caught
                for line in self.warnings() if isinstance(error, EvacError) else ():
                    error.add_note(f"warning: {line}")
                raise
            finally:
                self.recording.finish(self, self.registry, results, error)
        results = results.with_values(phases=self.phases.seconds())
        memory = self.recording.in_memory()  # also the last state
        return results if memory is None else replace(results, recorded=memory)

    def advance_tick(self, act: Callable[[], object] | None = None) -> None:
        """Advance by one tick: everything in ``loop.operations``, in order; `ended` is set after the last tick.

        Parameters
        ----------
        act : callable
            Called without arguments when the behaviours act, before the first of them: what it does has the bits of a
            behaviour that does it.

        Raises
        ------
        SimulationError, PluginError
            As `run`; a program has written what no person can have.
        """
        if act is not None:
            check_types(act=(act, Callable))
        self.population.check_written(len(self.fields.routes))
        self.loop.advance(act)

    def let_in(self) -> None:
        """Place the people whose arrival time has come, or who were added, as far as there is room for them."""
        with self.population.writable():
            came = self.population.arrive(self.building, self.time)
        crowd = self.population.crowd
        self.start_position[came], self.start_level[came] = crowd.position[came], crowd.level[came]
        if len(came):
            self.places.assign(self.fields)

    @property
    def to_come(self) -> bool:
        """Whether people are still to arrive before the end of the longest run."""
        step, settings = self.step, self.case.simulation
        is_late = np.isnan(self.population.crowd.arrival_time)
        return step < settings.last_step and bool(is_late.any()) and self.population.next_arrival < settings.duration

    @property
    def to_go_on(self) -> bool:
        """Whether a change that is still to come may send people on who are at an assembly area or a refuge."""
        settings, arrived = self.case.simulation, self.places.arrived
        changes = self.scene.changes_before(settings.duration)
        targets = self.timetable.groups_to_send | {change.what for change in changes if change.kind == "strategy"}
        waits = np.zeros(len(arrived), np.bool_)
        for group in self.population.groups:
            waits[group.rows] = group.name in targets
        lifts = {lift.name for lift in self.building.lifts}
        if any(change.kind == "open" and change.what in lifts for change in changes):
            waits |= self.places.waits_for_lift
        return self.step < settings.last_step and bool(changes) and bool((arrived & waits).any())

    def stop(self) -> None:
        """End the run now, unless it has ended already; `results` are those until now."""
        self.ended = self.ended or INTERRUPTED

    def release(self) -> None:
        """Release the memory of a run that has ended, which cannot be used any more; its results stay.

        Parts of a run refer to each other, so that otherwise they stay until Python looks for garbage, after many runs.
        """
        for part in (self.loop, self.scene, self):
            vars(part).clear()

    def results(self) -> Results:
        """Return the results up to the present step."""
        results = results_of(
            case=self.case,
            building=self.building,
            stuck=tuple(self.ending.stuck(self.step, self.population.crowd).tolist()),
            waiting_outside=sum(len(one.waiting(self.population.crowd, self.time)) for one in self.population.sources),
            crowd=copy_of(self.population.crowd),
            groups=self.population.groups,
            routes=self.fields.routes,
            start_position=self.start_position,
            start_level=self.start_level,
            crossings=self.population.crossings,
            ended=self.ended,
            time=self.time,
            steps=self.step,
            seed=self.seed,
            places=self.places.people_at(),
            entered_barred=self.scene.entered,
            notes=(*self._shut_in(), *self.deciding.notes(), *(() if self.lifts is None else self.lifts.notes())),
            warnings=self.warnings(),
            report=self.engine.contact_report(self.contact) | {"promised_overlap": self.watch.promised},
            seen=self.watch.observations(),
            phases=self.phases.seconds(),
            plan=self.plan,
            plugins=self._providers,
            files=self._files(),
            folder=self.folder,
            recorded=self.recording.in_memory(),
            changes=tuple(self.scene.changes),
            resumed=self.resumed,
            quickest=None if self.scene.quickest is None else self.scene.quickest.report(),
            lifts=() if self.lifts is None else self.lifts.use(),
            **({} if self.exposure is None else self.exposure.results(self.time)),
            **({} if self.safety is None else self.safety.results(self.population.crossings)),
        )
        return replace(results, metrics=self._metrics(results))

    def _metrics(self, results: Results) -> dict[str, Any]:
        """Return the result of each plugin's evac_metrics; for a plugin that fails, the error instead."""
        metrics: dict[str, Any] = {}
        for plugin, call in self.registry.calls("evac_metrics", results=results):
            try:
                with plugin_code(f"{plugin}: evac_metrics", call.func):
                    metrics[plugin] = call()
            except PluginError as error:
                metrics[plugin] = {"error": str(error)}
        return metrics

    def data_files(self) -> list[Path]:
        """Return the files that behaviours and conditions have requested."""
        scenes = [scene for _, scene in self.behaviours]
        files = [path for scene in scenes for path in scene.files]
        if self.exposure is not None:
            files += [path for scene in self.exposure.air.scenes for path in scene.files]
        return files

    def _files(self) -> tuple[str, ...]:
        """Return all files that the run has read, besides its case."""
        files = [*self.case.plugin_files, *self._building_files, *self.data_files()]
        return tuple(dict.fromkeys(str(path.resolve()) for path in files))

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of all data that are needed to continue a run from this tick with identical results.

        The state of recorders is not part of it, see `Recording.state`.
        """
        self.engine.load(self.contact)  # prepares the contact model, so that it has a state
        contact = state_of(self.contact, f"contact model {self.contact.name!r}", f"contact.{self.contact.name}.")
        return super().state() | contact

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
        self.displacement_velocity.flags.writeable = True  # between ticks, it is not
        self.population.protect()
        with self.population.writable():
            super().restore(state)
            self.scene.keep_doorway_open()
        self.displacement_velocity.flags.writeable = False
        settings, contact = self.case.simulation, self.contact
        if self.step % settings.steps_per_tick and self.step < settings.last_step:
            raise SavedError(f"step: {self.step} is not at the end of a tick")
        what = f"contact model {contact.name!r}: restore"
        with plugin_code(what, contact), part_of(state, f"contact.{contact.name}.") as own:
            contact.restore(own)
        self.ended = self.ending.over(self.step, self.population.crowd, self.can_grow)
