"""Every kind of event is in the trajectory, the replay, pictures and the report of a run."""

import base64
import json
import re
import zlib

import numpy as np
import pytest
from matplotlib.colors import to_rgb

import evac
from evac.pictures import palette
from evac.pictures.render import Renderer
from tests.simulation.test_timetable import event, house

EVENTS = [
    event("close", "back", 1.0),
    event("one_way", "a", 1.5, value="up"),
    event("slow", "hall", 2.0, value=0.5),
    event("alarm", "", 2.5, value=0.1),
    event("strategy", "below", 3.0, value=["main"]),
    event("bar", "hall", 3.5),
]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Return the results of a run with an event of each kind."""
    case = house(*EVENTS, **{"behaviours.response_time.time": 20.0, "simulation.duration": 5.0})
    return evac.run(case, tmp_path_factory.mktemp("events") / "result", progress=False)


def test_the_replay_tells_them(results):
    page = (results.folder / "replay.html").read_text(encoding="utf-8")
    data = re.search(r'id="data-about">([^<]*)<', page)[1]
    about = json.loads(zlib.decompress(base64.b64decode(data)))
    assert about["changes"] == [[change.time, change.words] for change in results.changes]
    marks = {state["since"]: state["marks"] for state in about["states"]}
    kinds = {time: [mark["kind"] for mark in now] for time, now in marks.items()}
    assert kinds[0.0] == kinds[1.0] == []
    assert kinds[1.5] == ["one_way"] * 2
    assert kinds[2.0] == ["slow", "one_way", "one_way"]
    assert kinds[3.5][0] == "barred"
    corners = 0.01 * np.reshape(marks[3.5][0]["triangles"], (-1, 3))[:, :2] + about["origin"]
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[6.0, 2.5], [12.0, 8.0]], atol=0.02)


def test_pictures_show_areas_and_directions(results):
    renderer = Renderer(results.trajectory, (600, 400), "plan")
    red = np.array([round(255 * part) for part in to_rgb(palette.CLOSED)])

    def reds(time):
        picture = renderer.image(results.trajectory.nearest(time)).astype(int)
        return int((np.abs(picture - red).max(axis=2) < 90).sum()), int((picture[..., 0] - picture[..., 1]).sum())

    (at_start, _), (closed, _), (directed, free), (barred, hatched) = map(reds, (0.5, 1.0, 1.5, 4.0))
    assert at_start < closed < directed <= barred
    assert hatched > free + 50_000, "the area is redder"
