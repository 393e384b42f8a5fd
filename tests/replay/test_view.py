"""The first view: people are seen in it, and no label covers them."""

import io
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import maximum_filter
from shapely import Point, box

import evac
from evac.replay.account import account_of_run
from evac.replay.motion import MotionPacker
from evac.replay.writer import write_page

#: Least change of a part of the colour of a pixel, from 0 to 255, by which somebody is told from what is behind.
TOLD_APART = 25

#: Keeps the sizes of people, so that they can be taken out of the picture for a while.
TAKEN = "kept = [[...replay.record.radius], [...replay.record.height]]"


def house(storeys):
    """A building with two shafts of stairs."""
    plan, width, depth = evac.Plan("house"), 30.0, 16.0
    names = [f"storey {k}" for k in range(storeys)]
    for k, name in enumerate(names):
        plan.storey(name, box(0, 0, width, depth), z=3.2 * k)
    for low, high in pairwise(names):
        west, east = [(5, 6.6), (5, 7.9)], [(width - 5, 8.1), (width - 5, 9.4)]
        plan.stair(f"West {low}", low, west, high, length=2.6, turn="left", direction=(1, 0))
        plan.stair(f"East {low}", low, east, high, length=2.6, turn="left", direction=(-1, 0))
    for k in range(12):
        plan.exit(f"exit {k + 1}", names[0], [(2.0 + 2 * k, 0), (3.0 + 2 * k, 0)])
    return plan.building()


def inside(polygon, random):
    """Return a random point of a polygon."""
    low, high = np.array(polygon.bounds).reshape(2, 2)
    while not polygon.contains(Point(at := random.uniform(low, high))):
        pass
    return at


@pytest.fixture(scope="module", params=[3, 12])
def page(request, room, tmp_path_factory):
    """The page of people who stand on all floors at first, and on the stairs later."""
    building, random = house(request.param), np.random.default_rng(request.param)
    people = 15 * len(building.levels)
    motion = MotionPacker(people, building)
    floors = [one for one in building.levels if one.kind == "floor"]
    stairs = [one for one in building.levels if one.kind != "floor"] or floors
    for time, share in ((0.0, 0.1), (20.0, 0.5), (40.0, 0.9)):
        of = [stairs if person < share * people else floors for person in range(people)]
        levels = [some[int(random.integers(len(some)))] for some in of]
        position = np.array([inside(level.polygon.buffer(-0.2), random) for level in levels])
        rows, level = np.arange(people, dtype=np.int32), np.array([one.index for one in levels], np.int32)
        motion.add(time, rows, level, position, np.zeros((people, 3)), np.ones(people, bool), np.zeros(people))
    everybody = np.zeros(people, np.int32)
    some = account_of_run(room[1])
    moves = replace(
        some.moves, start=everybody, time=np.zeros(0), **dict.fromkeys(("row", "target", "link"), everybody[:0])
    )
    sizes = {
        "group": np.arange(people, dtype=np.int32) % 60,
        "radius": everybody + 0.25,
        "height": everybody + 1.7,
        "moves": moves,
    }
    unknown = dict.fromkeys(("speed", "response_time"))
    account = replace(some, groups=[f"group {k + 1}" for k in range(60)], **sizes, **unknown)
    path = tmp_path_factory.mktemp("view") / "replay.html"
    write_page(path, motion, account, ())
    return path


def picture(browser):
    return np.array(Image.open(io.BytesIO(browser.picture())).convert("RGB")).astype(int)


def heads(browser):
    """Where heads are drawn, and feet, in pixels of the page; by the matrix of the camera alone."""
    matrix, bodies, tall, (left, top, width, height) = browser.run(
        """(() => {
          const { camera, people, record } = replay, box = document.getElementById("view").getBoundingClientRect();
          const { bodies, count } = people, shown = [...people.shown.subarray(0, count)];
          const tall = shown.map((i) => record.height[record.now.person[i]] / 1000);
          return [[...camera.matrix], [...bodies.subarray(0, 4 * count)], tall, [box.x, box.y, box.width, box.height]];
        })()"""
    )
    feet = np.array(bodies).reshape(-1, 4)[:, :3]
    found = []
    for share in (0.93, 0.05):
        lift = np.column_stack([np.zeros((len(feet), 2)), share * np.array(tall)])
        clip = np.column_stack([feet + lift, np.ones(len(feet))]) @ np.array(matrix).reshape(4, 4)
        found.append((clip[:, :2] / clip[:, 3:] * [0.5, -0.5] + 0.5) * [width, height] + [left, top])
    return found


@pytest.mark.parametrize(("width", "height", "dark"), [(1280, 800, False), (390, 800, True)])
def test_people_are_seen_in_the_first_view_and_labels_cover_nobody(browser, page, width, height, dark):
    browser.open(page, width, height, dark)
    for time in (0.0, 20.0, 40.0):
        browser.run(f"replay.act.seek({time})")
        browser.settle()
        image, (head, foot) = picture(browser), heads(browser)
        labels = browser.run(
            """[...document.querySelectorAll("#labels span")].filter(({ style }) => style.visibility === "visible")
                 .map((span) => span.getBoundingClientRect())
                 .map(({ left, top, right, bottom }) => [left, top, right, bottom])"""
        )
        for left, top, right, bottom in labels:
            for place in (head, foot, 0.5 * (head + foot)):
                assert not ((place > [left, top]) & (place < [right, bottom])).all(axis=1).any()
        browser.run(f"{TAKEN}; replay.record.radius.fill(0); replay.record.height.fill(0); replay.act.seek({time})")
        browser.settle()
        empty = picture(browser)
        browser.run("[replay.record.radius, replay.record.height] = kept")
        change = maximum_filter(np.abs(image - empty).max(axis=2), 3)  # a head may be as small as a pixel
        x, y = np.rint(head).astype(int).T
        assert (change[y, x] >= TOLD_APART).mean() >= 0.9


SIZES = [(1280, 800), (390, 844), (844, 390)]


@pytest.mark.parametrize("view", ["3d", "section"])
@pytest.mark.parametrize(("width", "height"), SIZES)
def test_the_building_is_in_the_picture_and_names_of_storeys_are_at_their_heights(browser, page, width, height, view):
    browser.show(page, width, height)
    browser.run(f"replay.act.view('{view}'); replay.act.seek(20)")
    browser.settle()
    corners = np.array(browser.run("replay.layout.corners().map((corner) => replay.camera.project(corner))"))
    assert np.abs(corners[:, :2]).max() <= 1.0
    free = browser.run("1 - 2 * document.getElementById('tools').offsetHeight / replay.stage.canvas.clientHeight")
    assert corners[:, 1].max() < free
    rows = browser.run(
        """(() => {
          const { layout, camera } = replay, { levels } = layout.building, view = document.getElementById("view");
          const top = view.getBoundingClientRect().top;
          return [...document.querySelectorAll("#labels .storey")].filter(({ style }) => style.visibility === "visible")
            .map((span) => {
              const storey = layout.storeys.findIndex(({ name }) => name === span.textContent);
              const level = levels.findIndex((one) => one.kind === "floor" && one.storey === storey);
              const [x1, y1, x2, y2] = layout.boxes[level], box = span.getBoundingClientRect();
              const at = [[x1, y1], [x2, y1], [x1, y2], [x2, y2]].map(([x, y]) => camera.project(
                layout.place(level, x, y, layout.storeys[storey].z)));
              const ys = at.map(([, y]) => top + (1 - y) / 2 * view.clientHeight);
              return [storey, Math.min(...ys), (box.top + box.bottom) / 2, Math.max(...ys)];
            });
        })()"""
    )
    named, low, middle, high = np.array(rows).T
    storeys = browser.run("replay.layout.storeys.length")
    every = named[1]  # The names of a high building do not fit above each other on a phone that lies on its side.
    assert named.tolist() == list(range(0, storeys, int(every)))
    assert every == 1 or height < 400
    assert (low - 1 <= middle).all()
    assert (middle <= high + 1).all()


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (1920, 1080)])
def test_tools_are_in_one_row_and_the_clock_is_in_sight(browser, page, width, height):
    browser.show(page, width, height)
    boxes = browser.run("[...document.getElementById('tools').children].map((one) => one.getBoundingClientRect().top)")
    assert len(set(boxes)) <= 2  # those of a storey alone are hidden, at the top
    assert browser.run("document.getElementById('time').getBoundingClientRect().bottom") < height


def test_buttons_stand_beside_a_long_title_where_the_page_is_low(browser, page):
    browser.show(page, 844, 390)
    browser.run("kept = document.getElementById('title').innerText; title.textContent = kept.repeat(3)")
    bottom, top = browser.run("[title.getBoundingClientRect().bottom, theme.getBoundingClientRect().top]")
    browser.run("title.textContent = kept")
    assert top < bottom


def test_every_storey_is_named_in_plan_and_section(browser, page):
    browser.show(page)
    for view in ("plan", "section"):
        browser.run(f"replay.act.view('{view}')")
        browser.settle()
        shown = browser.run("replay.labels.shown.map(({ span }) => span.className)")
        assert shown.count("storey") == browser.run("replay.layout.storeys.length")


def test_labels_away_from_what_they_name_have_a_line_to_it(browser, page):
    browser.show(page)
    browser.run("replay.act.seek(20); replay.act.select(7)")
    browser.settle()
    drawn, at = browser.run(
        """(() => {
          const { people, camera, record, labels } = replay, { width, height } = labels.cells, k = people.marked;
          const [x, y, z] = people.bodies.subarray(4 * k, 4 * k + 3);
          const [px, py] = camera.project([x, y, z + record.height[7] / 1000]);
          return [labels.shown.map(({ span, box, line }) => [span.className, span.innerText, box, line]),
                  [(px + 1) / 2 * width, (1 - py) / 2 * height]];
        })()"""
    )
    lines = {text: line for _, text, _, line in drawn}
    np.testing.assert_allclose(lines["Person 7"][2:], at, atol=0.5)
    for kind, text, (left, top, right, bottom, x, y), line in drawn:
        off = np.hypot(x - np.clip(x, left, right), y - np.clip(y, top, bottom))
        assert kind == "storey" or (np.hypot(line[2] - line[0], line[3] - line[1]) > 0) == (off > 12), text


def test_what_scrolls_can_be_reached_with_keys_and_the_page_has_a_title(browser, page):
    browser.show(page, 390, 800)
    unreachable = browser.run(
        """[...document.querySelectorAll("body *")].filter((one) => one.scrollHeight > one.clientHeight + 1
             && one.clientHeight && /auto|scroll/.test(getComputedStyle(one).overflowY)
             && one.tabIndex < 0 && !one.querySelector("button, select, input, [tabindex]")).map(({ id }) => id)"""
    )
    assert unreachable == []
    assert browser.run("document.title")
    assert browser.text("h1") == browser.run("document.title")


def test_the_section_has_storeys_as_bars_and_stairs_unfolded_beside_them(browser, page):
    browser.show(page)
    browser.run("replay.act.view('section'); replay.act.seek(40)")
    browser.settle()
    shown = browser.run(
        """(() => { const { people, record: { now, building: { levels } } } = replay;
             return [...people.shown.subarray(0, people.count)].map((i, k) => {
               const { kind, storey } = levels[now.level[i]];
               return [people.bodies[4 * k], people.bodies[4 * k + 1], now.z[i], storey, kind === "floor" ? 1 : 0];
             }); })()"""
    )
    x, y, z, storey, on_floor = np.array(shown).T
    bars = [y[(storey == k) & (on_floor == 1)] for k in np.unique(storey[on_floor == 1])]
    assert all(low.max() < high.min() for low, high in pairwise(bars))
    stairs = on_floor == 0
    assert x[stairs].min() > x[~stairs].max()
    rise = np.polyfit(z[stairs], y[stairs], 1)
    assert rise[0] > 0.5
    assert np.abs(np.polyval(rise, z[stairs]) - y[stairs]).max() < 1.0  # half the width of a stair, and its landing


def test_60_groups_and_12_exits_are_told_apart_and_in_the_order_of_numbers(browser, page):
    browser.show(page)
    legend = "[...document.querySelectorAll('#legend button')]"
    assert browser.run(f"{legend}.map(({{ innerText }}) => innerText)") == [f"group {k + 1}" for k in range(60)]
    swatches = browser.run(f"{legend}.map((one) => one.querySelector('.swatch').style.background)")
    assert len(set(swatches)) == 60
    drawn = browser.run(
        """Array.from({ length: 60 }, (_, k) => {
             const { people } = replay;
             return [people.words[k] & 0xffffff, Math.floor(people.bodies[4 * k + 3] / 10)].join();
           })"""
    )
    shown = browser.run("Array.from({ length: 60 }, (_, k) => replay.record.now.person[replay.people.shown[k]] % 60)")
    assert len(set(drawn)) == len(set(shown)) > 20
    rows = "[...document.querySelectorAll('#exits tbody tr')]"
    assert browser.run(f"{rows}.map(({{ cells }}) => cells[0].innerText)") == [f"exit {k + 1}" for k in range(12)]
    lines = browser.run(f"{rows}.map((row) => row.querySelector('line').getAttribute('style'))")
    curves = browser.run(
        "[...document.querySelectorAll('#chart .curve:not(.total)')].map((one) => one.getAttribute('style'))"
    )
    assert len(set(lines)) == 12
    assert curves == lines


def test_ticks_of_the_chart_reach_over_the_whole_range(browser, page):
    browser.show(page)
    at = browser.run(
        "[...document.querySelectorAll('#chart .at')].map((text) => [Number(text.getAttribute('x')), text.textContent])"
    )
    left, right = browser.run("[replay.record.begin, replay.record.end].map((time) => replay.chart.x(time))")
    assert at[0] == [left, "0"]
    assert at[-1] == [right, "40 s"]
    assert max(second - first for (first, _), (second, _) in pairwise(at)) < 0.4 * (right - left)
