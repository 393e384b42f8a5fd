"""What a part saves is what it restores, in place, and nothing else is accepted."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from evac.base.errors import PluginError
from evac.base.saved import Saved, SavedError, part_of, state_of, taken


class Clock(Saved):
    """A part of another part."""

    saved = ("ticks",)

    def __init__(self, ticks=0):
        self.ticks = ticks


class Part(Saved):
    """A number, arrays, a growing list, a mapping, a part, an attribute of a part, and what may be absent."""

    saved = ("time", "_rows", "log", "tables", "clock", "clock.ticks", "absent")
    growing = ("log", "tables")

    def __init__(self, time=0.0, length=0):
        self.time, self.clock, self.absent = time, Clock(int(time)), None
        self._rows = np.full((2, 3), time)
        self.log = np.arange(length, dtype=np.int32)
        self.tables = {"a": np.full((length, 2), time), "b": np.array([time])}


def test_a_part_is_restored_to_what_it_was():
    old, new = Part(2.5, 4), Part(7.0, 1)
    rows, state = new._rows, old.state()
    assert [*state] == ["time", "rows", "log", "tables.a", "tables.b", "clock.ticks"]
    old._rows[0, 0] = 9.0  # the state is a copy
    new.restore(state)
    assert new._rows is rows
    assert (new.time, type(new.time), new.clock.ticks, new.absent) == (2.5, float, 2, None)
    assert (rows == 2.5).all()
    assert new.log.tolist() == [0, 1, 2, 3]
    assert new.tables["a"].tolist() == [[2.5, 2.5]] * 4
    assert new.tables["b"].tolist() == [2.5]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rows": None}, "rows: the array is missing"),
        ({"rows": np.zeros((2, 4))}, "rows: expected float64 of shape (2, 3), got float64 of shape (2, 4)"),
        ({"rows": np.zeros((2, 3, 1))}, "rows: expected"),
        ({"rows": np.zeros((2, 3), np.float32)}, "got float32"),
        ({"log": np.zeros(3)}, "log: expected int32 of shape (None,), got float64"),
        ({"tables.a": np.zeros((3, 1))}, "tables.a: expected float64 of shape (None, 2)"),
        ({"clock.ticks": None}, "clock.ticks: the array is missing"),
    ],
)
def test_what_is_no_state_of_the_part_is_refused_by_name(change, words):
    state = {name: array for name, array in (Part(1.0, 3).state() | change).items() if array is not None}
    with pytest.raises(SavedError, match=re.escape(words)):
        Part().restore(state)


def test_numbers_are_within_their_bounds():
    state = {"route": np.array([0, 3], np.int32), "time": np.array([0.0, np.nan])}
    given = taken(state, "route", np.int32, (None,), 0, 3)
    given[0] = 9
    assert state["route"][0] == 0
    for bounds in ((1, 3), (0, 2)):
        with pytest.raises(SavedError, match=r"route: [03] is out of range"):
            taken(state, "route", np.int32, (2,), *bounds)
    with pytest.raises(SavedError, match="time: nan"):
        taken(state, "time", float, (2,))
    assert np.isnan(taken(state, "time", float, (2,), nan=True)[1])
    with part_of({"part.y": 1, "y": 2}, "part.") as own:
        assert own == {"y": 1}


def test_an_array_of_a_part_is_named_with_the_part():
    with (
        pytest.raises(SavedError, match=r"^part\.x: the array is missing"),
        part_of({"x": np.zeros(1)}, "part.") as own,
    ):
        taken(own, "x", float, (1,))


def test_a_plugin_returns_a_dict_of_arrays():
    def plugin(state):
        return SimpleNamespace(state=lambda: state)

    values = np.arange(3.0)
    state = state_of(plugin({"seen": values, "number": np.float64(2.0)}), "odd", "behaviours.odd.")
    values[0] = 7.0
    assert {name: array.tolist() for name, array in state.items()} == {
        "behaviours.odd.seen": [0.0, 1.0, 2.0],
        "behaviours.odd.number": 2.0,
    }
    for wrong, words in (([1], r"odd: state\(\) returns \[1\]; return a dict"), ({"n": 2}, "returns 2 for 'n'")):
        with pytest.raises(PluginError, match=words):
            state_of(plugin(wrong), "odd", "")
