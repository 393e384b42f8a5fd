"""An exit that closes at 2 s is closed from then on in everything that shows or measures the run."""

import textwrap

import numpy as np
import pytest
from PIL import Image, ImageColor

import evac
from evac.analysis.maps import level_maps
from evac.pictures import palette
from evac.pictures.map_pictures import draw_map
from evac.pictures.render import Renderer, render_animation
from evac.report.sections import building_section
from evac.results.ending import Stopped

CASE = {
    "building": {
        "exits": [
            {"name": "west", "segment": [[0.0, 1.0], [0.0, 2.5]], "z": 0.0},
            {"name": "east", "segment": [[5.0, 1.0], [5.0, 2.5]], "z": 0.0},
        ],
        "areas": [{"name": "all", "polygon": [[0.5, 0.5], [4.5, 0.5], [4.5, 3.5], [0.5, 3.5]], "z": 0.0}],
    },
    "contact": {"model": "nsm2"},
    "behaviours": {"closing": {}},
    "simulation": {"duration": 4.0},
    "output": {"picture": False, "animation": False},
    "people": [{"name": "people", "number": 12, "area": "all", "speed": 0.8}],
}

CLOSING = """
    import numpy as np

    from evac import Behaviour

    evac_interface = 3


    class Closing(Behaviour):
        '''Closes the western exit at 2 s, and lets haze rise.'''

        name = "closing"

        def prepare(self, scene):
            self.scene = scene.scene
            self.field = scene.level_field("haze", "1/m", 0.5)

        def act(self, crowd, time):
            self.field.values[:] = np.arange(self.field.size) + time
            if time >= 2.0:
                self.scene.set_open("west", False)

        def state(self):
            return {}
"""


def stop_at_3_s(progress):
    if progress.time > 3.0:
        raise Stopped


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("closing")
    (folder / "hall.obj").write_text("v 0 0 0\nv 5 0 0\nv 5 4 0\nv 0 4 0\nf 1 2 3 4\n")
    (folder / "closing.py").write_text(textwrap.dedent(CLOSING))
    building = CASE["building"] | {"mesh": str(folder / "hall.obj")}
    return evac.load(CASE | {"building": building}, plugin_files=[folder / "closing.py"])


@pytest.fixture(scope="module")
def result(case, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "result"
    evac.run(case, folder)
    return folder


@pytest.fixture(scope="module")
def trajectory(result):
    return evac.read_trajectory(result)


def reds(image):
    """Return the number of pixels that have the colour of what is closed."""
    return (np.abs(np.asarray(image, int) - ImageColor.getrgb(palette.CLOSED)) < 25).all(axis=2).sum()


def test_the_trajectory_says_when(case, trajectory):
    in_memory = evac.run(case, progress=False)
    assert (in_memory.changes, in_memory.trajectory.changes) == (trajectory.changes,) * 2
    assert trajectory.changes == (evac.Change(2.0, "close", "west", {"let_through": (6,)}),)
    west, east = (exit_ for exit_ in sorted(trajectory.building.exits, key=lambda one: one.name != "west"))
    for time, is_open in ((0.0, True), (1.9, True), (2.0, False), (4.0, False)):
        assert trajectory.building_at(time).is_open(west) is is_open
        assert trajectory.building_at(time).is_open(east)


def test_the_field_of_a_behaviour_is_in_the_trajectory(trajectory):
    haze = trajectory.field("haze")
    assert (haze.unit, haze.spacing, haze.values.shape) == ("1/m", 0.5, (len(trajectory), 80))
    assert not haze.values[0].any()
    before = trajectory.time[1:] - haze.values[1:, 0]  # since the behaviour acted
    assert ((before > 0.0) & (before < 0.11)).all()
    np.testing.assert_allclose(
        haze.values[1:] - haze.values[1:, :1], np.arange(80)[None].repeat(len(before), 0), atol=1e-5
    )
    assert haze.on(0).shape == (len(trajectory), 8, 10)
    with pytest.raises(evac.ResultError, match="'haze'"):
        trajectory.field("hase")


@pytest.mark.parametrize("view", ["3d", "plan"])
def test_pictures_and_films_show_it_closed_from_then_on(trajectory, tmp_path, view):
    renderer = Renderer(trajectory, (400, 300), view)
    before, after = (reds(renderer.image(trajectory.nearest(time))) for time in (1.5, 2.5))
    assert before == 0
    assert after > 20
    render_animation(renderer, tmp_path / "film.gif", fps=2.0, speed=1.0)
    with Image.open(tmp_path / "film.gif") as film:
        shown = []
        for k in range(film.n_frames):
            film.seek(k)
            shown.append(reds(film.convert("RGB")) > 20)
    assert shown == [False] * 4 + [True] * 5


def test_maps_show_what_is_closed_at_their_end_and_say_when(trajectory):
    def words(**times):
        figure = draw_map(trajectory, "density", level_maps(trajectory, spacing=0.5, **times))
        return " ".join(text.get_text() for text in figure.findobj(lambda artist: hasattr(artist, "get_text")))

    assert "closed" not in words(end=1.5)
    assert "west (closed)" in words()
    assert "'west' closed at 2 s" in words()
    assert "west (closed)" in words(start=2.5)
    assert "closed at" not in words(start=2.5)


def test_the_report_has_the_state_from_each_time_and_no_file_of_a_plugin(result):
    results = evac.read_results(result)
    assert results.summary()["plugin_files"] == []
    section = str(building_section(results))
    assert "open, closed from 2 s on" in section
