import pytest

from tests.attacks.trajectories import FORMAT_1, as_format_2, cases, parts_of, run


@pytest.mark.parametrize("case", list(cases(90, seed=3)), ids=str)
def test_a_damaged_trajectory_is_refused_or_read(case, tmp_path):
    run(case, tmp_path)


def test_parts_make_the_file_again():
    data = FORMAT_1.read_bytes()
    assert parts_of(data).seal() == data
    assert parts_of(as_format_2(data)).seal() == as_format_2(data)
