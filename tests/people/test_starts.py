"""Where people start: rooms by number, density and use, and ground on which nobody starts."""

import pytest
import shapely

import evac
from evac.base.errors import ScenarioError

#: A corridor with two offices, a closet that only a gap of 0.3 m opens to, and the enclosure of a stair down.
FLOOR = shapely.box(0, 0, 20, 2)
OFFICES = [shapely.box(0, 2.2, 6, 8), shapely.box(6.2, 2.2, 12, 8)]
STAIRWELL, CLOSET = shapely.box(17, 2.2, 20, 7), shapely.box(12.2, 2.2, 14, 5)
DOORWAYS = [shapely.box(3, 2, 4, 2.2), shapely.box(9, 2, 10, 2.2), shapely.box(17.5, 2, 18.5, 2.2)]


def house(**rooms):
    """A plan whose room "one" has these arguments."""
    plan = evac.Plan("house")
    plan.storey("street", shapely.box(10, 10, 25, 20), z=-2.4)
    plan.storey("first", [FLOOR, STAIRWELL, CLOSET])
    plan.room("one", "first", OFFICES[0], use="office", **rooms)
    plan.room("two", "first", OFFICES[1], use="office")
    for name, x in (("one", 3), ("two", 9), ("stairs", 17.5)):
        plan.door(name, "first", [(x, 2.1), (x + 1, 2.1)])
    plan.door("gap", "first", [(13, 2.1), (13.3, 2.1)])
    plan.stair("down", "street", [(18.5, 12), (20, 12)], "first", [(18.5, 7), (20, 7)])
    plan.exit("out", "street", [(10, 12), (10, 14)])
    plan.exit("side", "first", [(0, 0), (0, 2)])
    return plan


def started(plan, *people, **tables):
    """The simulation of a case whose groups have these keys, before its first step."""
    groups = [{"name": f"group {k}", "speed": 1.2, **group} for k, group in enumerate(people)]
    case = {"building": {"plan": plan}, "people": groups, "contact": {"model": "nsm2"}, **tables}
    case.setdefault("directions", {"spacing": 0.2})
    return evac.Simulation(evac.load(case), will_run=False)


def stand_on(simulation, ground):
    """Whether the body of each person is on some ground."""
    crowd = simulation.population.crowd
    bodies = shapely.buffer(shapely.points(crowd.position), crowd.radius - 1e-3)
    return shapely.intersects(shapely.union_all(ground), bodies)


@pytest.mark.parametrize("number", [20, 330])  # at random, and on a lattice
def test_nobody_starts_in_doorways_in_the_enclosure_of_a_stair_or_without_a_way_out(number):
    simulation = started(house(), {"level": "first", "number": number})
    assert len(simulation.population.crowd.level) == number
    assert not stand_on(simulation, DOORWAYS).any()
    assert not stand_on(simulation, [STAIRWELL, CLOSET]).any()
    found = {one.text.split(" of ", 1)[1].rsplit(" in ", 1)[0]: one for one in simulation.population.left_out}
    ground = {kind: float(one.text.split()[3]) for kind, one in found.items()}
    assert ground == {
        "doorways": pytest.approx(3 * 0.2, abs=0.1),
        "enclosures of stairs": pytest.approx(STAIRWELL.area, abs=0.1),
        "floor without a way out": pytest.approx(CLOSET.area, rel=0.3),
    }
    for kind, places in (("enclosures of stairs", [STAIRWELL]), ("floor without a way out", [CLOSET])):
        assert shapely.union_all(places).covers(shapely.Point(found[kind].place))
    assert {(one.kind, one.level) for one in found.values()} == {("left out", "first")}


def test_a_case_may_name_the_enclosure_of_a_stair_and_people_who_stay_need_no_way_out():
    plan = house()
    plan.area("landing", "first", STAIRWELL.buffer(-0.1))
    plan.area("closet", "first", CLOSET.buffer(-0.1))
    named = started(plan, {"area": "landing", "number": 8}, {"area": "closet", "number": 4})
    assert stand_on(named, [STAIRWELL, CLOSET]).all()
    assert not named.population.left_out
    assert stand_on(started(house(), {"level": "first", "number": 330, "leave": False}), [CLOSET]).any()


def test_a_case_may_name_a_stair_with_all_its_pieces():
    plan = evac.Plan()
    plan.storey("low", shapely.box(0, 0, 9, 8))
    plan.storey("high", shapely.box(0, 0, 9, 8), z=3.0)
    plan.stair("up", "low", [(2, 2), (3.2, 2)], "high", length=3.0, direction=(0, 1), turn="right")
    plan.exit("out", "low", [(0, 1), (0, 2)])
    simulation = started(plan, {"level": "up", "number": 8})
    assert {*simulation.population.crowd.level.tolist()} == {*simulation.building.stairs["up"]}


def test_people_wait_where_an_event_opens_a_way_later():
    plan = house()
    event = [{"time": 5.0, "kind": "open", "target": "side"}]
    simulation = started(plan, {"level": "first", "number": 330}, event=event)
    assert stand_on(simulation, [CLOSET]).any()


@pytest.mark.parametrize(("depth", "is_enclosure"), [(1.2, True), (5.6, True), (5.8, False), (12.0, False)])
def test_a_room_around_a_stair_is_an_enclosure_where_all_of_it_is_within_3_m_of_the_stair(depth, is_enclosure):
    plan = evac.Plan("straight flight")
    plan.storey("low", shapely.box(0, 0, 20, 6))
    plan.storey("high", [shapely.box(0, 0, 8, 6), around := shapely.box(8.2, 2 - depth / 2, 14, 2 + depth / 2)], z=3.0)
    plan.door("landing", "high", [(8.1, 1.5), (8.1, 2.4)])
    plan.stair("flight", "low", [(15.0, 1.4), (15.0, 2.6)], "high", [(10.2, 1.4), (10.2, 2.6)])
    plan.exit("out", "low", [(0, 1), (0, 3)])
    simulation = started(plan, {"level": "high", "number": 40})
    assert stand_on(simulation, [around.buffer(-0.3)]).any() != is_enclosure


def test_a_room_with_the_use_of_a_stair_is_an_enclosure():
    plan = evac.Plan("two rooms")
    plan.storey("ground")
    plan.room("hall", "ground", shapely.box(0, 0, 6, 6))
    plan.room("core", "ground", shapely.box(6, 0, 9, 6), use="stair")
    plan.exit("out", "ground", [(0, 1), (0, 3)])
    assert not stand_on(started(plan, {"level": "ground", "number": 40}), [shapely.box(6.3, 0, 9, 6)]).any()


@pytest.mark.parametrize(
    ("rooms", "group", "numbers"),
    [
        ({"people": 3}, {"use": "office"}, [3, 6]),  # stated; 5.8 x 5.8 m2 at 6 m2 per person
        ({"density": 0.5}, {"use": "office"}, [17, 6]),
        ({}, {"use": "office", "density": 0.3}, [10, 10]),
        ({"people": 30}, {"use": "office", "number": 18}, [15, 3]),
        ({}, {"area": "two"}, [0, 6]),
        ({"people": 4}, {"area": "one"}, [4, 0]),
        ({}, {"area": "one", "density": 0.2}, [7, 0]),
    ],
)
def test_people_in_rooms_by_number_density_or_use(rooms, group, numbers):
    simulation = started(house(**rooms), group)
    assert [int(stand_on(simulation, [office]).sum()) for office in OFFICES] == numbers
    assert simulation.case.people[0].count == len(simulation.population.crowd.level) == sum(numbers)


@pytest.mark.parametrize(
    ("group", "key"),
    [
        ({"use": "ofice"}, "people.group 0.use: .*'office'"),
        ({"area": "lobby"}, "people.group 0.number: missing"),
        ({"level": "first"}, "people.group 0.number: missing"),
        ({"use": "office", "area": "one"}, "people.group 0.use"),
        ({"area": "one", "number": 3, "density": 1.0}, "people.group 0.density"),
        ({"positions": [[1.0, 1.0]], "level": "first", "density": 1.0}, "people.group 0.density"),
    ],
)
def test_what_does_not_tell_where_people_start_is_refused(group, key):
    plan = house()
    plan.area("lobby", "first", shapely.box(0, 0, 2, 2))
    with pytest.raises(ScenarioError, match=key):
        started(plan, group)
