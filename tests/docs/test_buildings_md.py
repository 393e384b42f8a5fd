"""docs/buildings.md states rules as they are."""

from evac.scenario.tolerance import ERROR_PER_PATH, LONGEST, RELAXATION, SHORTEST, SOLVER_SHARE


def test_the_rule_of_tolerance_is_stated_as_it_is(root):
    guide = (root / "docs" / "buildings.md").read_text(encoding="utf-8")
    assert f"tolerance / ({ERROR_PER_PATH:g} v), at most {LONGEST:g} s" in guide
    assert f"below {SHORTEST:g} s it is refused" in guide
    assert f"{SOLVER_SHARE:g} of the tolerance [m]" in guide
    assert f"{SOLVER_SHARE / RELAXATION:g} of the tolerance per second [m/s]" in guide
