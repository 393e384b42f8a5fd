"""Escalators: stairs of the plan that move by the case, drawn as one object."""

import pytest

from tests.editor.test_page import CONTROL, Page

MOVING = "editor.store.now.content.case.building.moving"


@pytest.fixture
def drawn(browser, serve, house):
    """The page of the house after an escalator was drawn."""
    page = Page(browser, serve(house))
    page.keys("k")
    page.click((1, 6), (5, 6))
    yield page
    page.close()
    assert browser.errors == []


def test_an_escalator_is_drawn_judged_and_saved(drawn):
    row = drawn.row("shafts", "escalator A")
    assert "turn" not in row
    assert (row["lower"], row["upper"], row["foot"], row["direction"]) == ("ground", "first", [1, 6], [1, 0])
    assert drawn.run(MOVING) == {"escalator A": {"speed": 0.5, "towards": "up"}}
    drawn.judged()
    assert "Can be run" in drawn.text("#verdict")
    assert drawn.saved()["case"]["building"]["moving"] == drawn.run(MOVING)
    drawn.keys("z", modifiers=CONTROL)
    assert drawn.run(MOVING) is None
    assert [row["name"] for row in drawn.plan["shafts"]] == ["stair"]


def test_how_it_moves_follows_its_values_name_and_end(drawn):
    drawn.type("Towards", "down")
    drawn.type("Moves at", "0.75")
    assert drawn.run("editor.view.nameOf({ name: 'escalator A' })") == "escalator A \u2193"
    drawn.type("Name", "west")
    assert drawn.run(MOVING) == {"west": {"speed": 0.75, "towards": "down"}}
    drawn.run("editor.act.duplicate()")
    assert drawn.run(MOVING)["west B"] == {"speed": 0.75, "towards": "down"}
    drawn.keys("Delete")
    assert list(drawn.run(MOVING)) == ["west"]
    drawn.run("editor.act.select({ section: 'shafts', index: 1 })")
    drawn.type("Moves at", "")
    assert drawn.run(MOVING) is None
    assert drawn.row("shafts", "west")


def test_any_stair_can_move(drawn):
    drawn.run("editor.act.select({ section: 'shafts', index: 0 })")
    drawn.type("Moves at", "0.5")
    assert drawn.run(MOVING)["stair"] == {"speed": 0.5, "towards": "up"}
    drawn.run("editor.act.copyUp(1)")
    drawn.judged()
    assert "error" not in drawn.run("editor.view.findings.map(({ kind }) => kind)")
