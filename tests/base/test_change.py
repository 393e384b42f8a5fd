"""Which values belong to a change of each kind."""

import pytest

from evac.base.change import REMEDIES, is_legal

#: Values that a kind takes; all others of the table are refused.
LEGAL = {
    "open": [None],
    "close": [None],
    "one_way": [False, "up"],
    "slow": [0.5, 1.0],
    "bar": [None, False, True],
    "strategy": ["up", ("door", "back"), ()],
    "alarm": [None, 0.5, 1.0, 0.0],
}
VALUES = [None, False, True, "up", ("door", "back"), (), ("door", 5), 0.0, 0.5, 1.0, 1.5, -0.5, [1]]


@pytest.mark.parametrize("kind", LEGAL)
def test_a_kind_takes_its_values_and_no_others(kind):
    assert set(REMEDIES) <= set(LEGAL)
    found = [value for value in VALUES if is_legal(kind, value)]
    assert sorted(map(repr, found)) == sorted(map(repr, LEGAL[kind]))
