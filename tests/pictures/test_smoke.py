"""Smoke in pictures: a veil on the floors, and people coloured by the smoke at their heads."""

import numpy as np
import pytest

import evac
from evac.pictures.palette import colouring
from evac.pictures.render import Renderer, Smoke
from tests.conditions.corridor import corridor, prescribed


@pytest.fixture(scope="module")
def trajectory(tmp_path_factory):
    area = {"name": "west", "level": "f", "polygon": [[0, 0], [50, 0], [50, 2], [0, 2]]}
    smoke = prescribed(area="west", times=[0, 4], values={"extinction": [0, 4]}, hold=True)
    smoke["values"] |= {"co": [0, 30000], "co2": [0, 5], "o2": [21, 15]}
    case = corridor(smoke, positions=((0.5, 1.0), (80.0, 1.0)), dose={"heat": "none"})
    case = case.change({"building.areas": [area], "simulation.duration": 6.0})
    return evac.run(case, tmp_path_factory.mktemp("smoke") / "result").trajectory


@pytest.mark.parametrize("view", ["plan", "3d"])
def test_smoke_darkens_the_floor_where_it_is(trajectory, view):
    renderer = Renderer(trajectory, (800, 300), view)
    last = len(trajectory) - 1
    before, after = renderer.image(0).astype(float), renderer.image(last).astype(float)
    ends = renderer.view_at(0.0).project(np.zeros(2, np.int32), np.array([[20.0, 0.4, 0.0], [90.0, 0.4, 0.0]]))
    (x1, y1), (x2, y2) = ends[:, :2].round().astype(int)
    assert after[y1, x1].mean() < 0.7 * before[y1, x1].mean()
    corner = after[-60:, 400:].reshape(-1, 3)
    assert [text for text, _ in Smoke(trajectory).scale()] == ["0.1", "0.3", "1", "3", "10"]
    assert all((corner == colour).all(axis=1).any() for _, colour in Smoke(trajectory).scale())
    np.testing.assert_array_equal(after[y2, x2], before[y2, x2])


@pytest.mark.parametrize(("quantity", "top"), [("extinction", 4.0), ("visibility", 30.0), ("dose", 1.0)])
def test_people_are_coloured_by_the_air_at_their_heads(trajectory, quantity, top):
    found = colouring(trajectory, quantity)
    assert found.top >= top
    first, last = found.of(trajectory[0]), found.of(trajectory[len(trajectory) - 1])
    np.testing.assert_array_equal(first[0], first[1])
    assert (last[0] != last[1]).any()
    np.testing.assert_array_equal(last[1], first[1])
