import pytest

from tests.attacks.trajectories import cases, run, written
from tests.trajectory.parts import parts_of


@pytest.mark.parametrize("case", list(cases(96, seed=3)), ids=str)
def test_a_damaged_trajectory_is_refused_or_read(case, tmp_path):
    run(case, tmp_path)


def test_parts_make_the_file_again(tmp_path):
    data = written(tmp_path / "whole.evac")
    assert parts_of(data).seal() == data
