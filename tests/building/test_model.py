"""Links of a building: portals and exits, and both sides of a portal."""

import pytest

EXIT = {"name": "out", "segment": [[0, 0], [0, 2]], "z": 0.0}


@pytest.fixture
def building(read, stair_mesh):
    return read(stair_mesh, exits=[EXIT])


def test_portals_come_before_exits_among_the_links(building):
    links = [portal.index for portal in building.portals] + [building.link_of(exit_) for exit_ in building.exits]
    assert links == list(range(building.n_links))
    assert building.n_links > len(building.portals) > 0


def test_both_sides_of_a_portal(building):
    for portal in building.portals:
        first, second = portal.levels
        assert (portal.other(first), portal.other(second)) == (second, first)
        assert portal.segments_from(first).tolist() == portal.segments.tolist()
        reverse = [[x2, y2, x1, y1] for x1, y1, x2, y2 in portal.segments.tolist()]
        assert portal.segments_from(second).tolist() == reverse


def test_links_of_a_level(building):
    for level in building.levels:
        assert all(level.index in portal.levels for portal in building.portals_of(level.index))
        assert all(exit_.level == level.index for exit_ in building.exits_of(level.index))
    assert sum(len(building.portals_of(level.index)) for level in building.levels) == 2 * len(building.portals)
    assert sum(len(building.exits_of(level.index)) for level in building.levels) == len(building.exits)
