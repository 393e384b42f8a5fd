"""Families and classes: how far apart they are, that they gather and are counted first, and resumed runs."""

import numpy as np
import pytest
from shapely import box

import evac
from evac.report.of_run import main_results
from evac.simulation.shared import simulation_of
from tests.people.test_mobility import two_ways
from tests.runs import run_ticks

#: Speeds of the four people of each family [m/s].
SPEEDS = [0.6, 1.0, 1.4, 1.6]


def corridor(*groups, **parameters):
    """Return the simulation of groups (name, number, settings, speeds) in a corridor, who pass a hall at 20 to 24 m."""
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 60, 4))
    plan.exit("out", "floor", [(60, 0), (60, 4)])
    plan.area("home", "floor", box(0.5, 0.5, 8, 3.5))
    plan.area("hall", "floor", box(20, 0.5, 24, 3.5))
    people = [
        {
            "name": name,
            "number": number,
            "area": "home",
            "speed": {"list": speeds},
            "behaviours": {"together": settings},
        }
        for name, number, settings, speeds in groups
    ]
    content = {"building": plan, "people": people, "behaviours": {"walking": {}, "together": parameters}}
    return simulation_of(evac.load(content | {"contact": {"model": "nsm2"}, "directions": {"spacing": 0.2}}))


def families(settings, **parameters):
    return corridor(("families", 12, settings, SPEEDS * 3), **parameters)


def test_families_wait_for_their_slowest_and_not_for_others():
    """Alone, the fastest of a family are 25.8 m ahead of the slowest in the middle of the run, and out 55 s before."""
    simulation = families({"size": 4})
    crowd, spreads = simulation.population.crowd, []
    while not simulation.ended:
        simulation.advance_tick()
        if simulation.time > 15.0 and (crowd.level >= 0).all():
            spreads += list(np.ptp(crowd.position[:, 0].reshape(3, 4), axis=1))
    assert simulation.ended == "everybody out"
    assert max(spreads) < 4.0
    out = crowd.exit_time.reshape(3, 4)
    assert np.ptp(out, axis=1).max() < 8.0


def test_who_gathers_is_in_no_queue_and_resumed_runs_know_it(tmp_path):
    case = corridor(("class", 12, {"gather": "hall"}, SPEEDS * 3), places=["hall"], count=30.0).case
    results = evac.run(case, tmp_path / "whole")
    waited = [queue.waited for queue in results.queues]
    assert results.last_out > 90.0
    assert sum(waited) < 12 * 3.0
    first, second = simulation_of(case), simulation_of(case)
    run_ticks(first, 450)
    assert first.standing.sum() == 12
    second.restore(first.state())
    assert second.standing.tolist() == first.standing.tolist()


def class_of(speeds, *events, **parameters):
    """Return the simulation of a teacher and a class that follows it, who are counted in the hall."""
    keys = {"unit": "3b", "gather": "hall"}
    teacher, pupils = ("teacher", 1, keys, [1.0]), ("pupils", len(speeds), keys, speeds)
    case = corridor(teacher, pupils, places=["hall"], **parameters).case.to_dict()
    case["behaviours"]["teacher_following"] = {}
    next(group for group in case["people"] if group["name"] == "pupils")["behaviours"]["teacher_following"] = {
        "teacher": "teacher"
    }
    return simulation_of(evac.load(case | {"event": list(events)}))


def test_a_class_gathers_behind_its_teacher_is_counted_and_leaves_behind_it():
    simulation = class_of([0.8, 1.2, 1.4, 1.6] * 3, count=5.0)
    crowd, teacher = simulation.population.crowd, simulation.population.groups[1].rows[0]
    pupils = np.delete(np.arange(13), teacher)
    leads, arrived, left = [], None, None
    while not simulation.ended:
        simulation.advance_tick()
        inside = pupils[crowd.level[pupils] >= 0]
        if crowd.level[teacher] >= 0 and len(inside):
            x = crowd.position[:, 0]
            # On the way to the hall, and when all have left it, up to where those ahead give way to the teacher.
            if 12.0 < x[teacher] < 19.5 or 28.0 < x[teacher] < 57.0:
                leads.append(x[inside].max() - x[teacher])
            if arrived is None and ((x > 20.0) & (x < 24.0)).all():
                arrived = simulation.time if np.hypot(*simulation.displacement_velocity.T).max() < 0.1 else None
            if left is None and (x > 24.0).any():
                left = simulation.time
    assert simulation.ended == "everybody out"
    assert left - arrived > 5.0
    assert max(leads) < 1.0
    assert simulation.results().notes == ()


def test_who_was_missing_when_a_class_was_counted_is_told_and_the_others_leave(tmp_path):
    simulation = class_of([1.2, 0.0, 1.4], count=5.0, patience=10.0)
    run_ticks(simulation, 650)
    missing = next(group.rows for group in simulation.population.groups if group.name == "pupils")[1]
    assert (np.delete(simulation.population.crowd.position[:, 0], missing) > 24.0).all()
    (note,) = simulation.results().notes
    assert note.startswith("together: '3b' counted 3 of 4 at 'hall' at ")
    assert note.endswith(f"; 1 person missing: {missing}")
    simulation.results().write(tmp_path / "run")
    again = evac.read_results(tmp_path / "run")
    assert again.notes == (note,)
    assert note in again.remarks
    assert main_results(again)["Note 1"] == note


def test_a_class_that_has_not_gathered_was_not_counted():
    simulation = class_of([1.2, 1.4])
    run_ticks(simulation, 20)
    assert simulation.results().notes == ("together: '3b' was not counted; 0 of 3 were there",)


def test_a_class_leaves_by_the_exits_that_an_event_has_given_it_while_it_gathered():
    events = [{"time": 2.0, "kind": "strategy", "target": name, "value": "shortest"} for name in ("teacher", "pupils")]
    simulation = class_of([1.2, 1.4], *events, count=1.0)
    routes = simulation.fields.routes
    run_ticks(simulation, 30)
    assert {routes[k].area for k in simulation.population.crowd.route} == {"hall"}
    run_ticks(simulation, 270)
    assert {routes[k].strategy for k in simulation.population.crowd.route} == {"shortest"}


def test_a_unit_that_has_gathered_goes_to_its_assembly_area():
    case = class_of([1.2, 1.4], count=1.0).case.to_dict()
    case["building"]["plan"]["areas"].append(
        {"name": "yard", "storey": "floor", "polygon": [[40, 0.5], [46, 0.5], [46, 3.5], [40, 3.5]]}
    )
    case["place"] = [{"name": "yard", "kind": "assembly", "area": "yard"}]
    for group in case["people"]:
        group["assembly"] = ["yard"]
    case["event"] = [{"time": 5.0, "kind": "slow", "target": "home", "value": 0.5}]  # while they gather
    simulation = simulation_of(evac.load(case))
    halls = []
    while not simulation.ended:
        simulation.advance_tick()
        x = simulation.population.crowd.position[:, 0]
        halls.append(((x > 20.0) & (x < 24.0)).all())
    assert any(halls)
    assert [len(place.people) for place in simulation.results().places] == [3]


def test_wheelchairs_gather_without_stairs():
    plan = two_ways()
    plan.area("hall", "low", box(2, 6, 8, 9))
    unit = {"unit": "ward", "gather": "hall"}
    people = [
        {"name": name, "preset": preset, "area": "start", "number": 2, "behaviours": {"together": unit}}
        for name, preset in (("walkers", "adult"), ("wheelchairs", "wheelchair"))
    ]
    behaviours = {"walking": {}, "together": {"places": ["hall"], "count": 0.0}}
    case = {"building": plan, "people": people, "contact": {"model": "nsm2"}, "behaviours": behaviours}
    simulation = simulation_of(evac.load(case))
    crowd, stair = simulation.population.crowd, simulation.building.stairs["stairs"]
    on_stair = np.zeros(4, bool)
    while not simulation.ended:
        simulation.advance_tick()
        on_stair |= np.isin(crowd.level, stair)
    assert simulation.ended == "everybody out"
    assert not on_stair[crowd.group == 1].any()
    assert on_stair[crowd.group == 0].any()


@pytest.mark.parametrize("together", [False, True])
def test_nobody_waits_for_a_family_that_is_waiting(together):
    """In a corridor in which nobody passes, the slow one is the last of four, and three others are between."""
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 40, 0.9))
    plan.exit("out", "floor", [(40, 0), (40, 0.9)])
    positions = {"first": [[10, 0.45]], "others": [[8.5, 0.45], [7.5, 0.45], [6.5, 0.45]], "last": [[1, 0.45]]}
    people = [
        {"name": name, "positions": places, "level": "floor", "speed": 0.4 if name == "last" else 1.2}
        for name, places in positions.items()
    ]
    for group in people[::2] if together else []:
        group["behaviours"] = {"together": {"unit": "family"}}
    behaviours = {"walking": {}} | ({"together": {}} if together else {})
    results = evac.run({"building": plan, "people": people, "behaviours": behaviours, "contact": {"model": "nsm2"}})
    assert results.ended == "everybody out"
    times = results.people.groupby("group")["exit_time"].max()
    assert times["others"] < 50.0 < times["last"]
