"""What is written as TOML is read as it was."""

import tomllib
from itertools import pairwise

import pytest

from evac.base.toml import WIDTH, case_text, toml_lines


def test_infinity_and_odd_names_of_a_case_are_kept():
    case = {"title": 'a "b"\\ \x7f', "simulation": {"no_progress": None, "step": 1e-05}, "x y": {"a": [{"b": True}]}}
    read = tomllib.loads(case_text(case))
    assert read["title"] == case["title"]
    assert read["simulation"] == {"no_progress": float("inf"), "step": 1e-05}
    assert read["x y"] == case["x y"]


LONG = 'A sentence of many words, which is longer than a line, with  two blanks and a \\ and a "quoted" word. ' * 2
NESTED = {"name": "a", "ends": [[1.0, 2.0], [3.0, 4.0]], "more": {"numbers": [*range(40)], "on": True}}


@pytest.mark.parametrize(
    "table",
    [
        {"text": LONG, "short": "one line"},
        {"numbers": [*range(100)], "words": ["a word that is long"] * 9, "points": [[k, 0.5 * k] for k in range(30)]},
        {"table": {"a": 1, "inner": NESTED}, "list": [NESTED, {"name": "b"}], "empty": [], "none": {}},
        {"one": {"two": {"three": {"x": 1}}}, "rows": [{"values": [{"k": k} for k in range(20)]}]},
    ],
)
def test_long_values_are_broken_into_lines_and_read_as_they_were(table):
    text = case_text(table)
    assert tomllib.loads(text) == table
    assert max(map(len, text.splitlines())) <= WIDTH + 1  # with the break of a string
    assert tomllib.loads("\n".join(toml_lines(table))) == table


def test_the_lines_of_a_long_text_are_filled():
    lines = toml_lines({"text": LONG})
    assert len(lines) > 3
    for line, following in pairwise(lines):
        word = following.removesuffix("\\").split(" ")[0]
        assert len(line.removesuffix("\\")) <= WIDTH < len(line.removesuffix("\\")) + len(word) + 1


def test_tables_have_heads_unless_they_fit_a_line_of_another_table():
    text = case_text({"a": {"b": {"x": 1}, "c": NESTED}, "d": [{"x": 1}, {"x": 2}]})
    assert [line for line in text.splitlines() if line.startswith("[")] == [
        "[a]",
        "[a.c]",
        "[a.c.more]",
        "[[d]]",
        "[[d]]",
    ]
    assert "b = { x = 1 }" in text
