"""People on escalators: who stands and walks, on which side, and how many get on."""

import numpy as np
import pytest
from shapely import box

import evac
from evac.simulation.shared import simulation_of

#: Capacity of an escalator with steps of 1 m at 0.5 m/s in EN 115-1 [1/s].
CAPACITY = 6000.0 / 3600.0


def escalator(number, width=1.0, **riding):
    """Return a simulation of people before an escalator of 12 m, which rises 6 m."""
    plan = evac.Plan()
    plan.storey("low", box(-8, 0, 0, 6))
    plan.storey("high", box(10.4, 0, 22, 6), z=6.0)
    plan.stair("escalator", "low", [(0, 3), (0, 3 + width)], "high", [(10.4, 3), (10.4, 3 + width)])
    plan.exit("top", "high", [(22, 0), (22, 6)])
    content = {
        "building": {"plan": plan, "moving": {"escalator": {"speed": 0.5}}},
        "people": [{"name": "people", "level": "low", "number": number}],
        "contact": {"model": "nsm2"},
        "behaviours": {"walking": {}, "riding": riding},
    }
    return simulation_of(evac.load(content))


def offsets(simulation):
    """Return the distances of people on the escalator to the left of its middle, after 4 m, and who walks."""
    (level,) = (one.index for one in simulation.scene.building.levels if one.stair)
    y1, y2 = simulation.scene.building.levels[level].polygon.bounds[1::2]
    crowd, found = simulation.population.crowd, {}
    walks = simulation.state()["deciding.behaviour.riding.walks"]
    while not simulation.ended:
        simulation.advance_tick()
        for row in np.flatnonzero((crowd.level == level) & (crowd.position[:, 0] > 4.0)):
            found.setdefault(int(row), (crowd.position[row, 1] - 0.5 * (y1 + y2), walks[row]))
    return np.array(list(found.values()))


@pytest.mark.parametrize(("side", "sign"), [("right", -1.0), ("left", 1.0)])
def test_people_stand_on_their_side(side, sign):
    aside, walks = offsets(escalator(20, side=side, walking=0.4)).T
    assert 0 < walks.sum() < 20
    stand = sign * aside[walks == 0.0]
    assert (stand > 0.0).mean() >= 0.9
    assert np.median(stand) == pytest.approx(0.25, abs=0.06)
    assert np.median(sign * aside[walks > 0.0]) < 0.0


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_the_share_of_those_who_walk(share):
    _, walks = offsets(escalator(12, walking=share)).T
    assert walks.mean() == share


def test_the_flow_is_less_than_the_published_capacity():
    simulation = escalator(80, walking=0.25)
    assert simulation.run().warnings == ()
    _, link, time = simulation.population.crossings
    last = np.sort(time[link == link.max()])
    flow = 50.0 / (last[65] - last[15])
    assert 0.6 * CAPACITY < flow < CAPACITY
