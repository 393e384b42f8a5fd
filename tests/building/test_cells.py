"""Fields on square cells of all levels: their places, what is read beyond edges and of people who are out, sizes."""

import re

import numpy as np
import pytest
from shapely import box

from evac import Plan
from evac.building.model.cells import Cells, LevelField


@pytest.fixture(scope="module")
def building():
    plan = Plan()
    plan.storey("low", box(0.3, 0, 4, 3))
    plan.storey("high", box(-2, 1, 0, 2), z=3.0)
    return plan.building(need_exit=False)


def test_a_field_has_cells_on_each_level_and_is_read_at_places(building):
    field = LevelField(building, "smoke", "1/m", 0.5)
    assert [field.on(level).shape for level in (0, 1)] == [(6, 8), (2, 4)]
    for level in building.levels:
        x, y = Cells(level, 0.5).centres()
        field.on(level.index)[:] = 100.0 * level.index + x + 10.0 * y
    places = [(2.1, 1.4), (-1.6, 1.9), (2.1, 1.4), (9.0, -9.0), (-9.0, 9.0)]
    found = field.at([0, 1, -1, 0, 1], np.array(places))
    assert found == pytest.approx([2.25 + 12.5, 100.0 - 1.75 + 17.5, 0.0, 3.75 + 2.5, 100.0 - 1.75 + 17.5])


def test_cells_too_small_for_the_building_are_refused_with_the_size_that_works():
    plan = Plan()
    plan.storey("field", box(0, 0, 400, 100))
    building = plan.building(need_exit=False)
    with pytest.raises(ValueError, match=r"cells of 0.1 m are too small; use .* m or more") as refused:
        LevelField(building, "smoke", "1/m", 0.1)
    least = float(re.search(r"use (\S+) m", str(refused.value))[1])
    assert 0.2 < least < 0.25
    assert LevelField(building, "smoke", "1/m", least).size < 1_000_000
    for name, spacing in (("two\nlines", 0.5), ("smoke", 0.04), ("smoke", 2e6)):
        with pytest.raises(ValueError, match="field"):
            LevelField(building, name, "1/m", spacing)
