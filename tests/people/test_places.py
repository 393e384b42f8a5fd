"""Assembly areas: who goes there, who counts as there, and events that send people on."""

import pytest
from shapely import box

import evac
from evac.base.errors import ScenarioError
from evac.people.places import routes_to_places
from evac.report.of_run import main_results
from evac.results.verdict import answer_of
from evac.simulation.shared import simulation_of


def case_of(*events, places=("yard",), rooms=(None,), number=8, shown=False, **group):
    """Return a case of a class in a room, with a yard and a corner behind its door, and an exit of the room."""
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 10, 10).union(box(10, 4, 10.2, 5.2)).union(box(10.2, 0, 22, 10)))
    plan.exit("out", "floor", [(0, 4), (0, 6)])
    plan.area("room", "floor", box(1, 1, 9, 9))
    plan.area("yard", "floor", box(15, 2, 21, 8))
    plan.area("corner", "floor", box(11, 0, 13, 2))
    tables = [
        {"name": f"at {area}", "kind": "assembly", "area": area} | ({"capacity": room} if room else {})
        for area, room in zip(places, rooms, strict=True)
    ]
    group = {"name": "class", "area": "room", "number": number, "assembly": [f"at {places[0]}"]} | group
    return evac.load(
        {
            "building": plan,
            "people": [group],
            "place": tables,
            "event": [{"kind": "strategy", "target": "class"} | event for event in events],
            "contact": {"model": "nsm2"},
            "behaviours": {"walking": {}},
            "directions": {"spacing": 0.2},
            "output": dict.fromkeys(("trajectory", "replay", "picture"), shown),
        }
    )


def test_an_event_sends_people_to_exits_or_to_assembly_areas():
    case_of({"time": 1.0, "value": ["at yard"]}, {"time": 2.0, "value": ["out"]})
    with pytest.raises(ScenarioError, match=r"event\.1\.value.*not both"):
        case_of({"time": 1.0, "value": ["out"]}, {"time": 2.0, "value": ["out", "at yard"]})


def test_the_places_of_an_event_are_those_of_its_group_alone():
    table = case_of({"time": 1.0, "value": ["at yard"]}).to_dict()
    case = evac.load(table | {"people": [*table["people"], {"name": "staff", "area": "room", "number": 1}]})
    assert {one.name: [*routes_to_places(case, one)] for one in case.people} == {"class": ["at yard"], "staff": []}


def test_people_go_to_their_assembly_area_and_count_as_there(tmp_path):
    results = evac.run(case_of(), tmp_path / "run")
    assert (results.ended, results.exit_status, results.evacuated) == ("everybody out or at a safe place", 0, 0)
    (place,) = results.places
    assert (place.kind, place.people) == ("assembly", tuple(range(8)))
    assert (results.crowd.position[:, 0] > 15.0).all()
    assert 0.0 < place.last <= results.time
    again = evac.read_results(tmp_path / "run")
    assert again.places == results.places
    assert main_results(again)["At assembly area 'at yard'"] == "8"
    assert answer_of(again).outcome.endswith("0 of 8 people out, 8 at a safe place")


@pytest.mark.parametrize("far", ["at yard", "at corner"])
def test_people_go_to_the_area_with_the_least_time_and_cost(far):
    case = case_of(places=("yard", "corner"), rooms=(None, None), assembly=["at yard", "at corner"])
    places = {place.name: len(place.people) for place in evac.run(case.change({"directions.costs": {far: 60}})).places}
    assert places.pop(far) == 0
    assert [*places.values()] == [8]


def test_costs_of_what_does_not_exist_are_refused():
    with pytest.raises(ScenarioError, match=r"directions\.costs: .*'yrd'.*'at yard'"):
        evac.run(case_of().change({"directions.costs": {"yrd": 60.0}}))


def test_who_has_arrived_waits_for_nothing(tmp_path):
    """The class gathers, stays for a minute and goes on: the queues of the run and people's times of waiting."""
    on = {"when": {"count": 8, "area": "yard", "after": 60.0}, "value": []}
    results = evac.run(case_of(on, shown=True), tmp_path / "run")
    assert results.evacuated == 8
    assert results.time > 80.0
    queues = results.queues
    assert sum(queue.waited for queue in queues) < 8 * 20.0
    assert not any(
        queue.at_once[(results.trajectory.time > 50.0) & (results.trajectory.time < 60.0)].any() for queue in queues
    )


def test_who_finds_no_room_goes_to_another_area_or_leaves():
    case = case_of(places=("yard", "corner"), rooms=(3, 2), assembly=["at yard", "at corner"])
    results = evac.run(case)
    assert [len(place.people) for place in results.places] == [3, 2]
    assert results.evacuated == 3


def test_events_send_people_on_when_they_have_arrived():
    on = {"when": {"count": 8, "area": "yard", "after": 10.0}, "value": ["at corner"]}
    case = case_of(on, {"time": 60.0, "value": []}, places=("yard", "corner"), rooms=(None, None))
    simulation = simulation_of(case)
    where = {}
    while not simulation.ended:
        simulation.advance_tick()
        where[round(simulation.time, 1)] = [len(place.people) for place in simulation.places.people_at()]
    first, last = (change.time for change in simulation.scene.changes)
    assert where[round(first - 0.1, 1)] == [8, 0]
    assert where[last] == [0, 8]
    assert (simulation.ended, simulation.results().evacuated) == ("everybody out", 8)


def test_a_run_ends_when_the_condition_of_an_event_can_not_come_true_any_more():
    results = evac.run(case_of({"when": {"count": 9, "area": "yard"}, "value": []}))
    assert results.ended == "everybody out or at a safe place"
    assert results.time < 60.0


def test_a_change_in_python_sends_a_group_back_to_its_area():
    simulation = simulation_of(case_of({"time": 5.0, "value": []}))
    simulation.scene.apply(evac.Change(6.0, "strategy", "class", {"value": ["at yard"]}))
    results = simulation.run()
    assert len(results.places[0].people) + results.evacuated == 8
    assert results.places[0].people


def test_other_behaviours_do_not_choose_exits_for_people_on_their_way_to_an_area():
    case = case_of().to_dict()
    case["behaviours"] = {"route_choice": {"exits": ["out"], "every": 1.0}}
    results = evac.run(evac.load(case))
    assert len(results.places[0].people) == 8
