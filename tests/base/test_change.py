"""Which values belong to a change of each kind."""

import pytest

from evac.base.change import REMEDIES, Change, Control, changes_in_words, is_legal

#: Values that a kind takes; all others of the table are refused.
LEGAL = {
    "open": [None],
    "close": [None, "leave"],
    "no_entry": [None, False],
    "control": [False, {"every": 2.0}, {"most": 3, "delay": 0.0, "hold": 1.0}],
    "one_way": [False, "up", "leave"],
    "move": [False, {"speed": 0.5}, {"speed": 0.5, "towards": "down"}],
    "slow": [0.5, 1.0],
    "bar": [None, False, True],
    "strategy": ["up", "leave", ("door", "back"), (), ("opens at", "f1"), ("leaves", "f1", "f2"), ("leaves", "f1")],
    "lift": [("opens at", "f1"), ("leaves", "f1", "f2")],
    "alarm": [None, 0.5, 1.0, 0.0],
}
VALUES = [None, False, True, "up", ("door", "back"), (), ("door", 5), 0.0, 0.5, 1.0, 1.5, -0.5, [1]]
VALUES += ["leave", {"every": 2.0}, {"most": 3, "delay": 0.0, "hold": 1.0}, {}, {"every": 0.0}, {"most": 1.5}]
VALUES += [
    ("opens at", "f1"),
    ("leaves", "f1", "f2"),
    ("leaves", "f1"),
    {"speed": 0.5},
    {"speed": 0.5, "towards": "down"},
    {"speed": -0.5},
    {"towards": "down"},
]


@pytest.mark.parametrize("kind", LEGAL)
def test_a_kind_takes_its_values_and_no_others(kind):
    assert set(REMEDIES) <= set(LEGAL)
    found = [value for value in VALUES if is_legal(kind, value)]
    assert sorted(map(repr, found)) == sorted(map(repr, LEGAL[kind]))


def test_a_control_is_told_by_what_it_has():
    assert str(Control(every=2.0, most=40)) == "one person in 2 s, closes after 40 people"
    assert str(Control(delay=1.0, hold=0.5)) == "opens after 1 s, closes by itself after 0.5 s"


def test_the_end_of_a_change_is_told_as_such():
    for kind, ends in {
        "no_entry": "open to those",
        "one_way": "two-way",
        "bar": "free",
        "move": "stands still",
    }.items():
        assert ends in Change(1.0, kind, "a", {"value": False}).words
    assert Change(1.0, "bar", "a").words == "'a' barred"
    assert str(Change(2.5, "close", "a", {"value": "bodies"})) == "'a' closed for bodies alone at 2.5 s"


def test_what_happens_to_several_things_at_once_is_told_once_and_stops_of_lifts_are_not():
    changes = [Change(10.0, "alarm", "a"), Change(10.0, "lift", "car", {"value": ("opens at", "a")})]
    changes += [Change(10.0, "alarm", "b"), Change(10.0, "close", "b"), Change(20.0, "alarm", "a")]
    changes += [Change(20.0, "slow", "a", {"value": 0.5}), Change(20.0, "slow", "b", {"value": 0.4})]
    told = [(10.0, "'a', 'b' alarmed"), (10.0, "'b' closed"), (20.0, "'a' alarmed")]
    told += [(20.0, "'a' at 0.5 of the speed"), (20.0, "'b' at 0.4 of the speed")]
    assert changes_in_words(changes) == told
