import numpy as np
import pytest

from evac.analysis.lines import Moves, Occupancy, moves_of
from evac.base.errors import ResultError


def ints(*values):
    return np.array(values, np.int32)


def log(*rows):
    return ints(*(r[0] for r in rows)), ints(*(r[1] for r in rows)), np.array([r[2] for r in rows], float)


def test_moves_follow_a_person_down_and_out(building):
    moves = moves_of(building, ints(4), log((0, 3, 1.0), (0, 2, 2.0), (0, 1, 3.0), (0, 0, 4.0)), np.array([5.0]))
    assert moves.source.tolist() == [4, 3, 2, 1, 0]
    assert moves.target.tolist() == [3, 2, 1, 0, -1]
    assert moves.time.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_exits_in_the_log_are_not_counted_twice(building):
    exit_link = building.link_of(building.exits[0])
    moves = moves_of(building, ints(0), log((0, exit_link, 5.0)), np.array([5.0]))
    assert (moves.source.tolist(), moves.target.tolist()) == ([0], [-1])


def test_crossings_of_several_people_are_ordered_by_time(building):
    moves = moves_of(building, ints(0, 0), log((1, 0, 2.0), (0, 0, 1.0)), np.full(2, np.nan))
    assert (moves.row.tolist(), moves.time.tolist()) == ([0, 1], [1.0, 2.0])


def test_crossing_of_a_portal_elsewhere_is_refused(building):
    with pytest.raises(ResultError, match=r"1\.500 s person 0 .*'portal 3' .*'floor 0'"):
        moves_of(building, ints(0), log((0, 3, 1.5)), np.full(1, np.nan))


def test_moves_within_a_place_do_not_count():
    moves = Moves(ints(1, 0), ints(0, 0, 1), ints(1, 2, 0), ints(2, -1, 1), ints(0, 1, 0), np.array([1.0, 2.0, 3.0]))
    assert moves.occupancy([1, 2]) == Occupancy(people=2, greatest_number=1, last_left=None)
    assert moves.occupancy([2]) == Occupancy(people=1, greatest_number=1, last_left=2.0)
    assert moves.occupancy([7]) == Occupancy(people=0, greatest_number=0, last_left=None)


def test_occupancy_agrees_with_counting_at_every_moment():
    generator = np.random.default_rng(5)
    people, moves_each, levels = 30, 8, 4
    start = generator.integers(0, levels, people).astype(np.int32)
    track, rows = start.copy(), []
    for time in np.sort(generator.uniform(0.0, 100.0, people * moves_each)):
        person = generator.integers(people)
        source, track[person] = track[person], generator.integers(0, levels)
        rows.append((person, source, track[person], time))
    columns = list(zip(*rows, strict=True))
    moves = Moves(start, *(ints(*column) for column in columns[:3]), ints(*columns[0]), np.array(columns[3]))
    place = [1, 3]
    now, seen, most = start.copy(), set(np.flatnonzero(np.isin(start, place))), np.isin(start, place).sum()
    for person, _, target, _ in rows:
        now[person] = target
        seen |= {person} if target in place else set()
        most = max(most, np.isin(now, place).sum())
    found = moves.occupancy(place)
    assert (found["people"], found["greatest_number"]) == (len(seen), most)
