"""What the tools make of rooms: stairs that fit, exits along walls, sizes beside what is drawn."""

import numpy as np
import pytest

from tests.editor.test_page import CONTROL, SHIFT, Page

PLAN = """\
[[storeys]]
name = "ground"
wall = 0.1

[[rooms]]
name = "a"
storey = "ground"
polygon = [[0, 0], [6, 0], [6, 5], [0, 5]]

[[rooms]]
name = "b"
storey = "ground"
polygon = [[6, 0], [14, 0], [14, 5], [6, 5]]

[[rooms]]
name = "stairs"
storey = "ground"
polygon = [[14, 0], [17, 0], [17, 5], [14, 5]]
"""


@pytest.fixture
def page(browser, serve, tmp_path):
    """The page of a plan with three rooms in a row."""
    (tmp_path / "rooms.plan.toml").write_text(PLAN)
    page = Page(browser, serve(tmp_path / "rooms.plan.toml"))
    yield page
    page.close()
    assert browser.errors == []


def segments(page, section):
    page.judged()
    return {row["name"]: row["ends"][0] for row in page.run(f"editor.view.judged.segments.{section}")}


def test_a_stair_needs_a_storey_above_which_is_offered(page):
    page.keys("s")
    assert "there is none" in page.text("#hint")
    page.click((2, 1), (2, 4))
    assert "shafts" not in page.plan
    page.run("document.querySelector('#hint button').click()")
    assert [row["name"] for row in page.plan["storeys"]] == ["ground", "storey 1"]
    assert "there is none" not in page.text("#hint")
    page.click((8, 2), (13, 2))
    assert page.plan["shafts"][0]["upper"] == "storey 1"


@pytest.mark.parametrize(
    ("foot", "to", "turn", "at"),
    [
        ((7, 2.5), (9, 2.5), None, [7, 2.5]),  # 4.94 m of steps and 1.2 m to arrive at
        ((7, 0), (9, 0), None, [7, 0.65]),  # moved aside, to the wall of 0.1 m
        ((9, 2.5), (11, 2.5), "left", [9, 2.5]),
        ((10, 4.3), (7, 4.3), "left", [10, 4.3]),
        ((15.9, 0.9), (15.9, 3), "left", [16.35, 0.9]),  # which fills a room that is hardly wider
        ((14.7, 0.9), (14.7, 3), "right", [14.65, 0.9]),  # with the turn that leaves it where it was clicked
    ],
)
def test_a_stair_is_of_the_kind_that_fits(page, foot, to, turn, at):
    page.run("editor.act.copyUp(1)")
    page.keys("s")
    page.click(foot, to)
    page.judged()
    stair = page.plan["shafts"][0]
    assert stair.get("turn") == turn
    assert stair["foot"] == pytest.approx(at, abs=0.051)
    kinds = page.run("editor.view.judged.levels.map(({ kind }) => kind)")
    assert kinds.count("landing") == (turn is not None)
    assert ("U-shaped" in page.text("#told")) == (turn is not None)
    is_filled = foot[0] > 14
    assert (stair.get("gap"), stair.get("landing")) == (
        (0.5, pytest.approx(1.58, abs=0.01)) if is_filled else (None, None)
    )
    rooms = [row["polygon"] for row in page.plan["rooms"]]
    room = next(ring for ring in rooms if ring[0][0] < foot[0] < ring[1][0])
    pieces = page.run("editor.view.judged.levels.filter(({ kind }) => kind !== 'floor').flatMap((one) => one.polygons)")
    corners = np.concatenate([ring for ring, *_ in pieces])
    assert (corners >= np.min(room, axis=0) - 1e-3).all()
    assert (corners <= np.max(room, axis=0) + 1e-3).all()


def test_a_stair_that_fits_nowhere_is_told(page):
    page.run("editor.act.copyUp(1)")
    page.keys("s")
    page.click((15, 2.5), (14.2, 2.5))
    assert "does not fit" in page.text("#told")


def test_stairs_of_shafts_have_names_of_their_own(page):
    page.run("editor.act.copyUp(3)")
    page.keys("s")
    page.click((7, 1), (9, 1), (7, 3.5), (9, 3.5))
    assert [row["name"] for row in page.plan["shafts"]] == ["stair A", "stair B"]
    page.run("editor.store.commit(editor.store.now.mapRows((row) => ({ ...row, upper: 'storey 3' }), ['shafts']))")
    page.judged()
    stairs = page.run("editor.view.judged.levels.filter(({ kind }) => kind === 'flight').map(({ stair }) => stair)")
    assert sorted(stairs) == [f"stair {shaft} {number}" for shaft in "AB" for number in range(3)]
    assert page.run("editor.store.now.unique('shafts', 'stair A')") == "stair C"


def test_an_exit_along_rooms_with_no_way_between_them_is_one_of_each(page):
    page.judged()
    page.keys("e")
    page.drag((2, 0), (9, 0))
    assert page.text("#told") == "Exit, exit 2 added"
    found = segments(page, "exits")
    assert found["exit"] == pytest.approx([2, 0, 5.9, 0])
    assert found["exit 2"] == pytest.approx([6.1, 0, 9, 0])
    assert [row["segment"]["rooms"] for row in page.plan["exits"]] == [["a"], ["b"]]


def test_an_exit_along_joined_rooms_is_one_with_a_part_in_each(page):
    page.keys("d")
    page.click((6, 2))
    page.judged()
    page.keys("e")
    page.drag((2, 0), (9, 0))
    assert page.row("exits", "exit")["segment"] == [[[2, 0], [5.9, 0]], [[6.1, 0], [9, 0]]]
    page.judged()
    (exit,) = page.run("editor.view.judged.segments.exits")
    assert exit["ends"] == [pytest.approx([2, 0, 5.9, 0]), pytest.approx([6.1, 0, 9, 0])]
    page.keys("v")
    page.click((11, 2), (8, 0))
    assert page.text("#inspector h2") == "Exit"
    assert page.text("#inspector p") == "6.80 m wide, in 2 parts"


def test_doors_along_several_rooms_are_one_of_each(page):
    page.keys("r")
    page.drag((0, 5), (14, 8))
    page.keys("d")
    page.drag((2, 5), (9, 5))
    assert sorted(row["segment"]["rooms"] for row in page.plan["doors"]) == [["a", "room"], ["b", "room"]]


def test_several_rooms_are_given_a_use_and_deleted_at_once(page):
    page.click((1, 2))
    page.click((8, 2), modifiers=SHIFT)
    assert page.text("#inspector h2") == "Room b and 1 more"
    page.type("Use", "office")
    assert [row.get("use") for row in page.plan["rooms"]] == ["office", "office", None]
    page.keys("a", modifiers=CONTROL)
    page.type("People", "7")
    assert [row["people"] for row in page.plan["rooms"]] == [7, 7, 7]
    page.keys("Escape", "n", "b")
    assert page.text("#inspector h2") == "Room b and 1 more"
    page.keys("Delete")
    assert [row["name"] for row in page.plan["rooms"]] == ["stairs"]


def test_an_exit_is_dragged_round_the_corner_of_a_room(page):
    page.keys("e")
    page.click((3, 0))
    page.keys("Escape")
    page.drag((3, 0), (5, 0))
    assert page.row("exits", "exit")["segment"] == {"rooms": ["a"], "side": 0, "at": 5, "width": 1.2}
    page.drag((5, 0), (9, 0))
    assert page.row("exits", "exit")["segment"] == {"rooms": ["b"], "side": 0, "at": 3, "width": 1.2}
    page.drag((9, 0), (11, 1.5))
    assert page.row("exits", "exit")["segment"] == {"rooms": ["b"], "side": 0, "at": 5, "width": 1.2}


def test_a_door_is_as_wide_as_it_is_dragged(page):
    page.keys("d")
    page.drag((6, 1), (6, 3))
    assert page.row("doors", "door")["segment"] == {"rooms": ["a", "b"], "at": 2, "width": 2}


def test_copies_of_a_storey_are_above_all_others(page):
    page.run("editor.act.copyUp(2)")
    page.keys("s")
    page.click((7, 1), (9, 1))
    page.run("editor.store.commit(editor.store.now.put({ section: 'shafts', index: 0 }, 'upper', 'storey 2'))")
    page.run("editor.act.copyUp(1)")
    page.judged()
    plan = page.plan
    assert [(row["name"], row.get("z", 0), row.get("like")) for row in plan["storeys"]] == [
        ("ground", 0, None),
        ("storey 1", 3, "ground"),
        ("storey 2", 6, "ground"),
        ("storey 3", 9, "ground"),
    ]
    assert plan["shafts"][0]["upper"] == "storey 3"
    assert page.run("editor.view.judged.levels.filter(({ kind }) => kind === 'flight').length") == 3


def test_the_use_of_a_room_is_chosen_with_its_load(page):
    page.run("editor.act.select({ section: 'rooms', index: 0 })")
    options = page.run("[...document.querySelectorAll('#inspector select option')].map((one) => one.textContent)")
    assert "office: 6 m² a person" in options
    assert "corridor: nobody" in options
    page.type("Use", "office")
    assert "ADB D1: office" in page.text("#inspector")
    assert page.row("rooms", "a")["use"] == "office"
    page.type("Use", "another use …")
    page.type("Use", "vault")
    assert page.row("rooms", "a")["use"] == "vault"
    page.type("Use", "")
    assert "use" not in page.row("rooms", "a")


def test_a_building_without_an_exit_offers_the_tool(page):
    page.judged()
    assert "Exit (E)" in page.text("#findings .error")
    assert "[[exits]]" not in page.text("#findings .error")
    page.run("document.querySelector('#findings .error').click()")
    assert page.run("editor.tools.tool") == "exit"
    page.run("editor.store.commit(editor.store.now.with({ rooms: [] }))")
    page.judged()
    assert "Room (R)" in page.text("#findings .error")
    page.run("document.querySelector('#findings .error').click()")
    assert page.run("editor.tools.tool") == "room"


def test_a_stair_is_drawn_piece_by_piece(page):
    page.run("editor.act.copyUp(1)")
    page.keys("g")
    page.drag((11, 1), (12.5, 3.5))
    page.keys("l")
    page.click((8, 1), (8, 2.2), (11, 1), (11, 2.2))
    page.click((11, 2.2), (11, 3.5), (8, 2.2), (8, 3.5))
    plan = page.plan
    assert [(row["lower_z"], row["upper_z"]) for row in plan["flights"]] == [(0, 1.5), (1.5, 3)]
    assert {row["stair"] for row in [*plan["flights"], *plan["landings"]]} == {"stair A"}
    page.judged()
    kinds = page.run("editor.view.judged.levels.map(({ kind }) => kind)")
    assert sorted(kinds).count("flight") == 2
    assert "error" not in page.run("editor.view.findings.map(({ kind, item }) => item === 'exits' ? '' : kind)")
    page.keys("Escape")
    page.keys("v")
    page.click((9.5, 1.6))
    assert page.text("#inspector h2") == "Flight stair A"
    page.type("To height", "1.4")
    assert page.plan["flights"][0]["upper_z"] == 1.4
    page.drag((9.5, 1.6), (9.5, 2.1))
    assert page.plan["flights"][0]["lower_edge"] == [[8, 1.5], [8, 2.7]]
    page.keys("Delete")
    assert len(page.plan["flights"]) == 1
    page.run("while (editor.store.past.length) editor.store.undo()")
    assert "flights" not in page.plan
