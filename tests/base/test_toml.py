"""What is written as TOML is read as it was."""

import tomllib

from evac.base.toml import case_text


def test_infinity_and_odd_names_of_a_case_are_kept():
    case = {"title": 'a "b"\\ \x7f', "simulation": {"no_progress": None, "step": 1e-05}, "x y": {"a": [{"b": True}]}}
    read = tomllib.loads(case_text(case))
    assert read["title"] == case["title"]
    assert read["simulation"] == {"no_progress": float("inf"), "step": 1e-05}
    assert read["x y"] == case["x y"]


def test_long_values_are_on_short_lines():
    rows = {"outline": [[1.5 * k, 2.0] for k in range(60)], "name": "north", "words": ["east", "west"] * 30}
    case = {
        "title": 'a "long"\\ title ' * 12,
        "building": {"plan": {"storeys": [rows, {"name": "upper"}], "z": {"a": 1.0, "b": list(range(90))}}},
        "people": [{"positions": [[0.5, 1.0 * k] for k in range(50)], "speed": {"uniform": [1.0, 1.5]}}],
    }
    text = case_text(case)
    assert tomllib.loads(text) == case
    assert max(map(len, text.splitlines())) < 64
