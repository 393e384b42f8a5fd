"""The order of bodies: by place along a curve, or by travel time."""

import numpy as np
import pytest

from evac.physics.engine import PER_METRE, along_curve, rows_by_place, rows_by_travel_time
from evac.physics.state import make_crowd
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1
from evac_plugins.contact_nsm2 import Nsm2
from tests.physics.scenes import fields_towards, make_engine, random_crowd


def interleaved(x, y):
    """Return the number whose bits are those of x and y in turns."""
    return int("".join(a + b for a, b in zip(f"{x:028b}", f"{y:028b}", strict=True)), 2)


def test_the_curve_is_that_of_morton():
    random = np.random.default_rng(3)
    cells = random.integers(0, 2**28, (200, 2))
    found = along_curve((cells + 0.5) / PER_METRE, np.zeros(200, np.int32))
    assert found.tolist() == [interleaved(x, y) for x, y in cells.tolist()]


def test_the_curve_repeats_and_takes_one_level_after_the_other():
    random = np.random.default_rng(4)
    position = random.uniform(-900.0, 900.0, (200, 2)).round(3)
    level = random.integers(0, 100, 200).astype(np.int32)
    found = along_curve(position, level)
    np.testing.assert_array_equal(found, along_curve(position + 2**28 / PER_METRE, level))
    assert (np.diff(level[np.argsort(found)]) >= 0).all()


def test_neighbours_in_order_are_neighbours_in_place():
    """On average less than a fifth as far apart as in the order in which they were drawn."""
    crowd = make_crowd(np.random.default_rng(5).uniform(0.0, 40.0, (2000, 2)))
    rows = rows_by_place(crowd)
    apart = [np.hypot(*np.diff(place, axis=0).T).mean() for place in (crowd.position, crowd.position[rows])]
    assert apart[1] < 0.2 * apart[0]


def test_only_those_inside_are_in_order_and_ties_are_in_order_of_rows():
    crowd = make_crowd([(3, 1), (1, 1), (3, 1), (2, 1), (1, 1)], level=[0, 0, 0, -1, 0])
    assert rows_by_place(crowd).tolist() == [1, 4, 0, 2]
    state = make_engine(crowd, fields=fields_towards((0, 1))).data
    assert rows_by_travel_time(state, crowd).tolist() == [1, 4, 0, 2]


@pytest.mark.parametrize(
    ("model", "is_by_place"), [(Dem(), True), (Nsm1(), False), (Nsm2(), False)], ids=["dem", "nsm1", "nsm2"]
)
def test_models_that_are_solved_have_the_order_of_travel_time(model, is_by_place):
    crowd = random_crowd(60, (0, 0), (8, 8), seed=6)
    engine = make_engine(crowd, fields=fields_towards((9, 4)))
    by_place, by_time = rows_by_place(crowd), rows_by_travel_time(engine.data, crowd)
    assert (by_place != by_time).any()
    engine.advance(model, crowd, 0, 10, 0.01, False, False)
    np.testing.assert_array_equal(engine.data.bodies.row, by_place if is_by_place else by_time)
