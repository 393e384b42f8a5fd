"""DXF drawings: layers, blocks, curves, units, walls as lines, and files that are damaged."""

import math

import ezdxf
import pytest

from evac import BuildingError, import_building, read_building
from evac.contract.registry import Registry, built_in

REGISTRY = Registry(builtins=built_in("importer"))
ROOM = [(0, 0), (8, 0), (8, 5), (0, 5)]


@pytest.fixture
def drawing():
    document = ezdxf.new("R2013")
    document.header["$INSUNITS"] = 6
    return document


def add(space, layer, corners, close=True, **attributes):
    space.add_lwpolyline(corners, close=close, dxfattribs={"layer": layer, **attributes})


def plan_of(document, folder, **options):
    path = folder / "a.dxf"
    document.saveas(path)
    return REGISTRY.importer_for(path)(**options).read(path)


def building_of(document, folder, **options):
    return plan_of(document, folder, **options).building(need_exit=False)


def ground(building):
    return sum(level.polygon.area for level in building.levels)


def findings(made, kind):
    return [str(one) for one in made.findings if one.kind == kind]


@pytest.mark.parametrize("prefix", ["", "jps-", "JPS-"])
def test_layers_of_the_convention(drawing, tmp_path, prefix):
    space = drawing.modelspace()
    add(space, f"{prefix}walkablearea", ROOM)
    add(space, f"{prefix}obstacles", [(3, 2), (4, 2), (4, 3), (3, 3)])
    add(space, f"{prefix}distributions", [(0, 0), (2, 0), (2, 5), (0, 5)])
    add(space, f"{prefix}exits", [(7.5, 0.1), (7.9, 0.1), (7.9, 4.9), (7.5, 4.9)])
    add(space, "furniture", [(1, 1), (2, 1), (2, 2)])
    space.add_text("walkablearea", dxfattribs={"layer": f"{prefix}walkablearea"})
    building = building_of(drawing, tmp_path)
    # The exit is moved to the outline by 0.1 m on three sides.
    assert ground(building) == pytest.approx(7.5 * 5 - 1.0)
    assert [(way.name, round(way.width, 6)) for way in building.exits] == [("exit 1", 5.0)]
    assert [(area.name, area.polygon.area) for area in building.areas] == [("area 1", 10.0)]
    assert any("exit 1" in one for one in findings(building, "repaired"))


def test_an_outline_that_crosses_itself_is_repaired_and_told(drawing, tmp_path):
    outline = [(0, 0), (8, 0), (8, 6), (1, 6), (1, 1), (5, 1), (5, 4), (0, 4)]
    add(drawing.modelspace(), "walkablearea", outline)
    building = building_of(drawing, tmp_path)
    assert ground(building) == pytest.approx(8 * 4 + 7 * 2)  # what the outline goes around twice is ground, too
    assert len(findings(building, "repaired")) == 1


def test_blocks_are_expanded_on_their_layer_or_their_own(drawing, tmp_path):
    inner = drawing.blocks.new("column")
    add(inner, "0", [(0, 0), (0.5, 0), (0.5, 0.5), (0, 0.5)])
    outer = drawing.blocks.new("columns")
    for x in (1.0, 3.0):
        outer.add_blockref("column", (x, 0), dxfattribs={"layer": "obstacles"})
    space = drawing.modelspace()
    add(space, "walkablearea", ROOM)
    space.add_blockref("columns", (1, 2), dxfattribs={"layer": "anything", "xscale": 2.0, "yscale": 2.0})
    assert ground(building_of(drawing, tmp_path)) == pytest.approx(40.0 - 2 * 1.0)


def test_curves_become_polygons(drawing, tmp_path):
    space = drawing.modelspace()
    bulge = math.tan(math.pi / 8)  # a quarter of a circle
    space.add_lwpolyline(
        [(0, 0, 0), (5, 0, bulge), (8, 3, 0), (8, 5, 0), (0, 5, 0)], format="xyb", close=True,
        dxfattribs={"layer": "walkablearea"},
    )  # fmt: skip
    space.add_circle((2, 2), 0.5, dxfattribs={"layer": "obstacles"})
    expected = 40.0 - 9.0 + math.pi * 9.0 / 4 - math.pi * 0.25
    assert ground(building_of(drawing, tmp_path)) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    ("said", "metres"),
    [
        *((1, 0.0254), (3, 1609.344), (4, 0.001), (5, 0.01), (7, 1000.0), (10, 0.9144), (16, 100.0)),
        (21, 1200 / 3937),
    ],
)
def test_declared_units_are_believed(drawing, tmp_path, said, metres):
    drawing.header["$INSUNITS"] = said
    add(drawing.modelspace(), "walkablearea", [(x / metres, y / metres) for x, y in ROOM])
    building = building_of(drawing, tmp_path)
    assert ground(building) == pytest.approx(40.0)
    assert [one for one in findings(building, "found") if f"1 unit is {metres:.4g} m" in one]


@pytest.mark.parametrize(
    ("said", "size", "kind"),
    [(6, 1.0, "found"), (4, 1000.0, "found"), (4, 1.0, "assumed"), (6, 1000.0, "assumed"), (0, 1000.0, "assumed")],
)
def test_units_are_doubted(drawing, tmp_path, said, size, kind):
    drawing.header["$INSUNITS"] = said
    add(drawing.modelspace(), "walkablearea", [(size * x, size * y) for x, y in ROOM])
    building = building_of(drawing, tmp_path)
    assert ground(building) == pytest.approx(40.0)
    assert any("unit" in one for one in findings(building, kind))


def test_open_lines_of_the_floor_are_closed_and_told(drawing, tmp_path):
    for ends in ([(0, 0), (8, 0)], [(8, 0.05), (8, 5)], [(8, 5), (0, 5)], [(0, 5), (0, 0)], [(20, 20), (21, 20)]):
        drawing.modelspace().add_line(*ends, dxfattribs={"layer": "walkablearea"})
    building = building_of(drawing, tmp_path)
    assert ground(building) == pytest.approx(40.0)
    (closed,) = findings(building, "repaired")
    assert "(8.00, 0.03)" in closed or "(8.00, 0.02)" in closed
    assert any("(20.50, 20.00)" in one for one in findings(building, "left out"))
    with pytest.raises(BuildingError, match=r"\(0\.00, 0\.00\).* gap "):
        import_building([tmp_path / "a.dxf"], tmp_path / "case", options={"gap": 0.01})


def test_a_file_that_is_cut_off_is_refused_with_its_line(drawing, tmp_path):
    add(drawing.modelspace(), "walkablearea", ROOM)
    drawing.saveas(tmp_path / "a.dxf")
    content = (tmp_path / "a.dxf").read_bytes()
    for share in (0.2, 0.6, 0.95):
        (tmp_path / "a.dxf").write_bytes(content[: int(share * len(content))])
        with pytest.raises(BuildingError, match=r"line \d+ without EOF"):
            read_building(tmp_path / "a.dxf")


def test_a_damaged_file_is_refused_unless_its_repair_is_asked_for(drawing, tmp_path):
    add(drawing.modelspace(), "walkablearea", ROOM)
    add(drawing.modelspace(), "walkablearea", [(20, 0), (23, 0), (23, 3)])
    path = tmp_path / "a.dxf"
    drawing.saveas(path)
    path.write_text(path.read_text().replace(" 20\n3.0", " 2x\n3.0", 1))
    with pytest.raises(BuildingError, match=r"line \d+.*repair"):
        read_building(path)
    plan = REGISTRY.importer_for(path)(repair=True).read(path)
    assert any("damaged" in one for one in findings(plan, "warning"))


def test_another_unit_is_taken_if_lines_enclose_no_room_with_that_of_the_file(drawing, tmp_path):
    drawing.header["$INSUNITS"] = 4
    for x in range(0, 2000, 400):
        for line in (
            [(x, 0), (x + 400, 0), (x + 400, 550)],
            [(x, 0), (x, 550), (x + 140, 550)],
            [(x + 230, 550), (x + 400, 550)],
        ):
            add(drawing.modelspace(), "wall", line, close=False)
    plan = plan_of(drawing, tmp_path)
    assert ground(plan.building(need_exit=False)) == pytest.approx(5 * 4.0 * 5.5, rel=0.05)
    assert any("1 unit is 0.01 m: with 0.001 m" in line for line in findings(plan, "assumed"))


@pytest.mark.parametrize("is_hatch", [False, True])
def test_lines_that_enclose_no_room_are_left_out_with_their_place(drawing, tmp_path, is_hatch):
    space = drawing.modelspace()
    add(space, "wall", ROOM)
    stray = [(30, 0), (38, 0), (38, 6), (30, 6)] if is_hatch else [(30, 0), (38, 0), (38, 0.2), (30, 0.2)]
    if is_hatch:
        space.add_hatch(dxfattribs={"layer": "wall"}).paths.add_polyline_path(stray)
    else:
        add(space, "wall", stray)
    plan = plan_of(drawing, tmp_path)
    assert ground(plan.building(need_exit=False)) == pytest.approx(40.0)
    assert any("(34.00" in line and "enclose no room" in line for line in findings(plan, "left out"))


def test_faces_at_several_heights_are_left_out_with_the_format_that_keeps_them(drawing, tmp_path):
    space = drawing.modelspace()
    for x, z in ((0, 0.0), (15, 3.0)):
        corners = [(x, 0, z), (x + 10, 0, z), (x + 10, 8, z), (x, 8, z)]
        space.add_3dface(corners, dxfattribs={"layer": "FLOORS"})
    with pytest.raises(BuildingError, match="'FLOORS' is left out, since faces at several heights") as caught:
        plan_of(drawing, tmp_path)
    assert ".obj" in str(caught.value)
    add(space, "WALLS", ROOM)
    assert ground(building_of(drawing, tmp_path)) == pytest.approx(40.0)
    (text,) = [one for one in findings(plan_of(drawing, tmp_path), "left out") if "FLOORS" in one]
    assert "2 entities" in text


def test_texts_in_rooms_are_their_names(drawing, tmp_path):
    space = drawing.modelspace()
    rooms = [(0, 0), (4, 0), (4, 5), (0, 5)], [(4.2, 0), (9, 0), (9, 5), (4.2, 5)], [(9.2, 0), (12, 0), (12, 5)]
    for outline in rooms:
        add(space, "walls", outline)
    space.add_line((4.1, 2), (4.1, 3), dxfattribs={"layer": "doors"})
    for text, place, height in (("note on the floor", (3, 1), 0.1), ("Office 1", (1, 2), 0.3), ("3068", (1, 1), 0.5)):
        space.add_text(text, height=height, dxfattribs={"insert": place})
    space.add_mtext("12.5 m2\\PMEETING", dxfattribs={"insert": (5, 4), "char_height": 0.2, "layer": "a-anno-text"})
    tag = drawing.blocks.new("tag")
    tag.add_attdef("NAME", (0, 0))
    space.add_blockref("tag", (6, 1)).add_attrib("NAME", "Area 24.0 m2", (6, 1))
    plan = plan_of(drawing, tmp_path, doors="doors")
    assert {room.name: round(room.polygons[0].area, 6) for room in plan.rooms} == {
        "Office 1": 20.0,
        "MEETING": 24.0,
        "room 3": 7.0,
    }
    assert {room.use for room in plan.rooms} == {"room"}
    told = [(one.kind, one.number) for one in plan.findings if one.element == "text"]
    assert told == [("found", 2), ("found", 3), ("left out", 3)]
