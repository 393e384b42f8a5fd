"""The film of the page on drawing: an office of two storeys is drawn and run, step by step, and then a tower.

`python tests/editor/film.py docs/images/edit.webp` does the steps of docs/edit.md in a browser and tells their number.
"""

import io
import os
import sys
import tempfile
import threading
from pathlib import Path

from matplotlib import get_data_path
from PIL import Image, ImageDraw, ImageFont

sys.path.insert(0, str(Path(__file__).parents[2]))

from evac.editor import Server
from tests.editor.test_page import CONTROL, SHIFT, Page
from tests.replay.browser import Browser, find_chromium

SIZE = (1200, 760)
SMALL = (900, 570)
SHORT, LONG = 200, 900  # [ms]
ROOM, DEEP, WIDE = 5.4, 6.5, 2.0  # Rooms, their depth and the corridor [m].
SEEN = 8  # Pictures of a replay.


class Film:
    """Pictures of a page with what was done, and the number of actions."""

    def __init__(self, page: Page) -> None:
        self.page, self.at, self.actions = page, (0, 0), 0
        self.pictures: list[Image.Image] = []
        self.times: list[int] = []
        self.font = ImageFont.truetype(f"{get_data_path()}/fonts/ttf/DejaVuSans.ttf", 20)

    def show(self, words: str, actions: int = 1, time: int = SHORT) -> None:
        """Take a picture after some actions."""
        self.actions += actions
        picture = Image.open(io.BytesIO(self.page.browser.picture())).convert("RGB")
        pen = ImageDraw.Draw(picture)
        x, y = self.at
        pen.ellipse((x - 7, y - 7, x + 7, y + 7), outline="#c2185b", width=3)
        left = (SIZE[0] - pen.textlength(words, self.font)) / 2
        pen.rounded_rectangle((left - 16, SIZE[1] - 84, SIZE[0] - left + 16, SIZE[1] - 46), 8, fill="#17212b")
        pen.text((left, SIZE[1] - 78), words, "white", self.font)
        self.pictures.append(picture.resize(SMALL, Image.Resampling.LANCZOS))
        self.times.append(time)

    def click(self, point, words, modifiers=0, time=SHORT):
        self.page.click(point, modifiers=modifiers)
        self.at = self.page.spot(*point)
        self.show(words, time=time)

    def drag(self, start, end, words):
        self.page.drag(start, end)
        self.at = self.page.spot(*end)
        self.show(words)

    def key(self, key, words, modifiers=0, time=SHORT):
        self.page.keys(key, modifiers=modifiers)
        self.show(words, time=time)

    def press(self, selector, words, time=SHORT):
        left, top = self.page.run(
            f"(() => {{ const one = document.querySelector({selector!r}); one.scrollIntoView({{ block: 'nearest' }}); "
            "const box = one.getBoundingClientRect(); return [box.left + box.width / 2, box.top + box.height / 2]; })()"
        )
        self.at = left, top
        self.page.browser.click(left, top)
        self.show(words, time=time)

    def type(self, label, value, words):
        self.page.type(label, value)
        self.page.browser.settle()
        self.show(words)

    def write(self, file: Path) -> None:
        first, *others = self.pictures
        first.save(
            file, save_all=True, append_images=others, duration=self.times, quality=55, method=6, minimize_size=True
        )


class Start(Page):
    """A page that asks what to begin with."""

    def open(self, address):
        self.browser.send("Page.navigate", {"url": address})
        self.browser.wait("document.getElementById('begin').open")


def begin(film: Film) -> None:
    """Name a new building."""
    page = film.page
    page.run("document.getElementById('begin-folder').value = 'office'")
    film.show("name the folder of a new building", time=LONG)
    page.run("document.getElementById('begin-button').click()")
    page.browser.wait("document.getElementById('verdict').dataset.revision", 120)
    film.show("Begin")


def office(film: Film) -> None:
    """Draw the office: ten rooms along a corridor, on two storeys, with two stairs and three exits."""
    page, north, stairs = film.page, WIDE + DEEP, 5 * ROOM
    film.key("r", "R: the tool Room")
    film.click((0, 0), "click on a corner of the corridor")
    page.browser.mouse("mouseMoved", *page.spot(4, 1))
    page.keys(*"30x2")
    film.show("type 30x2", time=LONG)
    film.key("Enter", "Enter: a room of 30 by 2 m")
    film.type("Name", "corridor", "name it")
    film.drag((0, WIDE), (3, north), "drag a room for a stair")
    for k in range(5):
        film.drag((3 + k * ROOM, WIDE), (3 + (k + 1) * ROOM, north), "drag rooms: their sizes are told")
    for k in range(5):
        film.drag((k * ROOM, 0), ((k + 1) * ROOM, -DEEP), "drag rooms: their sizes are told")
    film.drag((stairs, 0), (30, -DEEP), "drag a room for a stair")
    film.key("d", "D: the tool Door")
    for at in [(1.5, WIDE), *((3 + (k + 0.5) * ROOM, WIDE) for k in range(5))]:
        film.click(at, "click on walls")
    for at in [*(((k + 0.5) * ROOM, 0) for k in range(5)), (28.5, 0)]:
        film.click(at, "click on walls")
    film.key("v", "V: select")
    film.click((6, 4), "a room")
    film.key("a", "Ctrl+A: all rooms", CONTROL)
    for at in [(4, 1), (1.5, 4), (28.5, -4)]:
        film.click(at, "Shift+click: not the corridor and the stairs", SHIFT)
    film.type("Use", "office", "the use of all ten")
    film.key("s", "S: a stair needs a storey above", time=LONG)
    film.press("#hint button", "Copy this storey up")
    for foot, to in [((0.8, 3.6), (0.8, 7)), ((28.2, -1.6), (28.2, -5))]:
        film.click(foot, "click on the middle of the lowest step")
        page.browser.mouse("mouseMoved", *page.spot(*to))
        film.click(to, "then on where it leads: a U-shaped stair fits", time=LONG)
    film.key("e", "E: the tool Exit")
    for at in [(0, 1), (30, 1), (30, -0.8)]:
        film.click(at, "click on outer walls")
    people(film)


def people(film: Film) -> None:
    """Choose the people of the office."""
    film.press("#people button", "the group at the left")
    film.type("Number", "250", "250 people")
    film.type("Level", "", "on all storeys")
    film.type("Use", "office", "in rooms with this use")


def tower(film: Film) -> None:
    """Draw a tower of eight storeys from the office, with 1,000 people."""
    film.press("#storeys li:last-child button", "for a tower: the upper storey")
    film.page.run("document.getElementById('copies').value = 6")
    film.show("6 copies on top")
    film.press("#copy button", "Copy this storey up: its stairs go on", LONG)
    film.key("3", "3: in 3D", time=LONG)
    film.press("#people button", "the group at the left")
    film.type("Number", "1000", "1,000 people")


def run(film: Film, people: int) -> None:
    """Run what was drawn, and look at its replay."""
    page, said = film.page, "document.getElementById('run-text').textContent"
    page.judged()
    film.press("#run", "Run", LONG)
    page.browser.wait(f"parseInt({said}) > {people // 6} || document.getElementById('run').textContent === 'Run'", 300)
    film.show("people move while it computes", 0, LONG)
    page.browser.wait("document.getElementById('run-box').dataset.phase === 'ended'", 600)
    film.show("the answer, and the replay", 0, LONG)
    page.browser.send("Page.navigate", {"url": f"{page.server.address}result/replay.html"})
    page.browser.wait("window.replay", 60)
    film.at = (-20, -20)
    film.show("Replay", 2, LONG)
    for k in range(1, SEEN):
        page.run(f"replay.act.seek(replay.record.end * {k / SEEN})")
        page.browser.settle()
        film.show("Replay", 0, 400)


def main(file: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        browser = Browser(find_chromium(), Path(folder))
        with Server(None) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            film = Film(Start(browser, server, *SIZE))
            begin(film)
            office(film)
            run(film, 250)
            print("office:", film.actions, "actions")
            film.actions = 0
            Page.open(film.page, server.address)
            tower(film)
            run(film, 1000)
            print("tower:", film.actions, "actions")
            server.shutdown()
        browser.close()
    film.write(file)
    print(f"{sum(film.times) / 1000:.0f} s, {file.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
