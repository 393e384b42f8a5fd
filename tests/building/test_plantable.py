"""Plans as tables, and plans of existing buildings."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import box

from evac import BuildingError, Plan
from evac.building.plan.plantable import plan_of, plan_of_building, table_of


def everything():
    plan = Plan(headroom=1.9)
    plan.storey("ground", [box(0, 0, 6, 6), box(6.1, 0, 12, 6)], wall=0.1)
    plan.storey("first", box(0, 0, 12, 6), z=3.0)
    plan.stair("u", "ground", [(8, 1.4), (8, 2.6)], "first", length=2.4, turn="left", direction=(1, 0), gap=0.2)
    plan.flight("odd", [(12, 1), (12, 2)], 0.0, [(15, 1), (15, 2)], 1.5)
    plan.landing("odd", box(15, 1, 17, 2), 1.5)
    plan.flight("odd", [(17, 1), (17, 2)], 1.5, [(20, 1), (20, 2)], 3.0)
    plan.storey("annex", box(20, 0, 24, 4), z=3.0)
    plan.door("inner", "ground", [(6, 1), (6, 2)], reach=0.5)
    plan.exit("door", "ground", [(0, 3), (0, 4)])
    plan.exit("ramp", "annex", polygon=box(23, 0, 25, 4))
    plan.opening("annex", [(20, 4), (23, 4)], "window")
    plan.area("office", "first", box(1, 4, 5, 6))
    plan.obstacle("table", "first", box(2, 5, 3, 5.5))
    return plan


def test_a_table_makes_the_same_plan():
    plan = everything()
    plan.north = -12.5
    table = table_of(plan)
    again = plan_of(table, Path("<plan>"), Path("."))
    assert table_of(again) == table
    one, other = everything().building(), again.building()
    assert np.array_equal(one.vertices, other.vertices)
    assert np.array_equal(one.walls, other.walls)
    assert (other.north, again.building(north=90.0).north) == (-12.5, 90.0)
    assert [level.name for level in one.levels] == [level.name for level in other.levels]
    assert [way.name for way in one.exits] == [way.name for way in other.exits] == ["door", "ramp"]
    assert [area.polygon.area for area in one.areas] == [area.polygon.area for area in other.areas]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"storys": []}, "building.plan.storys.*'storeys'"),
        ({"storeys": {}}, "building.plan.storeys"),
        ({"exits": [{"name": "a", "storey": "ground", "sgment": []}]}, "exits.a.sgment.*'segment'"),
        ({"exits": [{"name": "a"}]}, "exits.a.storey: missing"),
        ({"exits": ["a"]}, "exits.0"),
        ({"stairs": [{"name": 1, "lower": "g", "lower_edge": [], "upper": "f"}]}, "stairs.1.name"),
        ({"headroom": "high"}, "headroom"),
        ({"storeys": [{"name": "a", "z": "high", "polygons": []}]}, "'a'.*z"),
    ],
)
def test_wrong_keys_are_named(change, message):
    with pytest.raises(BuildingError, match=message):
        plan_of(change, Path("case.toml"), Path("."), "building.plan.")


def winding():
    """Return a building whose stair turns by 90 degrees between two floors."""
    plan = Plan()
    plan.storey("low", [shapely.box(0, 0, 4, 2), shapely.box(0, -3, 4, -0.2)])
    plan.storey("high", shapely.box(6, 4, 8, 8), z=1.5)
    plan.door("inner", "low", [(1, -0.1), (2, -0.1)])
    angles = np.deg2rad(np.arange(-90, 1, 15))
    edges = [[(4 + r * np.cos(a), 4 + r * np.sin(a)) for r in (2, 4)] for a in angles]
    for k in range(6):
        plan.flight("up", edges[k], 0.25 * k, edges[k + 1], 0.25 * (k + 1))
    plan.exit("door", "low", [[(0, 0.5), (0, 1)], [(0, 1.5), (0, 2)]])
    plan.area("office", "high", shapely.box(6, 6, 8, 8))
    return plan.building()


def test_a_building_is_made_again_from_its_plan():
    one = winding()
    other = plan_of_building(one).building()
    assert [(level.name, level.kind) for level in other.levels] == [(level.name, level.kind) for level in one.levels]
    assert [level.polygon.area for level in other.levels] == pytest.approx([level.polygon.area for level in one.levels])
    assert [level.slope for level in other.levels] == pytest.approx([level.slope for level in one.levels])
    assert [(door.name, door.level, door.width) for door in other.doors] == [("inner", 0, pytest.approx(1.0))]
    assert (other.exits[0].width, other.areas[0].polygon.area) == (pytest.approx(1.0), pytest.approx(4.0))


@pytest.mark.parametrize(
    ("polygon", "edge", "match"),
    [
        ("POLYGON ((4 0, 8 0, 8 2, 4 2, 4 0))", None, "corners with heights"),
        ("POLYGON Z ((4 0 0, 8 0 2, 8 2 3, 4 2 0, 4 0 0))", None, "off the plane"),
        ("POLYGON Z ((4 0 0, 8 0 2, 8 2 2, 4 2 0, 4 0 0))", [(4, 0), (4, 2)], "not both"),
        (None, [(4, 0), (4, 2)], "upper_edge: a segment must be"),
    ],
)
def test_a_flight_is_between_edges_or_in_one_plane(polygon, edge, match):
    flight = {"stair": "up", "polygon": polygon, "lower_edge": edge}
    table = {"storeys": [{"name": "low", "polygons": [[0, 0], [4, 0], [4, 2], [0, 2]]}], "flights": [flight]}
    with pytest.raises(BuildingError, match=match):
        plan_of(table, Path("a.plan.toml"), Path()).building(need_exit=False)
