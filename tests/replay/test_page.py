"""The page in a real browser: what it draws, says and does."""

import io
import json
import re

import numpy as np
import pytest
from PIL import Image
from shapely import box

import evac
from evac.analysis.maps import QUANTITIES, level_maps
from evac.pictures.palette import NOTHING, group_colours
from evac.replay.motion import GRAIN
from evac.replay.writer import replay_trajectory
from evac.trajectory.trajectory import read_trajectory


def pixels(browser):
    return np.array(Image.open(io.BytesIO(browser.picture())).convert("RGB")).astype(int)


def place_of(browser, person):
    """Where somebody's figure is drawn, a little above the middle of the body, in pixels of the page."""
    found = browser.run(
        f"""(() => {{
          const {{ people, record, camera }} = replay, box = document.getElementById("view").getBoundingClientRect();
          const k = [...people.shown.subarray(0, people.count)].findIndex((i) => record.now.person[i] === {person});
          const [x, y, z] = people.bodies.subarray(4 * k, 4 * k + 3);
          const at = camera.project([x, y, z + 0.75]);
          return [box.left + (at[0] + 1) / 2 * box.width, box.top + (1 - at[1]) / 2 * box.height];
        }})()"""
    )
    return found


def hue_of(colour):
    """Direction of a colour off grey."""
    off = np.array(colour, float) - np.mean(colour)
    return off / max(np.linalg.norm(off), 1e-9)


def test_people_are_where_and_when_they_were(browser, storeys):
    page, trajectory = storeys
    browser.open(page)
    for k in range(len(trajectory)):
        frame = trajectory[k]
        found = browser.run(
            f"""(() => {{
              const {{ motion, origin }} = replay.record, [a, b] = motion.first.subarray({k}, {k} + 2);
              const part = (name) => Array.from(motion[name].subarray(a, b));
              return {{ time: motion.times[{k}], origin, person: part("person"), level: part("level"),
                        x: part("x"), y: part("y"), z: part("z"),
                        speed: part("speed"), force: part("force") }};
            }})()"""
        )
        assert found["time"] == frame["time"]
        assert found["person"] == frame["person"].tolist()
        assert found["level"] == frame["level"].tolist()
        position = np.column_stack([found["x"], found["y"]]) + found["origin"]
        np.testing.assert_allclose(position, frame["position"], atol=0.51 * GRAIN)
        np.testing.assert_allclose(found["z"], frame["z"], atol=1.1 * GRAIN)
        np.testing.assert_allclose(found["speed"], frame["speed"], atol=0.0051)
        assert found["force"] == [float(f"{force:.2g}") for force in frame["contact_force"]]  # the same in all frames


def test_exits_that_are_closed_or_only_let_in_are_marked(browser, tmp_path):
    plan = evac.Plan()
    plan.storey("hall", box(0, 0, 6, 4))
    plan.exit("front", "hall", [(0, 1), (0, 3)])
    plan.exit("back", "hall", [(6, 1), (6, 3)])
    plan.exit("side", "hall", [(2, 4), (4, 4)])
    people = [{"name": "people", "level": "hall", "number": 2}]
    case = {"building": {"plan": plan, "closed": ["back"]}, "people": people, "contact": {"model": "nsm2"}}
    case["event"] = [{"time": 0.0, "kind": "one_way", "target": "side", "value": "in"}]
    results = evac.run(evac.load(case, {"simulation.duration": 1.0}), tmp_path / "result")
    notes = {"front": "", "back": " (closed)", "side": " (entrance only)"}
    names = {way.name: way.name + notes[way.name] for way in results.building.exits}
    assert {way.name: results.building.label_of(way) for way in results.building.exits} == names
    assert {line.partition(":")[0].replace("'", "") for line in results.answer.exits} == {
        f"Exit {name}" for name in names.values()
    }
    browser.open(tmp_path / "result" / "replay.html")
    told = "getComputedStyle(row.cells[0], '::after').content.replaceAll('\"', '')"
    rows = browser.run(f"[...document.querySelectorAll('#exits tbody tr')].map((row) => [row.innerText, {told}])")
    assert {name.split()[0]: mark.replace("none", "") for name, mark in rows} == notes
    labels = browser.run("[...document.querySelectorAll('#labels span')].map((span) => span.textContent)")
    assert set(names.values()) <= set(labels)


def test_people_are_drawn_in_the_colour_of_their_group_at_their_place(browser, storeys):
    page, trajectory = storeys
    browser.open(page)
    browser.run("replay.act.view('plan'); replay.act.storey(2)")
    image = pixels(browser)
    x, y = (round(value) for value in place_of(browser, 3))
    colour = group_colours(2)[trajectory.group[3]]
    assert hue_of(image[y, x]) @ hue_of([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) > 0.9
    # Nobody stands in the middle of the floor: it has one colour.
    corner = browser.run(
        """(() => { const box = document.getElementById("view").getBoundingClientRect();
             const [x, y] = replay.record.origin;
             const at = replay.camera.project(replay.layout.place(4, 6.0 - x, 4.0 - y, 6.0));
             return [box.left + (at[0] + 1) / 2 * box.width, box.top + (1 - at[1]) / 2 * box.height]; })()"""
    )
    x, y = (round(value) for value in corner)
    assert np.ptp(image[y - 3 : y + 3, x - 3 : x + 3].reshape(-1, 3), axis=0).max() <= 2


def test_keys_play_and_pause_and_step(browser, room):
    folder, results = room
    browser.show(folder / "replay.html")
    browser.press(" ", "Space")
    browser.wait("replay.state.time > 0.05")
    assert browser.run("document.getElementById('play').getAttribute('aria-label')") == "Pause"
    browser.press(" ", "Space")
    assert browser.run("document.getElementById('play').getAttribute('aria-label')") == "Play"
    before = browser.run("replay.state.time")
    browser.settle()
    assert browser.run("replay.state.time") == before
    browser.press("Home", "Home")
    browser.press("ArrowRight", "ArrowRight")
    assert browser.run("replay.state.time") == 0.5
    browser.press("End", "End")
    assert browser.run("Number(document.getElementById('slider').value)") == pytest.approx(results.time)
    browser.press("]", "BracketRight")
    assert browser.run("document.getElementById('speed').value") == "2"
    browser.press("?", "Slash")
    assert browser.run("document.getElementById('help').open")
    browser.press("Escape", "Escape")
    assert not browser.run("document.getElementById('help').open")


def test_a_click_tells_who_somebody_is(browser, room):
    folder, results = room
    browser.show(folder / "replay.html")
    person = int(np.argmax(results.crowd.exit_time))
    browser.run("replay.act.view('plan'); replay.act.seek(1.0)")
    browser.settle()
    browser.click(*place_of(browser, person))
    assert browser.text("#person-name") == f"Person {person}"
    facts = browser.text("#person-facts")
    for word in ("people", "room", f"{results.crowd.exit_time[person]:.2f} s", "door", "m/s"):
        assert word in facts
    browser.press("Escape", "Escape")
    assert browser.run("document.getElementById('person').hidden")


def test_somebody_is_found_and_followed(browser, room):
    folder, _ = room
    browser.show(folder / "replay.html")
    browser.run("document.getElementById('find').focus()")
    for key in "17":
        browser.press(key, f"Digit{key}", key)
    browser.press("Enter", "Enter", "\r")
    assert browser.text("#person-name") == "Person 17"
    browser.run("replay.act.find('peop'); replay.act.find('peop')")
    assert browser.run("replay.state.selected") == 19
    browser.run("replay.act.find('99')")
    assert "0 to 19" in browser.text("#found")
    browser.run("document.getElementById('find').blur()")
    browser.press("g", "KeyG")
    places = []
    for time in (1.0, 3.0):
        browser.run(f"replay.act.seek({time})")
        browser.settle()
        x, y = place_of(browser, 19)
        box = browser.run(
            "(({ x, y, width, height }) => [x, y, width, height])(replay.stage.canvas.getBoundingClientRect())"
        )
        assert np.hypot(x - box[0] - box[2] / 2, y - box[1] - box[3] / 2) < 0.15 * box[3]
        places.append(browser.run("replay.camera.target"))
    assert np.hypot(*np.subtract(*places)[:2]) > 0.1
    browser.press("Escape", "Escape")
    assert not browser.run("replay.state.isFollowed")


@pytest.mark.parametrize("quantity", ["density", "contact force"])
def test_colours_follow_the_quantity(browser, room, quantity):
    folder, _ = room
    browser.show(folder / "replay.html")
    browser.run(f"replay.act.seek(4.0); replay.act.colour({json.dumps(quantity)})")
    browser.settle()
    assert browser.text("#legend").startswith("10\n" if quantity == "contact force" else "0\n")
    values = browser.run(
        f"""Array.from({{ length: replay.people.count }},
             (_, k) => replay.people.valueOf({json.dumps(quantity)}, replay.record.now, k))"""
    )
    assert max(values) > min(values) >= 0.0
    colours = browser.run("Array.from(replay.people.words.subarray(0, replay.people.count), (word) => word & 0xffffff)")
    assert len(set(colours)) > 1
    if quantity != "contact force":
        return
    is_none = [colour == int("".join(reversed(re.findall("..", NOTHING[1:]))), 16) for colour in colours]
    assert is_none == [value < 10.0 for value in values]
    assert 0 < sum(is_none) < len(values)
    assert "10 N" in browser.text("#legend .below")


def show_map(browser, name):
    """Choose a map of the floors and wait until it is there."""
    browser.run(f"replay.act.layer({json.dumps(name)})")
    browser.wait("replay.state.isLayered")
    browser.settle()


def test_maps_of_the_run_are_those_of_evac_map(browser, room):
    folder, _ = room
    trajectory = read_trajectory(folder)
    (maps,) = level_maps(trajectory).values()
    browser.show(folder / "replay.html")
    show_map(browser, "mean density")
    for name, quantity in QUANTITIES.items():
        ny, nx, *values = browser.run(
            f"""(() => {{ const {{ density, maps }} = replay, {{ x, y, nx, ny }} = density.grids[0], found = [ny, nx];
                  for (let j = 0; j < ny; j++) for (let i = 0; i < nx; i++) {{
                    const k = (y + j) * density.width + x + i, value = maps.values[{json.dumps(quantity.label)}][k];
                    found.push(!density.inside[k] ? -1 : value === Infinity ? 1e9 : value);
                  }}
                  return found; }})()"""
        )
        expected = np.where(np.isinf(maps.array(name)), 1e9, np.where(np.isnan(maps.density), -1.0, maps.array(name)))
        found = np.array(values).reshape(ny, nx)
        assert found.shape == expected.shape
        # Speeds and forces of the page are rounded, positions to centimetres.
        step = {"speed": 0.01, "flow": 0.02, "contact_pressure": 0.05, "usage": 1e-9}.get(name, 1e-5)
        off = np.abs(found - np.nan_to_num(expected)) / np.nanmax(expected[expected < 1e9])
        assert np.quantile(off, 0.98) <= step, name


@pytest.mark.parametrize("name", ["density now", "time to clear"])
def test_a_map_is_drawn_on_the_floor_with_its_scale(browser, room, name):
    folder, _ = room
    browser.show(folder / "replay.html")
    browser.run("replay.act.view('plan'); replay.act.seek(3.0)")
    browser.settle()
    before, saved = pixels(browser), browser.saved()
    show_map(browser, name)
    assert (np.abs(pixels(browser) - before).max(axis=2) > 40).sum() > 2000
    assert name.split()[0] in browser.text("#layer-legend").lower()
    assert browser.saved() != saved
    browser.run("replay.act.layer('plain')")
    browser.settle()
    assert browser.saved() == saved


#: Colours of texts and of graphics, by what they are on.
TEXTS = {
    "panel": ("text", "soft", "exit", "accent", "error", "notice", "mark-text"),
    "ground": ("soft",),
    "accent": ("accent-text",),
    "error-ground": ("error",),
    "notice-ground": ("notice",),
}
GRAPHICS = {
    "panel": ("edge", "mark", *(f"line-{k}" for k in range(1, 7))),
    "ground": ("wall-top",),
    "floor": ("wall-top", "mark", "text"),
}


def test_texts_and_graphics_have_contrast_in_both_themes(browser, room):
    folder, _ = room
    browser.show(folder / "replay.html")
    for _ in range(2):
        for grounds, least in ((TEXTS, 4.5), (GRAPHICS, 3.0)):
            for ground, names in grounds.items():
                for name in names:
                    assert contrast(style_colour(browser, name), style_colour(browser, ground)) >= least, (name, ground)
        browser.press("t", "KeyT")


def style_colour(browser, name):
    colour = browser.run(f"getComputedStyle(document.documentElement).getPropertyValue('--{name}').trim()")
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255


def contrast(*colours):
    """Ratio of the luminances of two colours, as in WCAG 2.1."""
    parts = [np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4) for colour in colours]
    low, high = sorted(float(part @ [0.2126, 0.7152, 0.0722]) for part in parts)
    return (high + 0.05) / (low + 0.05)


def test_every_control_has_a_name_and_can_be_reached(browser, room):
    folder, _ = room
    browser.show(folder / "replay.html")
    tree = browser.send("Accessibility.getFullAXTree")["nodes"]
    controls = [node for node in tree if node.get("role", {}).get("value") in ("button", "slider", "combobox")]
    assert len(controls) >= 10
    assert [node for node in controls if not node.get("name", {}).get("value")] == []


def test_a_run_that_was_killed_says_so(browser, room, tmp_path):
    folder, _ = room
    (tmp_path / "trajectory.evac").write_bytes((folder / "trajectory.evac").read_bytes()[:-700])
    trajectory = read_trajectory(tmp_path)
    assert replay_trajectory(trajectory, tmp_path / "replay.html") == len(trajectory)
    browser.open(tmp_path / "replay.html")
    assert "killed" in browser.text("#banner")
    browser.run("replay.act.seek(Infinity)")
    browser.settle()
    last = trajectory[-1]
    assert browser.text("#inside") == str(len(last["person"]))
    assert browser.text("#outside") == str(20 - len(last["person"]))


def test_paths_are_those_of_everybody_or_of_the_group_that_is_shown(browser, storeys):
    page, trajectory = storeys
    browser.show(page)
    browser.run("replay.act.paths()")
    browser.settle()
    drawn = "replay.stage.meshes.paths.count"
    everybody = browser.run(drawn)
    groups = sorted(set(trajectory.group.tolist()))
    parts = []
    for index in range(len(groups)):
        browser.run(f"document.querySelectorAll('#legend button')[{index}].click()")
        browser.settle()
        parts.append(browser.run(drawn))
    assert sum(parts) == everybody > 0
    browser.press("h", "KeyH")
    assert browser.run(drawn) == 0


def test_a_video_is_saved_from_the_time_that_is_shown_to_the_end(browser, storeys):
    page, _ = storeys
    browser.open(page)
    browser.run(
        """URL.createObjectURL = (blob) => { window.film = blob; return ""; };
           HTMLAnchorElement.prototype.click = function () { window.named = this.download; };
           replay.act.seek(replay.record.end - 1); document.getElementById("save-film").click()"""
    )
    browser.wait("window.named")
    start = browser.run("film.slice(0, 12).arrayBuffer().then((bytes) => [...new Uint8Array(bytes)])")
    is_film = {"mp4": bytes(start[4:8]) == b"ftyp", "webm": bytes(start[:4]) == b"\x1a\x45\xdf\xa3"}
    assert is_film[browser.run("named").removeprefix("replay.")]
    assert browser.run("[replay.state.time === replay.record.end, replay.state.isPlaying]") == [True, False]
    browser.page = None
