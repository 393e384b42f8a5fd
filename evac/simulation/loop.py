"""The loop of a run: everything that happens at ticks is an operation with a trigger, in one list."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from evac.base.phases import Progress
from evac.results.ending import Stopped

if TYPE_CHECKING:
    from evac.simulation.simulation import Simulation


@dataclass(slots=True)
class Operation:
    """Something that happens at ticks."""

    name: str
    phase: str  # the phase of `evac.base.phases.PHASES` to which its wall time belongs
    act: Callable[[], object]  # called without arguments at each tick at which it is due
    # its trigger: returns whether it is due, when the operations before it have acted; None: at every tick
    is_due: Callable[[], bool] | None = None
    begin: Callable[[], object] | None = None  # called once, before the first tick, in the order of the list


class Loop:
    """Advances a simulation by one tick after the other.

    Attributes
    ----------
    operations : list of Operation
        In the order in which they act in each tick. Others may be added, at the end if they use the state after it.
    progress : callable or None
        Called with a `Progress` at every tick; if it raises `Stopped`, the run ends with this tick.
    """

    def __init__(self, simulation: "Simulation") -> None:
        self.progress: Callable[[Progress], None] | None = None
        self._simulation, self._settings = simulation, simulation.case.simulation
        self._steps_per_record = round(simulation.case.output.every / self._settings.tick)
        self._steps_per_record *= self._settings.steps_per_tick
        self._before = simulation.population.crowd.position.copy()
        self._end, self._is_output = 0, False
        self.operations = [*self._in_order()]

    def _in_order(self) -> Iterator[Operation]:
        """Yield the operations of the simulation."""
        one, crowd, watch = self._simulation, self._simulation.population.crowd, self._simulation.watch
        routes = None if one.exposure is None else one.exposure.routes
        if one.timetable.is_waiting:
            yield Operation("events", "behaviours", one.timetable.act, lambda: one.timetable.is_waiting)
        yield Operation("changes", "behaviours", one.scene.apply_waiting)
        if one.population.sources:
            yield Operation("arrivals", "behaviours", one.let_in)
        if routes is not None:

            def find_ways() -> None:
                if routes.update(one.time, one.scene):
                    one.ending.begin_anew()  # progress is then towards other ways

            yield Operation(
                "smoke on routes", "directions", find_ways, lambda: routes.is_due(self._tick, one.scene.version)
            )
        if one.scene.quickest is not None:
            yield Operation("quickest", "directions", self._find_quickest, self._is_update)
        yield Operation("behaviours", "behaviours", self._decide)
        yield Operation("areas", "behaviours", one.scene.act_on_areas, lambda: one.building.has_areas_to_heed)
        yield Operation("physics", "physics", self._move)
        yield Operation("settling", "recording", self._settle)
        if one.case.place:
            settle = one.places.settle
            yield Operation("places", "recording", lambda: settle(one.time, one.fields, one.displacement_velocity))
        if one.outside is not None:
            walk = one.outside.advance
            yield Operation("people outside", "recording", lambda: walk(self._left, one.time, self._span))
        if (exposure := one.exposure) is not None:
            steps = max(1, round(one.case.smoke.sampling / self._settings.tick)) * self._settings.steps_per_tick
            yield Operation(
                "conditions",
                "behaviours",
                lambda: exposure.act(one.time, one.fields),
                lambda: one.step % steps == 0,
                lambda: exposure.begin(one.time, one.fields),
            )
        look = watch.look_at_velocities
        yield Operation("velocities", "recording", lambda: look(one.time, crowd, one.displacement_velocity))
        yield Operation("overlaps", "recording", lambda: watch.look_at_overlaps(one.time, crowd))
        yield Operation("forces", "recording", lambda: watch.look_at_forces(one.time, crowd), self._is_at_output)
        record = one.recording.record
        yield Operation("recorders", "recording", lambda: record(one), self._is_at_output, self._start_recording)
        yield Operation("ending", "recording", self._end_run)
        yield Operation("progress", "output", self._show, lambda: self.progress is not None)

    def begin(self) -> None:
        """Begin the operations that have not begun."""
        for operation in self.operations:
            if operation.begin is not None:
                begin, operation.begin = operation.begin, None
                begin()

    def advance(self) -> None:
        """Make a tick."""
        self.begin()
        simulation, settings = self._simulation, self._settings
        self._end = min(simulation.step + settings.steps_per_tick, settings.last_step)
        self._is_output = self._end % self._steps_per_record == 0
        phase = self.operations[0].phase
        with simulation.phases.enter(phase):
            for operation in self.operations:
                if operation.is_due is None or operation.is_due():
                    if operation.phase != phase:
                        phase = operation.phase
                        simulation.phases.turn_to(phase)
                    operation.act()

    def _is_at_output(self) -> bool:
        return self._is_output

    def _decide(self) -> None:
        simulation = self._simulation
        if simulation.deciding.version != simulation.scene.version:
            simulation.ending.begin_anew()
        simulation.deciding.act(simulation.time)
        if rows := simulation.scene.take_new_ways():
            simulation.ending.begin_anew(rows)

    @property
    def _tick(self) -> int:
        return self._simulation.step // self._settings.steps_per_tick

    def _is_update(self) -> bool:
        assert self._simulation.scene.quickest is not None
        return self._simulation.scene.quickest.is_due(self._tick, self._settings.tick)

    def _find_quickest(self) -> None:
        """Solve the routes that follow the crowd again."""
        crowd = self._simulation.population.crowd
        assert self._simulation.scene.quickest is not None
        self._simulation.scene.quickest.update(crowd.level, crowd.position, crowd.route, crowd.contact_radius)

    def _move(self) -> None:
        simulation, settings = self._simulation, self._settings
        crowd, first = simulation.population.crowd, simulation.step
        self._before[:] = crowd.position
        reports = self._is_output or self._end == settings.last_step or simulation.deciding.reads_forces
        self._events = simulation.engine.advance(
            simulation.contact, crowd, first, self._end - first, settings.step, settings.is_explicit, reports
        )

    def _settle(self) -> None:
        """Count exits and crossings, and advance the clock."""
        simulation = self._simulation
        self._span = (self._end - simulation.step) * self._settings.step
        simulation.step = self._end
        simulation.scene.end_tick(simulation.time)
        np.subtract(simulation.population.crowd.position, self._before, out=simulation.displacement_velocity)
        simulation.displacement_velocity /= self._span
        self._left = simulation.population.settle(self._events)

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
        can_change = bool(simulation.scene.changes_before(self._settings.duration))
        simulation.ended = simulation.ending.reason(simulation.step, crowd, simulation.fields, can_change)
        if simulation.ended:
            simulation.scene.end()

    def _show(self) -> None:
        simulation, population = self._simulation, self._simulation.population
        people = len(population.crowd.level)
        assert self.progress is not None
        try:
            self.progress(Progress(simulation.time, self._settings.duration, people, people - population.inside))
        except Stopped:
            simulation.stop()
