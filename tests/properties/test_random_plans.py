"""Plans of spoiled polygons have the area that shapely gives them, or are refused with a place."""

import re

import numpy as np
import pytest
import shapely

from evac import BuildingError, Plan
from tests.properties.random_plans import plan_shapes
from tests.properties.seeded import drawn

PLACE = r"\(\d+\.\d\d, \d+\.\d\d|no polygon with an area"


def ground_of(number):
    """Return the ground of a plan as evac and as shapely see it, or of one that is refused a message with its place."""
    shapes = plan_shapes(np.random.default_rng(number))
    try:
        plan = Plan()
        plan.storey("floor", shapes)
        building = plan.building(need_exit=False)
    except BuildingError as error:
        return str(error)
    drawn = shapely.union_all([shapely.make_valid(one, method="structure", keep_collapsed=False) for one in shapes])
    return sum(level.polygon.area for level in building.levels), drawn.area


@drawn(20)
def test_a_spoiled_plan_keeps_its_ground_or_is_refused(seed):
    found = ground_of(seed)
    if isinstance(found, str):
        assert re.search(PLACE, found)
    else:
        assert found[0] == pytest.approx(found[1], rel=1e-3)
