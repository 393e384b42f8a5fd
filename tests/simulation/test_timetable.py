"""Events of a case: at a time or when something happens; what they do, and that a resumed run has the same."""

import json

import numpy as np
import pytest
from shapely import box

import evac
from evac.base.errors import ScenarioError
from evac.simulation.shared import simulation_of
from tests.runs import run_ticks

FLOOR = [[0, 0], [20, 0], [20, 8], [0, 8]]


def house(*events, **changes):
    """Return a case of two storeys with the stairs a, near the people, and b; the only exit is on the ground."""
    stair = {"lower": "ground", "upper": "first", "length": 4.0}
    plan = {
        "storeys": [{"name": "ground", "polygons": [FLOOR]}, {"name": "first", "z": 2.0, "polygons": [FLOOR]}],
        "stairs": [
            stair | {"name": "a", "lower_edge": [[2, 0.8], [2, 2]], "direction": [1, 0]},
            stair | {"name": "b", "lower_edge": [[18, 7.2], [18, 6]], "direction": [-1, 0]},
        ],
        "exits": [
            {"name": "main", "storey": "ground", "segment": [[0, 3], [0, 4.2]]},
            {"name": "back", "storey": "ground", "segment": [[20, 1], [20, 2.2]]},
        ],
        "areas": [{"name": "hall", "storey": "ground", "polygon": [[6, 2.5], [12, 2.5], [12, 8], [6, 8]]}],
    }
    table = {
        "building": {"plan": plan},
        "contact": {"model": "nsm1"},
        "directions": {"spacing": 0.2},
        "simulation": {"duration": 90.0, "no_progress": 10.0},
        "people": [
            {"name": "above", "number": 20, "level": "first", "exits": ["main"]},
            {"name": "below", "number": 10, "level": "ground"},
        ],
        "event": list(events),
    }
    return evac.load(table, changes)


def event(kind, target, time=None, **keys):
    return {"kind": kind, "target": target} | ({} if time is None else {"time": time}) | keys


def crossed(results, name, after):
    """Return how often each portal of a stair was crossed after a time."""
    _, portal, time = results.crossings
    own = [one.index for one in results.building.portals if name in one.name.split(" - ")]
    return [int(((portal == index) & (time > after)).sum()) for index in own]


def test_people_turn_round_where_a_stair_gets_the_other_direction_and_nobody_passes_it_against():
    results = simulation_of(house(event("one_way", "a", 4.0, value="up"))).run()
    assert results.ended == "everybody out"
    flight = next(level for level in results.building.levels if level.stair == "a")
    low, high = (portal for portal in results.building.portals if flight.index in portal.levels)
    person, portal, time = results.crossings
    assert not ((portal == low.index) & (time > 4.0)).any(), "its foot leads upwards"
    last = {int(one): int(link) for one, link in zip(person, portal, strict=True)}
    assert high.index not in last.values(), "who was on it has gone up again"
    assert sum(crossed(results, "b", 4.0)) >= 40


def test_a_stair_of_the_direction_in_which_people_go_changes_nothing_for_them():
    one = simulation_of(house()).run()
    other = simulation_of(
        house(event("one_way", "a", 0.0, value="down"), event("one_way", "a", 5.0, value=False))
    ).run()
    assert other.ended == "everybody out"
    assert crossed(other, "a", 0.0) == crossed(one, "a", 0.0)
    assert other.last_out == pytest.approx(one.last_out, rel=0.1)


def test_people_who_cannot_reach_any_exit_any_more_are_told_of_by_group():
    events = [event("close", "a", 4.0), event("close", "b", 4.0)]
    results = simulation_of(house(*events, **{"people.below.exits": ["main"]})).run()
    assert results.ended == "no progress"
    left = np.bincount(results.crowd.level[results.crowd.level >= 0], minlength=len(results.levels))
    (line,) = [line for line in results.notes if "cannot reach" in line]
    assert line.startswith(f"people.above: {left.sum()} people on ")
    assert "'first'" in line
    assert "any exit" in line


def test_people_whose_exits_cannot_be_reached_any_more_take_any_other_until_they_can():
    side = {"name": "side", "segment": [[20, 3], [20, 4.2]], "z": 2.0}
    changes = {"building.exits": [side], "people.above.strategy": "quickest", "people.above.number": 10}
    closing = [event("close", "a", 0.0), event("close", "b", 0.0)]
    used, rows = {}, np.arange(10)
    for name, events in (("open", []), ("closed", closing), ("again", [*closing, event("open", "a", 0.5)])):
        results = simulation_of(house(*events, **changes)).run()
        assert results.ended == "everybody out"
        exits = np.array(list(results.exits))[results.crowd.exit_used[rows]]
        used[name] = dict(zip(*np.unique(exits, return_counts=True), strict=True))
    assert used == {"open": {"main": 10}, "closed": {"side": 10}, "again": {"main": 10}}


@pytest.mark.parametrize("strategy", ["fastest", "quickest"])
def test_directions_do_not_lead_through_a_portal_against_its_direction(strategy):
    ways = []
    for value in ("down", "up"):
        simulation = simulation_of(
            house(event("one_way", "a", 0.0, value=value), **{"people.above.strategy": strategy})
        )
        run_ticks(simulation, 1)
        first = simulation.building.level_named("first").index
        route = int(simulation.population.crowd.route[0])
        ways.append(simulation.fields.travel_time_at(first, np.array([[6.5, 1.4]]), route)[0])
    assert ways[1] > ways[0] + 10.0


def hall(*events):
    """Return the way of one person through the hall, who walks at 1 m/s from its east to the main exit."""
    case = house(*events).change({"people": [WALKER]})
    simulation = simulation_of(case)
    places = []
    while not simulation.ended:
        simulation.advance_tick()
        places.append(simulation.population.crowd.position[0].copy())
    return np.array(places), simulation.population.crowd.exit_time[0]


WALKER = {
    "name": "walker",
    "level": "ground",
    "positions": [[15.0, 4.0]],
    "speed": 1.0,
    "speed_up": 0.5,
    "speed_down": 0.5,
    "exits": ["main"],
}


def inside(places):
    return (places[:, 0] > 6.1) & (places[:, 0] < 11.9) & (places[:, 1] > 2.6)


def test_people_are_slow_in_a_slow_area_and_go_round_a_barred_one():
    changes = (), [event("slow", "ground", 0.0, value=0.8)], [event("bar", "hall", 0.0)]
    (plain, free), (_, late), (barred, _) = (hall(*events) for events in changes)
    assert inside(plain).any()
    assert late == pytest.approx(free / 0.8, abs=0.2)
    assert not inside(barred).any()
    (slow, _), (slower, _) = (hall(event("slow", "hall", 0.0, value=value)) for value in (0.95, 0.3))
    assert inside(slow).any()
    assert not inside(slower).any(), "the way round is shorter in time"


@pytest.mark.parametrize("strategy", ["fastest", "quickest"])
def test_nobody_enters_a_barred_area_if_there_is_any_other_way(strategy):
    sides = (0, 0, 60, 2), (58, 0, 60, 12), (0, 10, 60, 12), (0, 0, 2, 12)
    plan = {
        "storeys": [{"name": "f", "polygons": [[[w, s], [e, s], [e, n], [w, n]] for w, s, e, n in sides]}],
        "exits": [{"name": "out", "storey": "f", "segment": [[0, 0.4], [0, 1.6]]}],
        "areas": [{"name": "wet", "storey": "f", "polygon": [[4, 0], [4.4, 0], [4.4, 2], [4, 2]]}],
    }
    table = {
        "building": {"plan": plan},
        "contact": {"model": "nsm1"},
        "people": [{"name": "p", "positions": [[6, 1]], "level": "f", "speed": 5.0, "strategy": strategy}],
        "directions": {"spacing": 0.2},
        "simulation": {"duration": 5.0},
    }
    x = {}
    for name, changes in (("free", []), ("barred", [event("bar", "wet", 0.0)])):
        simulation = simulation_of(evac.load(table, {"event": changes}))
        run_ticks(simulation, 20)
        x[name] = simulation.population.crowd.position[0, 0]
    assert x["free"] < 4.0
    assert x["barred"] > 8.0


@pytest.mark.parametrize("strategy", ["fastest", "quickest"])
def test_people_who_must_pass_a_barred_area_behind_a_stair_leave_it_in_its_whole_width(strategy):
    """They would otherwise walk along the end of the stair to the corner that is nearest to the exit."""
    changes = {"people.above.strategy": strategy}
    simulation = simulation_of(house(event("bar", "ground", 0.0), event("close", "b", 0.0), **changes))
    run_ticks(simulation, 30)  # by which directions that follow the crowd are solved again
    building, routes = simulation.building, [str(route) for route in simulation.fields.routes]
    (foot,) = (one for one in building.portals if one.name == "ground - a")
    flight = foot.other(building.level_named("ground").index)
    places = np.column_stack([np.full(6, 2.15), np.linspace(1.1, 1.7, 6)])
    route = next(k for k, name in enumerate(routes) if "main" in name)
    assert (simulation.fields.directions_at(flight, places, route)[:, 0] < -0.7).all()


def test_a_barred_storey_does_not_change_the_way_from_another_one_to_its_exit():
    free, barred = (simulation_of(house(*events)) for events in ([], [event("bar", "first", 0.0)]))
    places = np.column_stack([np.tile([0.2, 0.5, 1.0], 14), np.repeat(np.linspace(2.5, 4.7, 14), 3)])
    ways = [one.fields.directions_at(0, places, 0) for one in (free, barred)]
    assert ways[1] == pytest.approx(ways[0], abs=1e-9)


def test_who_enters_a_barred_area_is_named():
    simulation = run_ticks(simulation_of(house(event("bar", "ground", 3.0), event("bar", "first", 4.0))), 30)
    above = set(np.flatnonzero(simulation.population.crowd.level != 0).tolist())
    found = run_ticks(simulation, 200).results().summary()["entered_barred"]
    assert set(found) == {"ground"}
    assert 5 < len(found["ground"]) <= len(above)
    assert set(found["ground"]) <= above


@pytest.mark.parametrize("kind", ["close", "one_way", "slow", "bar", "strategy", "alarm"])
def test_an_event_at_the_start_happens_before_the_first_tick(kind):
    target = {"slow": "hall", "bar": "hall", "strategy": "above", "alarm": ""}.get(kind, "a")
    values = {"one_way": {"value": "down"}, "slow": {"value": 0.5}, "strategy": {"value": "shortest"}}
    behaviours = {"behaviours.walking": {}, "behaviours.response_time": {}}
    case = house(event(kind, target, 0.0, **values.get(kind, {})), **behaviours)
    (change,) = run_ticks(simulation_of(case), 2).scene.changes
    assert (change.kind, change.time) == (kind, 0.0)


@pytest.mark.parametrize("what", [{"kind": "bar"}, {"kind": "slow", "value": 0.05}])
def test_nobody_is_stuck_at_a_post_beside_a_barred_or_slow_doorway(what):
    """The area leaves 10 cm of the only door, which no body fits through."""
    plan = evac.Plan()
    plan.storey("f", box(0, 0, 10, 6).union(box(10, 2.5, 10.2, 3.5)).union(box(10.2, 0, 14, 6)))
    plan.exit("out", "f", [(14, 2), (14, 4)])
    plan.area("doorway", "f", box(10, 2.5, 10.2, 3.4))
    group = {"name": "people", "preset": "wheelchair", "positions": [[8.0, 2.0], [8.0, 4.5]], "level": "f"}
    table = {"building": plan, "people": [group], "event": [{"time": 0.5, "target": "doorway"} | what]}
    table["contact"], table["behaviours"] = {"model": "nsm2"}, {"walking": {}}
    assert evac.run(evac.load(table, {"simulation.duration": 60.0}), progress=False).ended == "everybody out"


def test_a_group_gets_other_exits_and_other_strategies():
    results = simulation_of(house(event("strategy", "below", 0.5, value=["back"]))).run()
    rows = next(group.rows for group in results.groups if group.name == "below")
    late = rows[results.crowd.exit_time[rows] > 0.5]
    names = list(results.exits)
    assert len(late) > 5
    assert {names[used] for used in results.crowd.exit_used[late]} == {"back"}
    routes = simulation_of(house(event("strategy", "below", 5.0, value="shortest")), will_run=False).fields.routes
    assert [route.strategy for route in routes if not route.exits] == ["fastest", "shortest"]


def test_an_alarm_shortens_the_response_times_of_those_in_its_place():
    times = {"behaviours.response_time.time": 50.0}
    results = simulation_of(house(event("alarm", "hall", 5.0, value=0.1), **times)).run()
    simulation = simulation_of(house(**times))
    hears = simulation.population.rows_in(simulation.building, "hall")
    expected = np.full(30, 50.0)
    expected[hears] = 10.0
    assert 0 < len(hears) < 10
    assert results.crowd.start_time.tolist() == pytest.approx(expected.tolist())


def test_phases_start_by_their_alarms_and_tell_when_their_floors_were_clear():
    phases = [{"name": "second", "of": ["below"], "cue": "first", "delay": 6.0}, {"name": "first", "of": ["first"]}]
    times = {"behaviours.response_time.time": {"uniform": [1.0, 3.0]}}
    case = house(phase=phases, **times)
    simulation = simulation_of(case)
    results = simulation.run()
    assert [(change.time, change.what) for change in results.changes] == [(0.0, "first"), (6.0, "below")]
    assert [phase["name"] for phase in results.phase] == ["second", "first"]
    on = {"second": ("below", 0), "first": ("above", simulation.building.level_named("first").index)}
    for phase, alarm in zip(results.phase, (6.0, 0.0), strict=True):
        group, level = on[phase["name"]]
        rows = next(one.rows for one in results.groups if one.name == group)
        starts, out = results.crowd.start_time[rows], results.crowd.exit_time[rows]
        assert ((starts >= alarm + 1.0) & (starts <= alarm + 3.0 + 1e-9)).all()
        assert (phase["people"], phase["alarm"]) == (len(rows), alarm)
        assert [phase[key] for key in ("first_start", "last_start", "last_out")] == [
            starts.min(),
            starts.max(),
            out.max(),
        ]
        left = [time for source, time in zip(results.moves.source, results.moves.time, strict=True) if source == level]
        (cleared,) = (row for row in results.tables["cleared"] if row[0] == phase["name"])
        assert [*phase["clear"].items()] == [cleared[1:]]
        assert cleared[2] == max(left)


@pytest.mark.parametrize(
    ("phases", "words"),
    [
        ([{"name": "a", "of": ["first"], "cue": "b"}], r"phase\.a\.cue.*'b'"),
        ([{"name": "a", "of": ["first"]}] * 2, r"phase\.1\.name.*two phases"),
    ],
)
def test_phases_without_a_beginning_are_refused(phases, words):
    with pytest.raises(ScenarioError, match=words):
        house(phase=phases, **{"behaviours.response_time.time": 1.0})
    with pytest.raises(ScenarioError, match=r"phase\.a\.name.*acts on an alarm"):
        house(phase=[{"name": "a", "of": ["first"]}])


@pytest.mark.parametrize(
    ("when", "is_true"),
    [
        ({"out": 4}, lambda s: np.isfinite(s.population.crowd.exit_time).sum() >= 4),
        ({"area": "hall", "at_most": 1}, lambda s: len(s.population.rows_in(s.building, "hall")) <= 1),
        ({"area": "hall", "count": 3}, lambda s: len(s.population.rows_in(s.building, "hall")) >= 3),
        ({"area": "first", "density": 0.05}, lambda s: len(s.population.rows_in(s.building, "first")) >= 8),
    ],
)
def test_an_event_happens_at_the_tick_at_which_its_condition_is_true(when, is_true):
    simulation = simulation_of(house(event("close", "back", when=when)))
    while not simulation.scene.changes:
        expected = is_true(simulation)
        time = simulation.time
        simulation.advance_tick()
        assert bool(simulation.scene.changes) == expected
    assert simulation.scene.changes[0].time == time


def test_an_event_follows_another():
    first = event("close", "back", when={"out": 4}, name="closing")
    case = house(first, event("open", "back", when={"event": "closing", "after": 2.0}))
    results = simulation_of(case).run()
    closing, opening = results.changes
    assert (closing.kind, opening.kind) == ("close", "open")
    assert opening.time == pytest.approx(closing.time + 2.0)
    assert results.building.closed == frozenset()


def long_hall():
    """Return a case of 60 people who start at 56 s, near an exit that closes at 60 s and far from another."""
    exits = [
        {"name": "near", "storey": "f", "segment": [[0, 4], [0, 5.2]]},
        {"name": "far", "storey": "f", "segment": [[60, 4], [60, 5.2]]},
    ]
    start = {"name": "start", "storey": "f", "polygon": [[0.5, 0.5], [12, 0.5], [12, 8.5], [0.5, 8.5]]}
    storey = {"name": "f", "polygons": [[[0, 0], [60, 0], [60, 9], [0, 9]]]}
    table = {
        "building": {"plan": {"storeys": [storey], "exits": exits, "areas": [start]}},
        "contact": {"model": "nsm2"},
        "directions": {"spacing": 0.2},
        "simulation": {"duration": 200.0, "seed": 1},
        "behaviours": {"walking": {}, "response_time": {"time": 56.0}},
        "output": {"picture": False},
        "people": [{"name": "people", "number": 60, "area": "start", "strategy": "shortest"}],
        "event": [event("close", "near", 60.0)],
    }
    return evac.load(table)


def test_nobody_passes_a_door_that_closed_at_60_s_but_those_named_whose_bodies_were_on_its_line(tmp_path):
    simulation = simulation_of(long_hall())
    near, far = (next(way for way in simulation.building.exits if way.name == name) for name in ("near", "far"))
    run_ticks(simulation, 600)
    crowd = simulation.population.crowd
    off_end = np.maximum(np.abs(crowd.position[:, 1] - 4.6) - 0.6, 0.0)
    is_touching = np.hypot(crowd.position[:, 0], off_end) < crowd.contact_radius
    on_line = np.flatnonzero((crowd.level >= 0) & is_touching)
    run_ticks(simulation, 1)
    assert simulation.time == pytest.approx(60.1)

    inside = np.flatnonzero((crowd.level >= 0) & (crowd.passing < 0))
    assert len(inside) > 40
    position, route = crowd.position[inside], crowd.route[inside]
    length = simulation.fields.travel_time_at(0, position, route, crowd.contact_radius[inside])
    to_far = np.hypot(60.0 - position[:, 0], np.maximum(np.abs(position[:, 1] - 4.6) - 0.6, 0.0))
    assert length == pytest.approx(to_far, rel=0.01), "in a convex hall, the shortest way is straight"
    towards = simulation.fields.directions_at(0, position, route, crowd.contact_radius[inside])
    away_from_walls = (position[:, 1] > 1.0) & (position[:, 1] < 8.0) & (position[:, 0] > 1.0)
    assert (towards[away_from_walls, 0] > 0.9).all()

    results = evac.run(long_hall(), tmp_path / "r", progress=False)
    late = (results.crowd.exit_used == near.index) & (results.crowd.exit_time > 60.0)
    assert np.flatnonzero(late).tolist() == on_line.tolist()
    assert (results.crowd.exit_time[late] < 62.0).all(), "they go on, and do not wait"
    assert results.ended == "everybody out"
    assert (results.crowd.exit_used == far.index).sum() > 40
    (change,) = json.loads((tmp_path / "r" / "summary.json").read_text())["changes"]
    values = {"let_through": on_line.tolist()} if on_line.size else {}
    assert (change["time"], change["kind"], change["what"], change["values"]) == (60.0, "close", "near", values)
    closed = [results.trajectory.building_at(time).closed for time in (59.9, 60.0, 60.1)]
    assert closed == [frozenset(), {near.index}, {near.index}]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (event("close", "main"), r"event\.0\.time"),
        (event("close", "main", 5.0, when={"out": 3}), r"event\.0\.time"),
        (event("close", "", 5.0), r"event\.0\.target"),
        (event("close", "main", 5.0, value=1.0), r"event\.0\.value"),
        (event("slow", "hall", 5.0, value=1.5), r"event\.0\.value.*from 0.01 to 1"),
        (event("strategy", "belw", 5.0, value="shortest"), r"event\.0\.target.*'below'"),
        (event("strategy", "below", 5.0, value="shortst"), r"event\.0\.value.*'shortest'"),
        (event("alarm", "hall", 5.0), r"event\.0\.kind.*behaviour"),
        (event("close", "main", when={"out": 3, "count": 3, "area": "hall"}), r"event\.0\.when\.event"),
        (event("close", "main", when={"count": 3}), r"event\.0\.when\.area"),
        (event("close", "main", when={"out": 3, "area": "hall"}), r"event\.0\.when\.area"),
        (event("close", "main", when={"event": "fire"}), r"event\.0\.when\.event.*'fire'"),
        (event("close", "ma\nin", 5.0), r"event\.0\.target.*one line"),
        (event("one_way", "a", 5.0, value="u\np"), r"event\.0\.value.*direction"),
        (event("strategy", "below", 5.0, value=["ma\nin"]), r"event\.0\.value.*exits"),
        (event("strategy", "below", 5.0, value=[1]), r"event\.0\.value: is \[1\].*exits"),
        (event("slow", "hall", 5.0, value=float("nan")), r"event\.0\.value: is nan.*from 0.01 to 1"),
        (event("open", "main", 5.0, value={}), r"event\.0\.value: is {}.*no value"),
    ],
)
def test_events_that_say_nothing_possible_are_refused_with_their_key(wrong, words):
    with pytest.raises(ScenarioError, match=words) as caught:
        house(wrong)
    assert "\n" not in str(caught.value)


def test_all_events_of_what_the_building_has_not_are_refused_at_once_with_their_keys():
    events = event("close", "mian", 5.0), event("close", "main", 5.0), event("one_way", "a", 5.0, value="west")
    phase = {"name": "p", "of": ["first", "frist"]}
    case = house(*events, phase=[phase], **{"behaviours.response_time.time": 1.0})
    with pytest.raises(ScenarioError) as caught:
        simulation_of(case)
    lines = [line.removeprefix(f"{case.source}: ") for line in str(caught.value).splitlines()]
    assert [line.split(": ")[0] for line in lines] == ["event.0", "event.2", "phase.p.of"]
    assert "'main'" in lines[0]
    assert "'frist'" in lines[2]
