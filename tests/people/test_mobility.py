"""People who cannot use stairs or narrow doors: their routes and their bodies."""

import numpy as np
import pytest
from shapely import box

import evac
from evac.cli.check import show_building
from evac.contract.registry import Registry
from evac.physics.state import FIRM
from evac.report.of_run import banner, main_results
from evac.simulation.shared import simulation_of
from tests.runs import run_ticks


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
    """Return a case of three people who walk and two in wheelchairs, in the same area."""
    start = {"area": wheelchair.pop("area", "start")}
    people = [
        {"name": "walkers", "preset": "adult", "number": 3, **start},
        {"name": "wheelchairs", "preset": "wheelchair", "number": 2, **start, **wheelchair},
    ]
    content = {"building": plan, "people": people, "contact": {"model": "nsm2"}, "behaviours": {"walking": {}}}
    return evac.load(content | {"output": {"trajectory": False}, "directions": {"spacing": 0.2}})


def test_wheelchairs_take_the_ramp_and_others_the_stair():
    simulation = simulation_of(case_of(two_ways()))
    crowd = simulation.population.crowd
    while not simulation.ended:
        simulation.advance_tick()
    assert simulation.ended == "everybody out"
    rows, links, _ = simulation.population.crossings
    steep = {portal.index for portal in simulation.building.portals if "ramp" in portal.name}
    on_ramp = np.zeros(len(crowd.level), bool)
    on_ramp[rows[np.isin(links, list(steep))]] = True
    assert (on_ramp == (crowd.group == 1)).all()


def test_wheelchairs_that_choose_exits_take_the_ramp():
    case = case_of(two_ways()).to_dict()
    case["behaviours"]["route_choice"] = {"every": 1.0}
    simulation = simulation_of(evac.load(case))
    run_ticks(simulation, 20)
    crowd, routes = simulation.population.crowd, simulation.fields.routes
    assert {routes[k].steepest for k in crowd.route[crowd.group == 1]} == {0.0834}


def test_wheelchairs_keep_their_width():
    crowd = simulation_of(case_of(two_ways())).population.crowd
    assert crowd.contact_radius[crowd.group == 1] == pytest.approx(0.4)
    assert crowd.contact_radius[crowd.group == 0] == pytest.approx(Registry().behaviours["walking"]().chest_depth / 2)


def test_without_limit_wheelchairs_have_the_route_of_all():
    simulation = simulation_of(case_of(two_ways()).change({"people.wheelchairs.steepest": 10.0}))
    one = simulation.fields
    position = simulation.population.crowd.position
    level = simulation.population.crowd.level
    times = [one.travel_time_at(level, position, route, np.full(len(level), 0.14)) for route in range(len(one.routes))]
    np.testing.assert_array_equal(times[0], times[1])


def test_wheelchairs_that_only_stairs_lead_out_are_told_of():
    with pytest.raises(evac.EvacError, match=r"wheelchairs.* cannot reach any exit without slopes above 0\.0834"):
        simulation_of(case_of(two_ways(gradient=1.0 / 8.0)))


def with_refuges(*places, number=4, gradient=1.0 / 8.0):
    """Return a case of people in wheelchairs above a ramp that is too steep, and refuges (name, capacity)."""
    plan = two_ways(gradient)
    plan.area("lobby", "high", box(30, 0, 34, 3))
    plan.area("corner", "high", box(24.5, 4, 26.5, 6))
    case = case_of(plan, number=number)
    tables = [{"name": f"at {area}", "kind": "refuge", "area": area, "capacity": room} for area, room in places]
    return evac.load({**case.to_dict(), "place": tables})


def test_who_cannot_leave_waits_in_a_refuge_and_counts_as_there(tmp_path):
    results = evac.run(with_refuges(("lobby", None)), tmp_path / "run")
    assert (results.ended, results.exit_status, results.stuck) == ("everybody out or at a safe place", 0, ())
    (refuge,) = results.places
    wheelchairs = np.flatnonzero(results.crowd.level >= 0)
    assert refuge.people == tuple(wheelchairs)
    assert (results.evacuated, results.at_places, results.is_complete) == (3, 4, True)
    x, y = results.crowd.position[wheelchairs].T
    assert ((x > 30) & (y < 3)).all()
    again = evac.read_results(tmp_path / "run")
    assert banner(again) == ""
    assert main_results(again)["At refuge 'at lobby'"] == "4"
    assert (again.places, again.exit_status, again.remarks) == (results.places, 0, results.remarks)


def test_a_refuge_takes_no_more_people_than_its_capacity():
    """A way is shorter over a level on which nobody goes that way."""
    results = evac.run(with_refuges(("lobby", 2), ("corner", 2)))
    assert [len(refuge.people) for refuge in results.places] == [2, 2]
    (told,) = results.remarks  # all refuges in one line, so that an answer of few lines loses none of them
    assert all(str(refuge) in told for refuge in results.places)
    full = r"cannot reach any exit without slopes.* place\.at lobby\.capacity or place\.at corner\.capacity"
    with pytest.raises(evac.EvacError, match=full):
        simulation_of(with_refuges(("lobby", 2), ("corner", 1)))


def test_people_on_their_way_to_a_refuge_leave_if_a_way_opens():
    case = with_refuges(("lobby", None), gradient=1.0 / 14.0)
    simulation = simulation_of(case.change({"building.closed": ["ramp"]}))
    crowd, routes = simulation.population.crowd, simulation.fields.routes
    assert {routes[k].area for k in crowd.route[crowd.group == 1]} == {"lobby"}
    simulation.scene.apply(evac.Change(2.0, "open", "ramp"))
    assert simulation.run().ended == "everybody out"


def test_who_does_not_fit_through_the_only_door_goes_to_a_refuge():
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 5, 5).union(box(5, 2.15, 5.2, 2.85)).union(box(5.2, 0, 8, 5)))
    plan.exit("out", "floor", [(8, 1), (8, 4)])
    plan.area("room", "floor", box(0.5, 0.5, 4.5, 4.5))
    plan.area("corner", "floor", box(0, 3, 2, 5))
    case = case_of(plan, area="room")
    refuge = {"name": "refuge", "kind": "refuge", "area": "corner"}
    results = evac.run(evac.load({**case.to_dict(), "place": [refuge]}))
    assert results.ended == "everybody out or at a safe place"
    assert (results.evacuated, results.at_places) == (3, 2)


def test_an_event_changes_the_exits_of_those_only_who_are_not_on_their_way_to_a_refuge():
    case = with_refuges(("lobby", None)).to_dict()
    event = {"time": 1.0, "kind": "strategy", "target": "wheelchairs", "value": "quickest"}
    other = {"time": 1.0, "kind": "strategy", "target": "walkers", "value": "quickest"}
    simulation = simulation_of(evac.load({**case, "event": [event, other]}))
    run_ticks(simulation, 20)
    crowd, routes = simulation.population.crowd, simulation.fields.routes
    assert {routes[k].area for k in crowd.route[crowd.group == 1]} == {"lobby"}
    assert {routes[k].strategy for k in crowd.route[crowd.group == 0]} == {"quickest"}


def test_routes_that_follow_the_crowd_avoid_slopes_too():
    simulation = simulation_of(case_of(two_ways(), strategy="quickest"))
    crowd = simulation.population.crowd
    while not simulation.ended:
        simulation.advance_tick()
        steep = [level.index for level in simulation.building.levels if level.slope > 0.2]
        assert not np.isin(crowd.level[crowd.group == 1], steep).any()
    assert simulation.ended == "everybody out"


@pytest.mark.parametrize(("rise", "ramp", "speed"), [(1.0, 0.125, 1.3), (1.0, 0.0, 0.7), (2.0, 0.125, 0.7)])
def test_ramps_are_walked_at_the_speed_on_the_level_up_to_one_in_eight(rise, ramp, speed, capsys):
    plan = evac.Plan()
    plan.storey("low", [box(0, 0, 6, 3)])
    plan.storey("high", [box(18, 0, 24, 3)], z=rise)
    plan.stair("way", "low", [(6, 0.5), (6, 2.5)], "high", [(18, 0.5), (18, 2.5)])
    plan.exit("out", "low", [(0, 0.5), (0, 2.5)])
    one = {"name": "one", "positions": [[21, 1.5]], "level": "high", "speed": 1.3, "speed_down": 0.7, "tau": 0.2}
    case = evac.load({"building": plan, "contact": {"model": "nsm2"}, "people": [one]}, {"building.ramp": ramp})
    simulation = simulation_of(case)
    on_flight = np.diff(simulation.run().crossings[2])[0]
    assert on_flight == pytest.approx(np.hypot(12.0, rise) / speed, rel=0.02)
    show_building(simulation.building, is_verbose=False)
    assert f"{'ramp' if speed == 1.3 else 'stair'} 1:{12 / rise:g}" in capsys.readouterr().out


def test_who_is_at_a_refuge_stands_firm_until_sent_elsewhere():
    simulation = simulation_of(with_refuges(("lobby", None)))
    while not simulation.ended:
        simulation.advance_tick()
    arrived, firmness = simulation.places.arrived, simulation.population.crowd.firmness
    assert arrived.any()
    assert (firmness[arrived] == FIRM).all()
    assert (firmness[~arrived] == 1.0).all()
    left = np.flatnonzero(arrived)[0]
    simulation.places.release(left)
    with simulation.population.writable():
        simulation.deciding.act(simulation.time)
    assert firmness[left] == 1.0
    assert (firmness[arrived] == FIRM).all()
