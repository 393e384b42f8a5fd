"""The building section: doors between rooms with their widths, or the checklist asks the author for them."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from shapely import box

from evac import Plan
from evac.report.pages import BLANK, Head, page
from evac.report.sections import building_section
from evac.results.recordedcase import BuildingTable
from evac.results.verdict import verdict_of

from .conftest import Page


def section_of(with_door):
    plan = Plan()
    plan.storey("floor", [box(0, 0, 5, 4), box(5.2, 0, 9, 4)])
    plan.door("inner", "floor", [(5.1, 1), (5.1, 1.95)])
    plan.exit("out", "floor", [(0, 1), (0, 2)])
    building = plan.building()
    building = building if with_door else replace(building, doors=())
    trajectory = SimpleNamespace(building=building, changes=())
    case_table = SimpleNamespace(building=BuildingTable())
    return building_section(SimpleNamespace(trajectory=trajectory, case_table=case_table))


@pytest.mark.parametrize("with_door", [True, False])
def test_doors_are_listed_or_asked_for(with_door):
    shown = Page(page(Head("title", "kind", verdict_of(None), "", {}), BLANK, [section_of(with_door)]))
    (row,) = [row for row in shown.table("Numbers of sections") if row[1].startswith("Doors")]
    assert (row[-1] == "nothing") == with_door
    assert ("doors between rooms" in row[-1]) != with_door
    if with_door:
        assert shown.table("Doors between rooms")[1:] == [["floor", "0.95", "open", "1", "inner"]]


def test_alike_stairs_above_each_other_share_a_row():
    plan = Plan()
    for k, name in enumerate("abcd"):
        plan.storey(name, [box(0, 0, 12, 6)], z=3.0 * k)
    for k, width in enumerate((1.4, 1.4, 1.2)):
        lower, upper = "abcd"[k : k + 2]
        plan.stair(f"west {k}", lower, [(4, 0), (4, width)], upper, length=5.0, direction=(1, 0))
    plan.exit("out", "a", [(0, 1), (0, 2)])
    run = SimpleNamespace(
        trajectory=SimpleNamespace(building=plan.building(), changes=()),
        case_table=SimpleNamespace(building=BuildingTable()),
    )
    shown = Page(page(Head("title", "kind", verdict_of(None), "", {}), BLANK, [building_section(run)]))
    rows = [(row[0], *row[1:4], row[-1]) for row in shown.table("Stairs: heights")[1:]]
    assert rows == [("west 0 to west 1", "0.00", "6.00", "1", "1.40"), ("west 2", "6.00", "9.00", "1", "1.20")]
