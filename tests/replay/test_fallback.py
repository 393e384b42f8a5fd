"""Links, pictures and print of the page, and what it shows without JavaScript or WebGL."""

import base64
import io
import re
import time

import numpy as np
from PIL import Image

from evac.replay.motion import GRAIN, MotionPacker
from evac.replay.writer import poster
from evac.trajectory.trajectory import read_trajectory


def image_of(address):
    return np.array(Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))).convert("RGB")).astype(int)


def test_a_picture_has_what_is_shown_with_labels_and_legend(browser, room):
    folder, _ = room
    browser.open(folder / "replay.html")
    browser.run("replay.act.seek(2.0)")
    browser.settle()
    shown = np.array(Image.open(io.BytesIO(browser.picture())).convert("RGB")).astype(int)
    box = browser.run("replay.stage.canvas.getBoundingClientRect().toJSON()")
    x, y, width, height = (round(box[name]) for name in ("x", "y", "width", "height"))
    saved = image_of(browser.saved())
    assert saved.shape[1] == width
    top = browser.run("document.getElementById('tools').offsetHeight") + 20
    part = shown[y + top : y + height - 40, x : x + width]  # without tools and the bar of the scale
    off = np.abs(saved[: len(part)] - part).max(axis=2)
    assert (off > 60).mean() < 0.01  # letters are smoothed in another way
    assert np.ptp(saved[height - top :], axis=(0, 1)).min() > 150  # texts and swatches


def test_print_is_light_and_has_a_picture_for_the_canvas(browser, room):
    folder, _ = room
    browser.open(folder / "replay.html", dark=True)
    browser.run("replay.act.seek(2.0); dispatchEvent(new Event('beforeprint'))")
    printed = image_of(browser.run("document.getElementById('printed').src"))
    assert printed.mean() > 200
    assert browser.run("document.documentElement.dataset.theme") == "light"
    dark = [{"name": "prefers-color-scheme", "value": "dark"}]
    browser.send("Emulation.setEmulatedMedia", {"media": "print", "features": dark})
    parts = "[...document.querySelectorAll('#printed, #answer, #facts, #exits, #view, #tools')]"
    shown = browser.run(f"{parts}.filter((one) => one.checkVisibility()).map(({{ id }}) => id)")
    assert sorted(shown) == ["answer", "exits", "facts", "printed"]
    browser.send("Emulation.setEmulatedMedia", {"media": "", "features": dark})
    browser.run("dispatchEvent(new Event('afterprint'))")
    assert browser.run("document.documentElement.dataset.theme") == "dark"
    pages = base64.b64decode(browser.send("Page.printToPDF", {"preferCSSPageSize": True})["data"])
    assert 1 <= len(re.findall(rb"/Type /Page\b(?!s)", pages)) <= 3


def test_without_javascript_there_are_the_results_and_a_poster(chromium, room):
    folder, results = room
    chromium.open(folder / "replay.html")
    chromium.send("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        chromium.send("Page.reload")
        for _ in range(200):
            time.sleep(0.05)
            if chromium.run("document.readyState === 'complete' && !window.replay"):
                break
        check_plain(chromium, results)
    finally:
        chromium.send("Emulation.setScriptExecutionDisabled", {"value": False})


def test_without_webgl_there_are_the_results_and_a_poster(chromium, room):
    folder, results = room
    chromium.open(folder / "replay.html")
    script = "HTMLCanvasElement.prototype.getContext = () => null"
    number = chromium.send("Page.addScriptToEvaluateOnNewDocument", {"source": script})["identifier"]
    try:
        chromium.send("Page.reload")
        chromium.wait("/WebGL/.test(document.getElementById('loading')?.textContent)")
        check_plain(chromium, results)
    finally:
        chromium.send("Page.removeScriptToEvaluateOnNewDocument", {"identifier": number})


def check_plain(browser, results):
    """The answer, the facts and a picture with everybody are seen, and nothing that needs the rest."""
    assert f"{results.last_out:.2f} s" in browser.text("#answer")
    assert f"{results.last_out:.2f} s" in browser.text("#facts")
    seen = "[...document.querySelectorAll('{}')].filter((one) => one.checkVisibility()).length"
    assert browser.run(seen.format("#poster svg")) == 1
    assert browser.run(seen.format("#view, #tools, aside, footer, button")) == 0
    dots = browser.run("[...document.querySelectorAll('#poster .people')].map((one) => one.getAttribute('d')).join('')")
    assert dots.count("M") == 20


def test_the_poster_has_everybody_where_they_were_first(descent):
    trajectory = read_trajectory(descent(people=6, frames=3).path)
    motion = MotionPacker(6, trajectory.building)
    for k in range(len(trajectory)):
        motion.add(trajectory[k])
    person, level, position = motion.first_state()
    first = trajectory[0]
    assert (person.tolist(), level.tolist()) == (first["person"].tolist(), first["level"].tolist())
    np.testing.assert_allclose(position, first["position"], atol=0.51 * GRAIN)
    picture = poster(motion, trajectory.group)
    assert picture.count("h0") == 6
    assert picture.count('class="exit"') == len(trajectory.building.exits)
