"""People who cannot use stairs or narrow doors: their routes and their bodies."""

import numpy as np
import pytest
from shapely import box

import evac
from evac.simulation.simulation import Simulation


def two_ways(gradient=1.0 / 14.0):
    """Return a plan of two storeys, 1 m apart, which a stair joins, and a longer way over a ramp."""
    plan = evac.Plan()
    plan.storey("low", box(0, 0, 10, 10))
    plan.storey("high", box(24, 0, 34, 10), z=1.0)
    plan.flight("stairs", [(12, 7), (12, 9)], 0.0, [(14, 7), (14, 9)], 1.0)
    plan.landing("stairs", box(10, 7, 12, 9), 0.0)
    plan.landing("stairs", box(14, 7, 24, 9), 1.0)
    length = 1.0 / gradient
    plan.flight("ramp", [(24 - length, 1), (24 - length, 3)], 0.0, [(24, 1), (24, 3)], 1.0)
    if length < 14.0:
        plan.landing("ramp", box(10, 1, 24 - length, 3), 0.0)
    plan.exit("out", "low", [(0, 4), (0, 6)])
    plan.area("start", "high", box(27, 6, 33, 9.5))
    return plan


def case_of(plan, **wheelchair):
    people = [
        {"name": "walkers", "preset": "adult", "number": 3, "area": "start"},
        {"name": "wheelchairs", "preset": "wheelchair", "number": 2, "area": "start", **wheelchair},
    ]
    content = {"building": plan, "people": people, "contact": {"model": "nsm2"}, "behaviours": {"walking": {}}}
    return evac.load(content | {"output": {"trajectory": False}})


def test_wheelchairs_take_the_ramp_and_others_the_stair():
    simulation = Simulation(case_of(two_ways()))
    crowd = simulation.population.crowd
    while not simulation.ended:
        simulation.advance_tick()
    assert simulation.ended == "everybody out"
    rows, links, _ = simulation.population.crossings
    steep = {portal.index for portal in simulation.building.portals if "ramp" in portal.name}
    on_ramp = np.zeros(len(crowd.level), bool)
    on_ramp[rows[np.isin(links, list(steep))]] = True
    assert (on_ramp == (crowd.group == 1)).all()


def test_wheelchairs_keep_their_width():
    crowd = Simulation(case_of(two_ways())).population.crowd
    assert crowd.contact_radius[crowd.group == 1] == pytest.approx(0.4)
    assert crowd.contact_radius[crowd.group == 0] == pytest.approx(0.14)


def test_without_limit_wheelchairs_have_the_route_of_all():
    simulation = Simulation(case_of(two_ways()).change({"people.wheelchairs.steepest": 10.0}))
    one = simulation.fields
    position = simulation.population.crowd.position
    level = simulation.population.crowd.level
    times = [one.travel_time_at(level, position, route, np.full(len(level), 0.14)) for route in range(len(one.routes))]
    np.testing.assert_array_equal(times[0], times[1])


def test_wheelchairs_that_only_stairs_lead_out_are_told_of():
    with pytest.raises(evac.EvacError, match=r"wheelchairs.* cannot reach any exit without slopes above 0\.0834"):
        Simulation(case_of(two_ways(gradient=1.0 / 8.0)))
