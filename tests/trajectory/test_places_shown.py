"""Refuges, assembly areas and signs in the trajectory, pictures and the replay."""

import base64
import json
import re
import zlib

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from shapely import box

import evac
from evac.pictures import palette
from evac.pictures.render import Renderer
from evac.report.sections import building_section

PLACES = [
    {"name": "lobby", "kind": "refuge", "area": "corner", "capacity": 2},
    {"name": "yard", "kind": "assembly", "area": "far end"},
    {"name": "sign", "kind": "sign", "position": [10.0, 5.9], "z": 0.0, "exit": "out"},
    {"name": "fire", "kind": "fire", "position": [12.0, 3.0], "level": "floor"},
]


def run(places, folder):
    plan = evac.Plan(north=90.0)
    plan.storey("floor", box(0, 0, 20, 6))
    plan.exit("out", "floor", [(0, 2), (0, 4)])
    plan.area("corner", "floor", box(1, 4, 5, 6))
    plan.area("far end", "floor", box(15, 0.5, 19, 5.5))
    people = [{"name": "people", "level": "floor", "number": 3}]
    case = {"building": plan, "people": people, "place": places, "contact": {"model": "nsm2"}}
    case["behaviours"] = {"familiarity": {"main": ["out"]}}
    return evac.run(evac.load(case, {"simulation.duration": 0.5}), folder, progress=False)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return run(PLACES, tmp_path_factory.mktemp("places") / "result")


def test_plans_show_them(results, tmp_path):
    """The pixels of a colour with and without places: floors under areas are a quarter of the colour."""
    counts = []
    for one in (results.trajectory, run([], tmp_path / "result").trajectory):
        picture = Renderer(one, (600, 300), "plan").image(0).astype(int)
        counts.append([])
        for kind, share in (("refuge", 0.25), ("assembly", 0.25), ("fire", 1.0)):
            floor, colour = (255.0 * np.array(to_rgb(name)) for name in (palette.LEVELS["floor"], palette.PLACES[kind]))
            counts[-1].append(int((np.abs(picture - ((1.0 - share) * floor + share * colour)).max(axis=2) < 4).sum()))
    assert min(counts[0][:2]) > 500
    assert counts[0][2] > 10 > counts[1][2]
    assert max(counts[1]) < 50


def test_pictures_know_where_north_is(results):
    """North is where x decreases: to the left in plan, and along -x as the axes of the camera see it."""
    assert Renderer(results.trajectory, (600, 300), "plan").view_at(0.0).north == pytest.approx([-1.0, 0.0], abs=1e-12)
    view = Renderer(results.trajectory, (600, 300)).view_at(0.0)
    here, there = view.project(np.zeros(2, np.int32), np.array([[10.0, 3.0, 0.0], [9.0, 3.0, 0.0]]))[:, :2]
    assert view.scale * view.north == pytest.approx(there - here)


def test_the_report_lists_them(results):
    text = re.sub(r"<[^>]+>", " ", str(building_section(results).content))
    for words in ("lobby refuge floor corner 2 people", "yard assembly floor far end any number"):
        assert words in " ".join(text.split())
    assert "sign sign floor out seen from 30 m" in " ".join(text.split())


def test_the_replay_has_them(results):
    page = (results.folder / "replay.html").read_text(encoding="utf-8")
    about = json.loads(zlib.decompress(base64.b64decode(re.search(r'id="data-about">([^<]*)<', page)[1])))
    found = about["building"]["places"]
    assert about["northward"] == pytest.approx([-1.0, 0.0], abs=1e-12)
    assert [(place["name"], place["kind"]) for place in found] == [
        ("lobby", "refuge"),
        ("yard", "assembly"),
        ("\u2192 out", "sign"),
        ("fire", "fire"),
    ]
    for place, area in zip(found, (8.0, 20.0, 0.18, 1.28), strict=True):
        (x1, y1), (x2, y2), (x3, y3) = np.moveaxis(0.01 * np.reshape(place["triangles"], (-1, 3, 3))[..., :2], 0, 2)
        assert 0.5 * np.abs((x2 - x1) * (y3 - y1) - (x3 - x1) * (y2 - y1)).sum() == pytest.approx(area, rel=0.02)
