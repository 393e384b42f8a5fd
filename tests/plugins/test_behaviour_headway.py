"""Headway: the published speed and turn, and who is followed, against exact numbers and searches over all pairs."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from evac.case.loading import load_case
from evac.people.behaviour import BehaviourScene
from evac.people.outside import make_outside
from evac.physics.state import make_crowd
from evac.simulation.assembly import make_behaviours
from evac.simulation.scene import Scene, SharedScene
from evac_plugins.behaviour_headway import Headway
from evac_plugins.contact_nsm1 import Nsm1
from tests.physics.scenes import fields_towards, make_building, make_engine, uniform_fields

EAST, WEST, NORTH, NORTH_EAST = (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (math.sqrt(0.5), math.sqrt(0.5))


def prepared(crowd, building=None, fields=None, outside=None, **parameters):
    """Return the behaviour, ready to act on a crowd."""
    building = building or make_building()
    behaviour = Headway(**parameters)
    scene = Scene(SharedScene(building, fields or uniform_fields(len(building.levels))))
    outside = outside or make_outside(len(crowd.level))
    behaviour.prepare(BehaviourScene(crowd, scene, (), np.random.default_rng(1), 0.1, outside))
    return behaviour


def acted(position, building=None, fields=None, time=0.0, route=None, level=0, start_time=0.0, speed=1.2, **given):
    """Return people at places after the behaviour has acted on them."""
    crowd = make_crowd(position, level=level, start_time=start_time, speed=speed)
    if route is not None:
        crowd.route[:] = route
    prepared(crowd, building, fields, **given).act(crowd, time)
    return crowd


def factors(position, **given):
    """Return what becomes of the speed factors of people at places, if nobody turns from anybody."""
    return acted(position, repulsion=0.0, **given).speed_factor


def behind(position, out, building, level=0, way=EAST, **given):
    """Return crowd and people outside: one person inside, and others, who have left, at (level, x, y, direction)."""
    crowd = make_crowd([position, *([0.0, 0.0] for _ in out)], level=[level] + [-1] * len(out), speed=1.2)
    outside = make_outside(len(crowd.level))
    for row, (of, x, y, direction) in enumerate(out, start=1):
        outside.level[row], outside.position[row], outside.direction[row] = of, (x, y), direction
        outside.depth[row] = np.dot((x, y), direction)
    fields = uniform_fields(len(building.levels), way)
    prepared(crowd, building, fields, outside, **{"repulsion": 0.0, **given}).act(crowd, 0.0)
    return crowd, outside


def turns(position, **given):
    """Return what is added to the directions of people at places."""
    return acted(position, **given).extra_direction


@pytest.mark.parametrize("distance", [0.31, 0.6, 1.0, 1.49])
def test_the_speed_is_the_distance_beyond_the_length_over_the_time_gap(distance):
    assert factors([[0.0, 0.0], [distance, 0.0]]) == pytest.approx([(distance - 0.3) / 1.2, 1.0], rel=1e-12)


def test_it_is_the_own_speed_from_where_that_is_slower():
    assert factors([[0.0, 0.0], [1.51, 0.0]]).tolist() == [1.0, 1.0]


@pytest.mark.parametrize("distance", [0.1, 0.3])
def test_nearer_than_the_length_one_stands(distance):
    assert factors([[0.0, 0.0], [distance, 0.0]]).tolist() == [0.0, 1.0]


def test_time_gap_and_length_are_those_given():
    found = factors([[0.0, 0.0], [1.0, 0.0]], speed=2.0, time_gap=0.5, length=0.4)
    assert found[0] == pytest.approx((1.0 - 0.4) / 0.5 / 2.0)


def test_the_nearest_of_several_ahead_counts():
    assert factors([[0.0, 0.0], [1.2, 0.1], [0.8, 0.0], [1.0, -0.1]])[0] == pytest.approx(0.5 / 1.2)


def test_a_factor_that_others_have_set_is_what_is_wanted():
    crowd = make_crowd([[0.0, 0.0], [0.8, 0.0], [0.0, 5.0], [0.8, 5.0]], speed=1.2)
    crowd.speed_factor[:] = [0.5, 1.0, 0.1, 1.0]
    prepared(crowd, repulsion=0.0).act(crowd, 0.0)
    # 0.6 m/s wanted, 0.5 left; 0.12 m/s wanted, less than 0.5.
    assert crowd.speed_factor == pytest.approx([0.5 / 1.2, 1.0, 0.1, 1.0])


@pytest.mark.parametrize(("across", "is_followed"), [(0.29, True), (-0.29, True), (0.31, False), (-0.31, False)])
def test_only_who_stands_on_the_line_is_followed(across, is_followed):
    distance = math.hypot(0.8, across)
    expected = (distance - 0.3) / 1.2 if is_followed else 1.0
    assert factors([[0.0, 0.0], [0.8, across]])[0] == pytest.approx(expected)


def test_nobody_follows_who_is_behind_or_beside():
    assert factors([[0.0, 0.0], [-0.5, 0.0]])[0] == 1.0
    assert factors([[0.0, 0.0], [0.0, 0.25]]).tolist() == [1.0, 1.0]


@pytest.mark.parametrize("other", [EAST, NORTH_EAST, NORTH, WEST], ids=str)
def test_whoever_is_ahead_is_braked_for_whichever_way_it_goes(other):
    found = factors([[0.0, 0.0], [0.8, 0.0]], fields=uniform_fields(1, EAST, other), route=[0, 1])
    assert found[0] == pytest.approx(0.5 / 1.2)


def test_who_is_turned_round_brakes_for_who_comes_up_behind():
    """The one in the middle is turned back by the one ahead, towards the one behind."""
    crowd = acted([[0.0, 0.0], [0.42, 0.0], [-0.9, 0.0]])
    assert crowd.extra_direction[0, 0] < -1.0
    assert crowd.speed_factor[0] == pytest.approx((0.9 - 0.3) / 1.2)


def test_who_has_not_set_off_is_not_followed_until_it_does():
    people = {"position": [[0.0, 0.0], [0.8, 0.0]], "start_time": [0.0, 5.0]}
    assert factors(**people, time=4.9)[0] == 1.0
    assert factors(**people, time=5.0)[0] == pytest.approx(0.5 / 1.2)


def test_who_does_not_want_to_walk_is_not_followed():
    crowd = make_crowd([[0.0, 0.0], [0.8, 0.0]], speed=1.2)
    crowd.speed_factor[1] = 0.0
    prepared(crowd, repulsion=0.0).act(crowd, 0.0)
    assert crowd.speed_factor.tolist() == [1.0, 0.0]


def test_who_is_out_is_not_followed():
    assert factors([[0.0, 0.0], [0.8, 0.0]], level=[0, -1])[0] == 1.0
    assert factors([[0.0, 0.0], [0.8, 0.0]], level=-1).tolist() == [1.0, 1.0]


#: A door in a wall at x = 0, and another one above a post.
DOORS = {"exits": [(0, (0.0, -0.5, 0.0, 0.5)), (0, (0.0, 0.7, 0.0, 1.7))]}
WALLS = {"walls": [(0.0, -5.0, 0.0, -0.5), (0.0, 0.5, 0.0, 0.7), (0.0, 1.7, 0.0, 5.0)]}


def test_who_has_left_is_followed_and_turned_from_as_one_inside():
    doors = make_building(**DOORS, **WALLS)
    crowd, _ = behind((-0.3, 0.0), [(0, 0.5, 0.1, EAST)], doors)
    assert crowd.speed_factor[0] == pytest.approx((math.hypot(0.8, 0.1) - 0.3) / 1.2, rel=1e-12)
    crowd, _ = behind((-0.3, 0.0), [(0, 0.2, 0.0, EAST)], doors, repulsion=8.0)
    assert crowd.extra_direction[0] == pytest.approx([-8.0 * math.exp((0.3 - 0.5) / 0.1), 0.0])
    crowd, _ = behind((-0.8, 0.1), [(0, 0.0, 0.1, EAST)], doors)  # still on the line
    assert crowd.speed_factor[0] == pytest.approx(0.5 / 1.2)
    crowd, _ = behind((-0.3, 0.0), [(-1, 0.5, 0.1, EAST)], doors)
    assert crowd.speed_factor[0] == 1.0


@pytest.mark.parametrize(
    ("y", "is_seen"), [(0.0, True), (-0.55, False), (0.6, False), (1.0, True)], ids=["door", "wall", "post", "other"]
)
def test_who_has_left_is_seen_through_the_exits_of_its_level(y, is_seen):
    """Whoever stands in front of one of two doors side by side sees who has left by the other one, through its own."""
    crowd, _ = behind((-0.3, y), [(0, 0.5, y, EAST)], make_building(**DOORS, **WALLS))
    assert crowd.speed_factor[0] == pytest.approx(0.5 / 1.2 if is_seen else 1.0)


def test_a_closed_exit_hides_who_has_left():
    building = make_building(**DOORS, **WALLS)
    closed = type(building)(**{**building.__dict__, "closed": frozenset({building.link_of(building.exits[0])})})
    for hall, is_seen in ((building, True), (closed, False)):
        crowd, _ = behind((-0.3, 0.0), [(0, 0.5, 0.0, EAST)], hall)
        assert crowd.speed_factor[0] == pytest.approx(0.5 / 1.2 if is_seen else 1.0)


def test_walls_before_an_exit_hide_and_those_behind_it_do_not():
    for x, is_seen in ((-0.1, False), (0.3, True)):
        building = make_building(**DOORS, walls=[*WALLS["walls"], (x, -0.2, x, 0.2)])
        crowd, _ = behind((-0.3, 0.0), [(0, 0.5, 0.0, EAST)], building)
        assert crowd.speed_factor[0] == pytest.approx(0.5 / 1.2 if is_seen else 1.0)


def test_who_has_left_another_level_is_seen_across_a_portal_only():
    """An exit right behind the foot of a stair, and one on the storey above."""
    bounds = ((-10.0, -10.0, -0.2, 10.0), (-0.2, -10.0, 0.0, 10.0))
    exits = [(1, (0.0, -0.5, 0.0, 0.5))]
    foot = make_building(bounds, portals=[(0, 1, (-0.2, -0.5, -0.2, 0.5))], exits=exits)
    for building, is_seen in ((foot, True), (make_building(bounds, exits=exits), False)):
        crowd, _ = behind((-0.3, 0.0), [(1, 0.5, 0.0, EAST)], building)
        assert crowd.speed_factor[0] == pytest.approx(0.5 / 1.2 if is_seen else 1.0)


def test_outside_people_follow_those_ahead_from_the_same_level():
    building = make_building(((-10.0, -10.0, 0.0, 10.0),) * 2, exits=[*DOORS["exits"], (1, (0.0, -0.5, 0.0, 0.5))])
    _, outside = behind((-9.0, 0.0), [(0, 0.1, 0.0, EAST), (0, 0.9, 0.0, EAST), (1, 0.5, 0.0, EAST)], building)
    assert outside.speed_factor == pytest.approx([1.0, 0.5 / 1.2, 1.0, 1.0])


@pytest.mark.parametrize("repulsion", [0.0, 8.0])
def test_outside_nobody_waits_for_who_comes_towards_it_or_is_nearer_to_its_exit(repulsion):
    """Exits that face each other across a lane would otherwise block for ever; nor do people inside count."""
    lane = make_building(exits=[(0, (0.0, -0.5, 0.0, 0.5)), (0, (1.5, 0.5, 1.5, -0.5))])
    _, outside = behind((-9.0, 0.0), [(0, 0.4, 0.0, EAST), (0, 1.1, 0.0, WEST)], lane, repulsion=repulsion)
    assert outside.speed_factor.tolist() == [1.0, 1.0, 1.0]
    _, outside = behind((0.9, 0.0), [(0, 0.4, 0.0, EAST)], lane, repulsion=repulsion)
    assert outside.speed_factor.tolist() == [1.0, 1.0]
    crossing = [(0, 0.4, 0.0, EAST), (0, 0.8, 0.1, NORTH_EAST)]
    _, outside = behind((-9.0, 0.0), crossing, lane, repulsion=repulsion)
    assert outside.speed_factor.tolist() == [1.0, pytest.approx((math.hypot(0.4, 0.1) - 0.3) / 1.2), 1.0]


@pytest.mark.parametrize("way", [EAST, NORTH])
def test_in_a_long_row_everybody_follows_the_next(way):
    """As many cells along one axis as one along the other."""
    places = 0.8 * np.arange(20.0)[:, None] * np.array(way) - 8.0 * np.array(way)
    found = factors(places, fields=uniform_fields(1, way))
    assert found == pytest.approx([0.5 / 1.2] * 19 + [1.0])


def test_of_two_side_by_side_at_a_door_the_nearer_goes_first():
    """Each stands ahead of the other, for their ways meet; the travel time decides."""
    found = factors([[-0.2, 0.16], [-0.2, -0.14]], fields=fields_towards((0.0, 0.0)), length=0.35)
    assert found[1] == 1.0
    assert found[0] < 0.1


def test_of_two_as_far_from_a_door_nobody_waits():
    found = factors([[-0.25, 0.125], [-0.25, -0.125]], fields=fields_towards((0.0, 0.0)), length=0.35)
    assert found.tolist() == [1.0, 1.0]


def test_of_two_on_two_routes_whose_ways_meet_one_goes_first():
    to_door = fields_towards((0.0, 0.0))
    for places in ([[-0.3, 0.1], [-0.25, -0.1]], [[-0.25, 0.1], [-0.3, -0.1]]):
        one, other = places
        e, f = (-np.array(place) / np.hypot(*place) for place in (one, other))
        fields = uniform_fields(1, tuple(e), tuple(f))
        found = factors(places, fields=fields, route=[0, 1])
        assert sorted(found == 1.0) == [False, True]
        assert (found == factors(places, fields=to_door)).all()


def test_on_a_stair_the_wanted_speed_is_that_of_the_stair():
    crowd = make_crowd([[0.0, 0.0], [0.7, 0.0]], speed=[[1.2, 0.5, 0.8]] * 2)
    building = make_building()
    slope = 0.5
    flight = type(building.levels[0])(
        **{**building.levels[0].__dict__, "uphill": np.array([1.0, 0.0]), "slope": slope, "kind": "flight"}
    )
    building = type(building)(**{**building.__dict__, "levels": (flight,)})
    prepared(crowd, building, repulsion=0.0).act(crowd, 0.0)
    assert crowd.speed_factor[0] == pytest.approx(min(1.0, 0.4 / (0.5 * math.cos(slope))))


def test_it_acts_behind_the_others_wherever_a_case_names_it():
    case = load_case("square_room", {"behaviours": {"headway": {}, "response_time": {"time": 1.0}}})
    assert [behaviour.name for behaviour in make_behaviours(case)] == ["response_time", "headway"]


def test_a_single_person_needs_none():
    behaviour = Headway()
    scene = SimpleNamespace(crowd=make_crowd([[0.0, 0.0]]))
    assert not behaviour.is_needed(scene)
    assert behaviour.is_needed(SimpleNamespace(crowd=make_crowd([[0.0, 0.0], [1.0, 0.0]])))


def test_through_a_wall_nobody_is_seen_but_beside_it():
    behind = [[0.0, 0.0], [0.8, 0.0]]
    assert factors(behind, building=make_building(walls=[(0.4, -1.0, 0.4, 1.0)]))[0] == 1.0
    assert factors(behind, building=make_building(walls=[(0.4, 0.1, 0.4, 1.0)]))[0] < 1.0


def test_the_joint_of_two_walls_hides_too():
    joined = make_building(walls=[(0.4, -1.0, 0.4, 0.0), (0.4, 0.0, 0.4, 1.0)])
    assert factors([[0.0, 0.0], [0.8, 0.0]], building=joined)[0] == 1.0


def test_walls_of_either_level_hide_across_a_portal_and_those_of_other_storeys_nobody():
    bounds = ((-10.0, -10.0, 0.4, 10.0), (0.4, -10.0, 10.0, 10.0), (-10.0, -10.0, 10.0, 10.0))
    people = {"position": [[0.0, 0.0], [0.8, 0.0]], "level": [0, 1]}
    for x, level, is_hidden in ((0.2, 0, True), (0.6, 1, True), (0.2, 2, False), (0.6, 2, False)):
        wall = {"walls": [(x, -0.2, x, 0.2)], "wall_level": [level]}
        building = make_building(bounds, portals=[(0, 1, (0.4, -0.5, 0.4, 0.5))], **wall)
        assert factors(**people, building=building)[0] == pytest.approx(1.0 if is_hidden else 0.5 / 1.2), (x, level)


def test_far_ahead_a_wall_hides_too():
    """The fast look farther than the reach of one bucket of walls."""
    people = {"position": [[-3.0, 0.0], [3.0, 0.0]], "speed": 8.0}
    assert factors(**people)[0] == pytest.approx(5.7 / 8.0)
    for x in np.linspace(-2.9, 2.9, 13):
        assert factors(**people, building=make_building(walls=[(x, -0.1, x, 0.1)]))[0] == 1.0, x


def test_across_a_portal_people_are_followed_and_on_another_storey_they_are_not():
    bounds = ((-10.0, -10.0, 0.4, 10.0), (0.4, -10.0, 10.0, 10.0))
    doorway = make_building(bounds, portals=[(0, 1, (0.4, -0.5, 0.4, 0.5))])
    above = make_building(bounds)
    people = {"position": [[0.0, 0.0], [0.8, 0.0]], "level": [0, 1]}
    assert factors(**people, building=doorway)[0] == pytest.approx(0.5 / 1.2)
    assert factors(**people, building=above)[0] == 1.0
    beside = {"position": [[0.0, 2.0], [0.8, 2.0]], "level": [0, 1]}
    assert factors(**beside, building=doorway)[0] == 1.0


def test_people_turn_from_each_other_by_the_published_repulsion():
    (left, right) = turns([[0.0, 0.0], [0.3, 0.4]])
    push = 8.0 * math.exp((0.3 - 0.5) / 0.1)
    assert left == pytest.approx([-0.6 * push, -0.8 * push], rel=1e-12)
    assert right == pytest.approx(-left)
    (left, _) = turns([[0.0, 0.0], [0.3, 0.4]], repulsion=5.0, range=0.2, length=0.4)
    assert np.hypot(*left) == pytest.approx(5.0 * math.exp((0.4 - 0.5) / 0.2))


def test_a_faint_repulsion_is_left_out_and_none_is_none():
    reach = 0.3 + 0.1 * math.log(8.0 / 0.01)
    assert np.hypot(*turns([[0.0, 0.0], [0.999 * reach, 0.0]])[0]) == pytest.approx(0.01, rel=0.02)
    assert turns([[0.0, 0.0], [1.001 * reach, 0.0]]).tolist() == [[0.0, 0.0], [0.0, 0.0]]
    assert turns([[0.0, 0.0], [0.2, 0.0]], repulsion=0.0).tolist() == [[0.0, 0.0], [0.0, 0.0]]
    assert turns([[0.0, 0.0], [0.1, 0.0]], repulsion=0.008)[0, 0] == pytest.approx(-0.008 * math.exp(2.0))
    assert turns([[0.0, 0.0], [0.0, 0.0]]).tolist() == [[0.0, 0.0], [0.0, 0.0]]


def test_people_turn_from_who_waits_but_not_from_who_is_out_or_hidden():
    assert turns([[0.0, 0.0], [0.5, 0.0]], start_time=[0.0, 9.0])[0, 0] < -0.5
    assert turns([[0.0, 0.0], [0.5, 0.0]], level=[0, -1])[0].tolist() == [0.0, 0.0]
    wall = make_building(walls=[(0.25, -1.0, 0.25, 1.0)])
    assert turns([[0.0, 0.0], [0.5, 0.0]], building=wall)[0].tolist() == [0.0, 0.0]


def test_the_turn_is_added_to_that_of_other_behaviours():
    crowd = make_crowd([[0.0, 0.0], [0.3, 0.4]])
    crowd.extra_direction[:] = 0.5, -0.25
    prepared(crowd).act(crowd, 0.0)
    push = 8.0 * math.exp((0.3 - 0.5) / 0.1)
    assert crowd.extra_direction[0] == pytest.approx([0.5 - 0.6 * push, -0.25 - 0.8 * push])


def test_who_has_turned_follows_on_the_way_turned_to():
    """A third person turns the first by 45 degrees, out of the line of the second."""
    push = 8.0 * math.exp((0.3 - 0.4) / 0.1)
    crowd = acted([[0.0, 0.0], [1.2, 0.0], [0.0, -0.4]])
    assert crowd.extra_direction[0] == pytest.approx([0.0, push])
    assert push > 1.0
    assert crowd.speed_factor[0] == 1.0
    assert acted([[0.0, 0.0], [1.2, 0.0]]).speed_factor[0] < 1.0


def test_two_who_come_towards_each_other_pass():
    """A little beside each other they turn aside; without repulsion they push each other to a standstill or aside."""
    crowd = make_crowd([[-3.0, 0.02], [3.0, -0.02]], speed=1.2, radius=0.2)
    crowd.route[:] = [0, 1]
    fields = uniform_fields(1, EAST, WEST)
    behaviour, engine, model = prepared(crowd, fields=fields), make_engine(crowd, fields=fields), Nsm1()
    nearest = math.inf
    for tick in range(80):
        crowd.speed_factor[:] = 1.0
        crowd.extra_direction[:] = 0.0
        behaviour.act(crowd, 0.1 * tick)
        engine.advance(model, crowd, 10 * tick, 10, 0.01, False, False)
        nearest = min(nearest, np.hypot(*(crowd.position[1] - crowd.position[0])))
    assert crowd.position[0, 0] > 2.0
    assert crowd.position[1, 0] < -2.0
    assert nearest > 0.35


#: Three levels in a row: a thin one between two others, and one above all of them. Lines at 0 and 0.3 are portals
#: between walls with a gap, exits are at the ends.
STOREYS = {
    "bounds": ((-6.0, -6.0, 0.0, 6.0), (0.0, -6.0, 0.3, 6.0), (0.3, -6.0, 0.6, 6.0), (-6.0, -6.0, 0.6, 6.0)),
    "portals": [(0, 1, (0.0, -5.0, 0.0, 5.0)), (1, 2, (0.3, -5.0, 0.3, 4.0))],
    "exits": [(2, (0.6, -4.0, 0.6, 4.0)), (3, (0.6, -3.0, 0.6, 6.0))],
}


def crowd_of_storeys(draw, n, far):
    """Return crowd and people outside at random places of `STOREYS`, and one of each far away if told."""
    level = draw.integers(0, 4, n)
    low, high = np.array(STOREYS["bounds"])[level].reshape(n, 2, 2).swapaxes(0, 1)
    position = draw.uniform(low, high)
    if far:
        position[0], level[0] = (4000.0, 3000.0), 2
    outside = make_outside(n)
    out = np.flatnonzero(draw.uniform(size=n) < 0.2)
    outside.level[out] = draw.integers(2, 4, len(out))
    outside.position[out] = draw.uniform((0.6, -6.0), (2.6, 6.0), (len(out), 2))
    if far:
        outside.position[out[0]] = 2.0, 3000.0
    angle = draw.uniform(-1.0, 1.0, len(out))
    outside.direction[out] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outside.depth[out] = outside.position[out, 0] - 0.6
    level[out] = -1
    crowd = make_crowd(np.where(level[:, None] < 0, np.nan, position), level=level, speed=draw.uniform(0.6, 2.0, n))
    crowd.route[:] = draw.integers(0, 3, n)
    return crowd, outside


class Pairs:
    """The rules of the docstring for all pairs of people, with shapely's geometry and without cells."""

    def __init__(self, crowd, directions, walls, wall_level, outside):
        self.met: set[tuple[int, bool, bool]] = set()
        self.route = crowd.route
        self.out = outside.level >= 0
        self.level = np.where(self.out, outside.level, crowd.level)
        self.position = np.where(self.out[:, None], outside.position, crowd.position)
        self.direction = np.where(self.out[:, None], outside.direction, directions[crowd.route])
        along = np.einsum("nk,nk->n", directions[crowd.route], self.position)
        self.remaining = np.where(self.out, -outside.depth, 100.0 - along)
        self.walls = [
            shapely.MultiLineString([wall.reshape(2, 2) for wall in walls[wall_level == level]]) for level in range(4)
        ]
        self.portals = {(a, b): shapely.LineString(np.reshape(at, (2, 2))) for a, b, at in STOREYS["portals"]}
        self.exits = {level: shapely.LineString(np.reshape(at, (2, 2))) for level, at in STOREYS["exits"]}

    def sees(self, i, j):
        """Return whether person i sees j, through at most two portals, or an exit of the level that j has left."""
        a, b = self.level[i], self.level[j]
        if self.out[i]:
            return self.out[j] and a == b
        line = shapely.LineString([self.position[i], self.position[j]])
        if self.out[j]:
            if b not in self.exits or not line.intersects(self.exits[b]):
                return False
            line = shapely.LineString([self.position[i], line.intersection(self.exits[b])])
        low, high = min(a, b), max(a, b)
        if low != high and high == 3:
            return False
        if not all(line.intersects(self.portals[k, k + 1]) for k in range(low, high)):
            return False
        return not line.intersects(self.walls[a]) and not line.intersects(self.walls[b])

    def nearby(self, i, reach):
        """Return (person, step, distance) of all whom person i sees within `reach` [m]."""
        steps = self.position - self.position[i]
        distances = np.hypot(*steps.T)
        near = np.flatnonzero((distances < reach) & (self.level >= 0) & (np.arange(len(steps)) != i))
        found = [(j, steps[j], distances[j]) for j in near if self.sees(i, j)]
        self.met.update((abs(self.level[i] - self.level[j]), self.out[i], self.out[j]) for j, _, _ in found)
        return found

    def brakes(self, i, j, step, length):
        """Return whether person i slows down for j, whom it sees."""
        e, f = self.direction[i], self.direction[j]
        if e @ step <= 0.0 or abs(e[0] * step[1] - e[1] * step[0]) > length:
            return False
        if e @ f <= 0.0:
            return not self.out[i]
        if self.out[i] or self.route[i] == self.route[j]:
            return self.remaining[j] < self.remaining[i]
        return (e + f) @ step > 0.0

    def factor(self, i, speed, length=0.3, time_gap=1.0):
        full = time_gap * speed
        ahead = [s for j, step, s in self.nearby(i, length + full) if self.brakes(i, j, step, length)]
        return min(1.0, max(0.0, (min(ahead, default=math.inf) - length) / full))

    def turn(self, i, length=0.3, repulsion=8.0, reach=0.1):
        near = self.nearby(i, length + reach * math.log(repulsion / 0.01))
        return -sum((repulsion * math.exp((length - s) / reach) * step / s for _, step, s in near), np.zeros(2))


@pytest.mark.parametrize("seed", range(4))
def test_everybody_does_what_a_search_over_all_pairs_tells(seed):
    """On levels behind portals and above each other, from which some have left."""
    draw = np.random.default_rng(seed)
    angles = draw.uniform(-math.pi, math.pi, 3)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    fields = uniform_fields(4, *map(tuple, directions))
    crowd, outside = crowd_of_storeys(draw, 500, far=seed % 2)
    walls, wall_level = draw.uniform(-6.0, 6.0, (16, 4)), np.repeat(range(4), 4)
    walls[:, 2:] = walls[:, :2] + 0.3 * (walls[:, 2:] - walls[:, :2])
    building = make_building(**STOREYS, walls=walls, wall_level=wall_level)
    pairs = Pairs(crowd, directions, walls, wall_level, outside)
    prepared(crowd, building, fields, outside, repulsion=0.0).act(crowd, 0.0)
    for i in np.flatnonzero(pairs.level >= 0):
        expected = pairs.factor(i, crowd.speed[i, 0])
        found = (outside if pairs.out[i] else crowd).speed_factor[i]
        assert found == pytest.approx(expected, abs=1e-12), i
    prepared(crowd, building, fields, outside).act(crowd, 0.0)
    for i in np.flatnonzero(crowd.level >= 0):
        assert crowd.extra_direction[i] == pytest.approx(pairs.turn(i), abs=1e-9), i
    # Levels between two people, and whether each of them has left.
    inside = {(apart, False, is_out) for apart in range(3) for is_out in (False, True)}
    assert pairs.met == inside | {(0, True, True)}


def test_a_fast_person_ends_up_behind_a_slow_one_at_the_time_gap():
    """Both at 0.8 m/s at last, 0.3 m + 1 s x 0.8 m/s apart, and never in touch."""
    crowd = make_crowd([[-9.0, 0.0], [-7.0, 0.0]], speed=[1.6, 0.8], radius=0.14)
    behaviour, engine, model = prepared(crowd), make_engine(crowd), Nsm1()
    apart = []
    for tick in range(110):
        crowd.speed_factor[:] = 1.0
        crowd.extra_direction[:] = 0.0
        behaviour.act(crowd, 0.1 * tick)
        engine.advance(model, crowd, 10 * tick, 10, 0.01, False, False)
        apart.append(crowd.position[1, 0] - crowd.position[0, 0])
    assert crowd.velocity[:, 0] == pytest.approx(0.8, abs=1e-3)
    assert apart[-1] == pytest.approx(1.1, abs=2e-3)
    assert min(apart) > 0.28
