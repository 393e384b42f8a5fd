"""Runs of the square room (paper, section 4.1) and the flow through its door.

The set-up is fixed: the shipped case (door in the middle of a wall, walls without thickness, default directions; people
are out when their centre crosses the door line). Positions and parameters have separate seeds: a position set is placed
with the greatest radius, and each of its runs redraws radius, mass, tau and speed.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.distributions import generator_for
from evac.base.errors import ScenarioError
from evac.case.loading import load_case
from evac.evidence.scenes import MODELS, make_engine, make_model
from evac.people.population import Population, build_population
from evac.physics.contact.model import border_scene
from evac.physics.state import Crowd, World, copy_of
from evac.simulation.simulation import Simulation

if TYPE_CHECKING:
    from evac.case.case import Case


#: A run is stopped and counted separately when nobody has left for this time [s].
GAP = 10.0

TICK = 0.1  # s

#: Resamples of the bootstrap, and the confidence of its intervals.
RESAMPLES = 2000
CONFIDENCE = 0.95


class FlowEstimate(NamedTuple):
    """A value and its interval by bootstrap over position sets [people per minute]."""

    value: float
    low: float
    high: float


class Flow(NamedTuple):
    """The flow in the runs of one model at one step, by two definitions.

    ``pooled`` is the slope of the linear regression of the number out on time over the pooled exits of all
    runs that were not stopped, ``mean`` the mean of the slopes of single runs; ``stopped`` of ``runs`` runs are
    counted separately.
    """

    pooled: FlowEstimate
    mean: FlowEstimate
    runs: int
    stopped: int


def run_set(seed: int, position_set: int, runs: int, step: float) -> dict[str, FloatArray]:
    """Return the sorted exit times (runs, people) [s] of each model in the runs of one position set at a step [s].

    They are NaN after the last exit of a stopped run.
    """
    places = start_positions(seed, position_set)
    crowds = [crowd_at(places, seed, position_set, run) for run in range(runs)]
    return {name: np.sort([exit_times(name, copy_of(crowd), step) for crowd in crowds], axis=1) for name in MODELS}


def start_positions(seed: int, position_set: int) -> FloatArray:
    """Return positions (20, 2) [m] at which people of the greatest radius do not touch."""
    case, simulation, _ = _room()
    greatest = case.people[0].radius.support()[1]
    wide = _changed(greatest)
    place_seed = int(generator_for(seed, "square room", "positions", str(position_set)).integers(2**31))
    return build_population(wide, simulation.building, simulation.fields, place_seed).crowd.position


def crowd_at(positions: FloatArray, seed: int, position_set: int, run: int) -> Crowd:
    """Return people at given positions, with the parameters of one run."""
    case, simulation, _ = _room()
    people = case.people[0]
    n = len(positions)

    def drawn(quantity: str) -> FloatArray:
        generator = generator_for(seed, "square room", quantity, str(position_set), str(run))
        values: FloatArray = getattr(people, quantity).draw(generator, n)
        return values

    empty = simulation.population.crowd
    fresh = {name: array.copy() for name, array in empty.values().items()}
    fresh["position"] = positions.copy()
    for quantity in ("radius", "mass", "tau"):
        fresh[quantity] = drawn(quantity)
    fresh["contact_radius"] = fresh["radius"].copy()
    fresh["speed"] = np.repeat(drawn("speed")[:, None], 3, axis=1)
    return Crowd(**fresh)


def exit_times(model: str, crowd: Crowd, step: float) -> FloatArray:
    """Run the room until everybody is out, or nobody has left for `GAP`; return exit times (n,) [s] or NaN.

    If the model refuses the step, all exit times are NaN.
    """
    _, simulation, world = _room()
    contact = make_model(model)
    try:
        contact.check_scene(border_scene(crowd, step, False))
    except ScenarioError:
        return crowd.exit_time
    engine = make_engine(world, len(crowd.level))
    population = Population(crowd, (), simulation.building, 1)
    per_tick = round(TICK / step)
    made, last_out = 0, 0.0
    while population.inside and made * step - last_out <= GAP:
        events = engine.advance(contact, crowd, made, per_tick, step, False, False)
        made += per_tick
        if events.number:
            population.settle(events)
            last_out = float(np.nanmax(crowd.exit_time))
    return crowd.exit_time


def flow(sets: Sequence[FloatArray], generator: np.random.Generator) -> Flow:
    """Return the flow of one model at one step, from the sorted exit times (runs, people) [s] of each position set.

    The generator draws the resamples of position sets.
    """
    return _flow([(times,) for times in sets], np.array([1.0]), generator)


def change(coarse: Sequence[FloatArray], fine: Sequence[FloatArray], generator: np.random.Generator) -> Flow:
    """Return the change of the flow from one step to another, for the same people; arguments as for `flow`.

    Position sets and runs are those available at both steps, from the first on; a run that was stopped at either step
    is counted separately at both.
    """
    shared = [(a[: len(b)], b[: len(a)]) for a, b in zip(coarse, fine, strict=False)]
    return _flow(shared, np.array([-1.0, 1.0]), generator)


def _flow(sets: Sequence[tuple[FloatArray, ...]], weight: FloatArray, generator: np.random.Generator) -> Flow:
    """Return the sum of the flows of groups of the same runs (runs, people) of each position set, weighted by group."""
    kept = [~np.any([stopped(times) for times in groups], axis=0) for groups in sets]
    whole = [[times[keep] for times in groups] for groups, keep in zip(sets, kept, strict=True)]
    picks = generator.integers(len(sets), size=(RESAMPLES, len(sets)))
    sums = np.array([[_sums(times) for times in groups] for groups in whole])
    # of each group: the sum of the slopes of single runs, and their number
    slopes = np.array(
        [[(sum(_slope(_sums(run[None])) for run in times), len(times)) for times in groups] for groups in whole]
    )

    def estimate(of: Callable[[FloatArray], FloatArray], values: FloatArray) -> FlowEstimate:
        with np.errstate(invalid="ignore", divide="ignore"):
            value, resampled = of(values.sum(axis=0)) @ weight, of(values[picks].sum(axis=1)) @ weight
        tail = 50.0 * (1.0 - CONFIDENCE)
        return FlowEstimate(*(60.0 * float(x) for x in (value, *np.nanpercentile(resampled, [tail, 100.0 - tail]))))

    runs = sum(map(len, kept))
    by_run = estimate(lambda values: values[..., 0] / values[..., 1], slopes)
    return Flow(estimate(_slope, sums), by_run, runs, runs - int(sum(keep.sum() for keep in kept)))


def stopped(times: FloatArray) -> NDArray[np.bool_]:
    """Return for each run (runs, people) whether people stayed inside or two exit times differ by more than `GAP`."""
    gaps = np.diff(times, axis=1, prepend=0.0)
    return np.asarray(np.isnan(times).any(axis=1) | (np.nan_to_num(gaps) > GAP).any(axis=1))


def _sums(times: FloatArray) -> FloatArray:
    """Return the sums (5,) of 1, t, N, t t and t N over all exits of some runs."""
    number = np.broadcast_to(np.arange(1.0, times.shape[1] + 1.0), times.shape)
    return np.array([times.size, times.sum(), number.sum(), (times * times).sum(), (times * number).sum()])


def _slope(sums: FloatArray) -> FloatArray:
    """Return the slopes (...,) of the regression of N on t from sums (..., 5) [people per s]."""
    count, t, n, tt, tn = np.moveaxis(sums, -1, 0)
    slope: FloatArray = (count * tn - t * n) / (count * tt - t * t)
    return slope


@cache
def _room() -> tuple["Case", Simulation, World]:
    case = load_case("square_room")
    simulation = Simulation(case)
    return case, simulation, simulation.scene.world


@cache
def _changed(radius: float) -> "Case":
    return _room()[0].change({"people.people.radius": radius})
