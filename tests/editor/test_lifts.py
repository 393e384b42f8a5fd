"""Lifts on the page: one object over storeys, drawn, changed, judged and saved."""

import tomllib

import numpy as np
import pytest

import evac
from tests.editor.test_page import CONTROL, SHIFT, Page

PLAN = """\
[[storeys]]
name = "ground"

[[rooms]]
name = "hall"
storey = "ground"
polygon = [[0, 0], [14, 0], [14, 8], [0, 8]]

[[storeys]]
name = "first"
z = 3.0
like = "ground"

[[storeys]]
name = "second"
z = 6.0
like = "ground"

[[exits]]
name = "exit"
storey = "ground"
segment = [[0, 1], [0, 2]]

[[lifts]]  # of the north side
name = "north"
storeys = ["ground", "first", "second"]
polygon = [[4, 8.2], [5.6, 8.2], [5.6, 9.8], [4, 9.8]]
door = [[4.3, 8.2], [5.3, 8.2]]
operation = { capacity = 12, discharge = "first" }
"""


@pytest.fixture
def page(browser, serve, tmp_path):
    """The page of a plan of three storeys with a lift."""
    file = tmp_path / "lift.plan.toml"
    file.write_text(PLAN)
    page = Page(browser, serve(file))
    yield page
    page.close()
    assert browser.errors == []


def saved(page):
    page.keys("s", modifiers=CONTROL)
    page.browser.wait("document.getElementById('saved').textContent === 'Saved'")
    return page.server.session.file.read_text()


def test_a_lift_is_drawn_once_for_all_storeys_above_and_saved(page):
    page.keys("PageUp", "u")
    page.drag((9, 3), (10.5, 5))
    page.judged()
    assert page.text("#verdict") == "Can be run"
    drawn = {}
    for storey in ("ground", "first", "second"):
        page.run(f"editor.act.goTo({storey!r})")
        drawn[storey] = np.median(page.colour(9.4, 4), axis=0).tolist()
    assert drawn["ground"] != drawn["first"] == drawn["second"]
    added = saved(page).removeprefix(PLAN)
    assert added == (
        '\n[[lifts]]\nname = "lift"\nstoreys = ["first", "second"]\n'
        "polygon = [[9, 3], [10.5, 3], [10.5, 5], [9, 5]]\ndoor = [[9, 4.5], [9, 3.5]]\noperation = { capacity = 15 }\n"
    )
    lifts = evac.read_building(page.server.session.file).lifts
    assert [(lift.name, lift.operation.capacity) for lift in lifts] == [("north", 12), ("lift", 15)]
    page.run("editor.store.undo()")
    assert saved(page).rstrip() == PLAN.rstrip()


@pytest.mark.parametrize(
    ("ends", "door"),
    [
        (((6, 8.2), (7.6, 9.8)), [[6.3, 8.2], [7.3, 8.2]]),  # north of the floor
        (((14.6, 3), (16.2, 5)), [[14.6, 4.5], [14.6, 3.5]]),  # east of it
        (((12, 6), (13.5, 7.5)), [[12, 7.2], [12, 6.2]]),  # in a corner of it
    ],
)
def test_the_door_is_where_there_is_most_floor(page, ends, door):
    page.keys("u")
    page.drag(*ends)
    page.judged()
    assert page.plan["lifts"][1]["door"] == door
    assert page.text("#verdict") == "Can be run"


def test_a_lift_its_sides_and_its_door_are_dragged(page):
    page.click((4.8, 9))
    assert page.text("#inspector h2") == "Lift north"
    page.drag((4.8, 9), (6.8, 9))
    assert page.plan["lifts"][0]["polygon"] == [[6, 8.2], [7.6, 8.2], [7.6, 9.8], [6, 9.8]]
    assert page.plan["lifts"][0]["door"] == [[6.3, 8.2], [7.3, 8.2]]
    page.drag((6.8, 9.8), (6.8, 10.2))
    assert page.plan["lifts"][0]["polygon"][2:] == [[7.6, 10.2], [6, 10.2]]
    page.drag((6, 9), (7, 9))  # a side before which there is too little room for the door
    row = page.plan["lifts"][0]
    assert row["polygon"][0] == [7, 8.2]
    assert row["door"] == [[7.05, 8.2], [7.55, 8.2]]
    page.run("while (editor.store.past.length) editor.store.undo()")
    page.drag((4.8, 8.2), (4, 9))
    assert page.plan["lifts"][0]["door"] == [[4, 9.5], [4, 8.5]]
    page.judged()
    assert "no floor within 0.6 m of its door" in page.text("#findings .error")
    page.run("document.querySelector('#findings .error').click()")
    assert page.text("#inspector h2") == "Lift north"


def test_the_keyboard_moves_a_lift_and_its_door(page):
    page.run("editor.view.canvas.focus()")
    page.keys("n", "n")
    assert page.text("#told") == "Lift north"
    page.keys("ArrowRight", modifiers=SHIFT)
    assert page.plan["lifts"][0]["polygon"][0] == [5, 8.2]
    for _ in range(9):
        page.keys("c")
    assert page.text("#told") == "Door"
    page.keys("ArrowRight")
    assert page.plan["lifts"][0]["door"] == [[5.4, 8.2], [6.4, 8.2]]
    page.keys("Delete")
    assert "lifts" not in page.plan


def test_the_values_of_a_lift_are_typed(page):
    page.run("editor.act.select({ section: 'lifts', index: 0 })")
    page.type("Speed", "2.5")
    page.type("Door [m]", "0.8")
    page.type("Depth", "2")
    page.run("document.querySelectorAll('#inspector fieldset input')[1].click()")  # the storey in the middle
    page.type("Discharge", "")
    row = page.plan["lifts"][0]
    assert row["storeys"] == ["ground", "second"]
    assert row["operation"] == {"capacity": 12, "speed": 2.5}
    assert row["door"] == [[4.4, 8.2], [5.2, 8.2]]
    assert row["polygon"][2] == [5.6, 10.2]
    page.judged()
    assert "no exit can be reached from 'first'" in page.text("#findings .warning")
    assert "[[lifts]]  # of the north side\n" in saved(page)
    assert tomllib.loads(saved(page))["lifts"] == page.plan["lifts"]


def test_lifts_follow_their_storeys(page):
    page.run("editor.act.copyUp(2)")
    assert page.plan["lifts"][0]["storeys"] == ["ground", "first", "second", "storey 3", "storey 4"]
    page.run("editor.store.commit(editor.store.now.rename({ section: 'storeys', index: 1 }, 'low'))")
    row = page.plan["lifts"][0]
    assert (row["storeys"][1], row["operation"]["discharge"]) == ("low", "low")
    page.run("editor.store.commit(editor.store.now.remove({ section: 'storeys', index: 1 }))")
    row = page.plan["lifts"][0]
    assert (row["storeys"], row["operation"]) == (["ground", "second", "storey 3", "storey 4"], {"capacity": 12})
    page.judged()
    assert page.text("#verdict") == "Can be run"


def test_floor_that_only_lifts_reach_is_not_hatched(page):
    page.judged()
    assert page.run("editor.view.judged.levels.map(({ reached }) => reached)") == [True] * 6
    page.run("editor.act.select({ section: 'lifts', index: 0 })")
    page.run(
        "editor.store.commit(editor.store.now.put({ section: 'lifts', index: 0 }, 'operation', { service: false }))"
    )
    page.judged()
    assert page.run("editor.view.judged.levels.filter(({ reached }) => reached).map(({ storey }) => storey)") == [
        "ground"
    ]
