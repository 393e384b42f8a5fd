"""Buildings of known truth, in files written by who did not know the importers, become these buildings."""

import pytest

from tests.importing.strangers import FORMATS
from tests.importing.strangers.judge import REFUSED, RIGHT, VERDICTS, judge
from tests.importing.strangers.truth import building

#: How many of 20 must be right, by format; the rest is refused with the true reason.
WANTED = {}


def test_truth_has_ways_for_all():
    truth = building(5)
    assert len(truth.stairs) >= len(truth.storeys) - 1
    for storey in truth.storeys:
        assert {door.kind for door in storey.doors} <= {"door", "exit", "lift"}
        reached = storey.floor.union_all() if hasattr(storey.floor, "union_all") else storey.floor
        assert reached.area > 100


@pytest.mark.slow
@pytest.mark.parametrize("name", WANTED)
def test_strangers_are_right_or_refused_truly(tmp_path, name):
    verdicts = {}
    for seed in range(100, 120):
        verdicts[seed] = judge(FORMATS[name](seed, tmp_path), tmp_path / f"{seed}")
    counts = {one: sum(verdict == one for verdict, _ in verdicts.values()) for one in VERDICTS}
    assert counts[RIGHT] >= WANTED[name], verdicts
    assert counts[RIGHT] + counts[REFUSED] == 20, verdicts
