"""Ways round the crowd: they use the width that is there, and keep the next portal or exit of the empty building."""

import numpy as np
import pytest

import evac
from evac.case.schema import QuickestSettings
from evac.directions.build import build_fields
from evac.directions.density import Kernels
from evac.directions.local import CROWDED, LocalWays
from evac.directions.march.waves import JAM
from evac.directions.routes import Route
from evac.simulation.simulation import Simulation

FASTEST = Route((), "fastest")


def local_in(building, routes=(FASTEST,), **settings):
    fields = build_fields(building, routes, clearance=0.0, speeds=(1.0, 0.5, 0.5), keep_grids=True)
    own = fields.with_own_directions()
    return LocalWays(own, fields, QuickestSettings(**{"memory": 0.0, **settings})), fields


def update(local, people, level=0, route=0, firm=0):
    """Update the ways for people at these places, all on one level, the first of whom stand firm."""
    n = len(people)
    levels, routes = np.full(n, level, np.int32), np.full(n, route, np.int32)
    local.update(levels, np.asarray(people), routes, np.full(n, 0.2), np.arange(n) < firm)


def crowd_in(x1, y1, x2, y2, step=0.4):
    return np.array([(x, y) for x in np.arange(x1, x2, step) for y in np.arange(y1, y2, step)])


@pytest.fixture
def hall(drawing):
    """Return a hall of 12 m with an exit at either end."""
    level = drawing.level((0.0, 0.0, 12.0, 6.0))
    drawing.exit("left", level, (0.0, 2.0), (0.0, 4.0))
    drawing.exit("right", level, (12.0, 2.0), (12.0, 4.0))
    return drawing.build()


def test_a_crowd_on_the_line_is_walked_round(hall):
    local, clear = local_in(hall)
    behind = np.array([[7.0, 3.3]])
    assert clear.directions_at(0, behind, 0, 0.2)[0] == pytest.approx([1.0, 0.0], abs=0.02)
    update(local, [*crowd_in(8.5, 1.6, 10.5, 3.7, 0.35), *behind])
    turned = local.fields.directions_at(0, behind, 0, 0.2)[0]
    assert turned.min() > 0.3  # to the side on which the crowd is narrower
    assert np.hypot(*turned) == pytest.approx(1.0, abs=1e-6)


def test_travel_times_stay_those_of_the_empty_building(hall):
    local, clear = local_in(hall)
    update(local, crowd_in(8.0, 1.0, 11.0, 5.0))
    assert (local.fields.packed.travel_time == clear.packed.travel_time).all()
    assert (local.fields.packed.direction != clear.packed.direction).any()


def test_beside_people_who_stand_firm_the_density_falls_with_the_room_that_is_left(drawing):
    """Nobody touches them, and from a radius farther away on they are no hindrance."""
    drawing.level((0.0, 0.0, 12.0, 6.0))
    drawing.exit("right", 0, (12.0, 2.0), (12.0, 4.0))
    fields = build_fields(drawing.build(), (FASTEST,), clearance=0.0, keep_grids=True)
    kernels = Kernels(fields.grids[0].grids, fields.packed, 0.7)
    found = kernels.beside(np.zeros(1, np.int32), np.array([[6.0, 3.0]]), np.array([0.2]), 0.3)
    away = np.array([[6.0 + distance, 3.0] for distance in (0.4, 0.6, 0.7, 0.8, 1.5)])
    there = found[kernels.nodes_at(np.zeros(5, np.int32), away)]
    assert there == pytest.approx([np.inf, JAM * 2 / 3, JAM / 3, 0.0, 0.0], abs=1e-6)


def test_people_who_stand_firm_are_walked_round_on_the_wide_side_until_they_have_gone(hall):
    """One stands 0.1 m above the line of the way, and 1.9 m of the hall are free on the other side of it."""
    local, clear = local_in(hall)
    before, standing = np.array([[9.0, 3.3]]), [9.8, 3.4]
    update(local, [standing, *before], firm=1)
    away = []
    place = before.copy()
    while place[0, 0] < 11.7:
        place += 0.05 * local.fields.directions_at(0, place, 0, 0.2)
        away.append(np.hypot(*(place[0] - standing)))
    assert min(away) > 0.4
    assert local.fields.directions_at(0, before, 0, 0.2)[0, 1] < -0.1
    restored, _ = local_in(hall)
    restored.restore(local.state())
    for one in (local, restored):
        update(one, before)
        assert one.fields.directions_at(0, before, 0, 0.2) == pytest.approx(
            clear.directions_at(0, before, 0, 0.2), abs=0.02
        )


def end_of_way(fields, place):
    """Follow the directions from a place in the hall until an exit is near; return its abscissa."""
    place = np.array([place])
    while 0.3 < place[0, 0] < 11.7:
        place += 0.05 * fields.directions_at(0, place, 0, 0.2)
    return place[0, 0]


def test_nobody_chooses_another_exit(hall):
    local, clear = local_in(hall)
    update(local, crowd_in(7.0, 0.2, 11.9, 5.8))  # all before the right exit
    for place in [(x, y) for x in (6.8, 8.0, 10.0) for y in (0.5, 3.0, 5.2)]:
        assert end_of_way(local.fields, place) > 11.0
    left = np.array([(x, y) for x in (2.0, 5.0) for y in (0.5, 3.0, 5.2)])
    assert local.fields.directions_at(0, left, 0, 0.2) == pytest.approx(clear.directions_at(0, left, 0, 0.2), abs=0.05)


def test_a_sparse_crowd_and_those_who_come_towards_it_change_nothing(hall):
    local, clear = local_in(hall)
    sparse = crowd_in(7.0, 1.0, 11.0, 5.0, 1.2)  # 0.7 per m2
    assert CROWDED > 1.0 / 1.2**2
    update(local, sparse)
    assert (local.fields.packed.direction == clear.packed.direction).all()
    assert not [key for key in local.state() if "column" in key]


@pytest.mark.parametrize("firm", [0, 1])
def test_people_of_another_way_do_not_count(drawing, firm):
    """Whether or not somebody stands firm in a corner."""
    level = drawing.level((0.0, 0.0, 12.0, 6.0))
    drawing.exit("left", level, (0.0, 2.0), (0.0, 4.0))
    drawing.exit("right", level, (12.0, 2.0), (12.0, 4.0))
    local, clear = local_in(drawing.build(), (Route(("left",), "fastest"), Route(("right",), "fastest")))
    crowd = crowd_in(7.0, 1.0, 10.0, 3.2)
    people = np.array([[0.5, 0.5]] * firm + [*crowd, [4.0, 3.0]])
    n = len(people)
    route = (np.arange(n) == n - 1).astype(np.int32)
    local.update(np.zeros(n, np.int32), people, route, np.full(n, 0.2), np.arange(n) < firm)
    there = np.array([[5.0, 3.0], [6.0, 3.0]])
    assert local.fields.directions_at(0, there, 1, 0.2) == pytest.approx(
        clear.directions_at(0, there, 1, 0.2), abs=0.01 if firm else 0.0
    )
    before = np.array([[10.5, 2.0]])
    assert (local.fields.directions_at(0, before, 0, 0.2) != clear.directions_at(0, before, 0, 0.2)).any()


def test_nobody_turns_round_at_a_portal_behind_which_a_crowd_stands(drawing):
    first, second = drawing.level((0.0, 0.0, 6.0, 4.0)), drawing.level((6.0, 0.0, 14.0, 4.0))
    drawing.portal(first, second, (6.0, 0.0), (6.0, 4.0))
    drawing.exit("end", second, (14.0, 1.5), (14.0, 2.5))
    local, _ = local_in(drawing.build())
    update(local, crowd_in(6.1, 0.1, 12.0, 4.0), second)
    places = np.array([(x, y) for x in (5.5, 5.9) for y in (0.5, 2.0, 3.5)])
    assert (local.fields.directions_at(first, places, 0, 0.2)[:, 0] > 0.0).all()
    places = np.array([(x, y) for x in (6.0, 6.1, 6.4) for y in (0.5, 2.0, 3.5)])
    assert (local.fields.directions_at(second, places, 0, 0.2)[:, 0] > 0.0).all()


def test_when_the_crowd_has_gone_ways_are_those_of_the_empty_building(hall):
    local, clear = local_in(hall)
    behind = np.array([[7.0, 3.3]])
    update(local, [*crowd_in(8.5, 1.6, 10.5, 3.7, 0.35), *behind])
    update(local, behind)
    now, before = (fields.directions_at(0, behind, 0, 0.2) for fields in (local.fields, clear))
    assert now == pytest.approx(before, abs=0.02)


def test_levels_without_people_wait_until_somebody_comes(drawing):
    """Also when the state is restored in between."""
    levels = [drawing.level((0.0, 0.0, 12.0, 6.0), z=z) for z in (0.0, 3.0)]
    for name, level in zip(("low", "high"), levels, strict=True):
        drawing.exit(name, level, (12.0, 2.0), (12.0, 4.0))
    building = drawing.build()
    local, clear = local_in(building)
    behind, crowd = np.array([[7.0, 3.3]]), crowd_in(8.5, 1.6, 10.5, 3.7, 0.35)

    def turned(ways, level):
        return ways.fields.directions_at(level, behind, 0, 0.2)[0, 1] - clear.directions_at(level, behind, 0, 0.2)[0, 1]

    update(local, [*crowd, *behind], 0)
    assert turned(local, 0) > 0.3
    update(local, [*crowd, *behind], 1)
    assert turned(local, 0) > 0.3  # nobody is there to need other ways
    assert turned(local, 1) > 0.3
    restored, _ = local_in(building)
    restored.restore(local.state())
    for one in (local, restored):
        update(one, behind, 0)
        assert turned(one, 0) == pytest.approx(0.0, abs=0.02)
        assert turned(one, 1) > 0.3
        update(one, behind, 1)
        assert turned(one, 1) == pytest.approx(0.0, abs=0.02)


def corner(**changes):
    """Return a corridor of 3.6 m round a corner, whose people keep distances."""
    plan = evac.Plan()
    plan.storey("f", [[(-12, 0), (3.6, 0), (3.6, 10), (0, 10), (0, 3.6), (-12, 3.6)]])
    plan.exit("end", "f", [(0, 10), (3.6, 10)])
    plan.area("start", "f", [(-11.8, 0.1), (-2, 0.1), (-2, 3.5), (-11.8, 3.5)])
    table = {
        "building": plan,
        "contact": {"model": "nsm2"},
        "behaviours": {"walking": {}},
        "people": [{"name": "a", "area": "start", "number": 80, "speed": {"normal": [1.34, 0.26], "minimum": 0.7}}],
        "simulation": {"duration": 90.0},
        "output": {"picture": False, "replay": False},
    }
    return evac.load(table, changes)


def test_people_use_the_width_of_a_corner():
    passed = {}
    for strategy in ("fastest", "shortest"):  # whose ways do not follow the crowd
        simulation = Simulation(corner(**{"people.a.strategy": strategy}))
        crowd, apart = simulation.population.crowd, []
        while not simulation.ended:
            simulation.advance_tick()
            x, y = crowd.position[crowd.level >= 0].T
            apart += np.hypot(x, y - 3.6)[(np.abs(3.6 - y - x) < 0.3) & (x > 0.0)].tolist()  # on the diagonal
        passed[strategy] = np.median(apart), simulation.time
    assert passed["fastest"][0] > 1.3 * passed["shortest"][0]  # of the distances from the inner corner
    assert passed["fastest"][1] < passed["shortest"][1]


def test_without_people_who_keep_distances_no_way_follows_the_crowd():
    simulation = Simulation(corner(**{"behaviours.walking": False}))
    assert simulation.scene.local is None
    assert simulation.fields is simulation.scene.shared_scene.fields
    states = {row.part: row.state for row in simulation.plan}
    assert states["ways round the crowd"] == "out"
