from itertools import pairwise

import numpy as np
import pytest
from PIL import Image

from evac.building.links import close_links
from evac.errors import ResultError
from evac.output.header import building_to_json
from evac.output.render import render_animation, render_picture
from evac.output.scene import Scene
from evac.output.trajectory import TrajectoryWriter, read_trajectory
from tests.output.conftest import crowd_at

SIZE = (320, 240)
TAB_BLUE, TAB_ORANGE = np.array([31, 119, 180]), np.array([255, 127, 14])


@pytest.fixture
def trajectory(descent):
    return read_trajectory(descent(people=6, frames=5).path)


def share_of_hue(pixels, colour):
    """Share of pixels whose colour is `colour`, brighter or darker."""
    pixels = pixels.reshape(-1, 3).astype(float)
    norm = np.linalg.norm(pixels, axis=1) * np.linalg.norm(colour)
    return float(((pixels @ colour) > 0.998 * norm).mean())


def test_picture_shows_floors_and_the_people_of_both_groups(trajectory, tmp_path):
    render_picture(trajectory, tmp_path / "run.png", size=(640, 480))
    pixels = np.asarray(Image.open(tmp_path / "run.png"))
    assert pixels.shape == (480, 640, 3)
    assert 0.3 < (pixels == 255).all(axis=2).mean() < 0.95
    beside_the_legend = pixels[:, :500]
    assert share_of_hue(beside_the_legend, TAB_BLUE) > 5e-4
    assert share_of_hue(beside_the_legend, TAB_ORANGE) > 5e-4


def test_picture_is_of_the_asked_time(trajectory, tmp_path):
    for name, time in (("early", 0.0), ("near", 0.2), ("late", 2.0)):
        render_picture(trajectory, tmp_path / f"{name}.png", time=time, size=SIZE)
    early, near, late = (np.asarray(Image.open(tmp_path / f"{name}.png")) for name in ("early", "near", "late"))
    np.testing.assert_array_equal(early, near)
    assert (early != late).any(axis=2).mean() > 1e-3


def test_speed_colours_the_people(trajectory, tmp_path):
    render_picture(trajectory, tmp_path / "speed.png", size=(640, 480), colour_by="speed")
    assert share_of_hue(np.asarray(Image.open(tmp_path / "speed.png")), TAB_ORANGE) < 1e-4


def test_storeys_are_pulled_apart_until_one_sees_into_each(trajectory):
    scene = Scene(trajectory, SIZE, None, "group")
    scene.close()
    assert scene.stretch > 1.0


def test_film_has_as_many_pictures_as_its_speed_asks_for(trajectory, tmp_path):
    render_animation(trajectory, tmp_path / "run.gif", fps=4.0, speed=2.0, size=SIZE)
    with Image.open(tmp_path / "run.gif") as film:
        assert film.n_frames == 5  # 2 s of people shown in 1 s, both ends included
        assert film.info["duration"] == 250
        pictures = []
        for k in range(film.n_frames):
            film.seek(k)
            pictures.append(np.asarray(film.convert("RGB")))
    assert all((a != b).any() for a, b in pairwise(pictures))


def test_frame_without_people_is_drawn(descent, tmp_path):
    empty = read_trajectory(descent(people=1, frames=1).path)
    render_picture(empty, tmp_path / "empty.png", size=SIZE)
    assert np.asarray(Image.open(tmp_path / "empty.png")).std() > 5.0


def test_film_of_a_kind_that_cannot_be_made_is_refused(trajectory, tmp_path, monkeypatch):
    with pytest.raises(ResultError, match=r"\.gif or \.mp4"):
        render_animation(trajectory, tmp_path / "run.avi")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ResultError, match="pip install imageio-ffmpeg"):
        render_animation(trajectory, tmp_path / "run.mp4")


def test_nonsense_is_refused(trajectory, tmp_path):
    with pytest.raises(ResultError, match=r"run\.gif"):
        render_picture(trajectory, tmp_path / "run.gif")
    with pytest.raises(ResultError, match="'mood'"):
        render_picture(trajectory, tmp_path / "run.png", colour_by="mood")
    with pytest.raises(ResultError, match="greater than 0"):
        render_animation(trajectory, tmp_path / "run.gif", fps=0.0)


def closed(path, *names):
    """A trajectory of nobody, with links of the building closed."""
    building = close_links(read_trajectory(path).building, names)
    header = {"title": "", "groups": [], "group": [], "radius": [], "building": building_to_json(building)}
    writer = TrajectoryWriter(path.with_name("closed.evac"), header, np.zeros(2))
    writer.append(0.0, crowd_at(np.zeros((0, 2)), []), np.zeros((0, 2)))
    writer.close()
    return read_trajectory(path.with_name("closed.evac"))


def test_closed_exits_and_portals_are_not_drawn_open(trajectory, tmp_path):
    shares = {}
    for names in ((), ("door",), ("portal 3",)):
        drawn = closed(trajectory.path, *names)
        render_picture(drawn, tmp_path / "run.png", size=(640, 480))
        pixels = np.asarray(Image.open(tmp_path / "run.png"))
        red, green, blue = pixels.reshape(-1, 3).astype(int).T
        shares[names] = np.mean(green > 1.3 * np.maximum(red, blue)), np.mean(red > 1.6 * np.maximum(green, blue))
    assert shares[()][0] > 2e-4
    assert shares[()][1] == 0.0
    assert shares[("door",)][0] == 0.0
    assert shares[("door",)][1] > 2e-4
    assert shares[("portal 3",)][0] == shares[()][0]
    assert shares[("portal 3",)][1] > 2e-4


def test_unwritable_places_are_named(trajectory, tmp_path):
    with pytest.raises(ResultError, match="absent"):
        render_picture(trajectory, tmp_path / "absent" / "run.png", size=SIZE)
    with pytest.raises(ResultError, match="absent"):
        render_animation(trajectory, tmp_path / "absent" / "run.gif", size=SIZE)


def test_trajectory_without_frames_is_refused(tmp_path, building):
    header = {"title": "", "groups": [], "group": [], "radius": [], "building": building_to_json(building)}
    TrajectoryWriter(tmp_path / "none.evac", header, np.zeros(2)).close()
    with pytest.raises(ResultError, match=r"none.evac"):
        render_picture(read_trajectory(tmp_path / "none.evac"), tmp_path / "run.png")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"time": 99.0}, "99 s; .* 0 to [0-9]"),
        ({"stretch": -1.0}, "greater than 0"),
    ],
)
def test_times_and_stretches_that_are_none_are_refused(trajectory, tmp_path, options, words):
    with pytest.raises(ResultError, match=words):
        render_picture(trajectory, tmp_path / "run.png", size=SIZE, **options)
