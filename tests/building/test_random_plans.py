"""Plans of spoiled polygons have the area that shapely gives them, or are refused with a place."""

import re

import numpy as np
import pytest
import shapely

from evac import BuildingError, Plan
from tests.building.random_plans import plan_shapes

SEED = 20260101
PLACE = r"\(\d+\.\d\d, \d+\.\d\d|no polygon with an area"


def ground_of(number):
    """Return the ground of a plan as evac and as shapely see it, or of one that is refused a message with its place."""
    shapes = plan_shapes(np.random.default_rng((SEED, number)))
    try:
        plan = Plan()
        plan.storey("floor", shapes)
        building = plan.building(need_exit=False)
    except BuildingError as error:
        return str(error)
    drawn = shapely.union_all([shapely.make_valid(one, method="structure", keep_collapsed=False) for one in shapes])
    return sum(level.polygon.area for level in building.levels), drawn.area


@pytest.mark.parametrize("first", [0, *(pytest.param(first, marks=pytest.mark.slow) for first in range(20, 2000, 20))])
def test_spoiled_plans_keep_their_ground_or_are_refused(first):
    found = {number: ground_of(number) for number in range(first, first + 20)}
    refused = [one for one in found.values() if isinstance(one, str)]
    assert len(refused) <= 2
    assert all(re.search(PLACE, message) for message in refused)
    for number, one in found.items():
        if not isinstance(one, str):
            assert one[0] == pytest.approx(one[1], rel=1e-3), number
