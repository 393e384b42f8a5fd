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
from evac.report.building import building_section
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


def test_the_trajectory_and_the_report_have_all_of_them(results):
    kinds = [one["kind"] for one in EVENTS]
    assert [change.kind for change in results.trajectory.changes] == kinds
    assert list(evac.read_results(results.folder).changes) == list(results.changes)
    condition = results.trajectory.building_at(4.0)
    assert (len(condition.one_way), condition.slowed, condition.barred) == (2, {("hall", 0.5)}, {"hall"})
    html = str(building_section(results).content)
    assert all(str(change).replace("'", "&#39;") in html for change in results.changes)


def test_the_replay_tells_them(results):
    page = (results.folder / "replay.html").read_text(encoding="utf-8")
    data = re.search(r'id="data-about">([^<]*)<', page)[1]
    about = json.loads(zlib.decompress(base64.b64decode(data)))
    assert about["changes"] == [[change.time, str(change)] for change in results.changes]


def test_plans_show_areas_and_directions(results):
    renderer = Renderer(results.trajectory, (600, 400), "plan")
    red = np.array([round(255 * part) for part in to_rgb(palette.CLOSED)])

    def reds(time):
        picture = renderer.image(results.trajectory.nearest(time)).astype(int)
        return int((np.abs(picture - red).max(axis=2) < 90).sum())

    at_start, closed, directed, barred = map(reds, (0.5, 1.0, 1.5, 4.0))
    assert at_start < closed < directed < barred
