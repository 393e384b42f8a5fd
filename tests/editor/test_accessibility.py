"""The page as axe-core judges it, in all of its states, on a large screen in light and on a small one in dark."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.editor.test_page import Page

#: What is shown, and how one comes to it.
STATES = {
    "storey": "editor.act.select(null)",
    "room": "editor.act.select({ section: 'rooms', index: 0 })",
    "rooms": "editor.act.selectAlike()",
    "escalator": """editor.store.commit(editor.store.now.move('stair', { speed: 0.5 })),
        editor.act.select({ section: 'shafts', index: 0 })""",
    "group": "editor.act.select({ section: 'people', index: 0 })",
    "3d": "document.getElementById('view-3d').click()",
    "stair": "editor.act.goTo('first'), editor.act.choose('stair')",
    "finding": "editor.act.goTo('ground'), editor.store.commit(editor.store.now.with({ exits: [] }))",
    "event": "document.getElementById('add-event').click()",
    "phase": "document.getElementById('add-phase').click()",
    "banner": "editor.act.warn('What is wrong')",
    "result": """editor.running.show({ phase: "ended", answer: ["Everybody out", "after 20 s"], files: ["replay.html"],
        status: "green", when: "2026-01-01 12:00", is_old: true })""",
    "picture": """editor.pictures.put = () => editor.pictures.show(), editor.pictures.all.ground =
        { at: [0, 0], width: 9, bitmap: new OffscreenCanvas(9, 9) }, editor.pictures.show(),
        editor.pictures.measure([[0, 0], [1, 1]])""",
    "save as": "document.getElementById('save-as').click()",
    "help": "document.getElementById('copy-to').close(), document.getElementById('show-help').click()",
}


@pytest.fixture(scope="module")
def axe():
    """The script of axe-core."""
    spec = find_spec("axe_core_python")
    if spec is None:
        pytest.skip("axe-core-python is not installed: pip install -e .[test]")
    return Path(spec.origin).with_name("axe.min.js").read_text("utf-8")


def violations(browser):
    """Return the rules that are not kept, with the elements."""
    options = "{ resultTypes: ['violations'] }"
    return browser.run(
        f"axe.run(document, {options}).then((found) => found.violations.map((one) => "
        "[one.id, one.nodes.map((node) => node.html.slice(0, 120))]))"
    )


@pytest.mark.parametrize(("width", "height", "is_dark"), [(1440, 900, False), (390, 800, True)])
def test_axe_finds_nothing(axe, browser, serve, house, width, height, is_dark):
    page = Page(browser, serve(house), width, height, is_dark)
    browser.run(axe)
    found = {}
    for name, way in STATES.items():
        page.run(f"void ({way})")
        if name == "finding":
            page.judged()
        browser.settle()
        found[name] = violations(browser)
    page.close()
    assert {name: rules for name, rules in found.items() if rules} == {}


def test_axe_finds_nothing_before_a_building_is_chosen(axe, browser, serve, house, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = Page(browser, serve(house))
    page.close()
    browser.send("Page.navigate", {"url": serve(None).address})
    browser.wait("document.getElementById('begin').open")
    browser.run(axe)
    assert violations(browser) == []
