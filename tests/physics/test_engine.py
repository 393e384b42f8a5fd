"""The engine: work arrays that are too short grow, and the run goes on as if they had been long enough."""

import numpy as np
import pytest

from evac.errors import SimulationError
from evac.physics.allocation import allocate, make_lists, make_room_for_contacts
from evac.physics.state import Events, make_crowd
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1
from evac_plugins.contact_nsm2 import Nsm2
from evac_plugins.force_social import SocialForce
from tests.physics.scenes import cut_wall, make_building, make_engine, walk

#: Places and velocities of people, each with what runs out of room last: contacts with walls, with each other, events.
SCENES = {
    "wall": [(-1.5, 0.2, 1.5, -0.5), (-0.5, 0.2, 1.5, -0.5)],
    "row": [(-1.9, 2.0, 1.9, 0.0), (-1.5, 2.0, 1.7, 0.0), (-1.1, 2.0, 1.5, 0.0)],
    "heap": [(-1.5, 0.2, 1.5, -0.5), (-1.1, 0.2, 1.5, -0.5), (-1.3, 0.55, 1.5, -0.5)],
    "exit": [(-0.01, 2.0, 1.5, 0.0), (-0.012, 4.0, 1.5, 0.0), (-0.04, 6.0, 1.5, 0.0), (-0.07, 8.0, 1.5, 0.0)],
}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize(
    ("model", "tick"), [(Dem(), 6), (Nsm1(), 1), (Nsm2(), 1)], ids=["dem", "nsm1", "nsm2"]
)  # within a tick a step that is made again starts its solve cold
def test_room_for_one_gives_the_bits_of_room_for_all(model, tick, scene):
    building = make_building(walls=cut_wall(-3, 0, 3, 0, 60), exits=[(0, (0, -10, 0, 10))])
    start = np.array(SCENES[scene])
    n = len(start)
    found = []
    for is_scarce in (False, True):
        crowd = make_crowd(start[:, :2], start[:, 2:], speed=1.5)
        engine = make_engine(crowd, building, forces=[SocialForce()])
        if is_scarce:
            engine.state.lists, engine.state.events = make_lists(n, 1, 1), allocate(Events, 1)
            make_room_for_contacts(engine.state, 1)
        crossings = []
        for first in range(0, 6, tick):
            events = engine.advance(model, crowd, first, tick, 0.01, True, True)
            columns = (events.row, events.kind, events.link, events.time)
            crossings += [tuple(column[k] for column in columns) for k in range(events.number)]
        report = engine.report()
        if scene == "exit":
            del report["list_builds"]  # a crossing that is undone makes lists stale
        found.append((crowd, crossings, report))
    (wanted, *wanted_counts), (crowd, *counts) = found
    for name in crowd.kinds:
        np.testing.assert_array_equal(getattr(crowd, name), getattr(wanted, name), err_msg=name)
    assert counts == wanted_counts
    assert (len(wanted_counts[0]), wanted_counts[1]["contacts"] > 2) == ((4, False) if scene == "exit" else (0, True))


def test_too_many_walls_at_one_body_say_so():
    crowd = make_crowd([(0.0, 0.1)], radius=0.2)
    building = make_building(walls=cut_wall(-1, 0, 1, 0, 1000))
    with pytest.raises(SimulationError, match=r"t = 0\.000 s: .* 60 walls"):
        walk(Dem(), crowd, 1, building=building)
