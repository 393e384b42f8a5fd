"""Tables of motion, frames at equal intervals, and objects of PedPy."""

from types import SimpleNamespace

import numpy as np
import pytest

from evac.analysis.tables import MOTION_COLUMNS, motion_table, regular_frames, to_pedpy
from evac.base.errors import ResultError
from evac.trajectory.trajectory import read_trajectory


def test_the_table_of_motion_has_a_row_for_each_person_inside_at_each_time(descent):
    walk = descent(people=4, frames=3, shift=(1e6, 2e6))
    table = motion_table(read_trajectory(walk.path))
    assert [*table] == [name for name in MOTION_COLUMNS if name not in ("dose", "extinction")]
    rows = [(0.5 * k, p) for k, crowd in enumerate(walk.crowds) for p in range(4) if crowd.level[p] >= 0]
    assert [*zip(table["time"].tolist(), table["person"].tolist(), strict=True)] == rows
    assert len(rows) == 11
    titles = [level.title for level in walk.building.levels]
    for row, (time, person) in enumerate(rows):
        crowd = walk.crowds[int(2 * time)]
        assert table["group"][row] == ("even", "odd")[person % 2]
        assert table["level"][row] == titles[crowd.level[person]]
        assert [table["x"][row], table["y"][row]] == pytest.approx(crowd.position[person].tolist(), abs=1e-6)
    assert table["velocity_x"].tolist() == [1.0] * 11
    assert table["velocity_y"].tolist() == [0.0] * 11
    on_stair = table["person"] == 0
    assert (table["velocity_z"] != 0.0).tolist() == on_stair.tolist()
    assert table["speed"].tolist() == pytest.approx(np.hypot(1.0, table["velocity_z"]).tolist())
    assert (np.diff(table["z"][on_stair]) < 0.0).all()


def at_times(*times):
    return SimpleNamespace(time=np.array(times), path="a run")


@pytest.mark.parametrize(
    ("times", "frames", "rate"),
    [((0.0, 0.5, 1.0), [0, 1, 2], 2.0), ((0.0, 0.5, 1.0, 1.2), [0, 1, 2], 2.0), ((2.0, 2.25), [0, 1], 4.0)],
)
def test_regular_frames_leave_out_a_last_one_between_two_output_times(times, frames, rate):
    found, found_rate = regular_frames(at_times(*times))
    assert (found.tolist(), found_rate) == (frames, rate)


@pytest.mark.parametrize(
    ("times", "words"), [((), "0 recorded frames"), ((0.0,), "1 recorded frames"), ((0.0, 0.5, 0.7, 1.5), "frame 2 on")]
)
def test_frames_without_a_rate_are_refused(times, words):
    with pytest.raises(ResultError, match=f"^a run: .*{words}"):
        regular_frames(at_times(*times))


def test_pedpy_gets_the_people_of_one_level(descent):
    pytest.importorskip("pedpy")
    walk = descent(people=4, frames=3)
    motion, area = to_pedpy(read_trajectory(walk.path), 4)
    here = [(p, k, *crowd.position[p]) for k, crowd in enumerate(walk.crowds) for p in range(4) if crowd.level[p] == 4]
    rows = motion.data.sort_values(["frame", "id"])[["id", "frame", "x", "y"]].to_numpy()
    np.testing.assert_allclose(rows, here, atol=1e-6)
    assert motion.frame_rate == 2.0
    assert area.polygon.area == pytest.approx(walk.building.levels[4].polygon.area)
    with pytest.raises(ResultError, match="nobody was ever on level"):
        to_pedpy(read_trajectory(walk.path), 1)
