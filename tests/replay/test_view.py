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
from evac.replay.motion import MotionPacker
from evac.replay.writer import account_of_run, replay_trajectory, write_page
from evac.trajectory.trajectory import read_trajectory

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


@pytest.fixture(scope="module", params=[12])
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
        frame = {"time": time, "person": np.arange(people, dtype=np.int32), "position": position}
        frame["level"] = np.array([one.index for one in levels], np.int32)
        still = {"velocity": np.zeros((people, 3)), "speed": np.zeros(people), "contact_force": np.zeros(people)}
        motion.add(frame | still | {"started": np.ones(people, bool)})
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


def test_the_first_view_lies_as_the_plan_and_names_every_exit(browser, page):
    browser.show(page)
    browser.run("replay.act.seek(40)")
    browser.settle()
    assert browser.run("replay.camera.right[0]") > 0.3
    shown = (
        "[...document.querySelectorAll('#labels .exit')].filter(({ style }) => style.visibility === 'visible').length"
    )
    assert browser.run(f"[{shown}, replay.record.building.exits.length]") == [12, 12]


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


def test_the_section_shows_a_car_and_its_riders_on_their_way(browser, tmp_path):
    plan = evac.Plan()
    for k in range(3):
        plan.storey(f"s{k}", box(0, 0, 10, 6), z=4.0 * k)
    plan.exit("door", "s0", [(0, 2), (0, 4)])
    plan.lift("lift", ["s0", "s1", "s2"], box(10.2, 2.2, 11.6, 3.8), [(10.2, 2.55), (10.2, 3.45)])
    people = [{"name": "one", "positions": [[9.0, 3.0]], "level": "s2", "lifts": "preferred"}]
    case = {"building": plan, "people": people, "contact": {"model": "nsm2"}, "behaviours": {"walking": {}}}
    quiet = {"output.every": 0.2, "output.picture": False, "output.animation": False}
    evac.run(evac.load(case, quiet), tmp_path / "r", progress=False)
    trajectory = read_trajectory(tmp_path / "r" / "trajectory.evac")
    replay_trajectory(trajectory, tmp_path / "replay.html")
    z = trajectory.z[:, 0]
    browser.show(tmp_path / "replay.html")
    browser.run("replay.act.view('section')")
    seen = []
    for height in (6.0, 5.0, 3.0, 2.0):
        browser.run(f"replay.act.seek({trajectory.time[np.nanargmin(np.abs(z - height))]})")
        browser.settle()
        seen.append(browser.run("[replay.record.now.z[0], replay.people.bodies[1]]"))
    z, y = np.array(seen).T
    rise = np.polyfit(z, y, 1)
    assert rise[0] >= 0.8  # storeys are 3.2 m apart in the picture at least
    np.testing.assert_allclose(np.polyval(rise, z), y, atol=0.01)
