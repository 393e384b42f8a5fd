"""Response times: who draws with whom, from what, and what is refused."""

from types import SimpleNamespace

import numpy as np
from shapely import box

from evac.building.model.building import Area
from evac.people.behaviour import BehaviourScene
from evac.simulation.scene import SharedScene
from evac_plugins.behaviour_response_time import ResponseTime

UNIFORM = {"uniform": [0.0, 10.0]}


AREAS = (Area("left", 0, box(0, 0, 4, 4)), Area("right", 0, box(4, 0, 8, 4)), Area("above", 1, box(0, 0, 20, 4)))


def scene(*groups, positions=None, levels=0, areas=AREAS, seed=1):
    """Return a scene of groups, given as (name, number, settings), in two rooms side by side on level 0."""
    made, count = [], 0
    for name, number, settings in groups:
        rows = np.arange(count, count + number, dtype=np.int32)
        made.append(SimpleNamespace(name=name, rows=rows, settings=settings, comes_in=False))
        count += number
    crowd = SimpleNamespace(
        position=np.zeros((count, 2)) if positions is None else np.array(positions, dtype=np.float64),
        level=np.array(np.broadcast_to(np.asarray(levels, dtype=np.int32), count)),
        group=np.repeat(np.arange(len(groups), dtype=np.int32), [number for _, number, _ in groups]),
        start_time=np.zeros(count),
    )
    scene = SharedScene(SimpleNamespace(areas=areas, levels=range(2), links=()), SimpleNamespace(grids=()))
    return BehaviourScene(crowd, scene, tuple(made), np.random.default_rng(seed), 0.1)


def start_times(behaviour, of):
    behaviour.prepare(of)
    return of.crowd.start_time


def test_each_person_draws_from_the_distribution():
    times = np.sort(start_times(ResponseTime(time=UNIFORM), scene(("all", 2000, {}))))
    expected = (np.arange(2000) + 0.5) / 200
    assert np.abs(times - expected).max() < 10 * 1.95 / np.sqrt(2000)  # Kolmogorov-Smirnov, 0.1 %


def test_a_group_draws_once():
    times = start_times(ResponseTime(time=UNIFORM, per="group"), scene(("a", 5, {}), ("b", 7, {})))
    assert len(set(times[:5])) == len(set(times[5:])) == 1
    assert times[0] != times[5]


def test_a_place_draws_once_and_a_level_is_the_place_outside_of_areas():
    positions = [[1, 1], [2, 3], [5, 1], [7, 2], [12, 1], [15, 2]]
    times = start_times(ResponseTime(time=UNIFORM, per="place"), scene(("a", 3, {}), ("b", 3, {}), positions=positions))
    left, right, outside = times[:2], times[2:4], times[4:]
    assert [len(set(place)) for place in (left, right, outside)] == [1, 1, 1]
    assert len({left[0], right[0], outside[0]}) == 3


def units(positions, **given):
    """Return a number for each person, in order of first appearance, the same for those who share a place's draw."""
    times = start_times(
        ResponseTime(time=UNIFORM, per="place"), scene(("all", len(positions), {}), positions=positions, **given)
    ).tolist()
    seen = list(dict.fromkeys(times))
    return [seen.index(time) for time in times]


def test_places_of_one_storey_are_apart_from_those_of_another_in_the_same_plan():
    positions = [(1, 1), (1, 1), (15, 1), (15, 1), (15, 5), (15, 5)]
    assert units(positions, levels=[0, 1, 0, 1, 0, 1]) == [0, 1, 2, 1, 2, 3]


def test_where_areas_overlap_the_first_is_the_place():
    areas = (Area("hall", 0, box(0, 0, 4, 4)), Area("corner", 0, box(2, 2, 6, 6)))
    assert units([(1, 1), (3, 3), (5, 5)], areas=areas) == [0, 0, 1]


def test_a_groups_own_time_replaces_the_shared_one():
    own = {"time": {"list": [1.0, 2.0, 3.0]}}
    times = start_times(ResponseTime(time=20.0), scene(("a", 3, own), ("b", 2, {}), ("c", 1, {"time": 0})))
    assert times.tolist() == [1.0, 2.0, 3.0, 20.0, 20.0, 0.0]


def test_left_out_exactly_if_everybody_sets_off_at_once():
    assert not ResponseTime().is_needed(scene(("a", 3, {})))
    assert ResponseTime().is_needed(scene(("a", 3, {"time": 2.0})))
    assert ResponseTime(time=UNIFORM).is_needed(scene(("a", 3, {})))
    assert not ResponseTime(time=UNIFORM).is_needed(scene(("a", 3, {"time": 0.0})))


def test_does_all_its_work_at_the_start_unless_people_wait_for_a_cue():
    for begin in ("start", "cue"):
        behaviour = ResponseTime(begin=begin)
        behaviour.prepare(scene(("a", 3, {})))
        assert behaviour.acts_at_ticks() == (begin == "cue")
