"""Pictures of levels: each storey has a panel, and each finding a mark on the right one."""

import pytest
import shapely

from evac import Plan
from evac.building.model.findings import Finding
from evac.pictures.annotated import Mark, draw_levels, levels_figure, panel_of


@pytest.fixture
def building():
    plan = Plan()
    plan.storey("ground", shapely.box(0, 0, 12, 6))
    plan.storey("first", shapely.box(0, 0, 12, 6), z=3.0)
    plan.storey("gallery", shapely.box(14, 0, 16, 6), z=3.4)
    plan.stair("main", "ground", [(2, 1), (2, 2.5)], "first", length=6.0, direction=(1, 0))
    plan.exit("door", "ground", [(0, 3), (0, 4)])
    return plan.building()


def test_floors_at_one_height_are_a_storey_with_the_stairs_up_from_it(building):
    names = [[level.name for level in own] for _, own in building.storeys]
    assert names == [["ground", "main flight z=0.00..3.00"], ["first"], ["gallery"]]


@pytest.mark.parametrize(
    ("level", "place", "panel"),
    [("first", (1.0, 1.0), 1), (None, (1.0, 5.0, 0.1), 0), (None, (1.0, 5.0, 2.9), 1), (None, (15.0, 1.0), 2)],
)
def test_a_finding_is_marked_on_its_storey(building, level, place, panel):
    panels = [[level.index for level in own] for _, own in building.storeys]
    assert panel_of(building, panels, Finding("warning", "odd", level, place)) == panel


def test_numbers_and_names_do_not_cover_each_other(building):
    findings = [Finding("warning", f"odd {'x' * k}", "ground", (4.4 + 0.3 * k, 1.75)) for k in range(4)]
    findings.append(Finding("warning", "at the door", "ground", (0.1, 3.5)))
    figure = levels_figure(building, findings)
    figure.canvas.draw()
    shown = [text for text in figure.axes[0].texts if text.get_text() and text.get_visible()]
    boxes = [text.get_window_extent() for text in shown]
    assert {"1", "2", "3", "4", "5", "main", "door 1.00 m"} <= {text.get_text() for text in shown}
    assert not [k for k, box in enumerate(boxes) if box.count_overlaps(boxes[:k])]
    assert all(figure.axes[0].bbox.count_contains([(box.x0, box.y0), (box.x1, box.y1)]) == 2 for box in boxes)


def test_marks_and_findings_are_in_the_picture(building, tmp_path):
    findings = [
        Finding("warning", "a narrow place", "ground", (10.0, 3.0)),
        Finding("found", "a door", "ground", (0.0, 3.5)),
        Finding("repaired", "a gap", place=(11.0, 3.0, 3.0)),
        Finding("left out", "nothing of note"),
        Finding("repaired", "a gap", "first", (1.0, 1.0)),
    ]
    marks = [Mark("7: 6.00 m", 0, building.walls[0])]
    import matplotlib as mpl

    with mpl.rc_context({"svg.fonttype": "none"}):
        draw_levels(building, tmp_path / "a.svg", findings, marks, "a title")
    text = (tmp_path / "a.svg").read_text(encoding="utf-8")
    for word in (
        "a title",
        "ground",
        "door 1.00 m",
        "main",
        "7: 6.00 m",
        "1  warning",
        "2  repaired",
        "a gap (and 1 more like",
        "3  left",
    ):
        assert word in text, word
    assert "a door" not in text


@pytest.mark.parametrize("length", [9, 400])
def test_doors_wider_than_letters_and_areas_larger_than_their_names_are_named_in_the_picture(tmp_path, length):
    plan = Plan()
    plan.storey("ground", [shapely.box(0, 0, 5, 4), shapely.box(5.2, 0, length, 4)])
    plan.door("inner", "ground", [(5.1, 1), (5.1, 1.95)])
    plan.area("hall", "ground", shapely.box(0, 0, 5, 4))
    plan.area("a cupboard under the stairs", "ground", shapely.box(8.6, 3.6, 9, 4))
    import matplotlib as mpl

    with mpl.rc_context({"svg.fonttype": "none"}):
        draw_levels(plan.building(need_exit=False), tmp_path / "a.svg")
    text = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert [word in text for word in ("inner 0.95 m", "hall", "cupboard")] == [length == 9, length == 9, False]


def test_a_finding_off_the_plan_is_marked_at_its_border(building):
    figure = levels_figure(building, [Finding("error", "far", "ground", (90.0, 3.0))])
    (ring,) = [line for axes in figure.axes for line in axes.lines if line.get_marker() == "o"]
    low, high = ring.axes.get_xlim()
    assert ring.get_xdata().tolist() == [high]
    assert ring.get_ydata().tolist() == [3.0]
    assert low < 12.0 < high < 20.0
