"""Table 3 of the paper at h = 0.01 s: the flow through the door of the square room, as docs/evidence/table3 has it."""

import numpy as np
import pytest

from evac.case.loading import load_case
from evac.simulation.simulation import Simulation

SETS, RUNS = 12, 25
#: Runs with a longer gap between two exits are counted apart [s].
BLOCKED = 10.0


def placed(seed):
    """Return start positions that suit everybody: drawn with the greatest radius."""
    changes = {"people.people.radius": 0.25, "simulation.seed": seed}
    return Simulation(load_case("square_room", changes)).population.crowd.position.tolist()


def exits_of(model, positions, seed):
    """Return the exit times [s] of one run, in order."""
    case = load_case("square_room", {"contact.model": model, "simulation.seed": seed, "simulation.duration": 120.0})
    table = case.to_dict()["people"][0] | {"positions": positions, "level": "room"}
    people = {key: value for key, value in table.items() if key not in ("area", "number")}
    crowd = Simulation(case.change({"people": [people]})).run().crowd
    return np.sort(crowd.exit_time[np.isfinite(crowd.exit_time)])


def flow(runs):
    """Return the slope of the regression of the number out on time over all points [1/min]."""
    time = np.concatenate(runs)
    number = np.concatenate([np.arange(1, len(run) + 1) for run in runs])
    return 60.0 * float(np.polyfit(time, number, 1)[0])


@pytest.fixture(scope="module")
def flows():
    """Flows of the position sets (SETS,) for each model."""
    found = {}
    for model in ("dem", "nsm2"):
        pooled = []
        for index in range(SETS):
            positions = placed(1000 + index)
            runs = [exits_of(model, positions, 10000 + RUNS * index + run) for run in range(RUNS)]
            free = [run for run in runs if len(run) == 20 and np.diff(run).max() <= BLOCKED]
            assert len(free) >= 0.8 * RUNS
            pooled.append(flow(free))
        found[model] = np.array(pooled)
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("model", "low", "high"), [("nsm2", 135.0, 180.0), ("dem", 155.0, 210.0)])
def test_flow_is_in_its_band(flows, model, low, high):
    error = flows[model].std(ddof=1) / SETS**0.5
    assert low - 3.0 * error <= flows[model].mean() <= high + 3.0 * error


@pytest.mark.slow
def test_nsm2_lets_fewer_out_than_dem(flows):
    assert flows["nsm2"].mean() < flows["dem"].mean()


@pytest.mark.slow
def test_start_positions_are_the_same_and_the_rest_is_redrawn():
    positions = placed(1000)
    one, other = (exits_of("dem", positions, seed) for seed in (1, 2))
    assert not np.array_equal(one, other)
