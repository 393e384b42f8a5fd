"""The state of a run between two ticks: the arrays that are needed to continue it with the same bits."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evac.base.errors import plugin_code
from evac.base.saved import SavedError, copies_of, part_of, state_of, take, taken
from evac.case.schema import LONGEST_RUN

if TYPE_CHECKING:
    from evac.simulation.simulation import Simulation

#: Arrays of the simulation itself.
OWN = ("start_position", "start_level", "displacement_velocity")


def saved_state(simulation: "Simulation") -> dict[str, NDArray[Any]]:
    """Return copies of the arrays of all parts, see `Simulation.state`."""
    simulation.engine.load(simulation.contact)  # prepares the contact model, so that it has a state
    contact = simulation.contact
    own = state_of(contact, f"contact model {contact.name!r}", f"contact.{contact.name}.")
    parts = {
        "population": simulation.population.state(),
        "engine": simulation.engine.snapshot(),
        "scene": simulation.scene.state(),
        "places": simulation.places.state(),
        "outside": {} if simulation.outside is None else simulation.outside.state(),
        "exposure": {} if simulation.exposure is None else simulation.exposure.state(simulation.scene),
        "quickest": {} if simulation.scene.quickest is None else simulation.scene.quickest.state(),
        "watch": simulation.watch.state(),
        "ending": copies_of(simulation.ending.arrays),
        "simulation": {
            "clock": np.array([simulation.step, simulation.deciding.version]),
            "events": simulation.timetable.state(),
            **copies_of({name: getattr(simulation, name) for name in OWN}),
        },
    }
    parts_of_state = {f"{name}.{key}": array for name, part in parts.items() for key, array in part.items()}
    return simulation.deciding.state() | own | parts_of_state


def restore_state(simulation: "Simulation", state: Mapping[str, NDArray[Any]]) -> None:
    """Restore the arrays that `saved_state` returned, see `Simulation.restore`."""
    with simulation.phases.enter("kernels"):
        simulation.engine.load(simulation.contact)

    def restore(name: str, part: Callable[..., None], *more: Any) -> None:
        with part_of(state, f"{name}.") as own:
            part(own, *more)

    restore("simulation", partial(_restore_own, simulation))
    restore("scene", simulation.scene.restore, simulation.time)
    if simulation.scene.quickest is not None:
        restore("quickest", simulation.scene.quickest.restore)
    routes = len(simulation.fields.routes)
    restore("population", simulation.population.restore, simulation.building, routes)
    restore("places", simulation.places.restore, routes)
    simulation.scene.hold()
    if simulation.outside is not None:
        restore("outside", simulation.outside.restore)
    if simulation.exposure is not None:
        restore("exposure", simulation.exposure.restore, simulation.scene)
    simulation.deciding.restore(state)
    contact = simulation.contact
    with plugin_code(f"contact model {contact.name!r}: restore", contact):
        restore(f"contact.{contact.name}", contact.restore)
    restore("engine", simulation.engine.restore)
    restore("watch", simulation.watch.restore, len(simulation.building.levels))
    ending = simulation.ending.arrays
    restore("ending", take, ending, dict.fromkeys(ending, (0.0, np.inf)))
    simulation.ended = simulation.ending.over(simulation.step, simulation.population.crowd)


def _restore_own(simulation: "Simulation", state: Mapping[str, NDArray[Any]]) -> None:
    """Restore the arrays that no part of the simulation owns."""
    settings = simulation.case.simulation
    clock = taken(state, "clock", np.int64, (2,), 0, round(LONGEST_RUN / settings.step))
    step, simulation.deciding.version = clock.tolist()
    if step % settings.steps_per_tick and step < settings.last_step:
        raise SavedError(f"clock: step {step} is not at the end of a tick")
    simulation.step = step
    simulation.timetable.restore(taken(state, "events", np.float64, (len(simulation.case.event),), 0.0, np.inf))
    bounds = {"start_level": (-1, len(simulation.building.levels) - 1)}
    take(state, {name: getattr(simulation, name) for name in OWN}, bounds)
