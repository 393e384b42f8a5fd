"""What is unlikely to be meant in a plan is reported with its place: heights, areas, repairs, units, steep stairs."""

import pytest
import shapely
from shapely import Point, box

from evac import BuildingError, Plan


def two_storeys(z=3.0, polygons=None, **options):
    plan = Plan(**options)
    plan.storey("ground", box(0, 0, 18, 10))
    plan.storey("upper", polygons or box(0, 0, 18, 10), z=z)
    plan.exit("out", "ground", [(0, 4), (0, 5)])
    return plan


def warnings(plan):
    return [one for one in plan.building().findings if one.kind == "warning" and "exit can be reached" not in one.text]


def test_the_part_of_an_area_beside_the_floor_is_reported():
    plan = two_storeys()
    plan.area("half", "ground", box(13, 4, 23, 9))
    plan.area("inside", "ground", box(1, 1, 5, 5))
    plan.area("edge", "ground", box(8, 8, 18, 10.08))
    plan.obstacle("table", "ground", box(2, 2, 3, 3))
    found = {one.text.partition("area ")[2]: one for one in plan.building().findings if "m2 of area" in one.text}
    assert {name[:6]: one.kind for name, one in found.items()} == {"'half'": "warning", "'edge'": "left out"}
    (half,) = [one for one in found.values() if one.kind == "warning"]
    assert "25.00 of the 50.00 m2" in half.text
    assert box(18, 4, 23, 9).contains(Point(half.place))


def test_an_outline_that_crosses_itself_is_a_finding_beside_the_error_that_follows():
    plan = two_storeys(polygons=[(0, 0), (18, 10), (18, 0), (0, 10)])
    plan.stair("stair", "ground", [(2, 0.1), (2, 1.5)], "upper", length=5.0, direction=(1, 0))
    (repair,) = plan.findings
    assert (repair.kind, repair.level, repair.place) == ("repaired", "upper", (9.0, 5.0))
    with pytest.raises(BuildingError, match=r"stair 'stair': its upper edge .* 'upper'"):
        plan.surface()
    plan = two_storeys()
    plan.storey("other", [(0, 0), (18, 10), (18, 0), (0, 10)], z=6.0)
    plan.exit("off", "ground", [(9, 4), (9, 5)])
    with pytest.raises(BuildingError, match="exit 'off'") as caught:
        plan.surface()
    assert "crosses itself" not in str(caught.value)


def test_a_stair_too_steep_is_refused_with_the_length_it_needs():
    plan = two_storeys()
    plan.stair("main", "ground", [(2, 0.1), (2, 1.5)], "upper", length=1.0, direction=(1, 0))
    with pytest.raises(BuildingError, match=r"stair 'main'.*3\.00 m over 1\.00 m.*72 degrees.*2\.52 m") as caught:
        plan.building()
    assert "walkable_angle" in str(caught.value)
    assert plan.building(walkable_angle=75.0).stairs
    long = two_storeys()
    long.stair("main", "ground", [(2, 0.1), (2, 1.5)], "upper", length=2.52, direction=(1, 0))
    assert long.building().stairs


@pytest.mark.parametrize(("x", "kind"), [(-0.25, "assumed"), (-0.4, "warning")])
@pytest.mark.parametrize("ends", [(7, 8), (8, 7)])
def test_floor_added_up_to_an_exit_outside_is_reported(x, kind, ends):
    plan = two_storeys()
    plan.exit("outside", "ground", [(x, y) for y in ends])
    (found,) = [one for one in plan.building().findings if "'outside'" in one.text]
    assert (found.kind, found.level, found.place) == (kind, "ground", (x, 7.5))
    assert f"{-x:.2f} m" in found.text


@pytest.mark.parametrize(("polygon", "count"), [(box(8.9, 4, 9.1, 5), 1), (box(17.8, 4, 18.2, 5), 0)])
def test_an_exit_given_as_a_polygon_between_two_parts_of_the_floor_is_warned_of(polygon, count):
    plan = two_storeys()
    plan.exit("cut", "ground", polygon=polygon)
    found = [one for one in warnings(plan) if "'cut'" in one.text]
    assert [(one.level, polygon.covers(Point(one.place))) for one in found] == [("ground", True)] * count


def test_an_exit_given_as_a_polygon_in_another_is_left_out():
    plan = Plan()
    plan.storey("floor", box(0, 0, 10, 6))
    plan.exit("wide", "floor", polygon=box(9.7, 2, 10.3, 4))
    plan.exit("same", "floor", polygon=box(9.8, 2.5, 10.2, 3.5))
    plan.exit("beside", "floor", polygon=box(9.85, 3.6, 10.2, 4.2))  # of which 0.2 m are beside the other
    building = plan.building()
    assert [way.name for way in building.exits] == ["wide"]
    told = [(one.kind, one.item, one.remedy) for one in building.findings if one.item]
    assert sorted(told) == [("assumed", f"exits.{name}", "remove it") for name in ("beside", "same")]


def test_the_polygon_of_an_exit_almost_on_the_outline_is_at_it():
    """The rim of floor behind it ends 1e-6 m beside a corner of the polygon."""
    outline = [(6.8159, 363.0359), (12.9869, 363.7838), (21.4223, 363.1601), (20.3816, 347.9866), (2.4809, 352.4114)]
    polygon = [(18.8948, 363.3283), (18.8919, 363.2884), (17.0989, 363.421), (17.1018, 363.4609)]
    plan = Plan()
    plan.storey("floor", outline)
    plan.exit("out", "floor", polygon=polygon)
    assert [way.width for way in plan.building().exits] == [pytest.approx(1.8, abs=0.15)]


def test_the_polygon_of_an_exit_that_leaves_a_spike_of_the_floor_is_at_the_outline():
    """The spike is 3 mm long and 0.04 mm wide."""
    outline = [(-85.09558, 395.820212), (-83.507814, 396.060714), (-83.729954, 397.52726), (-83.72716, 397.527683)]
    outline += [(-83.97, 399.130889), (-75.981454, 400.340928), (-79.886205, 387.337848), (-84.041764, 388.863032)]
    polygon = [(-83.889326, 397.503079), (-83.59271, 397.548008), (-83.370585, 396.081564), (-83.667202, 396.036635)]
    plan = Plan()
    plan.storey("floor", outline)
    plan.exit("out", "floor", polygon=polygon)
    assert [way.width for way in plan.building().exits] == [pytest.approx(1.76, abs=0.01)]


def test_rooms_that_overlap_and_share_walls_are_joined():
    """The intersections of the second room are polygons with lines beside, which meet each other."""
    corridor = shapely.Polygon(box(0, 0, 20, 3).exterior, [box(14, 0.8, 18.5, 2.2).exterior.coords])
    skewed = [(0, 3), (0, 10), (10, 10), (17.8, 2.2), (14, 2.2), (14, 2), (5, 3), (0, 3)]
    plan = Plan()
    plan.storey("floor", [corridor, skewed, box(10, 3, 20, 10)])
    plan.exit("door", "floor", [(0, 1), (0, 2)])
    building = plan.building()
    assert building.levels[0].polygon.area == pytest.approx(200.0 - 4.5 * 1.4, abs=1e-6)
    assert [finding.kind for finding in building.findings] == ["assumed"]


def test_an_exit_that_parts_a_floor_is_named_with_its_place():
    plan = Plan()
    plan.storey("floor", box(0, 0, 10, 6))
    plan.exit("across", "floor", polygon=box(5, -1, 5.5, 7))
    with pytest.raises(BuildingError) as caught:
        plan.building()
    (error,) = caught.value.findings
    assert (error.item, error.place, error.remedy) == ("exits.across", pytest.approx((5.25, 3.0)), "remove it")
    assert "exit:" not in error.text
