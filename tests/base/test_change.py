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


@pytest.mark.parametrize(
    ("kind", "what", "values", "words"),
    [
        ("open", "door", {}, "'door' opened"),
        ("close", "door", {"value": "bodies"}, "'door' closed for bodies alone"),
        ("no_entry", "hall", {"value": False}, "'hall' open to those who would enter"),
        ("no_entry", "hall", {}, "'hall' closed to those who would enter"),
        ("control", "door", {"value": False}, "'door' without control"),
        ("move", "stair", {"value": False}, "'stair' stands still"),
        ("one_way", "stair", {"value": "up"}, "'stair' one-way, up,"),
        ("one_way", "stair", {"value": False}, "'stair' two-way"),
        ("slow", "hall", {"value": 0.5}, "'hall' at 0.5 of the speed"),
        ("bar", "hall", {"value": False}, "'hall' free"),
        ("bar", "hall", {}, "'hall' barred"),
        ("strategy", "class", {"value": ["a", "b"]}, "'class' to a, b"),
        ("strategy", "class", {"value": []}, "'class' to any exit"),
        ("strategy", "class", {"value": "shortest"}, "'class' on the shortest way"),
        ("alarm", "", {"value": 0.5}, "everybody alarmed"),
        ("lift", "lift", {"value": ["leaves", "f1", "f2"]}, "'lift' leaves f1 for f2"),
    ],
)
def test_a_change_in_words(kind, what, values, words):
    change = Change(2.5, kind, what, values)
    assert change.words == words
    assert str(change) == f"{words} at 2.5 s"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((0.0, "close\n", "door"), "kind and name must be texts of one line"),
        ((0.0, "close", 3), "kind and name must be texts of one line"),
        ((float("inf"), "close", "door"), "not a finite number"),
        (("0", "close", "door"), "not a finite number"),
        ((0.0, "close", "door", [1]), "is not a dictionary"),
        ((0.0, "close", "door", {"value": float("nan")}), "use names, with finite numbers"),
        ((0.0, "close", "door", {"value": [[1]]}), "use names, with finite numbers"),
        ((0.0, "close", "door", {1: "x"}), "use names, with finite numbers"),
        ((0.0, "close", "door", {"let_through": [-1]}), "not a list of people"),
        ((0.0, "close", "door", {"let_through": [True]}), "not a list of people"),
        ((0.0, "close", "door", {"let_through": 1}), "not a list of people"),
    ],
)
def test_what_is_no_change_is_refused(given, words):
    with pytest.raises(ValueError, match=words):
        Change(*given)


def test_lists_of_a_change_are_tuples_and_its_time_a_float():
    change = Change(2, "close", "door", {"let_through": [0, 3]})
    assert (change.time, type(change.time), change.values) == (2.0, float, {"let_through": (0, 3)})
