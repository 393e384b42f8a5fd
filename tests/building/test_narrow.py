"""Places too narrow for a body."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from evac.building.model.narrow import gaps_at, gaps_below, gaps_between_walls, narrow_places
from tests.directions.conftest import Drawing

DOOR = {"name": "door", "segment": [[0, 1], [0, 2]], "z": 0.0}


def two_rooms(mesh, width: float, length: float):
    """Two rooms of 4 m by 4 m, joined by a passage of `width` and `length` in the middle of their facing walls."""
    low, high = 2 - width / 2, 2 + width / 2
    for x in (0.0, 4.0 + length):
        for y1, y2 in ((0.0, low), (low, high), (high, 4.0)):
            mesh.rectangle(x, y1, x + 4.0, y2)
    return mesh.rectangle(4.0, low, 4.0 + length, high)


@pytest.mark.parametrize("length", [0.1, 0.5, 3.0])
def test_a_neck_is_found_with_its_width_and_place(mesh, read, length):
    building = read(two_rooms(mesh, 0.45, length), exits=[DOOR])
    (found,) = gaps_at(building, building.levels[0], 0.5, least=0.5)
    assert found[0] == pytest.approx(0.45, abs=1e-9)
    x, y = found[1]
    assert 3.9 <= x <= 4.1 + length
    assert y == pytest.approx(2.0, abs=0.05)
    assert len(narrow_places(building, 0.5)) == 1


def test_obstacles_make_necks_and_niches_do_not(mesh, read):
    counter = {"name": "counter", "polygon": [[3, 0.3], [3.5, 0.3], [3.5, 3.6], [3, 3.6]], "z": 0.0}
    building = read(mesh.rectangle(0, 0, 8, 4), exits=[DOOR], obstacles=[counter])
    assert gaps_at(building, building.levels[0], 0.28, least=0.28) == []
    (found,) = gaps_at(building, building.levels[0], 0.45, least=0.45)  # the wider of the two ways round the counter
    assert found[0] == pytest.approx(0.4, abs=1e-9)
    assert found[1][1] == pytest.approx(3.8, abs=0.05)


def test_each_of_three_rooms_in_a_row_is_named_once(mesh, read):
    two_rooms(mesh, 0.4, 0.2)
    for y1, y2 in ((0.0, 1.8), (1.8, 2.2), (2.2, 4.0)):
        mesh.rectangle(8.4, y1, 12.4, y2)
    mesh.rectangle(8.2, 1.8, 8.4, 2.2)
    building = read(mesh, exits=[DOOR])
    places = sorted(place for _, place in gaps_at(building, building.levels[0], 0.5, least=0.5))
    np.testing.assert_allclose(places, [(4.1, 2.0), (8.3, 2.0)], atol=0.1)


def test_portals_and_exits(stair_mesh, read):
    building = read(stair_mesh, exits=[{"name": "hatch", "segment": [[0, 0.2], [0, 0.6]], "z": 0.0}])
    (hatch,) = narrow_places(building, 0.5)
    assert (hatch.level, hatch.place) == ("floor z=0.00", (0.0, 0.4))
    assert "'hatch'" in hatch.text
    assert "0.40 m" in hatch.text
    notes = narrow_places(building, 2.2)
    assert sum(note.text.startswith("portal ") for note in notes) == 2


def test_gaps_that_walls_leave_are_closed_and_steps_of_an_outline_are_not():
    gap = shapely.box(0, 0, 4, 4).union(shapely.box(3.99, 4, 8, 8))
    (found,) = gaps_below(gap).tolist()
    assert sorted([found[:2], found[2:]]) == [[3.99, 4.0], [4.0, 4.0]]
    wide = shapely.box(0, 0, 4, 4).union(shapely.box(3.97, 4, 8, 8))
    round_room = shapely.Point(0, 0).buffer(2.0, quad_segs=200)  # sides of 16 mm
    thin_wall = shapely.box(0, 0, 4, 4).difference(shapely.box(2, 0, 2.01, 3))  # a wall is no gap
    assert [len(gaps_below(polygon)) for polygon in (wide, round_room, thin_wall)] == [0, 0, 0]


def hall(*boxes, exit_=((8.0, 2.0), (8.0, 3.0)), turned=0.0):
    """Return a hall of 8 m by 6 m without some boxes, turned by an angle."""
    ground = shapely.box(0, 0, 8, 6).difference(shapely.union_all([shapely.box(*box) for box in boxes]))
    drawing = Drawing()
    drawing.level(shapely.affinity.rotate(ground, turned, origin=(0, 0)))
    drawing.exit("A", 0, *shapely.affinity.rotate(shapely.LineString(exit_), turned, origin=(0, 0)).coords)
    return drawing.build()


@pytest.mark.parametrize("turned", [0.0, 7.0, 33.0, 61.0])
def test_a_gap_beside_a_way_round_is_found_with_its_width_and_place_at_any_angle(turned):
    building = hall((4.0, 0.45, 4.2, 4.8), turned=turned)
    assert gaps_at(building, building.levels[0], 0.5, least=0.5) == []
    ((width, place),) = gaps_at(building, building.levels[0], 0.5)
    assert width == pytest.approx(0.45, abs=1e-9)
    middle = shapely.affinity.rotate(shapely.Point(4.1, 0.225), turned, origin=(0, 0))
    assert shapely.Point(place).distance(middle) < 0.11
    assert gaps_at(building, building.levels[0], 0.45) == []  # a body as wide as the gap passes


def test_niches_and_openings_are_no_gaps_and_a_closed_door_is_a_wall():
    niche = hall((8.0, 4.0, 8.5, 4.4), (6.0, 4.0, 6.5, 4.4), (6.3, 4.1, 6.5, 4.3))
    assert len(gaps_between_walls(niche, niche.levels[0], 0.5)) == 0
    beside = hall((7.5, 3.0, 7.7, 4.0), exit_=((8.0, 1.0), (8.0, 4.5)))
    assert len(gaps_between_walls(beside, beside.levels[0], 0.5)) == 0
    closed = replace(beside, closed=frozenset({0}))
    assert min(gaps_at(closed, closed.levels[0], 0.5))[0] == pytest.approx(0.3)


def test_warnings_say_for_how_many_a_gap_is_a_wall():
    building = hall((4.0, 0.45, 4.2, 4.8))
    assert narrow_places(building, [0.4, 0.44]) == ()
    assert narrow_places(building, [0.46, 0.5]) == ()  # for all of them: nobody passes it
    (warning,) = narrow_places(building, [0.4, 0.5, 0.47, 0.45])
    assert warning.place == pytest.approx((4.1, 0.225), abs=0.11)
    assert "0.45 m wide, a wall for 2 of 4 people" in warning.text


def test_where_the_ground_falls_apart_at_a_gap_it_is_told_once():
    building = hall((4.0, 0.45, 4.2, 6.0))
    (warning,) = narrow_places(building, [0.4, 0.5])
    assert "1 of 2 people" in warning.text
    (warning,) = narrow_places(building, [0.5])
    assert "1 of 1 person" in warning.text
