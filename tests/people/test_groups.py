import pytest
from shapely import box

import evac
from evac.base.errors import ScenarioError
from evac.directions.routes import Route
from evac.people.groups import check_people, default_clearance, narrowest_body, reference_speeds, routes_of


def group(name="all", **keys):
    return {"name": name, "number": 2, "area": "room 0", **keys}


def test_routes_are_listed_once_in_the_order_of_the_groups(make_case):
    case = make_case(
        group("a", strategy="shortest"), group("b"), group("c", exits=["door"]), group("d", strategy="shortest")
    )
    assert routes_of(case) == (Route(strategy="shortest"), Route(), Route(("door",), "fastest"))


def test_reference_speeds_are_the_people_s_means_over_the_flat(make_case):
    case = make_case(
        group("a", number=3, speed=2.0, speed_up={"factor": {"uniform": [0.4, 0.6]}}, speed_down=1.0),
        group("b", number=1, speed={"uniform": [1.0, 3.0]}, speed_up=0.6, speed_down={"uniform": [0.5, 1.5]}),
    )
    flat, up, down = reference_speeds(case)
    assert flat == 1.0
    assert up == pytest.approx((3 * 0.5 * 2 + 0.6) / 8, rel=1e-12)
    assert down == pytest.approx((3 + 1.0) / 8, rel=1e-12)


def test_the_clearance_is_the_greatest_radius_but_at_most_twice_the_greatest_mean(make_case):
    few = group("few", number=10, radius={"list": [0.15] * 9 + [0.9]})
    assert default_clearance(make_case(few, group("slim", radius=0.2))) == pytest.approx(0.45, rel=1e-12)
    assert default_clearance(make_case(group(radius={"uniform": [0.2, 0.3]}))) == 0.3


def test_the_narrowest_body_is_the_smallest_that_can_be_drawn(make_case):
    wide, narrow = group("wide", radius=0.25), group("narrow", radius={"uniform": [0.18, 0.3]})
    assert narrowest_body(make_case(wide, narrow)) == pytest.approx(0.36, rel=1e-12)
    assert narrowest_body(make_case(wide, group("narrow", radius=0.2))) == pytest.approx(0.4, rel=1e-12)


def test_slow_people_are_by_default_no_faster_on_stairs(make_case):
    assert reference_speeds(make_case(group(speed=0.5))) == (1.0, 1.0, 1.0)


def test_what_the_case_sets_goes_before_the_mean(make_case):
    case = make_case(group(speed=0, speed_up=0), directions={"stairs_up": 0.4, "stairs_down": 0.7})
    assert reference_speeds(case) == (1.0, 0.4, 0.7)


def test_unknown_names_are_refused_all_at_once_with_the_closest_there_is(make_case, house):
    case = make_case(
        group("a", area="rom 2"),
        group("b", exits=["dor"]),
        {"name": "c", "positions": [[1, 1]], "level": "wets 0"},
    )
    with pytest.raises(ScenarioError) as caught:
        check_people(case, house)
    assert str(caught.value).splitlines() == [
        f"{case.source}: people.a.area: unknown area 'rom 2'; did you mean 'room 2'?",
        f"{case.source}: people.b.exits: unknown exit 'dor'; did you mean 'door'?",
        f"{case.source}: people.c.level: unknown level 'wets 0'; did you mean 'west 0'?",
    ]


def test_a_position_on_a_stair_needs_the_name_of_its_piece(make_case):
    plan = evac.Plan()
    for name, z in (("low", 0.0), ("high", 3.0)):
        plan.storey(name, box(0, 0, 10, 4), z=z)
    plan.stair("west", "low", [(2, 1), (2, 2)], "high", length=5.0, direction=(1, 0))
    plan.exit("door", "low", [(0, 1), (0, 2)])
    case = make_case({"name": "p", "positions": [[4, 1.5]], "level": "west"})
    with pytest.raises(ScenarioError, match=r"people\.p\.level: .*west flight z=0\.00\.\.3\.00"):
        check_people(case, plan.building())
