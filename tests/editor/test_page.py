"""The page in a real browser: what is drawn, what is in the plan then, and in the file."""

import io
import json
import shutil
import subprocess
import threading
import tomllib
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import evac
from evac.base.distributions import parse
from evac.cli.main import main
from evac.editor import Server, Session

CONTROL, SHIFT = 2, 8


class Page:
    """A page of a server, with places in plan [m]."""

    def __init__(self, browser, server, width=1280, height=800, dark=False):
        self.browser, self.server = browser, server
        if browser._session is None:
            target = browser.send("Target.createTarget", {"url": "about:blank"})["targetId"]
            browser._session = browser.send("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
            for domain in ("Page", "Runtime", "Network", "Log"):
                browser.send(f"{domain}.enable")
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        browser.send("Emulation.setEmulatedMedia", {"features": scheme})
        browser.resize(width, height)
        self.open(server.address)

    def close(self):
        self.run("window.editor && void (editor.store.saved = editor.store.now.content)")  # else the browser asks
        self.browser.send("Page.navigate", {"url": "about:blank"})

    def open(self, address):
        self.close()
        self.browser.errors, self.browser.requests = [], []
        self.browser.send("Page.navigate", {"url": address})
        self.browser.wait("window.editor && document.getElementById('verdict').dataset.revision", 120)

    def run(self, code):
        return self.browser.run(code)

    def judged(self):
        """Wait until the plan of now is judged."""
        self.browser.wait("Number(document.getElementById('verdict').dataset.revision) === editor.store.revision", 120)
        self.browser.settle()

    def spot(self, x, y):
        return self.run(
            f"""(() => {{ const box = document.getElementById("view").getBoundingClientRect();
                const [left, top] = editor.view.spot([{x}, {y}]); return [box.left + left, box.top + top]; }})()"""
        )

    def click(self, *points, modifiers=0):
        for point in points:
            at = self.spot(*point)
            self.browser.mouse("mouseMoved", *at)
            self.browser.mouse("mousePressed", *at, 1, modifiers=modifiers)
            self.browser.mouse("mouseReleased", *at, modifiers=modifiers)
            self.browser.settle()

    def drag(self, start, end):
        (x1, y1), (x2, y2) = self.spot(*start), self.spot(*end)
        self.browser.mouse("mouseMoved", x1, y1)
        self.browser.mouse("mousePressed", x1, y1, 1)
        for k in range(1, 5):
            self.browser.mouse("mouseMoved", x1 + (x2 - x1) * k / 4, y1 + (y2 - y1) * k / 4, 1)
        self.browser.mouse("mouseReleased", x2, y2)
        self.browser.settle()

    def keys(self, *keys, modifiers=0):
        for key in keys:
            self.browser.press(key, modifiers=modifiers)

    def press(self, name):
        self.run(f"document.getElementById('{name}').click()")
        self.browser.settle()

    def type(self, label, value):
        """Type a value of what is selected."""
        self.run(
            f"""(() => {{ const all = [...document.querySelectorAll("#inspector label")];
                const input = all.find((one) => one.textContent.startsWith({label!r})).querySelector("input, select");
                input.value = {value!r}; input.dispatchEvent(new Event("change")); }})()"""
        )

    @property
    def plan(self):
        return self.run("editor.store.now.content")

    def row(self, section, name):
        return next(row for row in self.plan[section] if row["name"] == name)

    def text(self, selector):
        return self.browser.text(selector)

    def picture(self):
        self.browser.settle()
        return np.array(Image.open(io.BytesIO(self.browser.picture())).convert("RGB")).astype(int)

    def colour(self, x, y):
        picture = self.picture()
        left, top = self.spot(x, y)
        return picture[round(top) - 6 : round(top) + 6, round(left) - 6 : round(left) + 6].reshape(-1, 3)

    def saved(self):
        self.keys("s", modifiers=CONTROL)
        self.browser.wait("document.getElementById('saved').textContent === 'Saved'")
        session = self.server.session
        return tomllib.loads(session.file.read_text()) | {"case": tomllib.loads(session.case_file.read_text())}


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """The house, served for all tests."""
    folder = tmp_path_factory.mktemp("served") / "house"
    main(["new", str(folder)])
    with Server(Session(folder, folder.with_name("result"))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server
        server.shutdown()


@pytest.fixture
def page(browser, server, house):
    """The page of the house as it was; it raises no error and asks nobody but its server."""
    for file in ("house.plan.toml", "case.toml"):
        shutil.copy(house / file, server.session.file.with_name(file))
    server.session.journal.unlink(missing_ok=True)
    page = Page(browser, server)
    yield page
    page.close()  # before the journal of the next one is taken away
    assert browser.errors == []
    assert all(url.startswith(("http://127.0.0.1:", "data:", "about:")) for url in browser.requests)


def git(folder, *words):
    words = ["git", "-c", "user.name=a", "-c", "user.email=a@b.c", *words]
    return subprocess.run(words, cwd=folder, check=True, capture_output=True, text=True).stdout


def test_a_building_is_drawn_from_nothing(page, serve, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page.server = serve(None)
    page.browser.send("Page.navigate", {"url": page.server.address})
    page.browser.wait("document.getElementById('begin').open")
    page.run("document.getElementById('begin-folder').value = 'hut'")
    page.run("document.getElementById('begin-button').click()")
    page.browser.wait("document.getElementById('verdict').dataset.revision", 120)
    assert page.text("#verdict") == "Cannot be run: 1 error"
    page.keys("r")
    page.drag((0, 0), (12, 8))
    page.judged()
    assert "the building has no exit" in page.text("#findings")
    page.keys("e")
    page.click((0, 4))
    page.judged()
    assert page.text("#verdict") == "Can be run"
    saved = page.saved()
    assert saved["exits"][0]["segment"] == {"rooms": ["room"], "side": 3, "at": 4, "width": 1.2}
    assert (tmp_path / "hut/case.toml").is_file()


def test_a_wall_is_moved_with_its_door_and_only_its_lines_change(page):
    house = page.server.session.file.parent
    git(house, "init", "-q")
    git(house, "add", ".")
    git(house, "commit", "-qm", "drawn")
    page.drag((8, 4.2), (9, 4.2))
    page.judged()
    door = page.run("editor.view.judged.segments.doors[0].ends[0]")
    assert door == [9.1, 2, 9.1, 3]
    assert page.text("#verdict") == "Can be run"
    saved = page.saved()
    assert saved["rooms"][1]["polygon"] == [[9.2, 0], [14, 0], [14, 8], [9.2, 8]]
    assert git(house, "diff", "--numstat") == "2\t2\thouse.plan.toml\n"


def test_findings_appear_while_one_draws_and_lead_to_their_place(page):
    page.click((8.1, 2.5))
    assert page.text("#inspector h2") == "Door"
    page.type("Width", "40")
    page.judged()
    assert page.text("#verdict") == "Cannot be run: 1 error"
    page.run("editor.act.goTo('first')")
    page.run("document.querySelector('#findings .error').click()")
    assert page.run("editor.view.storey") == "ground"
    assert page.text("#inspector h2") == "Door"
    page.type("Width", "1.1")
    page.judged()
    assert page.text("#verdict") == "Can be run"


def test_the_case_is_saved_and_run_and_its_people_are_seen(page):
    page.click((8.1, 2.5))
    page.type("Width", "1.4")
    page.keys("Enter", modifiers=CONTROL)
    page.browser.wait("document.getElementById('run-box').dataset.phase === 'ended'", 120)
    results = evac.read_results(page.server.session.runner.folder)
    assert results.building.doors[0].width == pytest.approx(1.4)
    assert page.text("#run-verdict") == results.verdict["text"]
    assert page.text("#answer").splitlines() == results.answer.lines()[1:]
    assert page.text("#run") == "Run"
    assert page.run("document.getElementById('run-old').hidden")
    page.type("Width", "1.3")
    assert not page.run("document.getElementById('run-old').hidden")
    assert page.run("editor.act.save()")  # the file is newer than the result
    page.browser.wait("editor.running.state.is_old", 10)
    assert not page.run("document.getElementById('run-old').hidden")
    page.browser.send("Page.navigate", {"url": page.run("document.querySelector('#results a').href") + "#time=5"})
    page.browser.wait("Number(document.getElementById('slider').value) === 5")


def test_designs_are_made_and_compared(page, monkeypatch):
    designs = page.server.session.designs
    first = ["repeat", str(page.server.session.case_file), "--runs", "1", "--jobs", "1", "--seed", "1"]
    assert main([*first, "--out", str(designs.folder) + "-A", "--set", "output.picture=false"]) == 0
    page.browser.wait("document.querySelectorAll('#designs li').length === 1")
    page.run("document.querySelector('#designs input').click()")
    page.click((8.1, 2.5))
    page.type("Width", "0.7")
    page.run("document.getElementById('design-runs').value = 1")
    page.browser.wait("document.getElementById('design-name').value === 'B'")
    page.press("make-button")
    page.browser.wait("document.querySelectorAll('#designs li').length === 2", 120)
    assert evac.read_study(str(designs.folder) + "-B").building().doors[0].width == pytest.approx(0.7)
    assert page.text("#compare") == "A and B beside each other"
    shown = page.run("fetch(document.getElementById('compare').href).then((answer) => answer.text())")
    assert shown == evac.compare(f"{designs.folder}-A", f"{designs.folder}-B").page()


def test_groups_events_and_behaviours_are_changed_in_the_case(page):
    case = page.server.session.case_file
    before = tomllib.loads(case.read_text())
    page.run("document.querySelectorAll('#people button')[1].click()")
    assert page.text("#inspector h2") == "Group staff"
    page.type("Number", "20")
    page.run("document.getElementById('add-event').click()")
    page.type("Name", "blocked")
    page.type("Time [s]", "12")
    page.type("Target", "side")
    page.run("document.querySelector('#behaviours input[aria-label=rest]').click()")
    assert page.text("#inspector h2") == "Behaviour rest"
    page.judged()
    assert page.text("#verdict") == "Can be run"
    assert "+number = 20" in page.text("#changes")
    page.saved()
    after = tomllib.loads(case.read_text())
    assert after["people"][1] == before["people"][1] | {"number": 20}
    assert after["event"] == [{"name": "blocked", "time": 12, "kind": "close", "target": "side"}]
    assert after["behaviours"] == before["behaviours"] | {"rest": {}}
    assert 'area = "office"  # an area of the plan\n' in case.read_text()


def test_phases_and_limits_are_changed_in_the_case(page):
    page.run("document.getElementById('add-phase').click()")
    page.type("Of", "first")
    page.type("Delay [s]", "30")
    page.run("document.getElementById('add-compartment').click()")
    page.run("document.querySelector('#tables input[aria-label=safety]').click()")
    page.type("Available [s]", "90")
    page.run("document.querySelectorAll('#tables button')[1].click()")
    page.type("Seed", "7")
    page.judged()
    assert page.text("#verdict") == "Can be run"
    case = page.saved()["case"]
    assert case["phase"] == [{"name": "phase", "of": ["first"], "delay": 30}]
    assert case["compartment"] == [{"name": "compartment", "of": ["ground"], "available": 120}]
    assert case["safety"] == {"available": 90}
    assert case["simulation"] == {"duration": 3600.0, "seed": 7}


def test_a_distribution_has_its_numbers_and_its_curve(page):
    page.run("editor.act.select({ section: 'behaviours', index: 'response_time' })")
    page.browser.wait("document.querySelector('.curve').getAttribute('aria-label')")
    assert page.text("#inspector fieldset legend") == "Time [s]"
    page.type("Kind", "lognormal by mean")
    page.type("Mean, standard deviation", "60, 20")
    page.type("Maximum", "200")
    page.judged()
    time = page.plan["case"]["behaviours"]["response_time"]["time"]
    assert time == {"lognormal": {"mean": 60, "deviation": 20}, "maximum": 200}
    mean = round(parse(time, "time").mean(), 3)
    page.browser.wait(f"document.querySelector('.curve').getAttribute('aria-label').endsWith('mean {mean}')")
    page.type("Kind", "")
    assert "time" not in page.plan["case"]["behaviours"]["response_time"]


def test_a_fault_of_the_case_is_a_finding(page):
    page.run("editor.act.select({ section: 'people', index: 0 })")
    page.type("Number", "-3")
    page.judged()
    assert page.text("#verdict") == "Cannot be run: 1 error"
    assert "people.visitors.number" in page.text("#findings .error")


def test_people_of_a_run_are_on_their_storey(page, monkeypatch):
    accent = np.array([0x0B, 0x63, 0xA5])
    state = {"phase": "running", "text": "1/2 out", "people": {"ground": [6, 6, 0], "first": [6, 7, 3.2]}}
    page.judged()  # the first verdict fits the view
    monkeypatch.setattr(page.server.session.runner, "state", lambda: state)
    page.browser.wait("document.getElementById('run-text').textContent === '1/2 out'")
    page.browser.settle()
    assert page.text("#run") == "Stop"
    assert np.abs(page.colour(6, 6) - accent).sum(axis=1).min() < 40
    assert np.abs(page.colour(6, 7) - accent).sum(axis=1).min() > 100
    empty = page.run("editor.view3d.people = {}, document.getElementById('view-3d').click()") or page.picture()
    page.run("editor.running.show(editor.running.state)")
    page.browser.settle()
    figures = page.run(
        "(({ count, parts, bodies }) => [count, parts, [...bodies.slice(0, 8)]])(editor.view3d.figures())"
    )
    middle = page.run("editor.view3d.origin")
    places = [6 - middle[0], 6 - middle[1], 0, 6 - middle[0], 7 - middle[1]]
    assert figures[:2] == [2, [[0, 1], [1, 1]]]
    assert [*figures[2][:3], *figures[2][4:6]] == pytest.approx(places)
    assert 20 < (np.abs(page.picture() - empty).sum(axis=2) > 60).sum() < 5000


def test_floor_that_cannot_be_left_is_hatched(page):
    error = np.array([0xB3, 0x26, 0x1E])
    assert np.abs(page.colour(12, 2) - error).sum(axis=1).min() > 300
    page.click((14, 6.5))
    page.keys("Delete")
    page.click((8.1, 2.5))
    page.keys("Delete")
    page.judged()
    assert "no exit can be reached from 'ground" in page.text("#findings")
    assert np.abs(page.colour(12, 2) - error).sum(axis=1).min() < 150


def test_every_tool_draws(page):
    page.run("editor.view.zoomAt(0.7, [3, 4])")  # so that there is space at the right
    page.run("editor.store.commit(editor.store.now.put({ section: 'storeys', index: 0 }, 'wall', 0.2))")
    page.keys("r")
    page.drag((14, 0), (18, 5))  # with a corner that is there
    page.keys("d")
    page.click((14, 2))
    page.keys("e")
    page.click((18, 3))
    page.keys("o")
    page.click((10, 1.4), (11, 1.4), (11, 2.5), (10, 1.4))
    page.keys("a")
    page.drag((15, 1.4), (17, 4))
    page.keys("w")
    page.click((9, 7), (12, 7))
    page.keys("s")
    page.click((9.5, 4), (13, 4))
    page.keys("m")
    page.click((0, 0), (3, 4))
    assert page.text("#told") == "5.000 m"
    plan = page.plan
    assert plan["rooms"][-1] == {
        "name": "room",
        "storey": "ground",
        "polygon": [[14, 0], [18, 0], [18, 5], [14, 5]],
    }
    assert plan["doors"][-1]["segment"] == {"rooms": ["shop", "room"], "at": 2, "width": 0.9}
    assert plan["exits"][-1]["segment"] == {"rooms": ["room"], "side": 1, "at": 3, "width": 1.2}
    assert plan["obstacles"][-2]["polygon"] == [[10, 1.4], [11, 1.4], [11, 2.5]]
    assert np.ptp(plan["obstacles"][-1]["polygon"], axis=0) == pytest.approx([3, 0.1])
    assert plan["areas"][-1]["polygon"] == [[15, 1.4], [17, 1.4], [17, 4], [15, 4]]
    stair = plan["shafts"][-1]
    assert (stair["lower"], stair["upper"], stair["direction"]) == ("ground", "first", [1, 0])
    page.judged()
    drawn = {row["name"]: row["ends"] for row in page.run("Object.values(editor.view.judged.segments).flat()")}
    assert drawn["door 2"] == [[14, 1.55, 14, 2.45]]
    assert drawn["exit"] == [[18, 2.4, 18, 3.6]]
    for section, name in (("doors", "door 2"), ("exits", "exit")):
        ref = f"{{ section: '{section}', index: editor.store.now.rows('{section}').length - 1 }}"
        line = page.run(f"editor.view.lineOf({ref}, editor.store.now.row({ref})).flat()")
        assert line == drawn[name][0]
    saved = page.saved()
    assert saved == plan


def test_a_picture_lies_under_a_storey_and_is_scaled_by_two_points(page, tmp_path):
    file = page.server.session.file
    picture = Image.new("RGB", (200, 100), "white")
    picture.paste("red", (0, 0, 100, 100))
    picture.save(tmp_path / "plan.png")
    page.browser.send("DOM.enable")
    root = page.browser.send("DOM.getDocument")["root"]["nodeId"]
    chooser = page.browser.send("DOM.querySelector", {"nodeId": root, "selector": "#picture-file"})["nodeId"]
    page.browser.send("DOM.setFileInputFiles", {"nodeId": chooser, "files": [str(tmp_path / "plan.png")]})
    page.browser.wait("editor.pictures.own && editor.tools.tool === 'picture'")
    page.browser.settle()
    assert page.run("[editor.pictures.own.at, editor.pictures.own.width].flat()") == [0, 0, 14]
    page.click((2, 2), (6, 2))
    assert page.run("document.activeElement.id") == "picture-length"
    page.browser.send("Input.insertText", {"text": "5"})
    page.run("editor.view.canvas.focus()")
    assert page.run("[editor.pictures.own.at, editor.pictures.own.width].flat()") == [-0.5, -0.5, 17.5]
    page.drag((5, 5), (5.5, 5.5))
    page.browser.wait("editor.pictures.own.at[0] === 0 && editor.pictures.last.then(() => true)")
    page.run("editor.pictures.last")
    red, white = page.colour(7, 7).mean(axis=0), page.colour(12, 3).mean(axis=0)
    assert red[0] - red[1] > 80 > abs(white[0] - white[1])
    kept = json.loads(file.with_name("house.plan.toml.pictures").read_text())
    assert kept["ground"] | {"data": ""} == {"data": "", "at": [0, 0], "width": 17.5}
    assert b64decode(kept["ground"]["data"]) == (tmp_path / "plan.png").read_bytes()
    assert page.saved() == page.plan
    assert "picture" not in file.read_text()
    page.open(page.server.address)
    page.browser.wait("editor.pictures.own")
    page.press("picture-remove")
    page.browser.wait("document.getElementById('picture-box').hidden")
    page.keys("p")
    assert page.run("document.activeElement.id") == "picture-file"
    assert not file.with_name("house.plan.toml.pictures").exists()


def test_the_focus_goes_everywhere_and_is_seen(page):
    tab = {"key": "Tab", "code": "Tab", "windowsVirtualKeyCode": 9}
    seen = {}
    page.run("document.getElementById('undo').parentElement.querySelector('button:enabled').focus()")
    for _ in range(90):
        page.browser.send("Input.dispatchKeyEvent", {"type": "keyDown", **tab})
        name, outline, border = page.run(
            """(() => { const one = document.activeElement, style = getComputedStyle(one);
                const name = one === document.body ? "body" : one.id || one.value || one.textContent || one.type;
                const outline = parseFloat(style.outlineWidth) * (style.outlineStyle !== "none");
                return [name, outline, style.boxShadow]; })()"""
        )
        seen[name] = outline >= 2 or border != "none"
    wanted = {"view-plan", "view-3d", "theme", "show-help", "save", "run", "view", "fit", "add-storey", "copies"}
    wanted |= {"picture-file", "add-people", "add-event", "add-phase", "design-runs", "make-button", "changes"}
    wanted |= {"select", "room", "wall", "door", "exit", "stair"}
    assert wanted <= {*seen}
    assert [name for name, is_seen in seen.items() if not is_seen and name != "body"] == []


def test_lengths_are_typed(page):
    page.keys("r")
    page.click((15, 0))
    page.browser.mouse("mouseMoved", *page.spot(16, 1))
    page.keys(*"3x2.5", "Enter")
    assert page.plan["rooms"][-1]["polygon"] == [[15, 0], [18, 0], [18, 2.5], [15, 2.5]]
    page.keys("w")
    page.click((15, 4))
    page.browser.mouse("mouseMoved", *page.spot(15, 6))
    page.keys(*"1.75", "Enter")
    assert np.ptp(page.plan["obstacles"][-1]["polygon"], axis=0) == pytest.approx([0.1, 1.75])
    page.keys("v")
    page.click((11, 5))
    page.type("Width", "6")
    assert page.row("rooms", "shop")["polygon"] == [[8.2, 0], [14.2, 0], [14.2, 8], [8.2, 8]]


def test_what_is_being_typed_stays(page):
    page.click((11, 5))
    page.type("Use", "shop")
    page.run("editor.store.commit(editor.store.now.put({ section: 'storeys', index: 0 }, 'wall', 0.2))")
    page.keys("i")
    page.browser.send("Input.insertText", {"text": "corner "})
    page.judged()
    page.browser.send("Input.insertText", {"text": "shop"})
    page.click((4, 7))
    assert page.text("#inspector h2") == "Room hall"
    assert page.row("rooms", "corner shop")["use"] == "shop"


def test_everything_is_done_by_the_keyboard(page):
    page.run("editor.view.canvas.focus()")
    page.run("editor.tools.at = [14.2, 0]")
    page.keys("a", "Enter")
    page.keys("ArrowRight", "ArrowRight", modifiers=SHIFT)
    page.keys("Enter")
    page.keys("ArrowUp", modifiers=SHIFT)
    page.keys("Enter")
    page.keys("Enter")
    assert page.plan["areas"][-1]["polygon"] == [[14.2, 0], [16.2, 0], [16.2, 1]]
    page.keys("v", "ArrowUp", "ArrowUp")
    assert page.plan["areas"][-1]["polygon"] == [[14.2, 0.2], [16.2, 0.2], [16.2, 1.2]]
    page.keys("z", modifiers=CONTROL)  # the moves are one step
    assert page.plan["areas"][-1]["polygon"] == [[14.2, 0], [16.2, 0], [16.2, 1]]
    page.keys("d", modifiers=CONTROL)
    assert page.plan["areas"][-1]["name"] == "area 2"
    page.keys("Delete")
    page.keys("PageUp")
    assert page.run("editor.view.storey") == "first"
    page.keys("n")
    assert page.text("#inspector h2") != "Storey first"
    page.keys("Escape", "3")
    assert page.run("document.getElementById('view').hidden")


def test_a_new_name_is_used_where_the_old_one_was(page):
    page.click((11, 5))
    page.type("Name", "<b>café</b> & 'co'")
    assert page.row("doors", "door")["segment"]["rooms"] == ["hall", "<b>café</b> & 'co'"]
    page.keys("Escape")
    page.type("Name", "street")
    assert {row["storey"] for row in page.plan["exits"]} == {"street"}
    assert page.plan["shafts"][0]["lower"] == "street"
    page.judged()
    assert page.plan["case"]["people"][0]["level"] == "street"
    assert page.text("#verdict") == "Can be run"
    assert page.run("document.querySelectorAll('aside b').length") == 0
    assert page.saved() == page.plan


def test_a_storey_is_copied_up_with_its_stair(page):
    page.run("editor.act.goTo('first'); document.getElementById('copies').value = 3")
    page.run("document.querySelector('#copy button').click()")
    page.judged()
    assert [(row["name"], row.get("like")) for row in page.plan["storeys"]][2:] == [
        ("first 2", "first"),
        ("first 3", "first"),
        ("first 4", "first"),
    ]
    assert page.plan["shafts"][0]["upper"] == "first 4"
    assert [row["z"] for row in page.plan["storeys"]] == pytest.approx([0, 3.2, 6.4, 9.6, 12.8])
    assert page.run("editor.view.judged.levels.filter(({ kind }) => kind === 'flight').length") == 4
    assert page.saved() == page.plan


def test_infinite_values_and_openings_of_files_are_shown(page):
    page.run("""(() => { const { store } = editor, rows = store.now.rows("people");
        store.commit(store.now.set({ section: "people", index: 0 }, { ...rows[0], number: null, speed: null })
            .add("openings", { name: "gate", storey: "ground", segment: [[14, 2], [14, 3]] })); })()""")
    page.run("editor.act.select({ section: 'people', index: 0 })")
    label = "[...document.querySelectorAll('#inspector label')].find((one) => one.textContent.startsWith('{}'))"
    number, speed = map(label.format, ("Number", "Value"))
    assert page.run(f"{number}.querySelector('input').placeholder") == "inf"
    assert page.run(f"{speed}.querySelector('input').value") == "inf"
    page.click((14, 2.5))
    assert page.text("#inspector h2") == "Opening gate"
    page.run("document.querySelector('#inspector .actions').lastChild.previousSibling.click()")
    assert "openings" not in page.plan
    assert page.plan["exits"][-1]["name"] == "gate"
    page.keys("z", "z", modifiers=CONTROL)


def test_undo_goes_back_to_the_file_also_after_saving(page):
    first, bytes_of_file = page.plan, page.server.session.file.read_bytes()
    for _ in range(3):
        page.click((11, 5))
        page.keys("Delete")
        page.keys("v")
        page.keys("z", modifiers=CONTROL)
    page.drag((8, 4.2), (9, 4.2))
    second = page.plan
    page.saved()
    page.keys("z", modifiers=CONTROL)
    assert page.plan == first
    page.saved()
    assert page.server.session.file.read_bytes() == bytes_of_file
    page.keys("z", modifiers=CONTROL | SHIFT)
    assert page.plan == second
    page.keys("z", modifiers=CONTROL)


def test_a_file_that_changes_meanwhile_is_told_and_kept(page):
    page.drag((8, 4.2), (9, 4.2))
    file = page.server.session.file
    text = file.read_text().replace("width = 1.0", "width = 1.3")
    file.write_text(text)
    page.browser.wait("!document.getElementById('banner').hidden")
    page.keys("s", modifiers=CONTROL)
    page.browser.settle()
    assert file.read_text() == text
    page.press("keep-mine")
    assert page.saved()["doors"][0]["segment"]["width"] == 1.0
    file.write_text(text)
    page.browser.wait("!document.getElementById('banner').hidden")
    page.press("take-file")
    page.browser.wait("editor.store.now.content.doors[0].segment.width === 1.3")
    page.browser.errors = [one for one in page.browser.errors if "409" not in one]


def test_what_is_drawn_is_saved_as_another_case(browser, serve, house, eventually, monkeypatch):
    monkeypatch.chdir(house.parent)
    before = {file.name: file.read_bytes() for file in house.iterdir()}
    page = Page(browser, serve(house))
    first = page.server.session
    page.click((6.0, 4.0))
    page.type("Name", "big hall")
    page.browser.press("s", modifiers=CONTROL | SHIFT)
    folder = page.run("document.activeElement.id")
    assert folder == "copy-folder"
    page.run(
        f"document.getElementById('{folder}').value = 'house'; document.getElementById('copy-form').requestSubmit()"
    )
    page.browser.wait("document.getElementById('copy-told').textContent.includes('exist')")
    page.run(f"document.getElementById('{folder}').value = 'others/wide'")
    page.run("document.getElementById('copy-form').requestSubmit()")
    eventually(lambda: page.server.session is not first and page.server.session.listeners)
    page.judged()
    assert "big hall" in [row["name"] for row in page.plan["rooms"]]
    page.run("editor.store.commit(editor.store.now.put({ section: 'rooms', index: 1 }, 'people', 3))")
    page.saved()
    copy = house.parent / "others/wide"
    old, new = ({*(place / "house.plan.toml").read_text().splitlines()} for place in (house, copy))
    tie = 'segment = { rooms = ["big hall", "shop"], at = 2.5, width = 1.0 }'
    assert new - old == {'name = "big hall"', "people = 3", tie}
    assert {file.name: file.read_bytes() for file in house.iterdir()} == before
    assert (copy / "case.toml").read_bytes() == before["case.toml"]
    page.close()


def test_names_are_text_wherever_they_are_shown(page):
    markup = "<img src=x onerror=alert(1)>"
    for section in ("storeys", "rooms", "doors", "exits", "areas", "shafts", "people"):
        page.run(f"editor.store.commit(editor.store.now.rename({{ section: '{section}', index: 0 }}, {markup!r}))")
        page.run(f"editor.act.select({{ section: '{section}', index: 0 }})")
        assert markup in page.text("#inspector h2")
    page.judged()
    assert page.text("#verdict") == "Can be run"
    assert page.run("document.images.length") == 0
    assert page.saved() == page.plan


def test_unsaved_work_is_here_again_after_the_end_of_the_server(page):
    page.drag((8, 4.2), (9, 4.2))
    drawn = page.plan
    page.judged()
    with Server(Session(page.server.session.file.parent)) as again:
        threading.Thread(target=again.serve_forever, daemon=True).start()
        page.open(again.address)
        assert page.plan == drawn
        assert page.text("#saved") == "Not saved"
        page.press("undo")
        assert page.plan["rooms"][1]["polygon"][0] == [8.2, 0]
        page.judged()
        again.shutdown()
    page.press("save")
    page.browser.wait("document.getElementById('banner-text').textContent.includes('start it again')")
    page.browser.errors = [one for one in page.browser.errors if "ERR_" not in one]


def test_the_people_of_a_mesh_are_edited_but_not_its_building(browser, serve, tmp_path):
    shutil.copytree(Path(__file__).parents[2] / "buildings/square_room", tmp_path / "room")
    server = serve(tmp_path / "room")
    page = Page(browser, server)
    assert page.run("editor.view.judged.segments.exits.length") > 0
    assert page.run("[...document.querySelectorAll('#tools button')].map(({ value }) => value)") == [
        "select",
        "measure",
    ]
    before = page.plan
    page.keys("r", "Delete", "d")
    page.drag((1, 1), (3, 3))
    assert page.plan == before
    page.run("document.querySelector('#people button').click()")
    page.type("Number", "3")
    page.judged()
    assert page.text("#verdict") == "Can be run"
    page.keys("s", modifiers=CONTROL)
    page.browser.wait("document.getElementById('saved').textContent === 'Saved'")
    case = tomllib.loads(server.session.file.read_text())
    assert case == before["case"] | {
        "people": [{**before["case"]["people"][0], "number": 3}, *before["case"]["people"][1:]]
    }
    page.close()


def test_the_building_is_shown_in_3d_in_the_dark(browser, fire, serve):
    page = Page(browser, serve(fire), width=900, height=600, dark=True)
    page.press("view-3d")
    browser.wait("editor.view3d.isBuilt")
    browser.settle()
    picture = np.array(Image.open(io.BytesIO(browser.picture())).convert("RGB"))[60:560, 180:570]
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 30
    assert browser.errors == []
