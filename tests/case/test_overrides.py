import pytest

from evac.case.overrides import apply, parsed


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("5", 5),
        ("0.5", 0.5),
        ("true", True),
        ("nsm2", "nsm2"),
        ('"nsm2"', "nsm2"),
        ("[1, 2]", [1, 2]),
        ("{ uniform = [0, 1] }", {"uniform": [0, 1]}),
        ("two words", "two words"),
        ("a=b", "a=b"),
    ],
)
def test_a_value_is_toml_or_a_bare_word(word, value):
    assert parsed([f"some.key = {word}"]) == ([("some.key", value)], [])


@pytest.mark.parametrize("text", ["key", "key=", "=3", ""])
def test_what_is_no_assignment_is_refused(text):
    pairs, (fault,) = parsed([text])
    assert pairs == []
    assert "dotted.key=value" in fault.text


def test_broken_toml_is_refused_and_not_taken_for_a_word():
    pairs, (fault,) = parsed(["people.0.radius={ uniform = [0, 1 }"])
    assert pairs == []
    assert fault.key == ("people.0.radius",)
    assert "TOML" in fault.text


def test_one_text_is_one_override():
    assert parsed("a.b=1") == ([("a.b", 1)], [])


def test_items_of_lists_go_by_index_or_name_and_tables_are_made():
    table = {"people": [{"name": "a", "number": 1}, {"name": "b", "number": 2}]}
    keys, faults = apply(table, {"people.0.number": 5, "people.b.radius.uniform": [1, 2], "output.every": 1.0})
    assert faults == []
    assert keys == [("people", 0, "number"), ("people", 1, "radius", "uniform"), ("output", "every")]
    assert table == {
        "people": [{"name": "a", "number": 5}, {"name": "b", "number": 2, "radius": {"uniform": [1, 2]}}],
        "output": {"every": 1.0},
    }


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("people.clas.number", "no item has this name or number; did you mean 'class'?"),
        ("people.1.number", "no item has this name or number; known: class"),
        ("people.class.number.x", "people.class.number is 3, not a table; set people.class.number as a whole"),
    ],
)
def test_a_key_that_leads_nowhere_is_refused(key, text):
    table = {"people": [{"name": "class", "number": 3}]}
    keys, (fault,) = apply(table, {key: 1})
    assert keys == []
    assert fault.text == text
    assert table == {"people": [{"name": "class", "number": 3}]}
