"""Arguments of public functions."""

from collections.abc import Iterable, Mapping
from numbers import Real

import pytest

from evac.base.errors import ScenarioError
from evac.base.parameters import check_types


@pytest.mark.parametrize(
    ("value", "kind", "words"),
    [("a", Iterable, "a list"), (True, Real, "a number"), ([1], Mapping | None, "a dictionary or None")],
)
def test_texts_are_no_lists_and_true_is_no_number(value, kind, words):
    with pytest.raises(ScenarioError, match=f"^given is .* of type {type(value).__name__}; give {words}$"):
        check_types(given=(value, kind))
    check_types(given=({"a": 1}, Mapping | None), other=(None, Mapping | None), text=("a", str), flag=(True, bool))
