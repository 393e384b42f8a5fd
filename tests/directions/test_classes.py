"""Classes of bodies: gaps, portals and exits are walls for the bodies that do not fit through."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from evac.directions.build import MOST_CLASSES, build_fields, find_classes
from evac.directions.routes import Route
from tests.directions.conftest import Drawing
from tests.directions.walks import walk

ANY = (Route(),)
CLEARANCE = 0.25


def hall(*gaps, length=20.0, turned=0.0):
    """Return a hall of 12 m with a wall at x = 6 m, exits beside it, and gaps (low, width) in the wall."""
    wall = shapely.box(6.0, -2.0, 6.1, length + 1.0)
    for low, width in gaps:
        wall = wall.difference(shapely.box(5.0, low, 7.0, low + width))
    drawing = Drawing()
    drawing.level(shapely.box(0, 0, 12, length).difference(shapely.affinity.rotate(wall, turned, origin=(6.0, 0.0))))
    drawing.exit("A", 0, (12, 0.5), (12, 1.7))
    return drawing.build()


def test_there_is_a_class_for_each_width_of_a_gap_between_the_bodies():
    building = hall((1.0, 0.45), (3.0, 0.45), (5.0, 0.3), (8.0, 0.5), (12.0, 1.0))
    assert [found.width for found in find_classes(building, 0.4, 0.5)] == pytest.approx([0.45], abs=2e-6)
    assert [found.width for found in find_classes(building, 0.25, 0.6)] == pytest.approx([0.3, 0.45, 0.5], abs=2e-6)
    assert find_classes(building, 0.45, 0.45) == ()
    assert find_classes(hall((12.0, 1.0)), 0.4, 0.5) == ()


def test_exits_and_portals_make_classes_too_and_closed_ones_do_not(drawing):
    drawing.level((0.0, 0.0, 4.0, 5.0))
    drawing.level((4.0, 0.0, 8.0, 5.0))
    drawing.portal(0, 1, (4.0, 2.0), (4.0, 2.42))
    drawing.exit("east", 1, (8.0, 1.0), (8.0, 1.46))
    building = drawing.build()
    assert [found.width for found in find_classes(building, 0.4, 0.5)] == pytest.approx([0.42, 0.46], abs=2e-6)
    assert len(find_classes(replace(building, closed=frozenset({0})), 0.4, 0.5)) == 1


def test_many_gaps_make_few_classes_and_no_class_holds_a_body_too_wide_for_its_gaps():
    widths = 0.3 + 0.0131 * np.arange(20)
    building = hall(*((0.5 + 0.9 * index, width) for index, width in enumerate(widths)))
    classes = find_classes(building, 0.3, 0.6)
    assert 1 < len(classes) < MOST_CLASSES
    for width in widths:
        barred = [found.barred > width for found in classes]
        fitting = [found.width for found, is_barred in zip(classes, [*barred[1:], True], strict=True) if not is_barred]
        assert all(bound <= width + 1e-5 for bound in fitting)


@pytest.mark.parametrize(("far", "turned"), [(4.0, 3.0), (45.0, 0.0)])
def test_each_body_takes_the_nearest_gap_that_it_fits_through(far, turned):
    """Also where the way round is 40 m longer, for bodies of one width as for those of two."""
    building = hall((1.0, 0.45), (far, 1.1), length=far + 2.0, turned=turned)
    start = (4.0, 1.0)
    both = build_fields(building, ANY, clearance=CLEARANCE, narrowest=0.4, widest=0.5)
    wide = build_fields(building, ANY, clearance=CLEARANCE, narrowest=0.5, widest=0.5)
    narrow = build_fields(building, ANY, clearance=CLEARANCE, narrowest=0.4, widest=0.4)
    assert both.packed.field_of.shape == (1, 2)
    assert both.travel_time_at(0, [start], 0, 0.2) == narrow.travel_time_at(0, [start], 0, 0.2)
    short, round_it = both.travel_time_at(0, [start, start], 0, [0.2, 0.25])
    assert short == pytest.approx(8.5, abs=1.0)
    assert round_it > 2.0 * (far - 2.0) if far > 10.0 else round_it > short + 0.5
    assert wide.travel_time_at(0, [start], 0, 0.25)[0] == pytest.approx(round_it, abs=0.05)
    exit_, way = walk(wide, building, start, 0)
    assert exit_ == "A"
    assert max(y for _, _, y in way) > far - 0.5


def test_a_slanted_slit_is_passed_by_times_and_directions_alike():
    """A slit of 0.36 to 0.40 m: bodies of 0.38 m go round it, whatever the way round costs."""
    ground = shapely.box(0, 0, 12, 25).difference(shapely.Polygon([(6, 0.36), (6, 23.8), (7, 23.8), (7, 0.4)]))
    drawing = Drawing()
    drawing.level(ground)
    drawing.exit("A", 0, (12, 0.5), (12, 1.7))
    building = drawing.build()
    fields = build_fields(building, ANY, clearance=0.2, narrowest=0.34, widest=0.42)
    points = [(5.0, 1.0), (5.8, 0.18), (5.9, 0.4)]
    times = [fields.travel_time_at(0, points, 0, radius) for radius in (0.17, 0.19, 0.21)]
    assert (times[0] < 9.0).all()
    assert (times[1] > 40.0).all()
    assert (times[2] > 40.0).all()
    upwards = fields.directions_at(0, points, 0, 0.19)[:, 1]
    assert upwards[0] > 0.9
    assert (upwards > 0.0).all()


def test_where_no_way_is_wide_enough_directions_lead_to_the_gap_and_lengths_are_infinite():
    building = hall((1.0, 0.45))
    fields = build_fields(building, ANY, clearance=CLEARANCE, narrowest=0.4, widest=0.5)
    alone = build_fields(building, ANY, clearance=CLEARANCE, narrowest=0.5, widest=0.5)
    west, east = (4.0, 5.0), (8.0, 5.0)
    for one in (fields, alone):
        assert np.isfinite(one.travel_time_at(0, [west, east], 0, 0.25)).all()
        assert np.isfinite(one.lengths_at(0, [west, east], 0, 0.25)[:, 0]).tolist() == [False, True]
        assert one.are_passable(0, [west, east], 0, 0.25).tolist() == [False, True]
        assert one.directions_at(0, [west], 0, 0.25)[0] @ [2.0, -3.8] > 0.0
    assert np.isfinite(fields.lengths_at(0, [west], 0, 0.2)).all()
    assert fields.are_passable(0, [west], 0, 0.2).all()


def test_a_route_to_an_exit_that_is_too_narrow_has_no_length(drawing):
    drawing.level((0.0, 0.0, 10.0, 6.0))
    drawing.exit("wide", 0, (10.0, 1.0), (10.0, 2.0))
    drawing.exit("narrow", 0, (0.0, 1.0), (0.0, 1.45))
    routes = (Route(), Route(("wide",)), Route(("narrow",)))
    start = [(1.0, 1.2)]
    for narrowest in (0.4, 0.5):
        fields = build_fields(drawing.build(), routes, clearance=CLEARANCE, narrowest=narrowest, widest=0.5)
        lengths = [fields.lengths_at(0, start, route, 0.25)[0, 0] for route in range(3)]
        assert lengths[0] == lengths[1] == pytest.approx(9.0, abs=0.2)
        assert np.isinf(lengths[2])
        assert [fields.are_passable(0, start, route, 0.25)[0] for route in range(3)] == [True, True, False]


def test_without_a_gap_between_the_bodies_nothing_changes():
    building = hall((1.0, 0.3), (3.0, 0.55), (10.0, 1.1))
    one, two = (build_fields(building, ANY, clearance=CLEARANCE, narrowest=0.4, widest=widest) for widest in (0.4, 0.5))
    for name in ("direction", "travel_time", "field_of", "width"):
        np.testing.assert_array_equal(getattr(one.packed, name), getattr(two.packed, name))


def test_outside_a_niche_that_nobody_fits_into_directions_are_those_without_it():
    """Its ground can only be reached through the gap, which remains slow ground."""
    drawing = Drawing()
    drawing.level(shapely.box(0, 0, 8, 6).union(shapely.box(8, 2, 10, 4)).difference(shapely.box(8, 2.3, 8.1, 4)))
    drawing.exit("A", 0, (0, 1), (0, 2))
    building = drawing.build()
    avoided = build_fields(building, ANY, clearance=CLEARANCE, narrowest=0.4)
    free = build_fields(building, ANY, clearance=CLEARANCE)
    inside = [(9.0, 3.0)]
    assert avoided.travel_time_at(0, inside, 0)[0] > free.travel_time_at(0, inside, 0)[0] + 10.0
    points = [(7.0, 5.0), (4.0, 3.0), (7.5, 1.0)]
    assert np.array_equal(avoided.directions_at(0, points, 0), free.directions_at(0, points, 0))
