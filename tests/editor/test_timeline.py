"""Events and phases along the time of a run."""

import pytest

from tests.editor.test_page import SHIFT, Page

CASE = """
[[event]]
name = "alarm"
time = 30.0
kind = "alarm"

[[event]]
name = "shut"
when = { event = "alarm", after = 10 }
kind = "close"
target = "side"

[[event]]
when = { out = 5 }
kind = "close"
target = "main"

[[phase]]
name = "upper"
of = ["first"]
delay = 50
cue = "alarm"
"""


@pytest.fixture
def page(browser, serve, house):
    """The page of the house with events and a phase."""
    case = house / "case.toml"
    case.write_text(case.read_text() + CASE)
    page = Page(browser, serve(house))
    yield page
    page.close()
    assert browser.errors == []


def times(page):
    """Return by its words where each mark is, as a time [s]."""
    return page.run(
        """Object.fromEntries([...document.querySelectorAll("#timeline button")].map((one) =>
            [one.textContent.split(",").slice(0, -1).join(), parseFloat(one.style.left) / 100]))"""
    )


def middle(page, words):
    return page.run(
        f"""(() => {{ const all = [...document.querySelectorAll("#timeline button")];
            const box = all.find((one) => one.textContent.startsWith({words!r})).getBoundingClientRect();
            const {{ clientWidth }} = document.getElementById("timeline");
            return [box.x + box.width / 2, box.y + box.height / 2, clientWidth]; }})()"""
    )


def test_events_and_phases_are_at_their_times_after_their_cues(page):
    at = times(page)
    assert at["alarm"] / at["close side"] == pytest.approx(30 / 40, rel=1e-4)
    assert at["alarm"] / at["upper: first"] == pytest.approx(30 / 80, rel=1e-4)
    assert at["close main"] == 1  # at the end: nobody knows when


def test_a_new_phase_is_of_the_storey_that_is_shown(page):
    page.run("editor.act.goTo('first')")
    page.press("add-phase")
    assert page.plan["case"]["phase"][-1]["of"] == ["first"]


def test_a_mark_is_dragged_to_another_time(page):
    end = 30 / times(page)["alarm"]
    x, y, wide = middle(page, "alarm")
    page.browser.mouse("mouseMoved", x, y)
    page.browser.mouse("mousePressed", x, y, 1)
    for k in range(1, 5):
        page.browser.mouse("mouseMoved", x + k * wide / 20, y, 1)
    page.browser.mouse("mouseReleased", x + wide / 5, y)
    page.judged()
    assert page.plan["case"]["event"][0]["time"] == pytest.approx(30 + end / 5, abs=1)
    page.run("editor.store.undo()")
    assert page.plan["case"]["event"][0]["time"] == 30


def test_a_mark_is_clicked_and_moved_by_the_arrows(page):
    x, y, _ = middle(page, "upper")
    page.browser.click(x, y)
    assert page.text("#inspector h2") == "Phase upper"
    page.run("document.querySelector('#timeline .phase').focus()")
    page.keys("ArrowLeft")
    page.keys("ArrowLeft", modifiers=SHIFT)
    assert page.plan["case"]["phase"][0]["delay"] == 39
    page.run("document.querySelectorAll('#timeline .event')[1].focus()")
    page.keys("ArrowRight")
    assert page.plan["case"]["event"][1]["when"] == {"event": "alarm", "after": 11}
    assert page.saved()["case"]["phase"][0]["delay"] == 39
    assert page.run("editor.store.past.length") == 2
