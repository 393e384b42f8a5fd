"""Whether everybody gets out: travel times, connected ground and walks along the directions must agree."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from evac.base.errors import ScenarioError
from evac.building.plan.plan import Plan
from evac.directions.build import build_fields
from evac.directions.routes import Route
from evac.people.population import Group
from evac.people.ways import check_ways, cut_off
from evac.physics.state import make_crowd
from evac.physics.world import make_world
from tests.directions.conftest import Drawing

CASE = Path("case.toml")
ROUTES = (Route(), Route(("east",)))


def two_rooms(door=(2.0, 3.0), wall=0.2):
    """Return two rooms of 4 x 5 m with a wall between them that a door may be in, and an exit from the eastern one."""
    drawing = Drawing()
    between = shapely.box(4.0, -1.0, 4.0 + wall, 6.0)
    if door is not None:
        between = between.difference(shapely.box(3.0, door[0], 6.0, door[1]))
    drawing.level(shapely.box(0.0, 0.0, 8.0, 5.0).difference(between))
    drawing.exit("east", 0, (8.0, 1.0), (8.0, 2.0))
    return drawing.build()


def check(building, fields, positions, radius=0.2):
    crowd = make_crowd(positions)
    crowd.radius[:] = crowd.contact_radius[:] = radius
    group = Group("visitors", np.arange(len(positions), dtype=np.int32), {})
    return check_ways(CASE, building, fields, make_world(building, fields), crowd, (group,))


def refusal(building, fields, positions):
    with pytest.raises(ScenarioError) as caught:
        check(building, fields, positions)
    return str(caught.value)


def test_everybody_who_can_get_out_passes():
    building = two_rooms()
    check(building, build_fields(building, ROUTES), [[0.5, 0.5], [0.5, 4.5], [3.9, 0.1], [7.0, 4.0]])


def test_people_without_connected_ground_are_refused_by_place():
    building = two_rooms(door=None)
    message = refusal(building, build_fields(building, ROUTES), [[7.0, 1.0], [1.0, 2.0], [1.0, 3.0]])
    assert re.match(r"case\.toml: people\.visitors: 2 of 3 people .* at \(1\.00, 2\.00\)", message)
    assert "mesh" in message


@pytest.mark.parametrize("overlap", [0.0, 1e-3])
def test_rooms_that_meet_in_a_corner_are_not_connected(overlap):
    drawing = Drawing()
    drawing.level(shapely.box(0.0, 0.0, 4.0, 4.0).union(shapely.box(4.0 - overlap, 4.0, 8.0, 8.0)))
    drawing.exit("east", 0, (8.0, 6.0), (8.0, 7.0))
    building = drawing.build()
    fields = build_fields(building, ROUTES)
    check(building, fields, [[5.0, 5.0]])
    assert "mesh" in refusal(building, fields, [[3.5, 3.5]])


def test_a_gap_that_the_grid_does_not_pass_is_named_as_the_cause():
    building = two_rooms(door=(2.03, 2.07))
    message = refusal(building, build_fields(building, ROUTES), [[1.0, 2.0]])
    assert "directions.spacing = 0.1 m" in message
    check(building, build_fields(building, ROUTES, spacing=0.02), [[1.0, 2.0]])


def test_travel_times_that_pass_a_wall_are_refused():
    leaking = build_fields(two_rooms(), ROUTES)
    message = refusal(two_rooms(door=None), leaking, [[1.0, 2.0]])
    assert "they end at" in message


@pytest.mark.parametrize("share", [-1.0, 0.0], ids=["back", "nowhere"])
def test_directions_that_lead_to_no_exit_are_refused_with_their_end(share):
    building = two_rooms()
    fields = build_fields(building, (Route(),))
    wrong = replace(fields, packed=fields.packed.replace(direction=share * fields.packed.direction))
    message = refusal(building, wrong, [[0.5, 0.5]])
    assert "fastest" in message
    x, y = (float(number) for number in message.split("they end at (")[1].split(")")[0].split(","))
    if share == 0.0:
        assert (x, y) == (0.5, 0.5)
    else:
        assert shapely.box(0.0, 0.0, 0.1, 0.5).distance(shapely.Point(x, y)) < 1e-6


def test_walks_pass_portals_and_slide_along_walls():
    drawing = Drawing()
    drawing.level((0.0, 0.0, 4.0, 5.0))
    drawing.level((4.0, 0.0, 8.0, 5.0))
    drawing.portal(0, 1, (4.0, 2.0), (4.0, 3.0))
    drawing.exit("east", 1, (8.0, 1.0), (8.0, 2.0))
    building = drawing.build()
    fields = build_fields(building, ROUTES)
    starts = [[0.01, 0.01], [3.99, 0.5], [3.99, 4.99], [2.0, 2.5]]
    check(building, fields, starts)
    closed = replace(building, closed=frozenset({0}))
    message = refusal(closed, build_fields(closed, ROUTES), starts)
    assert "building.closed" in message


def test_bodies_are_told_where_they_are_stopped_and_points_pass():
    building = two_rooms(door=(2.0, 2.45))
    fields = build_fields(building, ROUTES, clearance=0.25, narrowest=0.4, widest=0.5)
    starts = [[1.0, 1.0], [1.0, 4.0], [3.0, 2.5], [7.0, 4.0]]
    assert check(building, fields, starts, [0.2, 0.21, 0.225, 0.25]) == ()
    (place,) = check(building, fields, starts, [0.2, 0.23, 0.25, 0.25])
    assert (place.kind, place.level) == ("warning", "floor 0")
    assert place.place == pytest.approx((3.9, 2.22), abs=0.1)
    assert "people.visitors: 2 of 4 people (0.46 to 0.50 m wide)" in place.text


@pytest.mark.parametrize("short", [5e-4, 1e-3, 0.01, 0.1])
def test_no_body_slips_through_a_gap_that_is_a_little_narrower(short):
    building = two_rooms(door=(2.0, 2.5 - short), wall=0.05)
    fields = build_fields(building, ROUTES, clearance=0.25, narrowest=0.5, widest=0.5)
    assert len(check(building, fields, [[1.0, 1.0], [3.0, 2.2]], 0.25 + 1e-4)) == 1
    passing = two_rooms(door=(2.0, 2.5 + short), wall=0.05)
    fields = build_fields(passing, ROUTES, clearance=0.25, narrowest=0.5, widest=0.5)
    assert check(passing, fields, [[1.0, 1.0], [3.0, 2.2]], 0.25) == ()


def test_a_walk_that_ends_within_a_cell_of_its_exit_has_arrived():
    """The exit is 87 m long and turned by a hundredth of a degree: the directions of some cells lead along it."""
    outline = (
        "POLYGON ((642.28 1716.64, 686.645425 1730, 692.897445 1730, 645.6 1715.76, 665.4 1711.38, 691.36 1711.47, "
        "779.2 1711.43, 787.83151 1730, 793.387893 1730, 793.17 1729.61, 779.423369 1700, 773.9 1700, 778.38 1709.66, "
        "691.37 1709.67, 665.21 1709.58, 642.34 1714.64, 642.47 1710.73, 640 1710.851787, 640 1720.402365, "
        "642.16 1720.36, 642.28 1716.64))"
    )
    plan = Plan()
    plan.storey("floor", outline)
    plan.exit("long", "floor", [(691.37, 1709.67), (778.38, 1709.66)])
    building = plan.building()
    fields = build_fields(building, (Route(),))
    assert check(building, fields, [[716.71, 1711.15]]) == ()
    away = replace(building, exits=(replace(building.exits[0], name="other"),))
    with pytest.raises(ScenarioError, match="they end at"):
        check(away, replace(fields, routes=(Route(("long",)),)), [[716.71, 1711.15]])


def test_who_is_cut_off_on_a_stair_is_told_of_by_the_name_of_the_stair_once():
    plan = Plan()
    for name, z in (("ground", 0.0), ("first", 3.5)):
        plan.storey(name, shapely.box(0.0, 0.0, 12.0, 8.0), z=z)
    plan.exit("east", "ground", [(12, 1), (12, 2)])
    plan.shaft("stair", "ground", "first", [(0, 3), (0, 4.2)], direction=(-1, 0), length=4.0, turn="left")
    building = plan.building()
    crowd = make_crowd(np.zeros((len(building.levels), 2)))
    crowd.level[:] = np.arange(len(building.levels))
    group = Group("visitors", np.arange(len(crowd.level), dtype=np.int32), {})
    fields = build_fields(two_rooms(), ROUTES[:1])
    (line,) = cut_off(building, fields, crowd, (group,), np.full(len(crowd.level), 5.0), [])
    assert len(building.pieces_of("stair")) == 3
    assert re.findall("'(.*?)'", line) == ["ground", "stair", "first"]
    assert line.endswith("numbers 0, 1, 2, 3, 4")
