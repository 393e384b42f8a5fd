"""Results and buildings as notebooks show them."""

from html.parser import HTMLParser

import numpy as np
import pytest

import evac


class Page(HTMLParser):
    """Text of the cells, and attributes of images and frames."""

    def __init__(self, text):
        super().__init__()
        self.cells, self.tags, self._in_cell = [], {}, False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self._in_cell = tag in ("td", "th")
        if self._in_cell:
            self.cells.append("")
        if tag in ("img", "iframe"):
            self.tags[tag] = dict(attrs)

    def handle_data(self, data):
        if self._in_cell:
            self.cells[-1] += data


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("notebook") / "r"
    case = evac.load("square_room", {"simulation.duration": 3.0, "title": "a < b & c", "output.animation": False})
    return evac.run(case, folder)


def test_results_show_tables_the_egress_curve_and_the_replay(results):
    page = Page(results._repr_html_())
    assert f"after 3.00 s (duration over): {results.evacuated} of 20 people out" in results._repr_html_()
    assert "door" in page.cells
    assert page.tags["img"]["src"].startswith("data:image/png;base64,")
    assert page.tags["iframe"]["srcdoc"] == (results.folder / "replay.html").read_text(encoding="utf-8")
    assert "<h4>a &lt; b &amp; c</h4>" in results._repr_html_()


def test_a_replay_that_is_not_there_or_too_large_is_not_shown(results, monkeypatch):
    monkeypatch.setattr("evac.pictures.notebook.LARGEST_REPLAY", 1000)
    assert "iframe" not in Page(results._repr_html_()).tags
    assert str(results.folder) in results._repr_html_()


def test_the_motion_is_a_data_frame(results):
    trajectory = evac.read_trajectory(results.folder)
    frame = trajectory.frame
    assert (frame.groupby("time").size().to_numpy() == [len(rows.person) for rows in trajectory.rows]).all()
    last = frame[frame.time == trajectory.time[-1]]
    np.testing.assert_array_equal(last[["x", "y"]], trajectory[-1]["position"])


def test_representations_are_short(results):
    trajectory = evac.read_trajectory(results.folder)
    simulation = evac.Simulation(results.case)
    for thing in (results, results.case, results.building, trajectory, simulation, simulation.fields):
        assert len(repr(thing)) < 200, type(thing)
    assert "duration over" in repr(results)
    assert f"{results.evacuated} of 20 out" in repr(results)


def test_a_building_is_drawn(results):
    page = Page(results.building._repr_html_())
    assert page.tags["img"]["alt"] == "plans of the storeys"
    assert page.tags["img"]["src"].startswith("data:image/png;base64,")
