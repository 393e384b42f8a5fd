import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from evac.base.errors import ScenarioError
from evac.directions.routes import Route
from evac.people.population import build_population
from evac.physics.state import Events


def group(name="all", **keys):
    return {"name": name, "number": 20, "area": "room 0", **keys}


def standing(name="one", **keys):
    return {"name": name, "positions": [[1.0, 1.0]], "level": "west 0", "radius": 0.2, **keys}


def events(*rows):
    row, kind, link, time = zip(*rows, strict=True)
    # Two places more than events, as in a buffer: what lies beyond the count is of no interest.
    return Events(
        number=len(rows),
        number_before=0,
        row=np.array([*row, 0, 0], np.int32),
        kind=np.array([*kind, 1, 1], np.int32),
        link=np.array([*link, 9, 9], np.int32),
        time=np.array([*time, -1.0, -1.0]),
    )


def test_everybody_has_arrays_of_the_declared_kind_within_the_drawn_ranges(make_case, house, fields):
    case = make_case(group("a"), group("b", number=5, area="room 3", mass=70, speed_up={"factor": 0.5}))
    population = build_population(case, house, fields(), seed=1)
    crowd = population.crowd
    assert [members.rows.tolist() for members in population.groups] == [list(range(20)), list(range(20, 25))]
    assert crowd.group.tolist() == [0] * 20 + [1] * 5
    assert crowd.level.tolist() == [0] * 20 + [3] * 5
    for name, array in crowd.values().items():
        assert len(array) == 25, name
        assert array.flags.c_contiguous, name
        kinds = {"mingled": np.uint8, **dict.fromkeys(("level", "group", "route", "exit_used", "passing"), np.int32)}
        assert array.dtype == kinds.get(name, np.float64), name
    assert ((crowd.radius >= 0.2) & (crowd.radius <= 0.25)).all()
    assert (crowd.mass[20:] == 70).all()
    assert np.array_equal(crowd.speed[20:, 1], 0.5 * crowd.speed[20:, 0])
    assert (crowd.velocity == 0).all()
    assert (crowd.start_time == 0).all()
    assert (crowd.speed_factor == 1).all()
    assert np.isnan(crowd.exit_time).all()
    assert (crowd.exit_used == -1).all()
    assert population.inside == 25


def test_by_default_nobody_is_faster_on_stairs(make_case, house, fields):
    told = group("told", number=5, area="room 3", speed=0.6, speed_down=0.9, limit_stair_speeds=False)
    case = make_case(group("slow", speed=0.6), told)
    crowd = build_population(case, house, fields(), seed=1).crowd
    assert (crowd.speed[:20, 1:] <= 0.6).all()
    assert (crowd.speed[:20, 1:] >= 0.5).all()
    assert (crowd.speed[20:, 2] == 0.9).all()


def test_what_a_group_draws_depends_on_seed_and_group_alone(make_case, house, fields):
    first = build_population(make_case(group("a"), group("b")), house, fields(), seed=1).crowd
    other = build_population(
        make_case(
            group("c", number=3, area="room 2"), group("b"), contact={"model": "hard"}, simulation={"step": 0.001}
        ),
        house,
        fields(),
        seed=1,
    ).crowd
    for name in ("radius", "height", "mass", "tau", "speed"):
        assert np.array_equal(getattr(first, name)[20:], getattr(other, name)[:20]), name
        assert not np.array_equal(getattr(first, name)[:20], getattr(first, name)[20:]), name
    again = build_population(make_case(group("a"), group("b")), house, fields(), seed=1).crowd
    for name, array in first.values().items():
        assert np.array_equal(array, getattr(again, name), equal_nan=True), name
    assert not np.array_equal(first.mass, build_population(make_case(group("a")), house, fields(), seed=2).crowd.mass)


def test_the_quantities_of_a_person_are_independent(make_case, house, fields):
    case = make_case(standing(positions=[[1.0, 1.0]] * 2000, radius={"uniform": [0.2, 0.25]}))
    crowd = build_population(case, house, fields(), seed=1).crowd
    ranks = stats.spearmanr(np.column_stack([crowd.radius, crowd.height, crowd.mass, crowd.tau, crowd.speed])).statistic
    assert ranks.shape == (7, 7)
    assert np.abs(ranks - np.eye(7)).max() < 0.1


def test_heights_are_those_of_adults_unless_they_are_given(make_case, house, fields):
    case = make_case(
        standing("a", positions=[[1.0, 1.0]] * 2000),
        standing("b", positions=[[1.0, 1.0]], height={"uniform": [1.0, 1.1]}),
    )
    height = build_population(case, house, fields(), seed=1).crowd.height
    assert height[:2000].mean() == pytest.approx(1.695, abs=0.01)
    assert (height[:2000].min(), height[:2000].max()) == pytest.approx((1.535, 1.855), abs=0.005)
    assert 1.0 <= height[2000] <= 1.1


def test_people_in_areas_keep_off_walls_portals_exits_and_each_other(make_case, house, fields):
    case = make_case(group("a", number=15, area="room 1"), standing("s", level="east 0", positions=[[5.0, 2.0]]))
    crowd = build_population(case, house, fields(), seed=1).crowd
    x, y = crowd.position[:15].T
    radius = crowd.radius[:15]
    assert (np.minimum.reduce([x - 4, 6 - x, y, 4 - y]) >= radius).all()
    gap = np.linalg.norm(crowd.position[:, None] - crowd.position[None], axis=2) - crowd.radius[:, None] - crowd.radius
    assert gap[~np.eye(16, dtype=bool)].min() >= 0


@pytest.mark.parametrize("link", ["portal", "exit"])
def test_nobody_starts_on_a_line_where_people_cross(make_case, house, fields, link):
    # A portal or exit along the whole side of the area, where there is no wall that would keep people off.
    level, side = (0, 4.0) if link == "portal" else (1, 6.0)
    way = replace(house.exits[0], segments=np.array([[6.0, 0.0, 6.0, 4.0]]))
    is_wall = ~(house.walls[:, [0, 2]] == 6.0).all(axis=1)
    house = replace(house, exits=(way,), walls=house.walls[is_wall], wall_level=house.wall_level[is_wall])
    case = make_case(group(number=25, area=f"room {level}", radius=0.25))
    crowd = build_population(case, house, fields(), seed=1).crowd
    assert np.abs(crowd.position[:, 0] - side).min() >= 0.25


@pytest.mark.parametrize(("z", "level"), [(0.0, 0), (3.0, 2), (2.8, 2)])
def test_a_position_finds_its_level_by_height(make_case, house, fields, z, level):
    case = make_case({"name": "one", "positions": [[1.0, 1.0], [5.0, 1.0]], "z": z, "velocity": [[1, 0], [0, -1]]})
    crowd = build_population(case, house, fields(), seed=1).crowd
    assert crowd.level.tolist() == [level, level + 1]
    assert crowd.position.tolist() == [[1, 1], [5, 1]]
    assert crowd.velocity.tolist() == [[1, 0], [0, -1]]


@pytest.mark.parametrize(("z", "level"), [(0.1, 0), (0.4, 2)])
def test_of_levels_above_each_other_the_nearest_is_taken(make_case, house, fields, z, level):
    low = replace(house, vertices=house.vertices * [1.0, 1.0, 0.5 / 3.0])
    case = make_case({"name": "one", "positions": [[1.0, 1.0]], "z": z})
    assert build_population(case, low, fields(), seed=1).crowd.level.tolist() == [level]


def test_on_the_common_edge_of_a_flight_and_a_floor_one_stands_on_the_floor(make_case, house, fields):
    case = make_case({"name": "one", "positions": [[4.0, 2.0], [4.0 + 5e-7, 1.0]], "z": 3.0})
    assert build_population(case, house, fields(), seed=1).crowd.level.tolist() == [2, 2]
    levels = (*house.levels[:2], replace(house.levels[2], kind="flight"), house.levels[3])
    crowd = build_population(case, replace(house, levels=levels), fields(), seed=1).crowd
    assert crowd.level.tolist() == [3, 3]


def test_a_body_may_touch_a_wall_and_stand_across_a_portal(make_case, house, fields):
    case = make_case(standing(positions=[[0.2, 1.0], [4.0, 2.0]]))
    assert build_population(case, house, fields(), seed=1).crowd.level.tolist() == [0, 0]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"positions": [[1, 1], [5, 1]]}, "people.one.positions.1: (5, 1) is outside level 'west 0'"),
        ({"positions": [[9, 1]], "level": None, "z": 0.0}, "people.one.positions.0: (9, 1)"),
        ({"positions": [[1, 1]], "level": None, "z": 1.5}, "people.one.positions.0: (1, 1)"),
        ({"positions": [[1, 1], [0.1, 1]]}, "people.one.positions.1: (0.1, 1) on level 'west 0' is 0.100 m"),
        (
            {"positions": [[1, 1], [0.3, 2]], "radius": {"list": [0.2, 0.5]}},
            "people.one.positions.1: (0.3, 2) on level 'west 0' is 0.300 m",
        ),
    ],
)
def test_a_position_that_cannot_be_is_refused_by_place(make_case, house, fields, keys, message):
    case = make_case({key: value for key, value in standing(**keys).items() if value is not None})
    with pytest.raises(ScenarioError) as caught:
        build_population(case, house, fields(), seed=1)
    assert str(caught.value).startswith(str(case.source))
    assert message in str(caught.value)


def test_too_many_people_are_refused_by_area_and_level(make_case, house, fields):
    case = make_case(group("crowd", number=500))
    with pytest.raises(ScenarioError) as caught:
        build_population(case, house, fields(), seed=1)
    message = str(caught.value)
    assert message.startswith(f"{case.source}: people.crowd.number: area 'room 0' on level 'west 0': ")
    assert re.search("500 people .* 0.25 m .* 16.0 m2", message)


def test_routes_are_rows_of_the_fields(make_case, house, fields):
    case = make_case(standing("a"), standing("b", strategy="shortest"))
    routes = (Route(strategy="shortest"), Route())
    assert build_population(case, house, fields(routes), seed=1).crowd.route.tolist() == [1, 0]


def test_groups_hand_a_behaviour_its_own_settings(make_case, house, fields):
    case = make_case(standing("a"), standing("b", behaviours={"follow": {"leader": "a"}}), behaviours={"follow": {}})
    population = build_population(case, house, fields(), seed=1)
    assert [group.settings for group in population.groups_for("follow")] == [{}, {"leader": "a"}]
    assert [group.settings for group in population.groups_for("other")] == [{}, {}]


def test_settling_writes_exits_and_logs_portals_in_order(make_case, house, fields):
    population = build_population(make_case(group(number=3)), house, fields(), seed=1)
    assert [len(part) for part in population.crossings] == [0, 0, 0]
    population.settle(events((2, 0, 0, 0.5), (0, 0, 0, 0.75)))
    population.settle(events((2, 1, 2, 1.25), (1, 0, 0, 1.5)))
    population.settle(events((0, 1, 2, 2.0)))
    row, link, time = population.crossings
    assert (row.tolist(), link.tolist(), time.tolist()) == ([2, 0, 1], [0, 0, 0], [0.5, 0.75, 1.5])
    assert population.crowd.exit_used.tolist() == [0, -1, 0]
    assert population.crowd.exit_time[[0, 2]].tolist() == [2.0, 1.25]
    assert population.inside == 1


def test_state_and_restore_go_back_to_the_same_bits(make_case, house, fields):
    population = build_population(make_case(group(number=3)), house, fields(), seed=1)
    population.settle(events((2, 0, 0, 0.5)))
    state = population.state()
    arrays = population.crowd
    population.settle(events((2, 1, 2, 1.25), (1, 0, 0, 1.5)))
    population.crowd.position[:] = 0
    population.restore(state)
    assert population.crowd is arrays
    assert population.inside == 3
    for name, array in population.state().items():
        assert np.array_equal(array, state[name], equal_nan=array.dtype == np.float64), name
    assert population.crossings[0].tolist() == [2]


def test_groups_stand_in_the_order_of_their_names(make_case, house, fields):
    """Those at given positions are placed first, whatever they are called."""
    tables = group("b"), standing("c", positions=[[2.0, 2.0]], level="west 1"), group("a", number=3, area="room 2")
    ordered = build_population(make_case(*tables), house, fields(), seed=1)
    assert [(members.name, members.rows.tolist()) for members in ordered.groups] == [
        ("a", [0, 1, 2]),
        ("b", list(range(3, 23))),
        ("c", [23]),
    ]
    for other in itertools.permutations(tables):
        crowd = build_population(make_case(*other), house, fields(), seed=1).crowd
        for name, array in ordered.crowd.values().items():
            assert np.array_equal(array, getattr(crowd, name), equal_nan=True), name
