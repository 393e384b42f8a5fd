"""Walking: the speed, the side step and the turn against exact numbers; nobody is stuck at a narrow door."""

import math
from itertools import permutations

import numpy as np
import pytest
from shapely import box

import evac
from evac.evidence.mobility.page import flow_through
from evac.people.behaviour import BehaviourScene
from evac.people.outside import make_outside
from evac.physics.state import make_crowd
from evac.simulation.scene import Scene, SharedScene
from evac.simulation.simulation import Simulation
from evac_plugins.behaviour_walking import Walking
from tests.physics.scenes import make_building, uniform_fields
from tests.runs import MODELS, assert_same_bits, run_ticks

EAST, WEST = (1.0, 0.0), (-1.0, 0.0)

#: Parameters by which nobody steps aside.
STRAIGHT = {"side_step": 0.0}


def acted(position, velocity=0.0, ticks=1, fields=None, route=None, contact_radius=0.14, building=None, **parameters):
    """Return the factors and headings of people at places after the behaviour has acted on them."""
    crowd = make_crowd(position, speed=1.2, radius=0.22, contact_radius=contact_radius)
    if route is not None:
        crowd.route[:] = route
    building = building or make_building()
    scene = Scene(SharedScene(building, fields or uniform_fields(len(building.levels))))
    moved = np.array(np.broadcast_to(velocity, crowd.position.shape), dtype=np.float64)
    behaviour = Walking(**parameters)
    outside = make_outside(len(crowd.level))
    view = BehaviourScene(crowd, scene, (), np.random.default_rng(1), 0.1, outside, displacement_velocity=moved)
    behaviour.prepare(view)
    for tick in range(ticks):
        crowd.speed_factor[:], crowd.extra_direction[:] = 1.0, 0.0
        behaviour.act(crowd, 0.1 * tick)
    way = np.where(np.asarray(crowd.route)[:, None] == 0, EAST, WEST)
    return crowd.speed_factor, crowd.extra_direction + way


@pytest.mark.parametrize("leader", [0.0, 0.5, -0.5])
@pytest.mark.parametrize("distance", [0.7, 1.0])
def test_the_speed_anticipates_the_motion_of_the_person_ahead(distance, leader):
    velocity = [[0.3, 0.0], [leader, 0.0]]
    factor, _ = acted([[0.0, 0.0], [distance, 0.0]], velocity, time_gap=1.0, length=0.4, anticipation=0.25, **STRAIGHT)
    assert factor == pytest.approx([share_at(distance - 0.4 + 0.25 * max(leader, 0.0)), 1.0], rel=1e-12)


def share_at(speed):
    """Return the share of the desired speed of 1.2 m/s at which people walk if a distance allows a speed [m/s]."""
    return min(max(speed / 1.2, 0.0), 1.0)


@pytest.mark.parametrize(("distance", "is_free"), [(1.55, False), (1.6, True), (1.65, True)])
def test_the_speed_is_the_desired_one_from_a_distance_on(distance, is_free):
    factor, _ = acted([[0.0, 0.0], [distance, 0.0]], time_gap=1.0, length=0.4, **STRAIGHT)
    assert factor[0] == pytest.approx(1.0, abs=0.05)
    assert (factor[0] == pytest.approx(1.0, rel=1e-12)) == is_free


@pytest.mark.parametrize(("sight", "expected"), [(0.75, 1.0), (0.85, 0.25)])
def test_people_farther_away_than_the_sight_are_not_heeded(sight, expected):
    factor, _ = acted([[0.0, 0.0], [0.8, 0.0]], time_gap=4.0 / 3.0, length=0.4, sight=sight, **STRAIGHT)
    assert factor[0] == pytest.approx(expected)


@pytest.mark.parametrize("distance", [0.3, 0.38])
def test_people_wait_behind_those_on_their_route_and_creep_behind_others(distance):
    position = [[0.0, 0.0], [distance, 0.0]]
    waiting, _ = acted(position, creep=0.1, **STRAIGHT)
    assert waiting == pytest.approx([0.0, 1.0])
    creeping, _ = acted(position, creep=0.1, fields=uniform_fields(1, EAST, EAST), route=[0, 1], **STRAIGHT)
    assert creeping == pytest.approx([0.1 / 1.2, 1.0])


@pytest.mark.parametrize("order", list(permutations(range(4))))
def test_the_speed_does_not_depend_on_the_order_of_people(order):
    position = np.array([[0.0, 0.0], [0.29, 0.1], [0.33, -0.1], [0.45, 0.0]])
    velocity = np.array([[0.0, 0.0], [0.1, 0.0], [0.03, 0.0], [0.0, 0.0]])
    route = np.array([0, 0, 1, 0])
    fields, some = uniform_fields(1, EAST, EAST), list(order)
    factor, _ = acted(position[some], velocity[some], fields=fields, route=route[some], **STRAIGHT)
    first, _ = acted(position, velocity, fields=fields, route=route, **STRAIGHT)
    assert factor == pytest.approx(first[some], rel=1e-12)


@pytest.mark.parametrize("across", [0.0, 0.15, 0.25, -0.25, 0.49, 0.51])
def test_people_beside_the_way_take_a_share_of_it(across):
    parameters = {"width": 0.2, "edge": 0.3, "time_gap": 1.0, "length": 0.4, "anticipation": 0.0, **STRAIGHT}
    factor, _ = acted([[0.0, 0.0], [0.6, across]], **parameters)
    share = min((0.5 - abs(across)) / 0.3, 1.0)
    allowed = (math.hypot(0.6, across) - share * 0.4) / share if share > 0.0 else math.inf
    assert factor[0] == pytest.approx(share_at(allowed), rel=1e-12)


@pytest.mark.parametrize("wall", [-0.2, 0.2, 0.35])
def test_people_step_away_from_walls(wall):
    walls = [(-1.0, wall, 3.0, wall), (-1.0, math.copysign(3.0, -wall), 3.0, math.copysign(3.0, -wall))]
    parameters = {"wall_step": 2.0, "wall_distance": 0.3, "reaction_time": 0.0}
    _, heading = acted([[0.0, 0.0]], building=make_building(walls=walls), **parameters)
    step = 2.0 * max(1.0 - abs(wall) / 0.3, 0.0)
    assert heading[0, 1] / heading[0, 0] == pytest.approx(-math.copysign(step, wall), abs=1e-9)


def oncoming(across, **parameters):
    """Return the factors and headings of two people who come towards each other."""
    position = [[0.0, 0.0], [1.0, across]]
    velocity = [[1.2, 0.0], [-1.2, 0.0]]
    return acted(
        position, velocity, fields=uniform_fields(1, EAST, WEST), route=[0, 1], reaction_time=0.0, **parameters
    )


@pytest.mark.parametrize("across", [0.0, 0.1, -0.1])
def test_people_who_come_towards_each_other_pass_on_the_right(across):
    _, heading = oncoming(across, right=0.3)
    assert heading[0, 1] < 0.0 < heading[1, 1]


def test_the_side_step_is_that_of_the_equation():
    # Approaching at 2.4 m/s from 1 m: 1 - 0.28 - 2.4 * 0.2 = 0.24 m of gap are left after 0.2 s.
    _, heading = oncoming(0.0, side_step=3.0, side_range=0.2, side_time=0.2)
    step = 3.0 * 2.0 * math.exp(-0.24 / 0.2)
    assert heading[0, 1] / heading[0, 0] == pytest.approx(-step, rel=1e-9)


def test_the_side_step_is_limited():
    _, heading = oncoming(0.0, side_step=50.0, side_limit=0.5)
    assert heading[0, 1] / heading[0, 0] == pytest.approx(-0.5)


def test_the_heading_turns_within_the_reaction_time():
    position, velocity = [[0.0, 0.0], [1.0, 0.1]], 0.0
    _, fast = acted(position, velocity, reaction_time=0.0)
    _, slow = acted(position, velocity, reaction_time=0.3)
    share = 1.0 - math.exp(-0.1 / 0.3)
    expected = (1.0 - share) * np.array(EAST) + share * fast[0]
    assert slow[0] == pytest.approx(expected / np.hypot(*expected), rel=1e-9)
    _, later = acted(position, velocity, ticks=40, reaction_time=0.3)
    assert later[0] == pytest.approx(fast[0], abs=1e-5)


def test_nobody_is_seen_through_a_wall():
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 6, 4).difference(box(2.9, 0, 3.0, 3)))
    plan.exit("out", "floor", [(6, 1), (6, 2)])
    factor, heading = acted([[2.6, 1.0], [3.3, 1.0]], building=plan.building(), wall_step=0.0)
    assert factor[0] == 1.0
    assert heading[0] == pytest.approx(EAST)


def room(width, number, **parameters):
    """Return a case of people who leave a room through a door of a width [m]."""
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 5, 5).union(box(5, 2.5 - width / 2, 5.2, 2.5 + width / 2)).union(box(5.2, 0, 8, 5)))
    plan.exit("out", "floor", [(8, 0), (8, 5)])
    plan.area("room", "floor", box(0.5, 0.5, 4.5, 4.5))
    people = {"name": "people", "area": "room", "number": number}
    content = {"building": plan, "people": [people], "contact": {"model": "nsm2"}, "output": {"trajectory": False}}
    return evac.load(content | {"behaviours": {"walking": parameters}, "simulation": {"duration": 120.0}})


@pytest.mark.parametrize("model", MODELS)
def test_nobody_is_stuck_at_a_narrow_door_and_nobody_is_crushed(model):
    results = evac.run(room(0.5, 40).change({"contact.model": model}))
    assert results.ended == "everybody out"
    assert 30.0 < results.time < 75.0
    assert not [line for line in results.quality_warnings if "lethal" in line]


def test_a_run_goes_on_to_the_same_bits():
    one, other = Simulation(room(0.8, 20)), Simulation(room(0.8, 20))
    run_ticks(one, 15)
    other.restore(one.state())
    for simulation in (one, other):
        run_ticks(simulation, 15)
    assert_same_bits(one, other)


@pytest.mark.parametrize("step", [0.0, 3.0])
def test_people_without_an_open_way_stand_until_one_opens(step):
    simulation = Simulation(room(0.8, 20, side_step=step))
    for change in [(1.0, "close"), (3.0, "open")]:
        simulation.scene.apply(evac.Change(*change, "out"))
    tick, crowd = simulation.case.simulation.tick, simulation.population.crowd
    run_ticks(simulation, round(2.9 / tick))
    standing = crowd.position.copy()
    assert np.hypot(*simulation.displacement_velocity.T).max() < 0.1
    run_ticks(simulation, round(1.0 / tick))
    assert np.hypot(*(crowd.position - standing).T).mean() > 0.1


def test_bodies_have_the_depth_of_the_chest():
    crowd = Simulation(room(0.8, 20)).population.crowd
    assert (crowd.contact_radius == 0.15).all()
    assert (crowd.radius >= 0.2).all()


def test_a_single_person_walks_as_with_all_parts():
    """Whose heading turns within the reaction time, too."""
    alone = room(0.8, 1).change({"simulation.seed": 5})
    simulations = [Simulation(alone, full=full) for full in (False, True)]
    one, other = (run_ticks(simulation, 30) for simulation in simulations)
    assert_same_bits(one, other)


def waiting(force, seed):
    """Return RiMEA 5: ten people at random places, who start to leave a room after 10 to 100 s."""
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 5, 8))
    plan.exit("out", "floor", [(2, 8), (3, 8)])
    plan.area("room", "floor", box(0.3, 0.3, 4.7, 7.7))
    people = {"name": "people", "area": "room", "number": 10, "speed": {"normal": [1.34, 0.26], "minimum": 0.7}}
    behaviours = {"walking": {}, "response_time": {"time": {"uniform": [10.0, 100.0]}}}
    content = {"building": plan, "people": [people], "behaviours": behaviours, "forces": force}
    return evac.load(content | {"simulation": {"duration": 150.0, "seed": seed}, "contact": {"model": "nsm2"}})


@pytest.mark.parametrize("force", [{}, {"social": {}}])
def test_who_has_not_started_is_walked_around_and_not_pushed(force):
    """Of people who keep no clearance, 3 % are pushed by more than 0.01 m, and with the social force more than half."""
    for seed in range(1, 6):
        simulation = Simulation(waiting(force, seed))
        crowd, start = simulation.population.crowd, simulation.start_position
        while not simulation.ended:
            simulation.advance_tick()
            stands = (crowd.level >= 0) & (simulation.time <= crowd.start_time)
            assert np.hypot(*(crowd.position - start)[stands].T).max(initial=0.0) < 0.01
        assert simulation.ended == "everybody out"


@pytest.mark.parametrize("seed", [2, 8, 12])
def test_a_crowd_walks_through_people_who_stand_and_pushes_none(seed):
    """A person who turned into somebody beside it, or whose way led along a wall, pushed one by up to 0.11 m."""
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 16, 4))
    plan.exit("out", "floor", [(16, 0), (16, 4)])
    for name, ends in {"from": (0.3, 5.0), "among": (7.0, 11.0)}.items():
        plan.area(name, "floor", box(ends[0], 0.3, ends[1], 3.7))
    each = {"speed": {"normal": [1.34, 0.26], "minimum": 0.7}}
    crowd = each | {"name": "crowd", "area": "from", "number": 30}
    others = each | {"name": "others", "area": "among", "number": 8}
    others["behaviours"] = {"response_time": {"time": {"constant": 200.0}}}
    content = {"building": plan, "people": [crowd, others], "behaviours": {"walking": {}, "response_time": {}}}
    simulation = Simulation(evac.load(content | {"contact": {"model": "nsm2"}, "simulation": {"seed": seed}}))
    people = simulation.population.crowd
    stands, start = people.start_time > 0.0, people.position.copy()
    run_ticks(simulation, round(20.0 / simulation.case.simulation.tick))
    assert np.hypot(*(people.position - start)[stands].T).max() < 0.01
    assert (people.level[~stands] < 0).mean() > 0.8


def passed(standing, walls=(), velocity=(0.0, 0.0)):
    """Return the factor and heading of a person at the origin that comes towards people who stand."""
    crowd = make_crowd([[0.0, 0.0], *standing], speed=1.2, radius=0.22, contact_radius=0.14)
    crowd.start_time[1:] = 60.0
    building = make_building(walls=walls)
    scene = Scene(SharedScene(building, uniform_fields(1)))
    moved = np.zeros_like(crowd.position)
    moved[0] = velocity
    behaviour = Walking(reaction_time=0.0)
    view = BehaviourScene(
        crowd, scene, (), np.random.default_rng(1), 0.1, make_outside(len(crowd.level)), displacement_velocity=moved
    )
    behaviour.prepare(view)
    behaviour.act(crowd, 0.0)
    return crowd.speed_factor[0], (crowd.extra_direction + EAST)[0]


@pytest.mark.parametrize("across", [0.1, -0.1])
def test_people_pass_those_who_stand_on_the_nearer_side_with_a_gap(across):
    factor, heading = passed([[1.0, across]])
    assert heading[1] * across < 0.0
    closest = abs(heading[0] * across - heading[1] * 1.0)
    assert 0.33 <= closest < 0.33 + math.radians(7.5)
    assert factor == 1.0


def test_people_pass_on_the_farther_side_if_a_wall_is_on_the_nearer_one():
    _, heading = passed([[1.0, 0.1]], walls=[(-1.0, -0.2, 3.0, -0.2)])
    assert heading[1] > 0.4


@pytest.mark.parametrize(("across", "expected"), [(-3.0, 0.0), (0.3, 1.0)])
def test_people_beside_those_who_stand_do_not_run_into_walls(across, expected):
    factor, _ = passed([[0.3, 0.9]], walls=[(0.45, across, 0.45, 3.0)], velocity=(1.2, 0.0))
    assert factor == pytest.approx(expected)


@pytest.mark.parametrize("behind", [-0.02, 0.02])
def test_people_behind_are_not_heeded(behind):
    """Of the direction of walking and of the heading, which are the same here."""
    _, heading = acted([[0.0, 0.0], [behind, 0.3]], velocity=[[0.0, 0.0], [0.0, -0.5]], reaction_time=0.0)
    assert (heading[0, 1] == 0.0) == (behind < 0.0)


def test_people_wait_behind_a_row_of_people_who_close_a_corridor():
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 12, 2))
    plan.exit("out", "floor", [(12, 0), (12, 2)])
    row = {"name": "row", "positions": [[6.0, 0.25 + 0.5 * k] for k in range(4)], "level": "floor"}
    row["behaviours"] = {"response_time": {"time": {"constant": 20.0}}}
    others = {"name": "others", "positions": [[2.0, 0.6], [3.0, 1.3], [4.0, 1.0]], "level": "floor"}
    behaviours = {"walking": {}, "response_time": {}}
    content = {"building": plan, "people": [row, others], "behaviours": behaviours, "contact": {"model": "nsm2"}}
    simulation = Simulation(evac.load(content))
    crowd, tick = simulation.population.crowd, simulation.case.simulation.tick
    run_ticks(simulation, round(20.0 / tick))
    stands = crowd.start_time > 0.0
    assert crowd.position[stands] == pytest.approx(simulation.start_position[stands], abs=0.01)
    assert crowd.position[~stands, 0].max() < 6.0
    run_ticks(simulation, round(40.0 / tick))
    assert simulation.ended == "everybody out"


@pytest.mark.parametrize("distance", [0.5, 0.8])
def test_people_with_wide_bodies_stop_farther_apart_by_what_they_are_wider(distance):
    """Two bodies of 0.8 m instead of 0.3 m: 0.5 m farther, ahead or beside."""
    one, _ = acted([[0.0, 0.0], [distance, 0.0]], **STRAIGHT)
    other, _ = acted([[0.0, 0.0], [distance + 0.5, 0.0]], contact_radius=0.4, **STRAIGHT)
    assert other[0] == pytest.approx(one[0], rel=1e-9)
    lane = {"width": 0.2, "edge": 0.1, **STRAIGHT}
    ahead, _ = acted([[0.0, 0.0], [distance + 0.5, 0.7]], contact_radius=0.4, **lane)
    beside, _ = acted([[0.0, 0.0], [distance + 0.5, 0.81]], contact_radius=0.4, **lane)
    assert ahead[0] < beside[0] == 1.0


@pytest.mark.parametrize(("wall", "step"), [(-0.45, 4.0 / 3.0), (-0.66, 0.0)])
def test_wide_bodies_step_away_from_walls_as_others_do_from_where_their_sides_are(wall, step):
    """A body of 0.8 m instead of 0.3 m: 0.25 m farther from the wall."""
    walls = [(-1.0, wall, 3.0, wall), (-1.0, 3.0, 3.0, 3.0)]
    parameters = {"wall_step": 4.0, "wall_distance": 0.3, "reaction_time": 0.0, "contact_radius": 0.4}
    _, heading = acted([[0.0, 0.0]], building=make_building(walls=walls), **parameters)
    assert heading[0, 1] / heading[0, 0] == pytest.approx(step, abs=1e-9)


@pytest.mark.parametrize(("radius", "turns_to_the_wall"), [(0.4, False), (0.14, True)])
def test_a_wide_body_that_touches_a_wall_does_not_step_towards_it(radius, turns_to_the_wall):
    walls = [(-1.0, -radius, 3.0, -radius), (-1.0, 3.0, 3.0, 3.0)]
    parameters = {"wall_step": 0.1, "reaction_time": 0.0, "contact_radius": radius}
    _, heading = acted([[0.0, 0.0], [0.05, 2.0 * radius]], building=make_building(walls=walls), **parameters)
    assert (heading[0, 1] < -0.1) == turns_to_the_wall
    assert heading[0, 1] < 1e-9


@pytest.mark.parametrize(("radius", "waits"), [(0.4, True), (0.14, False)])
def test_of_wide_bodies_that_meet_on_the_same_route_the_one_behind_waits(radius, waits):
    """Two people who come from both sides along the wall of a door: their headings are opposite."""
    simulation = Simulation(evac.load(before_a_door(radius)))
    crowd = simulation.population.crowd
    simulation.advance_tick()
    assert (crowd.speed_factor[1] < 0.1) == waits
    assert crowd.speed_factor[0] > 0.5


def before_a_door(radius):
    """Return a case of two people beside a door in the wall x = 8, the second one farther from it."""
    plan = {
        "storeys": [{"name": "f", "polygons": [[[0, 0], [8, 0], [8, 8], [0, 8]]]}],
        "exits": [{"name": "out", "storey": "f", "segment": [[8, 3.5], [8, 4.5]]}],
    }
    places = [[7.6, 3.6], [7.6, 3.75 + 2.0 * radius]]
    people = {"name": "p", "level": "f", "positions": places, "radius": radius, "turns": radius < 0.2}
    behaviours = {"walking": {"side_step": 0.0}}
    return {"building": {"plan": plan}, "people": [people], "behaviours": behaviours, "contact": {"model": "nsm2"}}


@pytest.mark.parametrize(("width", "seed"), [(0.9, 4), (0.815, 102), (1.0, 117)])
def test_people_in_wheelchairs_pass_a_door_that_is_hardly_wider_than_they_are(width, seed):
    assert flow_through(width, 1.0, seed)["left"] == 0
