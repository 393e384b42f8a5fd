"""Moving: every link on a path is crossed, in order, and a path that leads nowhere is an error."""

import numpy as np
import pytest

from evac.base.errors import SimulationError
from evac.physics.state import make_crowd
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1
from evac_plugins.contact_nsm2 import Nsm2
from tests.physics.scenes import make_building, make_engine, name_of, uniform_fields, walk

FREE = 1e30


def test_all_links_on_a_path_are_crossed_in_their_order():
    """Portals at x = 4 and 5 m and an exit at 6 m, in one step from 2.75 to 6.25 m: 3.25 m lie before the exit."""
    building = make_building(
        ((0, 0, 4, 2), (4, 0, 5, 2), (5, 0, 6, 2)),
        portals=[(0, 1, (4, 0, 4, 2)), (1, 2, (5, 0, 5, 2))],
        exits=[(2, (6, 0, 6, 2))],
    )
    crowd = make_crowd([(2.75, 1.0)], [(7.0, 0.0)], radius=0.2, tau=FREE)
    engine = make_engine(crowd, building, uniform_fields(3))
    events = engine.advance(Nsm1(), crowd, 0, 1, 0.5, True, False)
    assert events.number == 3
    assert (events.kind[:3].tolist(), events.link[:3].tolist()) == ([0, 0, 1], [0, 1, 2])
    np.testing.assert_allclose(events.time[:3], np.array([1.25, 2.25, 3.25]) / 7.0, rtol=1e-14)
    assert crowd.level[0] == -1
    assert crowd.distance[0] == pytest.approx(3.25, rel=1e-14)


def test_a_link_that_lies_behind_when_its_level_is_entered_is_not_crossed():
    """The level behind the portal at x = 4 m reaches back below the first one, and has an exit there at 3 m."""
    building = make_building(((0, 0, 4, 2), (2, 0, 8, 2)), portals=[(0, 1, (4, 0, 4, 2))], exits=[(1, (3, 0, 3, 2))])
    crowd = make_crowd([(2.75, 1.0)], [(7.0, 0.0)], radius=0.2, tau=FREE)
    engine = make_engine(crowd, building, uniform_fields(2))
    events = engine.advance(Nsm1(), crowd, 0, 1, 0.5, True, False)
    assert events.link[: events.number].tolist() == [0]
    assert crowd.level[0] == 1


def test_a_path_past_the_end_of_a_wall_does_not_cross_it():
    """Looked at in every step (`full`): the path crosses the wall's line 0.25 m beyond its end."""
    crowd = make_crowd([(-0.05, 0.25)], [(15.0, 0.0)], radius=0.2, tau=FREE)
    engine = walk(Nsm2(), crowd, 1, building=make_building(walls=[(0, -1, 0, 0)]), full=True)
    assert engine.report()["wall_crossings_prevented"] == 0
    np.testing.assert_allclose(crowd.position, [(0.1, 0.25)], rtol=0, atol=1e-15)


@pytest.mark.parametrize("model", [Dem(), Nsm1(), Nsm2()], ids=name_of)
def test_a_velocity_that_is_no_number_names_the_person(model):
    crowd = make_crowd([(1, 2), (3, 4)], level=[0, 0])
    crowd.velocity[1] = np.nan
    with pytest.raises(SimulationError, match=r"t = 0\.020 s: person 1 at \(3\.00, 4\.00\) on level 0 .* velocity"):
        make_engine(crowd).advance(model, crowd, 2, 1, 0.01, True, False)
