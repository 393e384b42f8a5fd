"""Findings, and the repair of names."""

import pickle

import pytest

import evac
from evac.building.model.findings import Finding, account, as_findings, repaired, warnings_of


def test_a_finding_begins_with_its_place():
    assert str(Finding("warning", "odd", "ground", (1.0, 2.0))) == "level 'ground' at (1.00, 2.00): odd"
    assert str(Finding("warning", "odd", place=(1.0, 2.0, -0.0))) == "(1.00, 2.00, 0.00): odd"
    assert str(Finding("warning", "odd", "ground")) == "level 'ground': odd"
    assert str(Finding("warning", "odd")) == "odd"


def test_only_warnings_are_shown_at_every_run():
    given = as_findings(["text", Finding("found", "a door"), Finding("repaired", "a gap")])
    assert warnings_of(given) == ("text",)
    assert pickle.loads(pickle.dumps(given)) == given


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


def test_the_account_of_elements():
    findings = [
        Finding("found", "5 doors", element="door", number=5),
        Finding("left out", "'a' has no room", element="door"),
        Finding("left out", "'b' has no room", element="door"),
        Finding("missing", "2 walls", element="wall", number=2),
        Finding("left out", "of no element"),
    ]
    assert account(findings) == [
        ("door", 3, 2, ["'a' has no room (and 1 more like this)"]),
        ("wall", 0, 2, ["2 walls"]),
    ]
