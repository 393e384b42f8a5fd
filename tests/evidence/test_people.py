"""People as measured: measures on exact motions, blocked runs, rows that are kept, and the page."""

import numpy as np
import pytest

from evac.evidence.people import measures
from evac.evidence.people.measures import Line, Track
from evac.evidence.people.runs import LEFT
from evac.evidence.people.values import Value, by_seed

TICK = 0.1


def moving(start, velocity, duration=30.0):
    """The track of people who walk at constant velocities from given places."""
    time = TICK * np.arange(round(duration / TICK) + 1)
    position = np.array(start, float)[None] + time[:, None, None] * np.array(velocity, float)
    return Track(time, position, np.zeros(position.shape[:2], np.int32), np.full(len(start), np.nan))


def in_a_row(number, distance, velocity, first=-1.0):
    """The track of people behind each other along x."""
    return moving([(first - k * distance, 0.0) for k in range(number)], (velocity, 0.0), 120.0)


def test_passing_times_at_constant_speed_are_exact_and_lacking_for_who_does_not_pass():
    track = moving(
        [(-1.03, 0.0), (-2.0, 1.0), (-5.0, 0.0), (4.0, 0.0)], [(0.5, 0.0), (2.0, 0.0), (0.0, 0.0), (1.0, 0.0)]
    )
    assert measures.passing_times(track, Line(0, 0.0, 1)) == pytest.approx([2.06, 1.0, np.nan, np.nan], nan_ok=True)
    back = moving([(0.0, 3.0)], [(0.0, -1.5)])
    assert measures.passing_times(back, Line(1, 0.3, -1)) == pytest.approx([1.8])


def test_flow_through_a_door_is_that_of_people_at_equal_distances():
    track = in_a_row(40, 0.7, 1.4)
    assert measures.door_flow(track, Line(0, 0.0, 1), 0.8) == {"flow per metre [1/s/m]": pytest.approx(2.0 / 0.8)}


def test_narrow_door_has_times_from_the_first_passage_on():
    found = measures.narrow_door(in_a_row(75, 0.5, 1.0), Line(0, 0.0, 1))
    assert found["flow [1/s]"] == pytest.approx(2.0)
    assert [found[f"{count} out [s]"] for count in (10, 40, 75)] == pytest.approx([4.5, 19.5, 37.0])
    assert found["nearest neighbour [m]"] == pytest.approx(0.5)
    assert found["heading rms [deg]"] == pytest.approx(0.0, abs=1e-6)


def test_crowds_are_compared_with_those_beside_them():
    half, other = in_a_row(40, 0.7, 1.4), in_a_row(40, 0.7, 0.7)
    both = [np.concatenate([a, b], axis=1) for a, b in zip(half[1:3], other[1:3], strict=True)]
    track = Track(half.time, *both, np.concatenate([np.full(40, 30.0), np.full(40, 20.0)]))
    beside = measures.flow_beside(track, (Line(0, 0.0, 1), Line(0, 0.0, 1)))
    assert beside == {"beside the straight corridor [-]": pytest.approx(2.0)}
    assert measures.last_beside(track, 40) == {"beside one stream alone [-]": pytest.approx(1.5)}
    # two of three of those who pass 16th to 60th are of the first 40, and nobody who passes later
    share = measures.share_of_first(track, Line(0, 0.0, 1), 40)["share from the left [-]"]
    assert share == pytest.approx(29 / 48, abs=2 / 48)
    assert measures.distance_in_file(half, 10) == {"distance [m]": pytest.approx(0.7)}


def test_nobody_counts_in_front_of_the_door_who_is_far_or_beyond_it():
    near = moving([(-0.5, 0.0), (-0.5, 0.4), (-2.5, 0.0), (-2.5, 0.1), (0.2, 0.0), (0.3, 0.0)], (0.0, 0.0))
    assert measures.nearest_neighbour(near, 1.0, Line(0, 0.0, 1)) == pytest.approx(0.4)
    assert np.isnan(measures.nearest_neighbour(in_a_row(3, 1.0, 1.0, -9.0), 1.0, Line(0, 0.0, 1)))


def test_heading_turns_by_the_angle_of_a_zigzag():
    angle = np.radians(np.where(np.arange(100) // 2 % 2, 10.0, -10.0))  # two ticks each
    way = np.concatenate([[(0.0, 0.0)], np.cumsum(np.stack([np.cos(angle), np.sin(angle)], axis=1), axis=0)])
    turns = []
    for length in (0.02, 0.001):  # m in a tick
        place = np.array([-1.5, 0.0]) + length * way
        track = Track(TICK * np.arange(101), place[:, None], np.zeros((101, 1), np.int32), np.full(1, np.nan))
        turns.append(measures.heading_rms(track, 4.0, Line(0, 0.0, 1)))
    assert turns == pytest.approx([20.0, np.nan], nan_ok=True)  # who hardly moves has no heading


def test_corridor_has_density_speed_and_flow_of_a_lattice():
    rows, spacing, speed = 60, 0.5, 1.25
    start = [(x, 3.1 + k * spacing) for k in range(rows) for x in (-0.6, 0.0, 0.6)]
    found = measures.corridor(moving(start, (0.0, -speed)), (-2.0, 0.0), 1.8, Line(1, -4.1, -1), (0.3, 0.75))
    assert found["density [1/m2]"] == pytest.approx(3.0 / 1.8 / spacing, rel=0.02)
    assert found["speed [m/s]"] == pytest.approx(speed)
    assert found["flow [1/s]"] == pytest.approx(3.0 * speed / spacing, rel=0.02)
    assert found[measures.speed_column(3.0, 3.5)] == pytest.approx(speed)
    assert np.isnan(found[measures.speed_column(1.0, 1.5)])
    assert found[measures.frames_column(1.0, 1.5)] == 0 < found[measures.frames_column(3.0, 3.5)]


def test_stair_has_the_speed_along_its_slope():
    track = in_a_row(50, 0.6, 0.3, 10.5)
    found = measures.stair(track, Line(0, 11.5, 1), (10.2, 12.8), 1.2, 0.6)
    assert found == {"flow per metre [1/s/m]": pytest.approx(0.5 / 1.2), "speed [m/s]": pytest.approx(0.5)}


def test_two_way_counts_each_crowd_in_its_direction_where_both_are():
    start = [(side * (1.0 + 0.5 * k), y) for side in (-1, 1) for k in range(60) for y in (-0.5, 0.5)]
    sign = np.repeat([1, -1], 120)
    found = measures.two_way(moving(start, sign[:, None] * np.array([0.8, 0.0])), sign, 3.0, 2.0, (12.0, 25.0))
    assert found["speed [m/s]"] == pytest.approx(0.8)
    assert found["density [1/m2]"] == pytest.approx(4.0, rel=0.02)
    alone = measures.two_way(moving(start[:120], (0.8, 0.0)), sign[:120], 3.0, 2.0, (12.0, 25.0))
    assert np.isnan(alone["speed [m/s]"])


def test_bend_has_the_distance_from_its_inner_corner_at_the_diagonal():
    track = moving([(-4.0, -1.0), (-5.0, -2.0), (-6.0, -3.0)], (1.0, 0.0))
    done = Track(track.time, track.position, track.level, np.array([7.0, 9.0, 8.0]))
    found = measures.bend(done)
    assert (found["last out [s]"], measures.last_out(done, 1)["last out [s]"]) == (9.0, 7.0)
    assert found["from inner corner [m]"] == pytest.approx(2.0 * np.sqrt(2.0), abs=0.1)


def run_row(seed, value=None, left=0, scene="a", **more):
    row = {"scene": scene, "setting": "walking", "model": "NSM2", "seed": seed, LEFT: left, "flow [1/s]": value}
    return row | more


def test_values_of_several_scenes_are_weighted_by_their_moments():
    value = Value(("a", "b"), "speed", weight="moments")
    rows = [
        run_row(1, scene="a", speed=1.0, moments=30),
        run_row(1, scene="b", speed=2.0, moments=10),
        run_row(2, scene="a", speed=None, moments=0),
        run_row(2, scene="b", speed=3.0, moments=5),
        run_row(3, None, 4, scene="a", speed=None, moments=None),
    ]
    assert by_seed(value, rows) == pytest.approx([1.25, 3.0])
