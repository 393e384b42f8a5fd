"""People as measured: measures on exact motions, blocked runs, rows that are kept, and the page."""

import csv
from itertools import starmap

import numpy as np
import pytest

from evac.evidence.evidence import Evidence
from evac.evidence.people import measures, page, runs
from evac.evidence.people.measures import Line, Track
from evac.evidence.people.runs import LEFT, Job, jobs, measure_runs, run_job
from evac.evidence.people.scenes import IMO_8, SCENES
from evac.evidence.people.values import VALUES, Value, by_seed, found_row
from evac.evidence.verdicts import MET, MOST_ROWS, NOT_MET, REPORTED
from evac.study.statistics import mean_interval

TICK = 0.1


def moving(start, velocity, duration=30.0):
    """The track of people who walk at constant velocities from given places."""
    time = TICK * np.arange(round(duration / TICK) + 1)
    position = np.array(start, float)[None] + time[:, None, None] * np.array(velocity, float)
    return Track(time, position, np.ones(position.shape[:2], bool), np.full(len(start), np.nan))


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
        track = Track(TICK * np.arange(101), place[:, None], np.ones((101, 1), bool), np.full(1, np.nan))
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
    done = Track(track.time, track.position, track.inside, np.array([7.0, 9.0, 8.0]))
    found = measures.bend(done)
    assert (found["last out [s]"], measures.last_out(done, 1)["last out [s]"]) == (9.0, 7.0)
    assert found["from inner corner [m]"] == pytest.approx(2.0 * np.sqrt(2.0), abs=0.1)


def run_row(seed, value=None, left=0, scene="a", **more):
    row = {"scene": scene, "setting": "walking", "model": "NSM2", "seed": seed, LEFT: left, "flow [1/s]": value}
    return row | more


def test_blocked_runs_have_no_value_and_stand_beside_the_mean():
    value = Value(("a",), "flow [1/s]", 2.0, share=0.1)
    rows = [run_row(1, 1.9), run_row(2, None, 7), run_row(3, 2.3), run_row(4, 9.0, scene="b")]
    found = found_row(value, "walking", "NSM2", rows)
    assert (found["runs"], found["blocked"], found["share blocked"]) == (3, 1, pytest.approx(1.0 / 3.0))
    assert (found["mean"], found["deviation [%]"]) == (pytest.approx(2.1), pytest.approx(5.0))
    assert found["verdict"].startswith(NOT_MET)
    free = found_row(value, "walking", "NSM2", [rows[0], rows[2], run_row(5, 2.0)])
    assert (free["from"], free["to"]) == pytest.approx(mean_interval(np.array([1.9, 2.3, 2.0])))
    none = found_row(value, "walking", "NSM2", rows[1:2])
    assert (none["mean"], none["deviation [%]"], none["verdict"][:7]) == (None, None, NOT_MET)


@pytest.mark.parametrize(
    ("mean", "interval", "blocked", "verdict"),
    [
        (1.0, (0.95, 1.05), 0, MET),
        (1.0, (0.5, 1.05), 0, f"{MET}, not certain"),
        (1.2, (1.15, 1.25), 0, NOT_MET),
        (1.2, None, 0, f"{NOT_MET}, not certain"),
        (1.0, (0.95, 1.05), 1, f"{NOT_MET}: blocked"),
    ],
)
def test_a_target_is_met_by_a_mean_within_it(mean, interval, blocked, verdict):
    assert Value(("a",), "b", 1.0, share=0.1).verdict(mean, interval, blocked) == verdict
    assert Value(("a",), "b", 1.0).verdict(mean, interval, blocked) == REPORTED


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


def test_the_values_held_out_are_the_ones_that_were_fixed():
    held = {value.scenes[0] for value in VALUES if value.is_held_out and len(value.scenes) == 1}
    doors = {"door 0.5 m", "door 0.7 m", "door 1 m", "door 2 m"}
    dense = {f"corridor 1.8 to {width} m" for width in ("1.2", "0.95", "0.7")}
    against = {f"{IMO_8} against {number}" for number in (0, 10, 50, 100)}
    assert held == doors | dense | against | {"stair up", "two-way 2 m"}
    bins = [value.column for value in VALUES if value.is_held_out and len(value.scenes) > 1]
    assert bins == [measures.speed_column(low, low + 0.5) for low in (2.0, 2.5, 3.0)]
    row = found_row(VALUES[0], "walking", "DEM", [])
    assert (row["held out"], row["verdict"]) == ("yes", f"{NOT_MET}: no measurement")


def test_every_value_has_scenes_and_a_column_of_the_table():
    for value in VALUES:
        assert set(value.scenes) <= set(SCENES)
        assert {value.column, value.weight or value.column} <= set(measures.MEASURES)
        assert (value.wanted is None) == (value.question == "")


def test_jobs_are_few_where_quick_and_many_where_no_run_may_block():
    quick = jobs(True, 1)
    assert {(job.setting, job.model) for job in quick} == {("walking", "NSM2")}
    assert len(quick) == runs.QUICK_RUNS * len(SCENES)
    full = jobs(False, 5)
    counts = {job.scene: 0 for job in full}
    for job in full:
        counts[job.scene] += (job.setting, job.model) == ("walking", "NSM2")
    assert {scene for scene, count in counts.items() if count == 100} == set(runs.NEVER_BLOCKED)
    assert min(counts.values()) == 10


def two_scenes(monkeypatch, *names):
    """Leave two scenes, with headway, and two runs of each."""
    monkeypatch.setattr(runs, "SCENES", {name: SCENES[name] for name in names})
    monkeypatch.setattr(runs, "SETTINGS", {"headway": {"headway": {}}})
    monkeypatch.setattr(runs, "QUICK_RUNS", 2)


def test_finished_rows_are_kept_until_the_code_changes(tmp_path, monkeypatch):
    two_scenes(monkeypatch, "door 1 m", "two-way 2 m")
    made = []

    def make(job):
        if len(made) == 3:
            raise KeyboardInterrupt
        made.append(job)
        return dict(zip(runs.KEY, job.key, strict=True)) | {LEFT: 0, "speed [m/s]": 1.5, runs.CODE: runs.code()}

    monkeypatch.setattr(runs, "run_job", make)
    with pytest.raises(KeyboardInterrupt):
        measure_runs(Evidence("people", tmp_path, quick=True))
    with (tmp_path / "runs.csv").open("a") as file:
        file.write("two-way 2 m,headway,NSM2,2,0")  # a line that an interruption broke
    first, made[:] = made[:], []
    rows = measure_runs(Evidence("people", tmp_path, quick=True))
    assert [job.key for job in first + made] == [tuple(str(row[key]) for key in runs.KEY) for row in rows]
    assert (len(first), len(made)) == (3, 1)
    monkeypatch.setattr(runs, "code", lambda: "another")
    made.clear()
    with pytest.raises(KeyboardInterrupt):
        measure_runs(Evidence("people", tmp_path, quick=True))
    with (tmp_path / "runs.csv").open() as file:
        assert [row[runs.CODE] for row in csv.DictReader(file)] == ["another"] * 3


def test_quick_page_of_two_scenes_tells_means_beside_blocked_runs(tmp_path, monkeypatch):
    two_scenes(monkeypatch, "door 1 m", "door 1.2 m")
    page.run(Evidence("people", tmp_path, quick=True))
    text = (tmp_path / "README.md").read_text()
    assert "**Quick run" in text
    with (tmp_path / "values.csv").open() as file:
        found = {row["value"]: row for row in csv.DictReader(file)}
    assert set(found) == {f"door {width} m: flow per metre [1/s/m]" for width in ("1", "1.2")}
    for name, row in found.items():
        assert (row["runs"], row["blocked"], row["setting"]) == ("2", "0", "headway")
        assert 0.8 < float(row["mean"]) < 2.0
        line = next(line for line in text.splitlines() if line.startswith(f"| {name}"))
        assert "0 of 2 blocked" in line
    page.run(Evidence("people", tmp_path, page_only=True))
    assert (tmp_path / "README.md").read_text() == text


def test_full_page_of_made_up_runs_judges_the_default_and_never_the_mean_of_runs_that_block(tmp_path, monkeypatch):
    def make(job):
        blocks = job.setting == "paper" and job.scene == "door 0.5 m"
        told = dict(zip(runs.KEY, job.key, strict=True)) | {LEFT: 5 * blocks, runs.CODE: runs.code()}
        return told if blocks else told | dict.fromkeys(measures.MEASURES, 1.0 + 0.01 * job.seed)

    monkeypatch.setattr(Evidence, "results", lambda self, function, tasks: starmap(make, tasks))
    monkeypatch.setattr(runs, "RUNS", 2)
    page.run(Evidence("people", tmp_path))
    head, body = (tmp_path / "README.md").read_text().split("\n## ", maxsplit=1)
    rows = [line for line in head.splitlines() if line.startswith("| [")]
    assert len(rows) <= MOST_ROWS
    assert any(row.startswith("| [door 0.5 m: runs not blocked]") and "100 of 100" in row for row in rows)
    narrow = [line for line in body.splitlines() if line.startswith("| door 0.5 m: flow [1/s]")]
    assert len(narrow) == len(runs.SETTINGS) == 3
    assert narrow[-1].count("-; 2 of 2 blocked") == len(runs.MODELS) == 3
    with (tmp_path / "values.csv").open() as file:
        found = [
            row for row in csv.DictReader(file) if row["setting"] == "paper" and row["value"].startswith("door 0.5")
        ]
    assert {(row["mean"], row["share blocked"]) for row in found} == {("", "1.0")}


def test_a_run_is_what_its_seed_makes_it_and_ends_when_all_are_through():
    one, again, other = (run_job(Job("door 1.2 m", "paper", "NSM2", seed)) for seed in (3, 3, 4))
    flow = "flow per metre [1/s/m]"
    assert one[flow] == again[flow] != other[flow]
    assert one[LEFT] == 0


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_everybody_finds_room_in_every_scene(scene):
    row = run_job(Job(scene, "headway", "NSM2", 1))
    assert row[LEFT] or any(row[name] is not None for name in measures.MEASURES if name in row)
