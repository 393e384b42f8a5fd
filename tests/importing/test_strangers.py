"""Buildings of known truth, in files written by who did not know the importers, become these buildings."""

import pytest

from tests.importing.strangers import FORMATS
from tests.importing.strangers.drawings import MANNERS, dxf
from tests.importing.strangers.judge import REFUSED, RIGHT, VERDICTS, judge

#: How many of 20 must be right, by format; the rest is refused with the true reason.
WANTED = dict.fromkeys(FORMATS, 19) | {"fds": 15}


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("osm", 2),
        ("fds", 1),
        ("ifc", 237),
        *(pytest.param("imdf", seed, marks=pytest.mark.slow) for seed in (235, 9606)),
    ],
)
def test_a_stranger_is_right(tmp_path, name, seed):
    assert judge(FORMATS[name](seed, tmp_path), tmp_path / "case") == (RIGHT, [])


@pytest.mark.parametrize(
    "manner", [pytest.param(one, marks=() if one == "arrows" else pytest.mark.slow) for one in MANNERS]
)
def test_a_drawing_is_right_in_the_manner_of_any_office(tmp_path, manner):
    assert judge(dxf(300, tmp_path, manner), tmp_path / "case") == (RIGHT, [])


@pytest.mark.slow
@pytest.mark.parametrize("name", WANTED)
def test_strangers_are_right_or_refused_truly(tmp_path, name):
    verdicts = {}
    for seed in range(100, 120):
        verdicts[seed] = judge(FORMATS[name](seed, tmp_path), tmp_path / f"{seed}")
    counts = {one: sum(verdict == one for verdict, _ in verdicts.values()) for one in VERDICTS}
    assert counts[RIGHT] >= WANTED[name], verdicts
    assert counts[RIGHT] + counts[REFUSED] == 20, verdicts
