"""What is written as TOML is read as it was."""

import tomllib

from evac.base.toml import case_text


def test_infinity_and_odd_names_of_a_case_are_kept():
    case = {"title": 'a "b"\\ \x7f', "simulation": {"no_progress": None, "step": 1e-05}, "x y": {"a": [{"b": True}]}}
    read = tomllib.loads(case_text(case))
    assert read["title"] == case["title"]
    assert read["simulation"] == {"no_progress": float("inf"), "step": 1e-05}
    assert read["x y"] == case["x y"]
