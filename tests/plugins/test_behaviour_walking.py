"""Walking: headings and speeds against the equations solved independently; nobody is stuck, pushed or seen by walls."""

import math

import numpy as np
import pytest
from shapely import box

import evac
from evac.analysis.lines import steady_flow
from evac.evidence.comfort.page import TOWER, comfort
from evac.evidence.mobility.page import flow_through
from evac.people.behaviour import BehaviourScene
from evac.people.outside import make_outside
from evac.physics.state import make_crowd
from evac.simulation.scene import SharedScene
from evac.simulation.shared import simulation_of
from evac.simulation.simulation import Simulation
from evac_plugins.behaviour_walking import Walking
from tests.physics.scenes import make_building, uniform_fields
from tests.runs import MODELS, assert_same_bits, run_ticks

WAYS = np.array([(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (math.sqrt(0.8), math.sqrt(0.2))])
EAST, WEST, NORTH, BESIDE = range(4)

#: Speed and radius of all people of the exact tests, and the parameters, which need not be the defaults.
SPEED, RADIUS, B, LENGTH, T, TA = 1.2, 0.15, 0.55, 0.43, 0.78, 2.0
HORIZON, STOP, RIGHT = 2.5, 0.5, 0.1
LAW = {"chest_depth": 2.0 * RADIUS, "breadth": B, "length": LENGTH, "headway": T, "anticipation": TA, "creep": 0.2}
CLEARANCE = 0.18
LAW |= {
    "clearance": CLEARANCE,
    "horizon": HORIZON,
    "stop_time": STOP,
    "right": RIGHT,
    "push": 1.0,
}

#: A tick within which no heading turns, and a reaction time within which all do.
NO_TIME, AT_ONCE = 1e-13, {"reaction_time": 0.0}


def acted(
    place, velocity=0.0, route=0, start=0.0, ticks=1, tick=0.1, radius=RADIUS, building=None, heading=0.0, **parameters
):
    """Return the shares of the desired speed and the directions of people on whom the behaviour has acted."""
    crowd = make_crowd(place, speed=SPEED, radius=max(0.22, radius), contact_radius=radius, start_time=start)
    crowd.route[:] = route
    building = building or make_building()
    scene = SharedScene(building, uniform_fields(len(building.levels), *WAYS))
    moved = np.array(np.broadcast_to(velocity, crowd.position.shape), dtype=np.float64)
    outside = make_outside(len(crowd.level))
    view = BehaviourScene(crowd, scene, (), np.random.default_rng(1), tick, outside, displacement_velocity=moved)
    behaviour = Walking(**(LAW | parameters))
    behaviour.prepare(view)
    behaviour.heading[:] = heading
    for step in range(ticks):
        crowd.speed_factor[:], crowd.extra_direction[:] = 1.0, 0.0
        behaviour.act(crowd, tick * step)
    return crowd.speed_factor, crowd.extra_direction + WAYS[crowd.route]


def speed_after(place, velocity=0.0, **others):
    """Return the speed of the first person along its way [m/s]."""
    return SPEED * acted(place, velocity, tick=NO_TIME, **others)[0][0]


def speed_left(place, moved, heading=WAYS[EAST], length=LENGTH, excess=0.0):
    """Return the speed along a heading that somebody who walks the same way leaves, for bodies wider by an excess."""
    beside = heading[0] * place[1] - heading[1] * place[0]
    later = beside + T * (heading[0] * moved[1] - heading[1] * moved[0])
    near = 0.0 if beside * later <= 0.0 else min(abs(beside), abs(later))
    share = min(2.0 * (1.0 - (near - excess) / B), 1.0)
    if share <= 0.0 or heading @ place <= 0.0:
        return math.inf
    return (math.hypot(*place) - excess - share * length + TA * max(moved @ heading, 0.0)) / (share * (T + TA))


@pytest.mark.parametrize(
    ("distance", "across"), [(0.5, 0.0), (0.9, 0.27), (1.1, -0.4), (1.1, 0.54), (1.1, 0.56), (2.8, 0.3)]
)
@pytest.mark.parametrize("moved", [(0.0, 0.0), (-0.5, 0.0), (0.4, 0.0), (1.0, 0.0), (0.1, -0.25), (0.1, 0.5)])
@pytest.mark.parametrize("excess", [0.0, 0.5])
def test_the_speed_behind_somebody_is_that_of_the_equation(distance, across, moved, excess):
    """For several distances, places beside the way and motions; wide bodies are farther apart by their excess width."""
    place = np.array([distance + excess, across])
    speed = speed_after([[0.0, 0.0], place], [[0.0, 0.0], moved], radius=RADIUS + 0.5 * excess)
    assert speed == pytest.approx(min(speed_left(place, np.array(moved), excess=excess), SPEED), rel=1e-9)


def test_the_equation_of_the_speed_in_numbers():
    """Single file; at 3/4 of the breadth, half the weight; the middle for those who change sides."""
    assert speed_left(np.array([1.1, 0.0]), np.zeros(2)) == pytest.approx(0.67 / 2.78)
    assert speed_left(np.array([1.1, 0.4125]), np.zeros(2)) == pytest.approx((1.174800 - 0.215) / 1.39, rel=1e-6)
    assert speed_left(np.array([1.2, 0.3]), np.array([0.1, -0.5])) == pytest.approx((1.236932 - 0.23) / 2.78, rel=1e-6)


@pytest.mark.parametrize("speed", [0.1, 0.24, 0.5, 0.79, 1.1])
def test_in_single_file_distances_are_the_length_and_the_headway_times_the_speed(speed):
    place, moved = [[0.0, 0.0], [LENGTH + T * speed, 0.0]], [[speed, 0.0]] * 2
    assert speed_after(place, moved) == pytest.approx(speed, rel=1e-9)


def test_on_stairs_people_stop_farther_behind_others():
    building = make_building()
    building.levels[0].uphill[:] = (0.6, 0.0)
    speed = speed_after([[0.0, 0.0], [1.5, 0.0]], building=building, stair_length=0.8)
    assert speed == pytest.approx((1.5 - 0.8) / (T + TA), rel=1e-9)


def way_until_touch(place, moved, heading, reach):
    """Return how far a person walks along a heading until it touches another one, by the roots of a polynomial [m]."""
    motion = moved - SPEED * np.asarray(heading)
    if np.hypot(*motion) < 0.03 or motion @ place >= 0.0:
        return math.inf
    roots = np.roots([motion @ motion, 2.0 * motion @ place, place @ place - reach * reach])
    return SPEED * roots.real.min() if abs(roots.imag).max() == 0.0 else math.inf


def seen_as(place, route, stands):
    """Return how a person on the way east at the origin counts another one: as leading, passing, standing or not."""
    if stands:
        return "stands"
    is_ahead = (WAYS[EAST] + WAYS[route]) @ place > 0.0
    if WAYS[EAST] @ WAYS[route] > math.sqrt(0.5):
        return "leads" if is_ahead else None
    return "passes" if is_ahead or route == WEST else None


def expected_motion(place, moved, route, stands):
    """Return the heading and the speed by which a person at the origin that walks east gets on best."""
    others = [(p, u, seen_as(p, r, s), r) for p, u, r, s in zip(place, moved, route, stands, strict=True)]
    others = [other for other in others if other[2] and other[0][0] >= 0.0]

    def left_by(heading, other, time):
        at, velocity, kind, route = other
        if kind == "leads":
            return speed_left(at, velocity, heading)
        if kind == "passes" and heading @ WAYS[route] < 0.0:
            relative = SPEED * heading - velocity
            at = at + RIGHT * np.array([-relative[1], relative[0]]) / np.hypot(*relative)
        return way_until_touch(at, velocity, heading, 2.0 * RADIUS + 0.05) / time

    def product(angle):
        heading = np.array([math.cos(angle), math.sin(angle)])
        left = min([SPEED, *(left_by(heading, other, HORIZON) for other in others)])
        return max(left, 0.0) * math.cos(angle)

    angles = sorted((math.radians(15.0 * k) for k in range(-5, 6)), key=lambda angle: (abs(angle), angle))
    best = max(angles, key=product)
    heading = np.array([math.cos(best), math.sin(best)])
    return heading, max(0.0, min([SPEED, *(left_by(heading, other, STOP) for other in others)]))


@pytest.mark.parametrize("seed", range(15))
def test_headings_and_speeds_are_the_best_by_the_equations(seed):
    """Of people at random places who walk the same way, cross, oppose or stand, all out of reach."""
    chance = np.random.default_rng(seed)
    angle, distance = chance.uniform(-2.0, 2.0, 7), chance.uniform(1.05, 3.4, 7)
    place = distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    route, stands = chance.integers(0, 4, 7), chance.random(7) < 0.2
    moved = np.where(stands[:, None], 0.0, WAYS[route] * chance.uniform(0.3, 1.3, (7, 1)))
    factor, heading = acted(
        np.vstack([np.zeros(2), place]),
        np.vstack([np.zeros(2), moved]),
        [EAST, *route],
        [0.0, *np.where(stands, 60.0, 0.0)],
        **AT_ONCE,
    )
    expected, speed = expected_motion(place, moved, route, stands)
    assert heading[0] == pytest.approx(expected, abs=1e-9)
    assert SPEED * factor[0] == pytest.approx(speed, abs=1e-9) or speed < 0.2 == pytest.approx(SPEED * factor[0])


@pytest.mark.parametrize("first", range(2))
def test_motion_does_not_depend_on_the_order_of_people(first):
    place = np.array([[0.0, 0.0], [0.36, 0.16], [0.38, -0.14], [0.8, 0.0], [-0.3, 0.2]])
    velocity = np.array([[0.5, 0.0], [0.1, 0.0], [-0.3, 0.1], [0.0, 0.2], [0.9, 0.0]])
    route = np.array([EAST, EAST, WEST, NORTH, EAST])
    order = np.roll(np.arange(5), first)[::-1]
    for found, others in zip(
        acted(place, velocity, route), acted(place[order], velocity[order], route[order]), strict=True
    ):
        assert others == pytest.approx(found[order], rel=1e-12)


def test_of_two_who_cross_only_the_one_behind_gives_way():
    place, velocity = [[0.0, 0.0], [1.5, -1.2]], [[1.2, 0.0], [0.0, 1.2]]
    factor, heading = acted(place, velocity, [EAST, NORTH], **AT_ONCE)
    # The sum of the ways points north-east, and the second person is farther along it.
    assert heading[0] != pytest.approx(WAYS[EAST], abs=0.1) or factor[0] < 0.9
    assert (factor[1], *heading[1]) == pytest.approx((1.0, *WAYS[NORTH]))


@pytest.mark.parametrize("across", [0.0, -0.1, 0.02])
def test_people_who_come_towards_each_other_pass_on_the_right(across):
    _, heading = acted([[0.0, 0.0], [2.0, across]], [[1.2, 0.0], [-1.2, 0.0]], [EAST, WEST], **AT_ONCE)
    assert heading[0, 1] < 0.0 < heading[1, 1]


def test_the_heading_turns_within_the_reaction_time():
    scene = [[0.0, 0.0], [1.0, 0.1]], 0.0
    _, fast = acted(*scene, **AT_ONCE)
    _, slow = acted(*scene, reaction_time=0.3)
    share = 1.0 - math.exp(-0.1 / 0.3)
    expected = (1.0 - share) * WAYS[EAST] + share * fast[0]
    assert abs(fast[0, 1]) > 0.2
    assert slow[0] == pytest.approx(expected / np.hypot(*expected), rel=1e-9)
    assert acted(*scene, ticks=60, reaction_time=0.3)[1][0] == pytest.approx(fast[0], abs=1e-5)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("before", "moved", "aim"),
    [
        ((-0.96, 0.28), (0.3, -0.4), (0.28, 0.96)),  # to the side of the heading before
        ((0.28, 0.96), (-0.3, 0.4), (0.8, 0.6)),  # to that of the velocity
        ((-0.8, 0.6), (-0.4, -0.3), (-0.6, 0.8)),  # the one to which the heading turns, not the velocity
        ((0.28, 0.96), (-0.09, 0.12), (1.0, 0.0)),  # who hardly moves turns at once
    ],
)
def test_who_turns_round_turns_to_the_side_first(before, moved, aim, side):
    before, moved, aim = (np.array([x, side * y]) for x, y in (before, moved, aim))
    factor, heading = acted([[0.0, 0.0]], [moved], heading=before, reaction_time=0.3)
    expected = before + (1.0 - math.exp(-0.1 / 0.3)) * (aim - before)
    assert heading[0] == pytest.approx(expected / np.hypot(*expected), rel=1e-9)
    assert factor[0] == pytest.approx(1.0)


@pytest.mark.parametrize("distance", [0.32, 0.38])
def test_people_wait_behind_those_on_their_route_and_creep_behind_others(distance):
    place = [[0.0, 0.0], [distance, 0.0]]
    assert speed_after(place, creep=0.1) == pytest.approx(0.0, abs=1e-9)
    assert speed_after(place, route=[EAST, WEST], creep=0.1, push=0.1) == pytest.approx(0.1)


def test_wide_people_who_look_hardly_ahead_wait_behind_whom_they_touch():
    assert speed_after([[0.0, 0.0], [0.8, 0.0]], radius=0.4, horizon=0.1) == pytest.approx(0.0, abs=1e-9)


def test_nobody_in_an_enclosure_of_stairs_turns_round_within_a_tick_or_steps_over_a_portal_and_back():
    moments = comfort(TOWER, "DEM", 8)
    assert moments["turns away"] == 0
    assert moments["step back"] <= 2
    assert moments["greatest way back [m]"] < 0.3


@pytest.mark.parametrize("wall", [-0.12, 0.16, 0.25])
@pytest.mark.parametrize("drift", [0.0, 0.1])
@pytest.mark.parametrize("radius", [0.15, 0.4])
def test_people_step_away_from_walls_by_a_damped_law(wall, drift, radius):
    """The distance is the one after the reaction time and the relaxation time; wide bodies are farther away."""
    excess = radius - 0.15
    wall += math.copysign(excess, wall)
    walls = [(-1.0, wall, 3.0, wall), (-1.0, math.copysign(3.0, -wall), 3.0, math.copysign(3.0, -wall))]
    parameters = {"building": make_building(walls=walls), "radius": radius, "tick": 50.0, "reaction_time": 0.2}
    _, heading = acted([[0.0, 0.0]], [[1.0, drift]], **parameters)
    later = abs(wall) - math.copysign(drift, wall * drift) * (0.2 + 0.5)
    step = max(0.18 + excess - later, 0.0) / (B / 2)
    assert heading[0, 1] / heading[0, 0] == pytest.approx(-math.copysign(step, wall), abs=1e-9)


@pytest.mark.parametrize(("width", "start"), [(0.6, 0.2), (0.9, 0.5)])
def test_a_person_alone_in_a_narrow_corridor_walks_straight(width, start):
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 14, width))
    plan.exit("out", "floor", [(14, 0), (14, width)])
    people = {
        "name": "p",
        "level": "floor",
        "positions": [[1.0, max(start * width, 0.21)]],
        "speed": 1.3,
        "radius": 0.2,
    }
    content = {"building": plan, "people": [people], "behaviours": {"walking": {}}, "contact": {"model": "nsm2"}}
    simulation, moved = simulation_of(evac.load(content)), []
    while simulation.population.crowd.position[0, 0] < 13.0:
        simulation.advance_tick()
        moved.append(simulation.displacement_velocity[0].copy())
    later = np.array(moved)[30:]
    turned = np.degrees(np.arctan2(later[:, 1], later[:, 0]))
    assert math.sqrt(np.mean(turned**2)) < 4.0
    assert later[:, 0].mean() > 0.97 * 1.3


def test_nobody_is_seen_through_a_wall():
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 6, 4).difference(box(2.9, 0, 3.0, 3)))
    plan.exit("out", "floor", [(6, 1), (6, 2)])
    factor, heading = acted([[2.4, 1.0], [3.3, 1.0]], building=plan.building())
    assert factor[0] == pytest.approx(1.0)
    assert heading[0] == pytest.approx(WAYS[EAST])
    assert acted([[2.4, 3.5], [3.3, 3.5]], building=plan.building())[0][0] < 0.5


@pytest.mark.parametrize("across", [0.1, -0.1])
def test_people_pass_those_who_stand_on_the_nearer_side_with_a_gap(across):
    factor, heading = acted([[0.0, 0.0], [1.5, across]], start=[0.0, 60.0], **AT_ONCE)
    assert heading[0, 1] * across < 0.0
    assert abs(heading[0, 0] * across - heading[0, 1] * 1.5) >= 2.0 * RADIUS + 0.05
    assert factor[0] == pytest.approx(1.0)


def test_people_pass_on_the_farther_side_if_a_wall_is_on_the_nearer_one():
    walls = [(-1.0, -0.2, 3.0, -0.2)]
    _, heading = acted([[0.0, 0.0], [1.0, 0.1]], start=[0.0, 60.0], building=make_building(walls=walls), **AT_ONCE)
    assert heading[0, 1] > 0.4


@pytest.mark.parametrize(("start", "least"), [(60.0, 0.0), (math.inf, 0.2)])
def test_people_stop_before_those_who_have_not_started_and_creep_past_those_who_never_do(start, least):
    """A way of the relaxation time times the present velocity is left free."""
    scene = {"start": [0.0, start], "velocity": [[1.0, 0.0], [0.0, 0.0]], "tick": NO_TIME}
    far, near = (SPEED * acted([[0.0, 0.0], [x, 0.0]], **scene)[0][0] for x in (1.1, 0.7))
    assert far == pytest.approx((1.1 - 0.35 - 0.5 * 1.0) / STOP, rel=1e-9)
    assert near == pytest.approx(least, abs=1e-9)


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


@pytest.mark.parametrize(("force", "runs"), [({}, 2), ({"social": {}}, 2)])
def test_who_has_not_started_is_walked_around_and_not_pushed(force, runs):
    """Of people who keep no clearance, 3 % are pushed by more than 0.01 m, and with the social force more than half."""
    for seed in range(1, 1 + runs):
        simulation = simulation_of(waiting(force, seed))
        crowd, start = simulation.population.crowd, simulation.start_position
        while not simulation.ended:
            simulation.advance_tick()
            stands = (crowd.level >= 0) & (simulation.time <= crowd.start_time)
            assert np.hypot(*(crowd.position - start)[stands].T).max(initial=0.0) < 0.01
        assert simulation.ended == "everybody out"


def among_others(seed):
    """Return a case of 30 people who walk through 8 who stand in a corridor."""
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
    return evac.load(content | {"contact": {"model": "nsm2"}, "simulation": {"seed": seed}})


@pytest.mark.parametrize("seed", [2, 12])
def test_a_crowd_walks_through_people_who_stand_and_pushes_none(seed):
    simulation = simulation_of(among_others(seed))
    people = simulation.population.crowd
    stands, start = people.start_time > 0.0, people.position.copy()
    run_ticks(simulation, round(20.0 / simulation.case.simulation.tick))
    assert np.hypot(*(people.position - start)[stands].T).max() < 0.01
    assert (people.level[~stands] < 0).mean() > 0.8


def test_people_wait_behind_a_row_of_people_who_close_a_corridor():
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 12, 2))
    plan.exit("out", "floor", [(12, 0), (12, 2)])
    row = {"name": "row", "positions": [[6.0, 0.25 + 0.5 * k] for k in range(4)], "level": "floor"}
    row["behaviours"] = {"response_time": {"time": {"constant": 20.0}}}
    others = {"name": "others", "positions": [[2.0, 0.6], [3.0, 1.3], [4.0, 1.0]], "level": "floor"}
    behaviours = {"walking": {}, "response_time": {}}
    content = {"building": plan, "people": [row, others], "behaviours": behaviours, "contact": {"model": "nsm2"}}
    simulation = simulation_of(evac.load(content))
    crowd, tick = simulation.population.crowd, simulation.case.simulation.tick
    run_ticks(simulation, round(20.0 / tick))
    stands = crowd.start_time > 0.0
    assert crowd.position[stands] == pytest.approx(simulation.start_position[stands], abs=0.01)
    assert crowd.position[~stands, 0].max() < 6.0
    run_ticks(simulation, round(40.0 / tick))
    assert simulation.ended == "everybody out"


def beside_a_wheelchair(gap, wide, number, seed):
    """Return a case of people who pass a wheelchair that stays, with a gap on one side and room `wide` on the other."""
    plan, width = evac.Plan(), wide + 0.8 + gap
    plan.storey("floor", box(0, 0, 12, width))
    plan.exit("out", "floor", [(12, 0), (12, width)])
    plan.area("from", "floor", box(0.3, 0.25, 3, width - 0.25))
    chair = {"name": "chair", "positions": [[6.0, wide + 0.4]], "level": "floor", "radius": 0.4, "turns": False}
    others = {"name": "others", "area": "from", "number": number, "speed": {"normal": [1.34, 0.26], "minimum": 0.7}}
    content = {"building": plan, "people": [chair | {"leave": False}, others], "contact": {"model": "nsm2"}}
    return evac.load(content | {"behaviours": {"walking": {}}, "simulation": {"seed": seed, "duration": 40.0}})


@pytest.mark.parametrize(
    ("gap", "wide", "number"), [(0.32, 0.0, 1), (0.4, 0.0, 6), (0.6, 0.0, 6), (0.25, 1.0, 6), (0.334, 1.0, 6)]
)
def test_who_stands_firm_is_passed_where_a_body_fits_and_not_pushed(gap, wide, number):
    """Bodies are 0.3 m deep; nobody swings before a gap that is too narrow, beside one that is wide enough."""
    for seed in (1, 2):
        simulation = simulation_of(beside_a_wheelchair(gap, wide, number, seed))
        while not simulation.ended:
            simulation.advance_tick()
        crowd = simulation.population.crowd
        assert (crowd.level == [0] + [-1] * number).all()
        assert crowd.position[0] == pytest.approx(simulation.start_position[0], abs=0.001)


@pytest.mark.parametrize("radius", [0.4, 0.14])
def test_two_who_meet_at_a_door_along_its_wall_both_pass(radius):
    """Their headings are opposite, and their route is the same."""
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 8, 8))
    plan.exit("out", "floor", [(8, 3.5), (8, 4.5)])
    places = [[7.5, 3.6], [7.5, 3.75 + 2.0 * radius]]
    people = {"name": "p", "level": "floor", "positions": places, "radius": radius, "turns": radius < 0.2}
    content = {"building": plan, "people": [people], "behaviours": {"walking": {}}, "contact": {"model": "nsm2"}}
    assert evac.run(evac.load(content | {"simulation": {"duration": 20.0}})).ended == "everybody out"


@pytest.mark.parametrize(("width", "seed"), [(0.815, 102), (1.0, 117)])
def test_people_in_wheelchairs_pass_a_door_that_is_hardly_wider_than_they_are(width, seed):
    assert flow_through(width, 1.0, seed)["left"] == 0


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


def test_with_regulation_at_most_as_many_pass_as_tests_prescribe():
    results = evac.run(room(1.0, 40, preset="regulation"))
    assert results.ended == "everybody out"
    measured = evac.run(room(1.0, 40))
    assert steady_flow(np.sort(results.crowd.exit_time)) < 1.33 < steady_flow(np.sort(measured.crowd.exit_time))


def test_people_without_an_open_way_stand_until_one_opens():
    simulation = simulation_of(room(0.8, 20))
    for change in [(1.0, "close"), (3.0, "open")]:
        simulation.scene.apply(evac.Change(*change, "out"))
    tick, crowd = simulation.case.simulation.tick, simulation.population.crowd
    run_ticks(simulation, round(2.9 / tick))
    standing = crowd.position.copy()
    assert np.hypot(*simulation.displacement_velocity.T).max() < 0.1
    run_ticks(simulation, round(1.0 / tick))
    assert np.hypot(*(crowd.position - standing).T).mean() > 0.1


def test_bodies_have_the_depth_of_the_chest():
    crowd = simulation_of(room(0.8, 20)).population.crowd
    assert (crowd.contact_radius == 0.15).all()
    assert (crowd.radius >= 0.2).all()


def test_a_single_person_walks_as_with_all_parts():
    """Whose heading turns within the reaction time, too."""
    alone = room(0.8, 1).change({"simulation.seed": 5})
    simulations = [Simulation(alone, full=full) for full in (False, True)]
    one, other = (run_ticks(simulation, 30) for simulation in simulations)
    assert_same_bits(one, other)
