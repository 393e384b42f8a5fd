import pickle

import pytest

from evac.building.model.findings import Finding, as_findings, grouped, warnings_of


def test_a_finding_begins_with_its_place():
    assert str(Finding("warning", "odd", "ground", (1.0, 2.0))) == "level 'ground' at (1.00, 2.00): odd"
    assert str(Finding("warning", "odd", place=(1.0, 2.0, -0.0))) == "(1.00, 2.00, 0.00): odd"
    assert str(Finding("warning", "odd", "ground")) == "level 'ground': odd"
    assert str(Finding("warning", "odd")) == "odd"


def test_only_warnings_are_shown_at_every_run():
    given = as_findings(["text", Finding("found", "a door"), Finding("repaired", "a gap")])
    assert warnings_of(given) == ("text",)
    assert pickle.loads(pickle.dumps(given)) == given


@pytest.mark.parametrize(("kind", "place"), [("oops", None), ("found", (1.0,)), ("found", (1.0, 2.0, 3.0, 4.0))])
def test_unknown_kinds_and_places_are_refused(kind, place):
    with pytest.raises(ValueError, match="finding"):
        Finding(kind, "text", place=place)


def test_findings_that_differ_in_names_and_numbers_are_told_once():
    told = [Finding("left out", f"{area} m2 of 'room {area}' are a void", "a", (area, 0.0)) for area in (3.0, 4.5)]
    assert grouped([*told, Finding("left out", "other", "b")]) == [
        f"{told[0]} (and 1 more like this)",
        "level 'b': other",
    ]
