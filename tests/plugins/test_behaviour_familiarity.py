"""Familiarity: known exits, signs, exits in sight, others who walk, and resumed runs."""

from shapely import box

import evac
from evac.simulation.shared import simulation_of
from tests.runs import run_ticks

SIGN = {"name": "sign", "kind": "sign", "position": [10.0, 7.9], "z": 0.0, "exit": "back"}


def case_of(*places, own=None, people=(), size=20, **familiarity):
    """Return a case of people in a hall with an exit at each end, of which they are nearer to "east".

    A corridor leads to the exit "back", which is farther.
    """
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 20, 8).union(box(9, 8, 11, 20)))
    plan.exit("main", "floor", [(0, 3), (0, 5)])
    plan.exit("east", "floor", [(20, 5), (20, 3)])
    plan.exit("back", "floor", [(11, 20), (9, 20)])
    plan.area("room", "floor", box(11, 1, 17, 7))
    group = {"name": "people", "area": "room", "number": size, "behaviours": {"familiarity": own or {}}}
    content = {"building": plan, "people": [group, *people], "place": list(places), "contact": {"model": "nsm2"}}
    return evac.load(content | {"behaviours": {"familiarity": familiarity}, "output": {"trajectory": False}})


def goals(simulation):
    """Return the number of people on their way to each exit."""
    exits = [simulation.fields.routes[k].exits for k in simulation.population.crowd.route]
    return {name: exits.count((name,)) for name in ("main", "east", "back")}


def test_everybody_takes_the_main_entrance_without_other_knowledge():
    assert goals(simulation_of(case_of(main=["main"], sees=0.0))) == {"main": 20, "east": 0, "back": 0}


def test_a_share_knows_the_nearer_exit():
    counts = goals(simulation_of(case_of(main=["main"], knows={"east": 0.3}, sees=0.0, preference=1.0, size=100)))
    assert 15 <= counts["east"] <= 45
    assert counts["main"] + counts["east"] == 100
    of_group = simulation_of(
        case_of(main=["main"], knows={"east": 0.3}, own={"knows": {"east": 1.0}}, sees=0.0, preference=1.0)
    )
    assert goals(of_group)["east"] == 20


def test_the_main_entrance_is_preferred():
    """From x = 11 to 17 the ways to "main" are at most 5.7 times as long as those to "east"."""
    knows = {"main": ["main"], "knows": {"east": 1.0}, "sees": 0.0}
    assert goals(simulation_of(case_of(**knows, preference=1.0)))["east"] == 20
    assert goals(simulation_of(case_of(**knows, preference=6.0)))["main"] == 20


def test_people_follow_a_sign_in_sight_and_only_such_a_one():
    knows = {"main": ["main"], "knows": {"back": 0.0}, "sees": 0.0, "notices": 1.0}
    assert goals(simulation_of(case_of(SIGN, **knows)))["back"] == 20
    for change in ({"range": 0.5}, {"position": [10.0, 19.0]}):  # too far; behind a corner
        simulation = simulation_of(case_of(SIGN | change, **knows))
        assert goals(simulation)["main"] > 15
    assert 0 < goals(simulation_of(case_of(SIGN, **knows | {"notices": 0.4}, size=60)))["back"] < 50


def test_people_learn_of_exits_in_sight():
    assert goals(simulation_of(case_of(main=["main"], knows={"east": 0.0}, sees=12.0)))["east"] == 20


def test_people_go_where_others_walk():
    others = {"name": "others", "area": "room", "number": 10, "exits": ["east"]}
    knows = {"main": ["main"], "knows": {"east": 0.0}, "sees": 5.0, "size": 5}
    counts = {}
    for influence in (0.0, 1.0):
        simulation = simulation_of(case_of(**knows, people=[others], influence=influence))
        run_ticks(simulation, 12)
        group = simulation.population.groups[1]
        routes = simulation.population.crowd.route[group.rows]
        counts[influence] = [simulation.fields.routes[k].exits[0] for k in routes].count("east")
    assert counts[0.0] < counts[1.0] == 5


def test_who_knows_only_a_closed_exit_takes_any():
    results = evac.run(case_of(main=["main"], sees=0.0).change({"building.closed": ["main"]}))
    assert results.ended == "everybody out"


def test_exits_of_the_group_limit_the_choice():
    case = case_of(main=["main"], knows={"east": 1.0}, preference=1.0).to_dict()
    case["people"][0]["exits"] = ["main"]
    assert goals(simulation_of(evac.load(case)))["main"] == 20


def test_an_event_changes_the_strategy_of_those_only_for_whom_there_are_directions():
    event = {"when": {"out": 1}, "kind": "strategy", "target": "people", "value": "shortest"}
    case = case_of(main=["main"], knows={"east": 0.5}).to_dict() | {"event": [event]}
    results = evac.run(evac.load(case))
    assert results.ended == "everybody out"
