"""Shapes of slow and barred areas, and arrows that point in the direction in which links are passed."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

import evac
from evac.base.change import Change
from evac.building.model.links import changed
from evac.building.model.marks import marks_of


@pytest.fixture(scope="module")
def building():
    plan = evac.Plan()
    plan.storey("low", [shapely.box(0, 0, 6, 6), shapely.box(6.2, 0, 12, 6)])
    plan.storey("high", shapely.box(0, 0, 12, 6), 2.0)
    plan.door("door", "low", [(6.1, 2), (6.1, 3)])
    plan.stair("stair", "low", [(1, 1), (1, 2.2)], "high", [(5, 1), (5, 2.2)])
    plan.exit("out", "low", [(12, 3), (12, 4.2)])
    plan.area("west", "low", shapely.box(1, 3, 5, 5))
    plan.area("east", "low", shapely.box(7, 3, 11, 5))
    return plan.building()


@pytest.mark.parametrize(
    ("name", "value", "points"),
    [
        ("door", "west", [(6.6, 2.5, 5.6, 2.5)]),
        ("door", "east", [(5.6, 2.5, 6.6, 2.5)]),
        ("out", "out", [(11.0, 3.6, 12.0, 3.6)]),
        ("out", "in", [(12.0, 3.6, 11.0, 3.6)]),
        ("stair", "up", [(0.0, 1.6, 1.0, 1.6), (5.0, 1.6, 6.0, 1.6)]),
        ("stair", "down", [(1.0, 1.6, 0.0, 1.6), (6.0, 1.6, 5.0, 1.6)]),
    ],
)
def test_arrows_point_in_the_direction_of_links(building, name, value, points):
    marks = marks_of(changed(building, Change(0.0, "one_way", name, {"value": value})))
    assert {mark.kind for mark in marks} == {"one_way"}
    assert {building.levels[mark.level].kind for mark in marks} == {"floor"}
    found = []
    for mark in marks:
        corners = shapely.get_coordinates(mark.shape)[:-1]
        begin, tip = 0.5 * (corners[0] + corners[-1]), corners[3]
        found.append((*begin.tolist(), *tip.tolist()))
    np.testing.assert_allclose(sorted(found), sorted(points), atol=1e-9)


def test_areas_are_marked_and_barred_ones_as_such(building):
    slow = frozenset({("west", 0.5), ("east", 0.2), ("high", 0.5)})
    marks = marks_of(replace(building, slowed=slow, barred=frozenset({"east"})))
    assert [(mark.kind, building.levels[mark.level].name) for mark in marks] == [
        ("barred", "low"),
        ("slow", "high"),
        ("slow", "low"),
    ]
    assert [mark.shape.area for mark in marks] == pytest.approx([8.0, building.level_named("high").polygon.area, 8.0])
