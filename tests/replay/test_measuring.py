"""Lines and areas that are drawn in the page, against shapely and the trajectory."""

import csv
from itertools import pairwise

import numpy as np
import pytest
from shapely import LineString, Point, box

from evac.replay.motion import GRAIN
from evac.trajectory.trajectory import read_trajectory

#: Keeps what is saved, and saves nothing.
KEEP = """
  URL.createObjectURL = (blob) => { window.saved = blob.text(); return "blob:none"; };
  HTMLElement.prototype.click = () => {};
"""


def drag(browser, start, end):
    """Draw from one place of the room to another one [m]."""
    places = browser.run(
        f"""{[list(start), list(end)]}.map(([x, y]) => {{
              const {{ record: {{ origin }}, layout, camera, stage: {{ canvas }} }} = replay;
              const box = canvas.getBoundingClientRect();
              const at = camera.project(layout.place(0, x - origin[0], y - origin[1], 0));
              return [box.x + (at[0] + 1) / 2 * box.width, box.y + (1 - at[1]) / 2 * box.height];
            }})"""
    )
    browser.mouse("mousePressed", *places[0], 1)
    browser.mouse("mouseMoved", *np.mean(places, axis=0), 1)
    browser.mouse("mouseMoved", *places[1], 1)
    browser.mouse("mouseReleased", *places[1])
    browser.settle()


def saved_table(browser):
    """Save the table and return its rows."""
    browser.run(KEEP + "document.getElementById('measured-save').dispatchEvent(new Event('click'))")
    return list(csv.DictReader(browser.run("saved").splitlines()))


@pytest.fixture(params=["3d", "plan"])
def view(request, browser, room):
    """The page of the room, and its trajectory with the origin of the page."""
    browser.open(room[0] / "replay.html")
    browser.run(f"replay.act.view('{request.param}'); replay.act.seek(3.0)")
    browser.settle()
    return read_trajectory(room[0]), np.array(browser.run("replay.record.origin"))


def test_people_through_a_line(browser, view, room):
    trajectory, origin = view
    browser.press("m", "KeyM")
    camera = browser.run("[replay.camera.azimuth, ...replay.camera.target]")
    drag(browser, (2.0, 0.6), (2.0, 4.4))
    assert browser.run("[replay.camera.azimuth, ...replay.camera.target]") == camera  # a drag draws and does not turn
    ends = np.reshape(browser.run("replay.measured.ends"), (2, 2)) + origin
    np.testing.assert_allclose(ends, [(2.0, 0.6), (2.0, 4.4)], atol=0.05)
    line, passed = LineString(ends), {"to the left": 0, "to the right": 0}
    for first, second in pairwise(range(len(trajectory))):
        there, here = trajectory[first], trajectory[second]
        after = dict(zip(here["person"].tolist(), here["position"], strict=True))
        for person, start in zip(there["person"].tolist(), there["position"], strict=True):
            if person in after and LineString([start, after[person]]).intersects(line):
                (ax, ay), (bx, by) = np.subtract(*ends[::-1]), after[person] - start
                passed["to the left" if ax * by - ay * bx > 0 else "to the right"] += 1
    assert sum(passed.values()) > 5
    rows = saved_table(browser)
    length = np.hypot(*np.subtract(*ends))
    for direction, count in passed.items():
        of = [row for row in rows if row["direction"] == direction]
        assert int(of[-1]["count"]) == count
        times = np.array([0.0] + [float(row["time"]) for row in of])
        flow = np.diff([0] + [int(row["count"]) for row in of]) / np.diff(times)
        np.testing.assert_allclose([float(row["flow"]) for row in of], flow)
        np.testing.assert_allclose([float(row["specific_flow"]) for row in of], flow / length, rtol=1e-6)
        assert times[-1] == browser.run("replay.record.end")
    assert f"of {passed['to the right']}" in browser.text("#measured-facts")


def test_people_and_density_in_an_area(browser, view, room):
    trajectory, origin = view
    browser.run("replay.act.measure('area')")
    drag(browser, (0.5, 1.0), (3.0, 4.0))
    x1, y1, x2, y2 = browser.run("replay.measured.ends")
    area = box(*(np.array([min(x1, x2), min(y1, y2), max(x1, x2), max(y1, y2)]) + np.tile(origin, 2)))
    floor = area.intersection(room[1].building.levels[0].polygon).area
    rows = saved_table(browser)
    assert len(rows) == len(trajectory)
    for k in range(len(trajectory)):
        position = trajectory[k]["position"]
        within = [sum(area.buffer(by).covers(Point(at)) for at in position) for by in (-GRAIN, GRAIN)]
        assert within[0] <= int(rows[k]["people"]) <= within[1]
        assert float(rows[k]["density"]) == pytest.approx(int(rows[k]["people"]) / floor, rel=0.08)
    assert max(int(row["people"]) for row in rows) > 3
    browser.run("replay.act.measure('')")
    assert browser.run("document.getElementById('measured-section').hidden")
