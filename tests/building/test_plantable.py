"""Plans as tables: the same plan there and back, and keys that are wrong are named."""

from pathlib import Path

import numpy as np
import pytest
from shapely import box

from evac import BuildingError, Plan
from evac.building.plan.plantable import plan_of, table_of


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
    table = table_of(everything())
    again = plan_of(table, Path("<plan>"), Path("."))
    assert table_of(again) == table
    one, other = everything().building(), again.building()
    assert np.array_equal(one.vertices, other.vertices)
    assert np.array_equal(one.walls, other.walls)
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
