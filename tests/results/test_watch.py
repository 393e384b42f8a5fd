"""What is noticed of people during a run: means over spans of time, by person, with time and place."""

import numpy as np
import pytest

from evac.physics.state import make_crowd
from evac.results.ending import CRUSHING_FORCE, CRUSHING_LOAD, DENSITY, FEWEST_FRAMES, Watch, densities


def crowd_of(speeds, forces=0.0, **of):
    places = np.column_stack([np.arange(len(speeds)), np.full(len(speeds), 5.0)])
    crowd = make_crowd(places, [(speed, 0.0) for speed in speeds], **of)
    crowd.contact_force[:] = forces
    return crowd


def displaced(*speeds):
    return np.array([(0.0, speed) for speed in speeds])


def test_velocities_that_nobody_moves_with_are_chatter():
    """Three people for 4 s: in the second span of 2 s the last two chatter, the last one more."""
    watch = Watch(np.full(3, 0.2), 0.5, 0.5)
    calm = crowd_of([1.0, 1.0, 1.0])
    for k in range(1, 5):
        watch.look(0.5 * k, calm, displaced(1.0, 0.9, 0.81))
    assert watch.observations().get("chatter") is None
    for k in range(5, 9):
        watch.look(0.5 * k, calm, displaced(1.0, 0.4, 0.3))
    found = watch.observations().get("chatter")
    assert (found.people, found.since, found.until, found.begin, found.end) == (2, 2.0, 4.0, 2.0, 4.0)
    assert (found.person, found.level, found.x, found.y) == (2, 0, 2.0, 5.0)
    assert found.values == pytest.approx((1.0, 0.3))
    assert watch.observations().get("crushing") is None


@pytest.mark.parametrize(
    ("velocity", "moved", "is_chatter"), [(0.41, 0.2, True), (0.39, 0.2, False), (0.2, 0.01, False)]
)
def test_chatter_is_more_than_twice_as_fast_and_by_more_than_a_fifth_of_a_metre_per_second(velocity, moved, is_chatter):
    watch = Watch(np.full(1, 0.2), 2.0, 2.0)
    watch.look(2.0, crowd_of([velocity]), displaced(moved))
    assert (watch.observations().get("chatter") is not None) == is_chatter


@pytest.mark.parametrize("people", [0, 1, 300])
def test_densities_are_the_people_within_a_disc_of_one_square_metre_on_the_same_level(people):
    rng = np.random.default_rng(people)
    crowd = make_crowd(8.0 * rng.random((people, 2)) - 3.0)
    crowd.level[:] = rng.integers(-1, 3, people)
    apart = np.hypot(*(crowd.position[:, None] - crowd.position).transpose(2, 0, 1))
    together = (crowd.level[:, None] == crowd.level) & (crowd.level >= 0)[:, None]
    exact = (together & (np.pi * apart**2 <= 1.0)).sum(axis=1)
    np.testing.assert_array_equal(densities(crowd), exact)


@pytest.mark.parametrize(("people", "parts", "is_dense"), [(6, 0, False), (7, 0, True), (7, 5, False)])
def test_a_crowd_is_too_dense_if_it_is_so_for_ten_seconds_on_one_level(people, parts, is_dense):
    """People on a circle of 0.2 m, which one of them leaves at one sample, and one on another level above them."""
    angle = np.arange(people) * 2.0 * np.pi / people
    crowd = make_crowd(0.2 * np.array([*np.column_stack([np.cos(angle), np.sin(angle)]), (0.0, 0.0)]))
    crowd.level[-1] = 1
    watch = Watch(np.full(people + 1, 0.2), 1.0, 1.0)
    for time in range(1, 10):
        crowd.position[0, 0] = 5.0 if time == parts else 0.2
        watch.look(float(time), crowd, np.zeros((people + 1, 2)))
    assert watch.observations().get("dense") is None
    watch.look(10.0, crowd, np.zeros((people + 1, 2)))
    found = watch.observations().get("dense")
    assert (found is not None) == is_dense == (people > DENSITY and not parts)
    if found is not None:
        assert (found.people, found.begin, found.end, found.values[0]) == (7, 0.0, 10.0, 7.0)


def test_who_leaves_within_a_span_is_left_out_of_it():
    watch = Watch(np.full(2, 0.2), 1.0, 1.0)
    crowd = crowd_of([1.0, 1.0])
    watch.look(1.0, crowd, displaced(0.0, 0.0))
    crowd.level[0] = -1
    watch.look(2.0, crowd, displaced(0.0, 0.0))
    assert (watch.observations().get("chatter").people, watch.observations().get("chatter").person) == (1, 1)


def test_people_are_counted_once_and_the_greatest_span_is_kept():
    watch = Watch(np.full(1, 0.2), 2.0, 2.0)
    for k, velocity in enumerate((1.0, 2.0, 1.5, 0.0), 1):
        watch.look(2.0 * k, crowd_of([velocity]), displaced(0.1))
    found = watch.observations().get("chatter")
    assert (found.people, found.since, found.until, found.begin, found.end) == (1, 0.0, 6.0, 2.0, 4.0)
    assert found.values == pytest.approx((2.0, 0.1))


def press(forces, radius):
    """Ten recorded times, 1 s apart, with the same contact forces."""
    watch = Watch(np.asarray(radius), 0.1, 1.0)
    crowd = crowd_of(np.zeros(len(forces)), forces, radius=radius)
    for k in range(1, FEWEST_FRAMES + 1):
        assert watch.observations().get("crushing") is None
        watch.look(float(k), crowd, np.zeros((len(forces), 2)))
    return watch.observations().get("crushing")


def test_the_force_through_a_body_is_half_the_sum_over_its_contacts():
    """Pressed between two walls by F the sum is 2 F, and the load F over the diameter."""
    load = 1.01 * CRUSHING_LOAD
    found = press([2.0 * 0.4 * load, 2.0 * 0.5 * 0.99 * CRUSHING_LOAD], [0.2, 0.25])
    assert (found.people, found.person, found.begin, found.end) == (1, 0, 0.0, 10.0)
    assert found.values == pytest.approx((0.4 * load, load))


def test_a_wide_body_is_crushed_by_the_force_on_a_person():
    wide = 2.0
    assert press([2.0 * 0.99 * CRUSHING_FORCE], [wide]) is None
    assert press([2.0 * 1.01 * CRUSHING_FORCE], [wide]).values[0] == pytest.approx(1.01 * CRUSHING_FORCE)


def test_a_single_impact_crushes_nobody():
    """A man of 80 kg who meets a wall at 1.5 m/s is stopped within a step of 0.01 s by 12 kN."""
    watch = Watch(np.full(1, 0.2), 0.1, 0.5)
    for k in range(1, 21):
        watch.look(0.5 * k, crowd_of([0.0], 12e3 if k == 7 else 0.0), displaced(0.0))
    assert watch.observations().get("crushing") is None


def test_people_who_overlap_too_much_are_counted_once_with_period_and_greatest():
    watch = Watch(np.array([0.2, 0.25, 0.2]), 0.1, 0.5, promised=0.1)
    crowd = crowd_of([0.0] * 3)
    for time, overlaps in (
        (0.1, (0.1, 0.0, 0.0)),
        (0.2, (0.11, 0.0, 0.3)),
        (0.3, (0.12, 0.15, 0.0)),
        (0.4, (0.0,) * 3),
    ):
        crowd.overlap[:] = overlaps
        crowd.level[2] = -1  # who has left is not counted
        watch.look(time, crowd, displaced(0.0, 0.0, 0.0))
    found = watch.observations().get("overlaps")
    assert (found.people, found.since, found.until) == pytest.approx((2, 0.1, 0.3))
    assert (found.person, found.begin, found.end, found.x, found.y) == pytest.approx((1, 0.2, 0.3, 1.0, 5.0))
    assert found.values == pytest.approx((0.15, 0.6))
    assert watch.observations().get("chatter") is watch.observations().get("crushing") is None
