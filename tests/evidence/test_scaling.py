"""Halls of any size, and where the time of a step goes."""

import csv
import itertools
import math

import numpy as np
import pytest

from evac.base.errors import SimulationError
from evac.evidence.evidence import Evidence
from evac.evidence.scaling import headway, large, laws, walks
from evac.evidence.scaling import page as scaling
from evac.evidence.scaling.halls import DENSITY, DOOR, RADIUS, doors_along, hall_case, make_hall, nearest_door
from evac.evidence.scaling.minimal import make_minimal, walk_minimal
from evac.evidence.scaling.page import PHASES, STEP, phase_times
from evac.evidence.scaling.peers import programs
from evac.evidence.scaling.walks import JAMMED, LONGEST, SETTLING, TICK, Walk, make_variant, memory, time_ticks
from evac.physics.state import SKIN, copy_of, make_problem


def walked(people, density, name, ticks):
    walk = Walk(make_hall(people, density, 1), STEP)
    walk.advance(make_variant(name, STEP).model, ticks)
    return walk


def gaps(crowd):
    apart = np.linalg.norm(crowd.position[:, None] - crowd.position[None], axis=2)
    apart -= crowd.radius[:, None] + crowd.radius[None]
    return apart[np.triu_indices(len(crowd.radius), 1)]


@pytest.mark.parametrize("density", [2.0, 5.0])
@pytest.mark.parametrize("people", [20, 400])
def test_hall_holds_its_people_without_overlap(people, density):
    hall = make_hall(people, density, seed=1)
    crowd = hall.crowd
    assert len(crowd.level) == people
    assert gaps(crowd).min() >= 0.0
    assert (crowd.position > crowd.radius[:, None]).all()
    assert (crowd.position < np.array([hall.depth, hall.length]) - crowd.radius[:, None]).all()
    assert crowd.radius.min() >= RADIUS[0]
    assert np.isfinite(hall.fields.travel_time_at(0, crowd.position, 0)).all()


def test_density_is_reached_as_halls_grow():
    for density in (2.0, 5.0):
        halls = {people: make_hall(people, density, 1) for people in (20, 200, 2000)}
        shares = [people / (hall.depth * hall.length) / density for people, hall in halls.items()]
        assert shares == sorted(shares)
        assert 0.94 < shares[-1] <= 1.0


def test_walls_and_doors_close_the_hall():
    hall = make_hall(2000, 2.0, seed=1)
    walls = sum(math.dist(wall[:2], wall[2:]) for wall in hall.building.walls)
    doors = sum(exit_.width for exit_ in hall.building.exits)
    assert len(hall.building.exits) == 3
    assert doors == pytest.approx(3 * DOOR)
    assert hall.depth == hall.length
    assert walls + doors == pytest.approx(4.0 * hall.length)


def test_a_hall_is_no_deeper_than_it_may_be_and_has_doors_along_its_length():
    hall = make_hall(2000, 5.0, seed=1, deepest=10.0)
    assert 9.0 < hall.depth <= 10.0
    assert 0.94 < 2000 / (hall.depth * hall.length) / 5.0 <= 1.0
    assert len(hall.building.exits) == round(hall.length / 10.0) == 4
    assert gaps(hall.crowd).min() >= 0.0
    assert (hall.crowd.position < np.array([hall.depth, hall.length]) - hall.crowd.radius[:, None]).all()
    assert make_hall(2000, 5.0, seed=1, deepest=100.0).depth == make_hall(2000, 5.0, seed=1).depth


def test_the_nearest_door_is_that_whose_middle_is_nearest_along_the_wall():
    low, high = doors_along(40.0)
    assert len(low) == 4
    np.testing.assert_allclose(0.5 * (low + high), [5.0, 15.0, 25.0, 35.0])
    places = np.array([0.0, 9.9, 10.1, 24.0, 29.9, 40.0])
    assert nearest_door(40.0, places).tolist() == [0, 0, 1, 2, 2, 3]


def test_same_seed_gives_the_same_hall():
    one, two, other = make_hall(50, 2.0, 1), make_hall(50, 2.0, 1), make_hall(50, 2.0, 2)
    assert np.array_equal(one.crowd.position, two.crowd.position)
    assert not np.array_equal(one.crowd.position, other.crowd.position)


@pytest.mark.parametrize("name", scaling.MODELS)
def test_phases_share_the_step_and_leave_the_crowd_alone(name):
    walk, variant = walked(100, 2.0, name, ticks=3), make_variant(name, STEP)
    cost = time_ticks(walk, variant.model, 2)
    before = walk.crowd.position.copy(), walk.crowd.velocity.copy(), walk.crowd.level.copy()
    spent = phase_times(walk, variant, cost)
    assert tuple(spent) == PHASES
    assert min(spent.values()) >= 0.0
    assert spent["contact and rest"] == pytest.approx(
        max(0.0, cost.seconds - sum(spent[phase] for phase in PHASES if phase != "contact and rest"))
    )
    for array, old in zip((walk.crowd.position, walk.crowd.velocity, walk.crowd.level), before, strict=True):
        assert np.array_equal(array, old)


def test_walking_is_the_same_walk_every_time():
    hall = make_hall(100, 5.0, 1)
    ends = [walked(100, 5.0, "NSM2", ticks=3) for _ in range(2)]
    assert np.array_equal(ends[0].crowd.position, ends[1].crowd.position)
    assert not np.array_equal(ends[0].crowd.position, hall.crowd.position)
    assert np.abs(ends[0].crowd.position - hall.crowd.position).max() < 2.5 * ends[0].time
    assert ends[0].time == pytest.approx(3 * TICK)


def test_a_tick_lasts_as_long_whatever_the_step():
    walk = Walk(make_hall(20, 2.0, 1), STEP / 4)
    walk.advance(make_variant("DEM", STEP / 4).model, 2)
    assert (walk.made, walk.time) == (80, pytest.approx(2 * TICK))


def test_a_jam_is_a_crowd_that_has_come_to_a_crawl():
    walk = Walk(make_hall(200, 5.0, 1), STEP)
    assert walk.pace == 0.0
    walk.advance(make_variant("NSM1 inertial", STEP).model, 5)
    assert walk.pace > JAMMED
    jam = Walk(make_hall(200, 5.0, 1), STEP)
    variant = make_variant("NSM1 inertial", STEP)
    assert jam.into_a_jam(variant) == "jam"
    assert SETTLING * TICK < jam.time < LONGEST
    assert jam.pace < walk.pace
    # Walked to the jam roughly, settled and timed as shipped.
    assert variant.rough.gap_tolerance > variant.model.gap_tolerance


def test_a_crowd_that_walks_out_or_keeps_walking_is_no_jam(monkeypatch):
    variant = make_variant("DEM", STEP)
    assert Walk(make_hall(20, 2.0, 1), STEP).into_a_jam(variant) == "50 % are out"
    monkeypatch.setattr("evac.evidence.scaling.walks.LONGEST", 0.5)
    crowd = Walk(make_hall(500, 5.0, 1), STEP)
    assert crowd.into_a_jam(variant) == "longest time"
    assert crowd.time == pytest.approx(0.5 + SETTLING * TICK)


def test_a_refusal_stands_in_the_row_with_its_time(monkeypatch):
    def refuse(self, model, ticks=1):
        self.made += 1
        raise SimulationError("t = 7.070 s: person 1 at (1, 2) would pass through a wall: the contact is too soft")

    monkeypatch.setattr(Walk, "advance", refuse)
    row = scaling._row(make_hall(20, 5.0, 1), "jammed", make_variant("DEM", STEP), 1, 1)
    assert row["walk ended by"] == "refused at t = 7.070 s"
    assert row["ns per person-step"] is None
    assert {row[f"{phase} [%]"] for phase in PHASES} == {None}


def in_the_middle(hall, reach):
    """Return the crowd of a hall without those who may touch a wall or reach a door soon."""
    crowd = copy_of(hall.crowd)
    crowd.level[(np.abs(crowd.position - 0.5 * hall.length) > reach).any(axis=1)] = -1
    return crowd


@pytest.mark.parametrize("density", [2.0, 5.0])
def test_the_minimal_kernel_walks_as_dem_does_away_from_walls(density):
    hall = make_hall(400, density, 1)
    walk = Walk(hall._replace(crowd=in_the_middle(hall, 2.5)), STEP)
    minimal = make_minimal(walk.crowd, hall.fields.packed, STEP)
    people = nearest(walk.crowd.position, minimal.position)
    before = walk.crowd.position[people].copy()
    walk.advance(make_variant("DEM", STEP).model, 8)
    walk_minimal(minimal, 8 * walk.per_tick, STEP)
    assert np.linalg.norm(minimal.position - before, axis=1).mean() > 0.5
    np.testing.assert_allclose(minimal.position, walk.crowd.position[people], atol=1e-9)
    np.testing.assert_allclose(minimal.velocity, walk.crowd.velocity[people], atol=1e-7)
    report = walk.engine.report()
    assert report["overlaps"] > 0
    assert report["sub_steps"] == report["steps"]


def nearest(positions, places):
    return np.linalg.norm(positions[:, None] - places[None], axis=2).argmin(axis=0)


def test_the_lists_of_the_minimal_kernel_have_each_pair_once():
    hall = make_hall(300, 5.0, 1)
    minimal = make_minimal(hall.crowd, hall.fields.packed, STEP)
    walk_minimal(minimal, 1, STEP)
    place, radius = minimal.listed_position, minimal.radius
    apart = np.linalg.norm(place[:, None] - place[None], axis=2) - radius[:, None] - radius[None]
    expected = {(i, j) for i, j in np.argwhere(apart < SKIN).tolist() if i < j}
    found = [
        (i, j)
        for i in range(len(radius))
        for j in minimal.pair_body[minimal.pair_start[i] : minimal.pair_start[i + 1]].tolist()
    ]
    assert len(found) == len(expected) > 300
    assert {tuple(sorted(pair)) for pair in found} == expected


def test_ticks_are_timed_beside_the_minimal_kernel(monkeypatch):
    """A tick of evac takes 3 s, one of the minimal kernel 2 s."""
    walk = Walk(make_hall(20, 2.0, 1), STEP)
    calls = itertools.cycle([3.0, 2.0])
    monkeypatch.setattr(walks, "cpu_time", lambda call: call() or next(calls))
    cost = time_ticks(walk, make_variant("NSM2", STEP).model, 4)
    assert (cost.seconds, cost.per_person) == pytest.approx((0.3, 0.3 / 20))
    assert (cost.minimal, cost.ratio) == pytest.approx((0.2 / 20, 1.5))


def test_a_case_of_a_hall_has_the_doors_and_the_density_of_a_hall():
    content = hall_case(2000)
    plan, (group,) = content["building"]["plan"], content["people"]
    side = plan["storeys"][0]["polygons"][0][2][0]
    assert group["number"] / side**2 == pytest.approx(DENSITY)
    doors = [exit_["segment"] for exit_ in plan["exits"]]
    assert len(doors) == round(side / 10.0) == 3
    assert {one[0] for door in doors for one in door} == {side}
    assert [math.dist(*door) for door in doors] == pytest.approx([DOOR] * 3)


@pytest.mark.parametrize(("model", "behaviour"), large.SCENES)
def test_a_large_hall_is_simulated_beside_the_minimal_kernel(model, behaviour):
    row = large.simulate(200, model, behaviour, 1)
    assert (row["people"], row["model"], row["behaviour"]) == (200, model, behaviour)
    assert sum(row[f"{phase} [%]"] for phase in large.SHOWN) == pytest.approx(100.0)
    costs = ("set-up [s]", "set-up [minimal steps]", "first tick [s]", "ns per person-step", "times minimal")
    assert min(row[key] for key in costs) > 0.0
    assert row["nodes"] == pytest.approx((10.0 / 0.1) ** 2, rel=0.3)
    assert row["peak memory [MB]"] == pytest.approx(1e-6 * large.peak_memory(), rel=0.5)


def test_memory_grows_with_the_people_alone():
    model = make_variant("DEM", STEP).model
    small, large = (memory(walked(people, 2.0, "DEM", ticks=2), model) for people in (200, 2000))
    assert 8 < large / small <= 10
    # DEM has its stiffness and a number of its own for each person, NSM2 the contact problem.
    other = walked(2000, 2.0, "NSM2", ticks=1)
    problem = sum(np.asarray(value).nbytes for value in other.engine.state.problem.values().values())
    without = sum(np.asarray(value).nbytes for value in make_problem(0, 0).values().values())
    found = memory(other, make_variant("NSM2", STEP).model) - large
    assert found == problem - without - 8 * (1 + 2000)


@pytest.mark.slow
def test_page_is_written(tmp_path):
    scaling.run(Evidence("scaling", tmp_path, quick=True))
    names = {path.name for path in tmp_path.iterdir()}
    tables = {f"{name}.csv" for name in ("claims", "scaling", "large", "headway", "laws")}
    assert names - {"peers.csv"} == {"README.md", "run.json", "scaling.png", *tables}
    with (tmp_path / "scaling.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert np.allclose([sum(float(row[f"{phase} [%]"]) for phase in PHASES) for row in rows], 100.0)
    assert len(rows) == len(scaling.QUICK_SIZES) * (2 * len(scaling.MODELS) + 1)
    assert {row["model"] for row in rows if row["state"] == "jammed"} == {*scaling.MODELS, scaling.STIFF_NAME}
    for name in ("minimal [ns]", "times minimal", "bytes, times minimal"):
        assert min(float(row[name]) for row in rows) > 0.0
    page = (tmp_path / "README.md").read_text()
    scaling.run(Evidence("scaling", tmp_path, page_only=True))
    assert (tmp_path / "README.md").read_text() == page


def test_headway_is_timed_beside_the_same_walk_without_it(monkeypatch):
    """Calls take 1 s, 3 s where they decide, and 0.5 s of the minimal kernel; nobody is out so soon."""
    spans = {"advance": 1.0, "act": 3.0, "walk_minimal": 0.5}
    hall = make_hall(20, 2.0, 1)

    def timed(call):
        call()
        return next(span for name, span in spans.items() if name in call.__code__.co_names)

    monkeypatch.setattr(headway, "cpu_time", timed)
    monkeypatch.setattr(walks, "cpu_time", timed)
    monkeypatch.setattr(headway, "WARM", 0)
    monkeypatch.setattr(headway, "TIMED", 3)
    costs = headway.compare(hall, make_variant("NSM2", STEP))
    assert costs["without"] == costs["with: steps"] == pytest.approx(1e9 / 10 / 20)
    assert costs["with: headway itself"] == pytest.approx(3.0 * costs["without"])
    assert costs["with / without"] == pytest.approx(4.0)
    assert (costs["without / minimal"], costs["with / minimal"]) == pytest.approx((2.0, 8.0))


def test_laws_are_timed_in_turns_and_the_linear_spring_walks_as_dem(monkeypatch):
    """Ticks of the minimal kernel take 0.5 s, those of the laws 2, 3, 3.5 and 4 s."""
    spans = itertools.cycle((0.5, 2.0, 3.0, 3.5, 4.0))

    def timed(call):
        call()
        return next(spans)

    monkeypatch.setattr(programs, "cpu_time", timed)
    monkeypatch.setattr(laws, "WARM", 0)
    monkeypatch.setattr(laws, "TIMED", 3)
    dem, spring, _, hertz = laws.compare(make_hall(100, 5.0, 1), STEP)
    assert (dem["ns per person-step"], dem["times DEM"]) == pytest.approx((1e9 * 2.0 / 100 / 10, 1.0))
    assert (spring["times DEM"], hertz["times DEM"]) == pytest.approx((1.5, 2.0))
    assert (dem["times minimal"], hertz["times minimal"]) == pytest.approx((4.0, 8.0))
    assert spring["sub-steps per step"] == 1.0
    assert hertz["times DEM, per sub-step"] * hertz["sub-steps per step"] == pytest.approx(
        hertz["times DEM"] * dem["sub-steps per step"]
    )
    soft, hard = Walk(make_hall(100, 2.0, 1), STEP), Walk(make_hall(100, 2.0, 1), STEP)
    soft.advance(laws.Spring(), 5)
    hard.advance(make_variant("DEM", STEP).model, 5)
    assert np.allclose(soft.crowd.position, hard.crowd.position, rtol=0.0, atol=1e-12)
