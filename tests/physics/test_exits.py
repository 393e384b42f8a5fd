"""Walls and people right behind an exit: whoever is before it does not touch them."""

import numpy as np
import pytest

from evac.physics.seams import reaches
from evac.physics.state import make_crowd
from evac.physics.world import have_seams, make_world, walls_behind_exits
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1
from evac_plugins.contact_nsm2 import Nsm2
from tests.physics.scenes import make_building, make_engine, uniform_fields, walk

HALL = [(4, 1, 4, -3), (4, 3, 4, 2)]


def slot(depth):
    """Return a hall with an exit in its eastern wall, and a wall of the same level behind it."""
    walls = [*HALL, (4 + depth, -3, 4 + depth, 3)]
    return make_building(walls=walls, exits=[(0, (4, 1, 4, 2))])


@pytest.mark.parametrize("model", [Dem(), Nsm1(), Nsm2()], ids=lambda model: model.name)
@pytest.mark.parametrize("depth", [0.05, 0.1, 0.2])
def test_a_wall_right_behind_an_exit_stops_nobody(model, depth):
    """Alone, the way to the exit takes as long as with nothing behind it."""
    times = []
    for building in (slot(depth), make_building(walls=HALL, exits=[(0, (4, 1, 4, 2))])):
        crowd = make_crowd([(3.005, 1.5)], [(1.0, 0.0)], radius=0.22, speed=1.0)
        engine = make_engine(crowd, building)
        events = [engine.advance(model, crowd, first, 10, 0.01, False, False) for first in range(0, 100, 10)]
        assert crowd.level[0] == -1
        times.append(events[-1].time[0])
    assert times[0] == pytest.approx(0.995, abs=1e-9)
    assert times[0] == times[1]


def test_people_on_either_side_of_a_slot_behind_an_exit_do_not_touch():
    """Their discs overlap; a wall of the level stands between them, behind the exit."""
    for order in (1, -1):
        crowd = make_crowd([(3.9, 1.5), (4.25, 1.5)][::order], radius=[0.2, 0.19][::order], speed=0.0)
        walk(Dem(), crowd, 50, building=slot(0.05))
        assert not crowd.velocity.any()


@pytest.mark.parametrize(("wall", "backed"), [((4.2, -3, 4.2, 3), 1), ((5.5, -3, 5.5, 3), 0), ((4, 2, 6, 2), 0)])
def test_only_levels_with_walls_right_behind_an_exit_are_marked(wall, backed):
    building = make_building(walls=[*HALL, wall], exits=[(0, (4, 1, 4, 2))])
    assert np.array_equal(make_world(building, uniform_fields()).backed, [backed])
    assert have_seams(walls_behind_exits(building)) == bool(backed)
    assert (reaches in make_engine(make_crowd([(0.0, 0.0)]), building).entries(Dem())) == bool(backed)
