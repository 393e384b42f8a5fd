"""Route choice: least cost by own speeds, within what the case allows, and changes during a run."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from evac.base.errors import PluginError, ScenarioError
from evac.directions.build import build_fields
from evac.directions.routes import Route
from evac.people.behaviour import BehaviourScene
from evac_plugins.behaviour_route_choice import RouteChoice, route_costs
from tests.directions.conftest import Drawing

STEEP = math.atan(3.0 / 4.0)
ANY = (Route(),)


def drawn():
    """A floor 10 m long: the exit "stair" lies behind a stair of 5 m (up) in the east, "flat" in the west."""
    drawing = Drawing()
    for box, slope in (((0, 0, 10, 2), 0.0), ((10, 0, 14, 2), STEEP), ((14, 0, 15, 2), 0.0)):
        drawing.level(box, uphill=(1.0, 0.0) if slope else (0.0, 0.0), slope=slope)
    for first, x in ((0, 10), (1, 14)):
        drawing.portal(first, first + 1, (x, 0), (x, 2))
    drawing.exit("flat", 0, (0, 0), (0, 2))
    drawing.exit("stair", 2, (15, 0), (15, 2))
    return drawing


@pytest.fixture(scope="module")
def building():
    return drawn().build()


def scene(building, behaviour, groups, routes=ANY, route=None):
    """Return a scene of groups, given as (x positions, speeds up, settings), on the lower floor."""
    fields = build_fields(building, tuple(dict.fromkeys((*routes, *behaviour.routes()))), speeds=(1.0, 0.5, 0.5))
    x = np.concatenate([np.array(positions, dtype=float) for positions, _, _ in groups])
    made, first = [], 0
    for name, (positions, _, settings) in enumerate(groups):
        rows = np.arange(first, first + len(positions), dtype=np.int32)
        made.append(SimpleNamespace(name=f"group {name}", rows=rows, settings=settings))
        first += len(positions)
    up = np.concatenate([np.array(speeds, dtype=float) for _, speeds, _ in groups])
    crowd = SimpleNamespace(
        position=np.column_stack((x, np.ones(len(x)))),
        level=np.zeros(len(x), dtype=np.int32),
        contact_radius=np.full(len(x), 0.2),
        speed=np.column_stack((np.ones(len(x)), up, up)),
        route=np.zeros(len(x), dtype=np.int32) if route is None else np.array(route, dtype=np.int32),
    )
    scene = SimpleNamespace(building=building, fields=fields, version=0)
    return BehaviourScene(crowd, scene, tuple(made), np.random.default_rng(0), 0.1)


def chosen(of):
    """Return the routes of everybody."""
    return [of.fields.routes[index] for index in of.crowd.route]


def test_costs_weigh_lengths_with_own_speeds(building):
    behaviour = RouteChoice(exits=["flat", "stair"])
    of = scene(building, behaviour, [([4.0, 4.0], [0.5, 1.0], {})])
    routes = [of.fields.routes.index(route) for route in behaviour.routes()]
    rows = np.arange(2, dtype=np.int32)
    costs = {m: route_costs(of.fields, of.crowd, rows, routes, m) for m in ("shortest", "fastest", "comfortable")}
    assert costs["shortest"] == pytest.approx(np.array([[4.0, 12.0], [4.0, 12.0]]), abs=0.05)
    assert costs["fastest"] == pytest.approx(np.array([[4.0, 17.0], [4.0, 12.0]]), abs=0.05)
    assert costs["comfortable"] == pytest.approx(np.array([[4.0, 37.0], [4.0, 22.0]]), abs=0.2)


def test_a_way_down_costs_what_the_speed_and_the_comfort_factor_say(building):
    """From the upper floor the flat exit is 10.5 m and 5 m down a stair away."""
    behaviour = RouteChoice(exits=["flat"])
    of = scene(building, behaviour, [([14.5], [0.5], {})])
    of.crowd.level[:] = 2
    of.crowd.speed[:] = (1.0, 0.5, 0.7)
    routes = [of.fields.routes.index(route) for route in behaviour.routes()]
    rows = np.arange(1, dtype=np.int32)
    costs = [route_costs(of.fields, of.crowd, rows, routes, m)[0, 0] for m in ("shortest", "fastest", "comfortable")]
    assert costs == pytest.approx([10.5 + 5, 10.5 + 5 / 0.7, 10.5 + 3 * 5 / 0.7], abs=0.05)


def test_who_cannot_climb_takes_the_way_that_does_not(building):
    behaviour = RouteChoice(exits=["stair", "flat"])
    of = scene(building, behaviour, [([9.0], [0.0], {})])
    behaviour.prepare(of)
    assert [route.exits for route in chosen(of)] == [("flat",)]


def test_between_strategies_seconds_decide(building):
    """At x = 9 the stair is 7 m and 17 s away for somebody slow on it, the flat exit 9 m and 9 s."""
    behaviour = RouteChoice(exits=["flat", "stair"], strategies=["shortest", "fastest"])
    of = scene(building, behaviour, [([9.0, 9.0], [0.5, 1.0], {})])
    behaviour.prepare(of)
    assert [route.exits for route in chosen(of)] == [("flat",), ("stair",)]


def test_who_is_out_chooses_no_more(building):
    """Level -1 would be read as the last level, where the exit "stair" is the nearer one."""
    behaviour = RouteChoice(exits=["flat", "stair"], every=5.0)
    of = scene(building, behaviour, [([1.0, 1.0], [1.0, 1.0], {})])
    behaviour.prepare(of)
    of.crowd.position[:, 0] = 14.5
    of.crowd.level[:] = [2, -1]
    behaviour.act(of.crowd, 5.0)
    assert [route.exits for route in chosen(of)] == [("stair",), ("flat",)]


def test_who_has_no_way_keeps_the_route():
    drawing = drawn()
    drawing.level((20, 0, 22, 2))
    behaviour = RouteChoice(exits=["flat", "stair"])
    of = scene(drawing.build(), behaviour, [([9.0, 21.0], [1.0, 1.0], {})])
    of.crowd.level[1] = 3
    behaviour.prepare(of)
    assert chosen(of) == [Route(("stair",)), Route()]


def test_people_slow_on_stairs_take_the_other_exit(building):
    """At x = 7.5 the flat exit costs 7.5 s, the stair 3.5 s + 5 m / speed up."""
    behaviour = RouteChoice(exits=["flat", "stair"])
    of = scene(building, behaviour, [([7.5, 7.5, 9.0], [1.0, 2.0, 0.5], {})])
    behaviour.prepare(of)
    assert [route.exits for route in chosen(of)] == [("flat",), ("stair",), ("flat",)]
    assert not behaviour.acts_at_ticks()


def test_strategies_have_their_own_measure(building):
    """At x = 9 the ways are 9 m and 7 m long; they take 9 s and 7 s, with stairs counted three times 9 s and 17 s."""
    taken = {}
    for strategy in ("shortest", "fastest", "comfortable"):
        behaviour = RouteChoice(exits=["flat", "stair"], strategies=[strategy])
        of = scene(building, behaviour, [([9.0, 9.0], [1.0, 0.5], {})])
        behaviour.prepare(of)
        taken[strategy] = [route.exits[0] for route in chosen(of)]
    assert taken == {"shortest": ["stair"] * 2, "fastest": ["stair", "flat"], "comfortable": ["flat"] * 2}


def test_exits_of_the_case_and_of_the_group_limit_the_choice(building):
    behaviour = RouteChoice(exits=["flat", "stair"])
    routes = (Route(), Route(("stair",)))
    groups = [([1.0], [0.5], {}), ([1.0], [0.5], {"exits": ["stair"]}), ([1.0], [0.5], {})]
    of = scene(building, behaviour, groups, routes, route=[0, 0, 1])
    behaviour.prepare(of)
    assert [route.exits for route in chosen(of)] == [("flat",), ("stair",), ("stair",)]


def test_a_strategy_changes_during_the_run(building):
    behaviour = RouteChoice(exits=["flat", "stair"], change_at=20.0, change_to="comfortable")
    groups = [([9.0], [1.0], {}), ([9.0], [1.0], {"change_at": math.inf})]
    of = scene(building, behaviour, groups)
    behaviour.prepare(of)
    assert behaviour.acts_at_ticks()
    behaviour.act(of.crowd, 19.9)
    assert chosen(of) == [Route(("stair",))] * 2
    behaviour.act(of.crowd, 199 * 0.1 + 0.1)
    assert chosen(of) == [Route(("flat",), "comfortable"), Route(("stair",))]


def test_people_choose_again_once_a_period_from_where_they_are(building):
    behaviour = RouteChoice(exits=["flat", "stair"], every=5.0)
    of = scene(building, behaviour, [([9.0, 9.0], [1.0, 1.0], {})])
    behaviour.prepare(of)
    of.crowd.position[:, 0] = 2.0
    of.crowd.level[1] = -1
    behaviour.act(of.crowd, 4.9)
    assert [route.exits for route in chosen(of)] == [("stair",), ("stair",)]
    for time, nearer, exit_ in ((5.0, 2.0, "flat"), (9.9, 9.0, "flat"), (10.0, 9.0, "stair")):
        of.crowd.position[:, 0] = nearer
        behaviour.act(of.crowd, time)
        assert [route.exits for route in chosen(of)] == [(exit_,), ("stair",)]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"strategies": ["fast"]}, "strategies: .*'fastest'"),
        ({"strategies": []}, "strategies"),
        ({"exits": "flat"}, "exits: .*'flat'"),
        ({"change_at": 5.0}, "change_to"),
        ({"every": -1.0}, "every: .*-1"),
    ],
)
def test_refuses_settings(settings, message):
    with pytest.raises(PluginError, match=message):
        RouteChoice(**settings)


@pytest.mark.parametrize(
    ("group", "route", "message"),
    [
        ({"exits": ["stairs"]}, 0, r"people\.group 0\.behaviours\.route_choice\.exits: 'stairs'.*'stair'"),
        ({"strategies": ["shortest"]}, 0, "strategies: 'shortest'"),
        ({"change_at": 5.0}, 0, "behaviours.route_choice.change_to"),
        ({"exits": ["stair"]}, 1, r"people\.group 0\.exits: .*flat.* \(stair\); add"),
    ],
)
def test_refuses_groups_that_ask_for_more(building, group, route, message):
    behaviour = RouteChoice(exits=["flat", "stair"])
    of = scene(building, behaviour, [([1.0], [1.0], group)], (Route(), Route(("flat",))), route=[route])
    with pytest.raises(ScenarioError, match=message):
        behaviour.prepare(of)
