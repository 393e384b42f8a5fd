"""Names of any kind reach the file of a building and the pictures as one line, or are refused."""

import pytest

import evac
from evac.base.errors import BuildingError
from evac.building.model.findings import repaired

KEPT = ['Saal "Blau"', 'A101 12"', "back\\", '\\"', "it's", "'", "#1", "東", "a:b", "$5 to $10", "  two  blanks "]
REPAIRED = {"a\nb": "a b", "a\r\n\tb": "a b", "\x01": "unnamed", "\u2028": "unnamed", "\ud800x": "x", "a\0b": "a b"}
REPAIRED["n" * 300] = "n" * 197 + "..."


def plan_with(name):
    plan = evac.Plan()
    plan.storey(name, [(0, 0), (5, 0), (5, 4), (0, 4)])
    plan.exit(name, name, [(0, 1), (0, 2)])
    plan.area(name, name, [(1, 1), (2, 1), (2, 2), (1, 2)])
    return plan


@pytest.mark.parametrize("name", [*KEPT, *REPAIRED])
def test_names_are_read_as_they_were_written(name, tmp_path):
    plan_with(name).write(tmp_path / "a.msh")
    for building in (plan_with(name).building(), evac.read_building(tmp_path / "a.msh")):
        found = [one.name for kind in (building.levels, building.exits, building.areas) for one in kind]
        assert found == [repaired(name)] * 3
        assert REPAIRED.get(name, name) == repaired(name)
    told = [one for one in plan_with(name).building().findings if one.kind == "repaired"]
    assert len(told) == (3 if name in REPAIRED else 0)


def test_two_names_that_become_the_same_are_refused():
    plan = plan_with("a\nb")
    plan.exit("a b", "a\nb", [(5, 1), (5, 2)])
    with pytest.raises(BuildingError, match="a b"):
        plan.building()
