"""Pictures and films, in three dimensions and in plan."""

import importlib.util
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from PIL import Image

from evac.base.errors import ResultError
from evac.building.model.building import Place
from evac.building.model.links import close_links
from evac.pictures import palette
from evac.pictures.floorplan import plan_view
from evac.pictures.model3d import MARGIN, view_of
from evac.pictures.palette import COLOURINGS, colouring
from evac.pictures.render import HIDDEN, Renderer, draw_people, render_animation, render_picture
from evac.pictures.view import Camera, aim
from evac.trajectory.trajectory import TrajectoryWriter, building_to_json, read_trajectory
from tests.three_storeys import crowd_at

SIZE = (320, 240)
EVEN, ODD = (np.array(colour) for colour in palette.rgb(palette.GROUPS[:2]))


@pytest.fixture
def trajectory(descent):
    return read_trajectory(descent(people=6, frames=5).path)


def share_of_hue(pixels, colour):
    """Share of pixels whose colour is `colour`, brighter or darker."""
    pixels = pixels.reshape(-1, 3).astype(float)
    norm = np.linalg.norm(pixels, axis=1) * np.linalg.norm(colour)
    return float(((pixels @ colour) > 0.998 * norm).mean())


@pytest.mark.parametrize("view", ["3d", "plan"])
def test_picture_shows_floors_and_the_people_of_both_groups(trajectory, tmp_path, view):
    render_picture(Renderer(trajectory, (640, 480), view), tmp_path / "run.png")
    pixels = np.asarray(Image.open(tmp_path / "run.png"))
    assert pixels.shape[2] == 3
    assert 640 in pixels.shape or 480 in pixels.shape
    assert 0.2 < (pixels == 255).all(axis=2).mean() < 0.95
    beside_the_legend = pixels[:, :500]
    assert share_of_hue(beside_the_legend, EVEN) > 3e-4
    assert share_of_hue(beside_the_legend, ODD) > 3e-4


def test_picture_is_of_the_asked_time(trajectory, tmp_path):
    renderer = Renderer(trajectory, SIZE, "plan")
    for name, time in (("early", 0.0), ("near", 0.2), ("late", 2.0)):
        render_picture(renderer, tmp_path / f"{name}.png", time=time)
    early, near, late = (np.asarray(Image.open(tmp_path / f"{name}.png")) for name in ("early", "near", "late"))
    np.testing.assert_array_equal(early, near)
    assert (early != late).any(axis=2).mean() > 1e-3


@pytest.mark.parametrize("name", [name for name in COLOURINGS if name != "group"])
def test_a_quantity_colours_the_people(trajectory, name):
    image = Renderer(trajectory, (640, 480), "plan", colour_by=name).image(2)
    assert share_of_hue(image, ODD) < 1e-4
    found = colouring(trajectory, name)
    frame = trajectory[2]
    shares = {"speed": frame["speed"] / 2.0, "contact_force": np.log10(np.maximum(frame["contact_force"], 10) / 10) / 3}
    if name in shares:
        colours = np.round(255 * palette.ramp_of(found.scale.colours))
        expected = colours[np.clip(255 * shares[name] + 1e-9, 0, 255).astype(int)]
        if name == "contact_force":
            expected[frame["contact_force"] < 10] = palette.rgb([palette.NOTHING])[0]
        np.testing.assert_array_equal(found.of(frame), np.repeat(expected[:, None], 3, axis=1))


def test_waiting_counts_the_time_at_which_people_stood(written):
    stands, walks = [[1.0, 1.0]] * 5, [[2.0 + k, 3.0] for k in range(5)]
    trajectory = written(np.stack([stands, walks], axis=1), interval=2.0)
    waiting = colouring(trajectory, "waiting")
    assert waiting.top == 8.0
    scale = np.round(255 * palette.ramp_of("waiting time"))
    for k in range(5):
        neutral = palette.rgb([palette.NOTHING])[0]
        expected = [scale[int(255 * 2.0 * k / 8.0)] if k else neutral, neutral]
        np.testing.assert_array_equal(waiting.of(trajectory[k])[:, 0], expected)


def test_levels_are_drawn_alone(trajectory):
    for view in ("plan", "3d"):
        top = Renderer(trajectory, SIZE, view, levels=["floor 2"])
        places = top.view_at(0.0).project(np.arange(5), np.zeros((5, 3)))
        assert np.isfinite(places[:, 0]).tolist() == [False, False, False, False, True]
    with pytest.raises(ResultError, match="'floor 7'"):
        Renderer(trajectory, SIZE, levels=["floor 7"])


@pytest.mark.parametrize("view", ["3d", "plan"])
def test_people_are_drawn_where_they_are_and_as_wide_as_they_are(first_out, view):
    """The pixels of the person of group b, at (3, 3) on the ground, radius 0.4 m, and nobody else of that colour."""
    camera = Camera(azimuth=-90.0, elevation=40.0)
    renderer = Renderer(read_trajectory(first_out), (1200, 900), view, camera, ["floor 0"])
    colour = np.array(palette.rgb([palette.GROUPS[1]])[0])
    x, y, _ = renderer.view_at(0.0).project(np.array([0]), np.array([[3.0, 3.0, 0.0]]))[0]
    image = renderer.image(0).astype(float)
    image[:, renderer.view_at(0.0).side[0] :] = 255.0  # without the legend
    norm = np.linalg.norm(image, axis=2) * np.linalg.norm(colour)
    rows, columns = np.nonzero((image @ colour > 0.996 * norm) & (np.ptp(image, axis=2) > 60))
    assert columns.mean() == pytest.approx(x, abs=2.0)
    assert np.ptp(columns) + 1 == pytest.approx(2 * 0.4 * renderer.view_at(0.0).scale, rel=0.12)
    lowest = 0.4 if view == "plan" else 0.55 * 0.4 * np.sin(np.radians(40.0))  # feet are narrower than shoulders [m]
    assert rows.max() == pytest.approx(y + lowest * renderer.view_at(0.0).scale, abs=6.0)


def test_people_behind_a_floor_show_through():
    pictures = []
    for wall in (-np.inf, np.inf):
        image = np.full((60, 60, 3), 255, np.uint8)
        place, radius, height = np.array([[30.0, 50.0, 0.0]]), np.array([8.0]), np.array([58.0])
        draw_people(
            image, place, radius, height, np.full((1, 3, 3), [0, 0, 200], np.uint8), 0.6, np.full((60, 60), wall)
        )
        pictures.append(255.0 - image[35, 30, 0])
    assert pictures[1] == pytest.approx(HIDDEN * pictures[0], rel=0.05)


def test_figures_are_as_tall_as_people():
    """Seen from the side; from above, all discs are the same."""
    height = np.array([48.0, 72.0])
    for elevation, wanted in ((0.0, height), (0.5 * np.pi, np.array([16.0, 16.0]))):
        image = np.full((100, 100, 3), 255, np.uint8)
        places = np.array([[25.0, 85.0, 0.0], [75.0, 85.0, 1.0]])
        draw_people(image, places, np.full(2, 8.0), height, np.full((2, 3, 3), 90, np.uint8), elevation)
        drawn = (image[:, :50] < 200).any(axis=(1, 2)), (image[:, 50:] < 200).any(axis=(1, 2))
        assert [np.count_nonzero(rows) for rows in drawn] == pytest.approx(wanted, abs=3.0)


def test_storeys_are_pulled_apart_and_lie_as_in_plan(trajectory):
    building = trajectory.building
    chosen = aim(building, building.levels, Camera())
    assert chosen.stretch > 1.0
    assert chosen.axes[0, 0] > 0.9  # x goes to the right
    given = aim(building, building.levels, Camera(azimuth=30.0, elevation=20.0, stretch=2.0))
    assert (given.stretch, given.elevation) == (2.0, pytest.approx(np.radians(20.0)))
    np.testing.assert_allclose(given.axes[2], [0.8138, 0.4698, 0.3420], atol=1e-4)


def test_film_has_as_many_pictures_as_its_speed_asks_for(trajectory, tmp_path):
    render_animation(Renderer(trajectory, SIZE, "plan"), tmp_path / "run.gif", fps=4.0, speed=2.0)
    with Image.open(tmp_path / "run.gif") as film:
        assert film.n_frames == 5  # 2 s of people shown in 1 s, both ends included
        assert film.info["duration"] == 250
        pictures = []
        for k in range(film.n_frames):
            film.seek(k)
            pictures.append(np.asarray(film.convert("RGB")))
    assert all((a != b).any() for a, b in pairwise(pictures))


def test_a_film_as_mp4_needs_its_extra(trajectory, tmp_path, monkeypatch):
    path, there = tmp_path / "run.mp4", importlib.util.find_spec("imageio_ffmpeg")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ResultError, match=r"run\.mp4: .*evac\[film\].*\.gif"):
        render_animation(Renderer(trajectory, SIZE, "plan"), path)
    assert not path.exists()
    monkeypatch.undo()
    if there:
        render_animation(Renderer(trajectory, SIZE, "plan"), path)
        assert path.read_bytes()[4:8] == b"ftyp"


def closed(path, *names):
    """A trajectory of nobody, with links of the building closed."""
    building = close_links(read_trajectory(path).building, names)
    header = {
        "title": "",
        "groups": [],
        "group": [],
        "radius": [],
        "height": [],
        "building": building_to_json(building),
    }
    writer = TrajectoryWriter(path.with_name("closed.evac"), header, np.zeros(2))
    writer.append(0.0, crowd_at(np.zeros((0, 2)), []), np.zeros((0, 2)))
    writer.close()
    return read_trajectory(path.with_name("closed.evac"))


def test_closed_exits_and_portals_are_not_drawn_open(trajectory, tmp_path):
    shares = {}
    for names in ((), ("door",), ("portal 3",)):
        drawn = closed(trajectory.path, *names)
        render_picture(Renderer(drawn, (640, 480)), tmp_path / "run.png")
        pixels = np.asarray(Image.open(tmp_path / "run.png"))
        red, green, blue = pixels.reshape(-1, 3).astype(int).T
        shares[names] = np.mean(green > 1.3 * np.maximum(red, blue)), np.mean(red > 1.6 * np.maximum(green, blue))
    assert shares[()][0] > 2e-4
    assert shares[()][1] == 0.0
    assert shares[("door",)][0] == 0.0
    assert shares[("door",)][1] > 2e-4
    assert shares[("portal 3",)][0] == shares[()][0]
    assert shares[("portal 3",)][1] > 2e-4


def test_places_are_drawn_in_three_dimensions(building):
    level = building.levels[0]
    middle = level.polygon.representative_point()
    line = shapely.LineString([(middle.x - 1.0, middle.y - 2.0), (middle.x + 1.0, middle.y - 2.0)])
    places = (
        Place("lobby", "refuge", 0, middle.buffer(1.0), area="a", capacity=2),
        Place("sign", "sign", 0, middle, exit="way", range=9.0),
        Place("gate", "line", 0, line),
    )
    camera, levels = Camera(azimuth=-90.0, elevation=60.0), [level]
    bare, drawn = (view_of(one, SIZE, camera, levels, MARGIN) for one in (building, replace(building, places=places)))
    assert {label.text for label in drawn.labels} - {label.text for label in bare.labels} == set(map(str, places))
    assert (bare.image != drawn.image).any(axis=2).mean() > 0.002
    left, top, right, bottom = drawn.side  # of the legend
    assert 0.5 * SIZE[0] < left < right < SIZE[0]
    assert 0.1 * SIZE[1] < top < bottom < SIZE[1]
    lobby = view_of(replace(building, places=places[:1]), SIZE, camera, levels, MARGIN)
    rows, columns = np.nonzero((bare.image != lobby.image).any(axis=2))
    x, y, _ = lobby.project(np.zeros(1, np.int32), np.array([[middle.x, middle.y, 0.0]]))[0]
    assert (columns.mean(), rows.mean()) == (pytest.approx(x, abs=2.0), pytest.approx(y, abs=2.0))


def test_names_of_storeys_that_the_font_lacks_are_numbers_in_plans(building):
    images, numbered = [], []
    for names in (("階段", "floor 1", "地下 2"), ("[1]", "floor 1", "[2] 2")):
        floors = iter(names)
        levels = [replace(one, name=next(floors)) if one.kind == "floor" else one for one in building.levels]
        images.append(plan_view(replace(building, levels=tuple(levels)), SIZE, None, 0.3, numbered).image)
    np.testing.assert_array_equal(*images)
    assert numbered == ["階段", "地下"]
