"""The loop of a run: everything that happens at ticks is an operation with a trigger, in one list."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from evac.base.progress import Progress
from evac.results.ending import NO_PROGRESS, Stopped

if TYPE_CHECKING:
    from evac.simulation.simulation import Simulation


@dataclass(slots=True)
class Operation:
    """Something that happens at ticks."""

    name: str
    phase: str  # the phase of `evac.base.progress.PHASES` to which its wall time belongs
    act: Callable[[], object]  # called without arguments at each tick at which it is due
    # its trigger: returns whether it is due, when the operations before it have acted; None: at every tick
    is_due: Callable[[], bool] | None = None
    begin: Callable[[], object] | None = None  # called once, before the first tick, in the order of the list


class Loop:
    """Advances a simulation by one tick after the other; `progress` may raise `Stopped` to end the run with a tick.

    `operations` are in the order in which they act; others may be added, at the end if they use the state after a tick.
    """

    def __init__(self, simulation: "Simulation") -> None:
        self.progress: Callable[[Progress], None] | None = None
        self._simulation, self._settings = simulation, simulation.case.simulation
        self._steps_per_record = round(simulation.case.output.every / self._settings.tick)
        self._steps_per_record *= self._settings.steps_per_tick
        self._before = simulation.population.crowd.position.copy()
        self._end, self._is_output = 0, False
        self._act: Callable[[], object] | None = None
        record = partial(simulation.recording.record, simulation)
        self.operations = [
            Operation("changes", "behaviours", self._change, begin=simulation.population.protect),
            Operation("directions", "directions", self._find_ways, self._is_way_to_find),
            Operation("behaviours", "behaviours", self._decide),
            Operation("physics", "physics", self._move),
            Operation("settling", "recording", self._settle),
            Operation("conditions", "behaviours", self._expose, self._is_sampled, self._begin_exposure),
            Operation("safety", "recording", self._judge, lambda: simulation.safety is not None, self._judge_start),
            Operation("watch", "recording", self._look),
            Operation("recorders", "recording", record, lambda: self._is_output, self._start_recording),
            Operation("ending", "recording", self._end_run),
            Operation("progress", "output", self._show, lambda: self.progress is not None),
        ]

    def begin(self) -> None:
        """Begin the operations that have not begun."""
        for operation in self.operations:
            if operation.begin is not None:
                begin, operation.begin = operation.begin, None
                with self._simulation.population.writable():
                    begin()

    def advance(self, act: Callable[[], object] | None = None) -> None:
        """Make a tick, in which a program may `act` before the behaviours."""
        self.begin()
        self._act = act
        simulation, settings = self._simulation, self._settings
        self._end = min(simulation.step + settings.steps_per_tick, settings.last_step)
        self._is_output = self._end % self._steps_per_record == 0
        phase, velocity = self.operations[0].phase, simulation.displacement_velocity
        velocity.flags.writeable = True
        with simulation.phases.enter(phase), simulation.population.writable():
            for operation in self.operations:
                if operation.is_due is None or operation.is_due():
                    if operation.phase != phase:
                        phase = operation.phase
                        simulation.phases.turn_to(phase)
                    operation.act()
        velocity.flags.writeable = False

    def _change(self) -> None:
        """Apply events and other changes of the scene, and let in those whose arrival time has come."""
        simulation = self._simulation
        simulation.timetable.act()
        simulation.scene.apply_waiting()
        if simulation.lifts is not None:
            simulation.lifts.act()
        if simulation.population.sources:
            simulation.let_in()

    def _is_way_to_find(self) -> bool:
        scene = self._simulation.scene
        return self._simulation.exposure is not None or scene.quickest is not None or scene.local is not None

    def _find_ways(self) -> None:
        """Solve the directions that follow smoke or the crowd again."""
        simulation = self._simulation
        scene, tick = simulation.scene, simulation.step // self._settings.steps_per_tick
        routes = None if simulation.exposure is None else simulation.exposure.routes
        if routes is not None and routes.is_due(tick, scene.ways_version) and routes.update(simulation.time, scene):
            simulation.ending.begin_anew()  # progress is then towards other ways
        scene.follow_crowd(tick, self._settings.tick)

    def _decide(self) -> None:
        simulation = self._simulation
        if has_changed := simulation.deciding.version != simulation.scene.version:
            simulation.ending.begin_anew()
        simulation.deciding.act(simulation.time, self._act)
        if simulation.lifts is not None:
            simulation.lifts.steer()
        if has_changed or not simulation.step:
            simulation.scene.note_cut_off()
        if rows := simulation.scene.take_new_ways():
            simulation.ending.begin_anew(rows)
        if simulation.building.has_areas_to_heed:
            simulation.scene.act_on_areas()

    def _move(self) -> None:
        simulation, settings = self._simulation, self._settings
        crowd, first = simulation.population.crowd, simulation.step
        self._before[:] = crowd.position
        reports = self._is_output or self._end == settings.last_step or simulation.deciding.reads_forces
        self._events = simulation.engine.advance(
            simulation.contact, crowd, first, self._end - first, settings.step, settings.is_explicit, reports
        )

    def _settle(self) -> None:
        """Advance the clock; count exits and crossings; people arrive at places, and walk on outside."""
        simulation = self._simulation
        span = (self._end - simulation.step) * self._settings.step
        simulation.step = self._end
        simulation.scene.time = simulation.time
        np.subtract(simulation.population.crowd.position, self._before, out=simulation.displacement_velocity)
        simulation.displacement_velocity /= span
        left = simulation.population.settle(self._events)
        simulation.places.settle(simulation.time, simulation.fields, simulation.displacement_velocity)
        if simulation.outside is not None:
            simulation.outside.advance(left, simulation.time, span)

    def _is_sampled(self) -> bool:
        """Return whether the conditions of the air are read at this tick."""
        if self._simulation.exposure is None:
            return False
        every = max(1, round(self._simulation.case.smoke.sampling / self._settings.tick))
        return self._simulation.step % (every * self._settings.steps_per_tick) == 0

    def _begin_exposure(self) -> None:
        if self._simulation.exposure is not None:
            self._simulation.exposure.begin(self._simulation.time, self._simulation.fields)

    def _expose(self) -> None:
        assert self._simulation.exposure is not None
        self._simulation.exposure.act(self._simulation.time, self._simulation.fields)

    def _judge(self) -> None:
        simulation, exposure = self._simulation, self._simulation.exposure
        if simulation.safety is not None:
            doses = None if exposure is None else exposure.doses_at(simulation.time)
            simulation.safety.look(simulation.time, simulation.places.arrived, doses)

    def _judge_start(self) -> None:
        if self._simulation.step == 0:
            self._judge()

    def _look(self) -> None:
        simulation, crowd = self._simulation, self._simulation.population.crowd
        simulation.watch.look(simulation.time, crowd, simulation.displacement_velocity, self._is_output)

    def _start_recording(self) -> None:
        simulation = self._simulation
        if not simulation.recording.is_started:
            with simulation.phases.enter("kernels"):
                simulation.engine.load(simulation.contact)
            with simulation.phases.enter("recording"):
                simulation.recording.start(simulation)

    def _end_run(self) -> None:
        simulation, crowd = self._simulation, self._simulation.population.crowd
        if simulation.case.place and simulation.timetable.is_waiting and simulation.places.arrived.any():
            simulation.timetable.act()  # before a run ends because all have arrived
        if (simulation.population.sources and simulation.to_come) or (simulation.case.place and simulation.to_go_on):
            return
        ended = simulation.ending.reason(simulation.step, crowd, simulation.fields, simulation.can_grow)
        if ended and not (ended == NO_PROGRESS and self._can_change()):
            simulation.ended = ended
            simulation.scene.end()

    def _can_change(self) -> bool:
        """Return whether the scene or the air is going to change, so that a crowd that is blocked may get out."""
        scene, exposure, time = self._simulation.scene, self._simulation.exposure, self._simulation.time
        is_ahead = bool(scene.changes_before(self._settings.duration)) or scene.controls.is_waiting(time)
        is_ahead |= self._simulation.lifts is not None and self._simulation.lifts.is_busy
        return is_ahead or (exposure is not None and exposure.air.changes_after(time))

    def _show(self) -> None:
        simulation, population = self._simulation, self._simulation.population
        people = len(population.crowd.level)
        assert self.progress is not None
        try:
            self.progress(Progress(simulation.time, self._settings.duration, people, people - population.inside))
        except Stopped:
            simulation.stop()
