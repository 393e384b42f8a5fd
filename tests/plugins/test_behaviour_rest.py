"""People who rest: where they stop on a stair with a landing, for how long, and that a resumed run goes on."""

import pytest
from shapely import box

import evac
from evac.simulation.simulation import Simulation

TICK = 0.1


def stair(**settings):
    """Return a case of one person who goes down two flights of 4 m with a landing of 2 m between them."""
    plan = evac.Plan()
    plan.storey("low", box(0, 0, 5, 4))
    plan.storey("high", box(15, 0, 20, 4), z=4.0)
    plan.flight("stair", [(5, 1), (5, 3)], 0.0, [(9, 1), (9, 3)], 2.0)
    plan.landing("stair", box(9, 1, 11, 3), 2.0)
    plan.flight("stair", [(11, 1), (11, 3)], 2.0, [(15, 1), (15, 3)], 4.0)
    plan.exit("out", "low", [(0, 1), (0, 3)])
    person = {"name": "person", "positions": [[17.0, 2.0]], "level": "high", "speed": 1.0, "speed_down": 0.5}
    person["behaviours"] = {"rest": settings} if settings else {}
    content = {"building": plan, "people": [person], "contact": {"model": "nsm2"}, "behaviours": {"rest": {}}}
    return evac.load(content)


def stops(simulation):
    """Return (x, duration) of each time that the person stands."""
    found, crowd = [], simulation.population.crowd
    while not simulation.ended:
        simulation.advance_tick()
        if crowd.speed_factor[0] == 0.0 and crowd.level[0] >= 0:
            if found and abs(found[-1][0] - crowd.position[0, 0]) < 0.5:
                found[-1][1] += TICK
            else:
                found.append([crowd.position[0, 0], TICK])
    return found


@pytest.mark.parametrize(
    ("after", "places"),
    [(3.0, [10.4, 4.4]), (6.0, [4.4]), (20.0, [])],
)
def test_people_rest_on_the_next_landing_or_floor(after, places):
    found = stops(Simulation(stair(after=after, pause=5.0)))
    assert [x for x, _ in found] == pytest.approx(places, abs=0.35)
    assert [seconds for _, seconds in found] == pytest.approx([5.0] * len(places), abs=0.15)


def test_without_the_key_nobody_rests():
    simulation = Simulation(stair())
    assert "rest" not in {behaviour.name for behaviour, _ in simulation.behaviours}
