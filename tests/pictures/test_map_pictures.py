"""Pictures of maps, looked at by their pixels."""

import itertools

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from evac import Plan
from evac.analysis.maps import QUANTITIES
from evac.base.errors import ResultError
from evac.pictures import palette
from evac.pictures.floorplan import beside, draw_plans
from evac.pictures.map_pictures import NEVER, draw_cut, draw_map, draw_maps, write_maps
from evac.trajectory.trajectory import read_trajectory


@pytest.fixture
def trajectory(descent):
    return read_trajectory(descent(people=6, frames=5).path)


def pixels(figure):
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[..., :3].astype(int)


def has_colour(image, colour, tolerance=3):
    return (np.abs(image - np.array(palette.rgb([colour])[0])).max(axis=2) <= tolerance).mean()


def test_every_quantity_is_drawn_on_a_plan_of_every_storey(trajectory, tmp_path):
    maps = trajectory.maps(spacing=0.5)
    paths = write_maps(trajectory, maps, QUANTITIES, tmp_path)
    assert [path.name for path in paths] == [f"map_{name}.png" for name in QUANTITIES]
    assert all(np.asarray(Image.open(path)).std() > 5.0 for path in paths)
    figure = draw_map(trajectory, "density", maps)
    assert [axes.get_title(loc="left") for axes in figure.axes[:3]] == ["floor 0", "floor 1", "floor 2"]


def test_maps_that_share_their_plans_look_like_those_drawn_alone(trajectory):
    maps = trajectory.maps(spacing=0.5)
    names = ["flow", "time_to_clear", "density"]
    together = [pixels(figure) for figure in draw_maps(trajectory, names, maps)]
    for name, drawn in zip(names, together, strict=True):
        np.testing.assert_array_equal(drawn, pixels(draw_map(trajectory, name, maps)))


def test_what_is_not_cleared_has_a_colour_of_its_own(written):
    stays = written(np.full((3, 1, 2), [5.0, 3.0]))
    leaves = written(np.full((3, 1, 2), [5.0, 3.0]), [[0], [0], [-1]])
    assert has_colour(pixels(draw_map(stays, "time_to_clear")), NEVER) > 1e-4
    assert has_colour(pixels(draw_map(leaves, "time_to_clear")), NEVER) == 0.0


def test_one_level_and_the_formats(trajectory, tmp_path):
    maps = trajectory.maps(["floor 1"])
    (path,) = write_maps(trajectory, maps, ["speed"], tmp_path / "one.svg", ["floor 1"])
    assert path.read_text(encoding="utf-8").startswith("<?xml")
    with pytest.raises(ResultError, match="'mood'"):
        draw_map(trajectory, "mood", maps)
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(ResultError, match="taken"):
        write_maps(trajectory, maps, ["speed"], tmp_path / "taken" / "map.png", ["floor 1"])


def test_plans_share_one_scale_and_one_frame(building):
    plans = draw_plans(building, "Three storeys")
    assert [[level.name for level in levels] for levels in plans.levels] == [
        ["floor 0", "flight 1"],
        ["floor 1", "flight 2"],
        ["floor 2"],
    ]
    assert len({axes.get_xlim() for axes in plans.axes}) == 1
    figure = plans.figure
    for axes in plans.axes:
        box = axes.get_position()
        width, height = figure.get_size_inches()
        wide, high = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
        assert box.width * width / wide == pytest.approx(box.height * height / high, rel=1e-6)


def test_ticks_of_people_are_whole_numbers(written):
    figure = draw_map(written([[[3.0, 3.0]], [[4.0, 3.0]]]), "usage")
    ticks = [float(label.get_text()) for label in figure.axes[-1].get_yticklabels()]
    assert len(ticks) > 1
    assert ticks == np.round(ticks).tolist()


@pytest.mark.parametrize("beside", [-1.0, 0.5, 9.0])
def test_the_name_of_an_exit_is_not_written_over_the_colour_bar_of_a_cut(trajectory, beside):
    """The right edge of the cut is beside the exit by so much [m], and its name is at the right of the exit."""
    building = trajectory.building
    (exit_,) = building.exits
    x, y = exit_.segments.reshape(-1, 2).mean(axis=0)
    figure = Figure((6.0, 2.0), dpi=100)
    FigureCanvasAgg(figure)
    level = building.levels[exit_.level].name
    maps = trajectory.maps(spacing=0.5)
    draw_cut(figure, (0.0, 0.0, 0.33, 1.0), trajectory, "waiting", maps, level, (x + beside - 5.0, y), 5.0)
    edge = round(figure.axes[0].get_window_extent().x1) + 2
    assert has_colour(pixels(figure)[:, edge:], palette.EXIT, 40) == 0.0
    assert figure.axes[0].get_aspect() == 1.0


@pytest.mark.parametrize("turned", [False, True])
def test_long_names_of_exits_beside_each_other_are_written_in_lines(turned):
    names = ["north east entrance of the audience", "north west entrance of the audience"]
    ends = [[[5.2, 6.0], [4.2, 6.0]], [[3.6, 6.0], [2.6, 6.0]]]
    plan = Plan()
    plan.storey("hall", [[(-y, x) if turned else (x, y) for x, y in [(0, 0), (8, 0), (8, 6), (0, 6)]]])
    for name, line in zip(names, ends, strict=True):
        plan.exit(name, "hall", [(-y, x) if turned else (x, y) for x, y in line])
    building = plan.building()
    plans = draw_plans(building, "Hall", greatest=(5.4, 4.0))
    plans.figure.canvas.draw()
    boxes = [text.get_window_extent() for text in (*plans.axes[0].texts, *plans.names)]
    assert len(boxes) == 3
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))


def test_names_are_written_outside_of_lines_and_upright_at_upright_ones():
    axes, corners = Figure().add_subplot(), [(0, 0), (4, 0), (4, 3), (0, 3), (0, 0)]
    for one, other in itertools.pairwise(corners):
        beside(axes, np.array([[*one, *other]], float), "door", "black")
    written = [(text.get_ha(), text.get_va(), text.get_rotation(), *text.xy) for text in axes.texts]
    assert written == [
        *(("center", "top", 0, 2, 0), ("left", "center", 90, 4, 1.5)),
        *(("center", "bottom", 0, 2, 3), ("right", "center", 90, 0, 1.5)),
    ]
