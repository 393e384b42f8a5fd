"""DXF drawings as architects draw them: kinds of walls and doors, units, layers of any name, several plans."""

import itertools
import math
import re

import ezdxf
import numpy as np
import pytest
import shapely
import shapely.affinity

import evac
from evac import BuildingError, import_building, read_building

pytestmark = pytest.mark.usefixtures("unpictured")

UNITS = {"m": (6, 1.0), "cm": (5, 100.0), "mm": (4, 1000.0), "inch": (1, 1 / 0.0254)}
#: Two rooms of 5.0 m and 3.6 m by 4.0 m, an inner wall of 0.2 m and outer walls of 0.3 m; a door in each.
LEFT, RIGHT = shapely.box(0.3, 0.3, 5.3, 4.3), shapely.box(5.5, 0.3, 9.1, 4.3)
INNER, OUTER = shapely.box(5.3, 1.0, 5.5, 1.9), shapely.box(2.0, 0.0, 3.0, 0.3)
BODY = shapely.box(0, 0, 9.4, 4.6).difference(shapely.union_all([LEFT, RIGHT, INNER, OUTER]))
FLOOR = LEFT.area + RIGHT.area + INNER.area
SINGLE = [[(0, 0), (2, 0)], [(3, 0), (9, 0), (9, 4), (0, 4), (0, 0)], [(5, 0), (5, 1)], [(5, 1.9), (5, 4)]]


class Drawing:
    """A drawing in some unit, whose corners are given in metres."""

    def __init__(self, unit="m", declared=None):
        self.document = ezdxf.new("R2013")
        self.document.header["$INSUNITS"] = UNITS[declared or unit][0]
        self.size = UNITS[unit][1]
        self.space = self.document.modelspace()

    def line(self, corners, layer="0", space=None, **given):
        corners = [(self.size * x, self.size * y) for x, y in corners]
        (self.space if space is None else space).add_lwpolyline(corners, dxfattribs={"layer": layer}, **given)

    def rings(self, shape, layer):
        for part in shapely.get_parts(shape):
            for ring in shapely.get_rings(part):
                self.line(ring.coords[:-1], layer, close=True)

    def swing(self, hinge, radius, start, layer="0", leaf=None, space=None):
        """Draw an arc of 90 degrees, and the leaf at one of its ends."""
        space, (x, y) = self.space if space is None else space, hinge
        attributes = {"layer": layer}
        centre = (self.size * x, self.size * y)
        space.add_arc(centre, self.size * radius, start, start + 90.0, dxfattribs=attributes)
        if leaf is not None:
            angle = math.radians(leaf)
            tip = (x + radius * math.cos(angle), y + radius * math.sin(angle))
            self.line([hinge, tip], layer, space)

    def doors(self, layer):
        self.swing((5.5, 1.0), 0.9, 0.0, layer, leaf=0.0)
        self.swing((2.0, 0.3), 1.0, 0.0, layer, leaf=90.0)


def double_lines(unit, declared, walls, doors):
    drawing = Drawing(unit, declared)
    drawing.rings(BODY, walls)
    drawing.doors(doors)
    return drawing


def wide_polylines(*, is_old=False):
    drawing = Drawing("mm")
    for corners, width in (([(0.15, 0.15), (2.0, 0.15)], 300), ([(5.4, 0.3), (5.4, 1.0)], 200),
                           ([(3.0, 0.15), (9.25, 0.15), (9.25, 4.45), (0.15, 4.45), (0.15, 0.15)], 300),
                           ([(5.4, 1.9), (5.4, 4.3)], 200)):  # fmt: skip
        places = [(1000 * x, 1000 * y, width, width) for x, y in corners]
        if is_old:
            drawing.space.add_polyline2d(
                [place[:2] for place in places], dxfattribs={"layer": "Wände", "default_start_width": width}
            )
        elif width == 300:
            drawing.space.add_lwpolyline(places, format="xyse", dxfattribs={"layer": "Wände"})
        else:
            drawing.line(corners, "Wände")
            drawing.space[-1].dxf.const_width = width
    drawing.doors("Türen")
    return drawing


def hatches():
    drawing = Drawing("cm")
    for part in shapely.get_parts(BODY):
        hatch = drawing.space.add_hatch(dxfattribs={"layer": "A-WALL-PATT"})
        for number, ring in enumerate(shapely.get_rings(part)):
            hatch.paths.add_polyline_path([(100 * x, 100 * y) for x, y in ring.coords], flags=1 if number == 0 else 16)
    drawing.doors("A-DOOR")
    return drawing


def blocks_of_doors(outer="nested"):
    """Doors as nested blocks on layer 0, furniture and dimensions on layers named so."""
    drawing, name = Drawing("mm"), outer
    drawing.rings(BODY, "MUR")
    leaf = drawing.document.blocks.new("Porte 90")
    drawing.swing((0, 0), 0.9, 0.0, leaf=0.0, space=leaf)
    outer = drawing.document.blocks.new(name)
    outer.add_blockref("Porte 90", (0, 0), dxfattribs={"layer": "PORTES"})
    drawing.space.add_blockref(name, (5500, 1000), dxfattribs={"layer": "PORTES"})
    larger = {"layer": "PORTES", "xscale": 10 / 9, "yscale": 10 / 9}
    drawing.space.add_blockref(name, (3000, 300), dxfattribs={**larger, "rotation": 90})
    drawing.line([(1, 1), (2.5, 1), (2.5, 3), (1, 3)], "A-FURN", close=True)
    drawing.line([(0, 2), (9.4, 2)], "Cotes")
    return drawing


def unnamed_layers():
    drawing = double_lines("mm", None, "L17", "L4")
    drawing.line([(1, 3.0), (2, 3.4), (2.2, 2.7), (1, 3)], "L9")
    return drawing


def windows():
    """The outer wall is interrupted by a window of three lines, which end 0.2 m before it, beside the door."""
    drawing = Drawing("m")
    drawing.rings(BODY.difference(shapely.box(5.9, 4.3, 8.7, 4.6)), "wall")
    for y in (4.3, 4.45, 4.6):
        drawing.line([(6.1, y), (8.5, y)], "Fenster")
    drawing.doors("door")
    return drawing


def fills():
    """Walls as triangles, of which 3D faces have a height too."""
    drawing = Drawing("cm")
    for number, part in enumerate(shapely.get_parts(shapely.constrained_delaunay_triangles(BODY))):
        corners = [(100.0 * x, 100.0 * y, 280.0 * (number % 3)) for x, y in part.exterior.coords[:3]]
        add = drawing.space.add_3dface if number % 2 else drawing.space.add_solid
        add([*corners, corners[2]], dxfattribs={"layer": "WALLS"})
    drawing.doors("doors")
    return drawing


def multilines():
    drawing = Drawing("mm")
    for corners, width in (([(0.15, 0.15), (2.0, 0.15)], 300), ([(5.4, 0.3), (5.4, 1.0)], 200),
                           ([(3.0, 0.15), (9.25, 0.15), (9.25, 4.45), (0.15, 4.45), (0.15, 0.15)], 300),
                           ([(5.4, 1.9), (5.4, 4.3)], 200)):  # fmt: skip
        given = {"layer": "walls", "scale_factor": width, "justification": 1}
        drawing.space.add_mline([(1000 * x, 1000 * y) for x, y in corners], dxfattribs=given)
    drawing.doors("doors")
    return drawing


def frozen_layers():
    """Walls that were taken away are on a frozen layer, and bearing walls have a French name like doors."""
    drawing = double_lines("m", None, "MURS PORTEURS", "MENUISERIES")
    drawing.document.layers.add("old walls").freeze()
    drawing.rings(shapely.box(3, 0.3, 3.1, 4.3), "old walls")
    return drawing


def far_away():
    """Coordinates of a map, at which overlays leave lines besides polygons."""
    drawing = double_lines("m", None, "walls", "doors")
    for entity in drawing.space:
        entity.translate(456789.123, 5432100.5, 0.0)
    return drawing


def lines_in_space():
    """The lower and upper edges of walls, and the vertical lines between them."""
    drawing = Drawing("mm")
    corners = [ring.coords for part in shapely.get_parts(BODY) for ring in shapely.get_rings(part)]
    for (x1, y1), (x2, y2) in [pair for ring in corners for pair in itertools.pairwise(1000 * np.array(ring))]:
        for begin, end in (((x1, y1, 0), (x2, y2, 0)), ((x1, y1, 2500), (x2, y2, 2500)), ((x1, y1), (x1, y1, 2500))):
            drawing.space.add_line(begin, end, dxfattribs={"layer": "walls"})
    drawing.doors("doors")
    return drawing


KINDS = {
    "double lines in metres": lambda: double_lines("m", None, "A-WALL", "A-DOOR"),
    "double lines in millimetres": lambda: double_lines("mm", None, "xref$0$A-Wall-Full", "A-Door"),
    "inches said to be millimetres": lambda: double_lines("inch", "mm", "WALLS", "DOORS"),
    "all on layer 0": lambda: double_lines("cm", None, "0", "0"),
    "wide polylines": wide_polylines,
    "wide polylines of old files": lambda: wide_polylines(is_old=True),
    "hatches": hatches,
    "blocks of doors": blocks_of_doors,
    "blocks of doors in a block named like a plant": lambda: blocks_of_doors("PLANTA"),
    "layers without meaning": unnamed_layers,
    "windows": windows,
    "fills": fills,
    "multilines": multilines,
    "frozen layers": frozen_layers,
    "far away": far_away,
    "lines in space": lines_in_space,
}


@pytest.mark.parametrize("kind", KINDS)
def test_drawings_of_architects_need_no_option(kind, tmp_path):
    KINDS[kind]().document.saveas(tmp_path / "a.dxf")
    made = import_building([tmp_path / "a.dxf"], tmp_path / "case", people=8)
    assert (made.fault, made.missing) == ("", ())
    assert sum(level.polygon.area for level in made.building.levels) == pytest.approx(FLOOR, rel=0.02)
    assert [way.width for way in made.building.exits] == [pytest.approx(1.0, abs=0.02)]


def test_outlines_of_rooms_are_walls_where_nothing_else_is(tmp_path):
    drawing = Drawing("mm")
    rooms = [shapely.box(0, 0, 12, 2), shapely.box(0, 2.15, 5.9, 7), shapely.box(6.05, 2.15, 12, 7)]
    for room in rooms:
        drawing.rings(room, "A-AREA")
    drawing.swing((2, 2.075), 0.9, 0.0, "A-DOOR", leaf=90.0)
    drawing.swing((8, 2.075), 0.9, 0.0, "A-DOOR", leaf=90.0)
    drawing.swing((0, 0.5), 1.0, 0.0, "A-DOOR", leaf=0.0)
    drawing.document.saveas(tmp_path / "a.dxf")
    building = read_building(tmp_path / "a.dxf")
    assert [level.polygon.area for level in building.levels] == [pytest.approx(81.47 + 2 * 0.9 * 0.15, abs=0.02)]
    assert [way.width for way in (*building.exits, *building.doors)] == [
        pytest.approx(w, abs=0.02) for w in (1, 0.9, 0.9)
    ]


def test_a_door_in_a_curved_wall(tmp_path):
    drawing = Drawing("mm")
    ring = shapely.Point(0, 0).buffer(6.3, quad_segs=64) - shapely.Point(0, 0).buffer(6, quad_segs=64)
    half = shapely.box(-7, 0, 7, 7) - shapely.box(-7, -1, 0, 0.5)
    for side in (1, -1):
        corners = shapely.get_coordinates(shapely.affinity.scale(half & ring, yfact=side, origin=(0, 0)))[:-1]
        drawing.space.add_lwpolyline(
            [(1000 * x, 1000 * y, 0.001) for x, y in corners], format="xyb", close=True, dxfattribs={"layer": "walls"}
        )
    drawing.swing((-6, -0.5), 1.0, 90.0, "doors", leaf=180.0)
    drawing.document.saveas(tmp_path / "a.dxf")
    building = read_building(tmp_path / "a.dxf")
    assert sum(level.polygon.area for level in building.levels) == pytest.approx(36 * np.pi, rel=0.01)
    assert [way.width for way in building.exits] == [pytest.approx(1.0, abs=0.05)]


def test_walls_as_single_lines(tmp_path):
    drawing = Drawing("mm")
    for corners in SINGLE:
        drawing.line(corners, "muros")
    drawing.swing((5, 1.0), 0.9, 0.0, "puertas", leaf=0.0)
    drawing.swing((2, 0.0), 1.0, 0.0, "puertas", leaf=90.0)
    drawing.document.saveas(tmp_path / "a.dxf")
    made = import_building([tmp_path / "a.dxf"], tmp_path / "case", people=8)
    assert sum(level.polygon.area for level in made.building.levels) == pytest.approx(9 * 4 - 0.1 * 3.1, rel=0.02)
    assert evac.run(evac.load(made.folder)).evacuated == 8


@pytest.mark.parametrize(("plan", "storeys"), [("", 2), ("2", 1), ("2,1", 2)])
def test_several_plans_of_one_drawing(tmp_path, plan, storeys):
    drawing = Drawing("m")
    drawing.rings(BODY, "WALL")
    drawing.rings(shapely.transform(BODY, lambda xy: xy * [1.0, 1.5] + [20.0, 0.0]), "WALL")
    drawing.doors("DOOR")
    drawing.document.saveas(tmp_path / "a.dxf")
    options = {"plan": plan} if plan else {}
    made = import_building([tmp_path / "a.dxf"], tmp_path / "case", options=options, partial=True)
    areas = [level.polygon.area for level in made.building.levels]
    assert len({level.z_min for level in made.building.levels}) == storeys
    assert sum(areas) == pytest.approx(FLOOR * {"": 2.5, "2": 1.5, "2,1": 2.5}[plan], rel=0.02)
    lowest = min(made.building.levels, key=lambda level: level.z_min)
    assert (lowest.polygon.bounds[0] > 15.0) == plan.startswith("2")


@pytest.mark.parametrize("plan", ["3", "1,3", "0,1", "1,1", "1,two"])
def test_a_plan_that_is_not_in_the_drawing_is_refused(tmp_path, plan):
    drawing = two_plans()
    drawing.document.saveas(tmp_path / "a.dxf")
    with pytest.raises(BuildingError, match="the drawing has 2 plans"):
        import_building([tmp_path / "a.dxf"], tmp_path / "case", options={"plan": plan})


def two_plans():
    """The upper storey has a balcony at the place of the exit."""
    drawing = Drawing("m")
    drawing.rings(BODY, "WALL")
    drawing.rings(shapely.transform(BODY, lambda xy: xy + np.array([20.0, 0.0])), "WALL")
    drawing.doors("DOOR")
    drawing.swing((25.5, 1.0), 0.9, 0.0, "DOOR", leaf=0.0)
    drawing.swing((22.0, 0.3), 1.0, 0.0, "DOOR", leaf=90.0)
    return drawing


def with_treads(layer, rows):
    drawing = two_plans()
    for x, y in itertools.product(np.arange(1.0, 4.1, 0.28), rows):
        drawing.line([(x, y), (x, y + 1.0)], layer)
    return drawing


@pytest.mark.parametrize("is_u_shaped", [False, True])
def test_a_drawn_stair_leads_to_the_plan_above(tmp_path, is_u_shaped):
    drawing = with_treads("Treppe", (2.0, 3.1) if is_u_shaped else (2.0,))
    if not is_u_shaped:
        drawing.line([(4.1, 2.5), (0.9, 2.5)], "Treppe")  # an arrow to the left
        for y in (2.4, 2.6):
            drawing.line([(0.9, 2.5), (1.1, y)], "Treppe")
    drawing.document.saveas(tmp_path / "a.dxf")
    made = import_building([tmp_path / "a.dxf"], tmp_path / "case", people=8)
    assert (made.is_accepted, made.fault, [*made.building.stairs]) == (True, "", ["stair 1"])
    assert [portal.width for portal in made.building.portals] == [pytest.approx(1.0)] * (4 if is_u_shaped else 2)
    told = {one.kind for one in made.findings if "'stair 1' to 'floor 2'" in one.text}
    assert told == {"assumed" if is_u_shaped else "found"}


def test_what_may_be_no_stair_is_proposed(tmp_path):
    with_treads("L17", (2.0,)).document.saveas(tmp_path / "a.dxf")
    made = import_building([tmp_path / "a.dxf"], tmp_path / "case", people=8)
    assert len([one for one in made.findings if one.kind == "warning" and "'drawn stair 1'" in one.text]) == 1
    assert (made.is_accepted, [way.name for way in made.building.exits]) == (False, ["floor 1 exit door 1"])
    file = made.folder / "building.plan.toml"
    text = file.read_text(encoding="utf-8")
    start = text.index("# [[stairs]]")
    file.write_text(text[:start] + re.sub("(?m)^# ?", "", text[start:]), encoding="utf-8")
    made = import_building([tmp_path / "a.dxf"], tmp_path / "case", people=8)
    assert (made.is_accepted, made.fault, [*made.building.stairs]) == (True, "", ["drawn stair 1"])
    assert not [one for one in made.findings if "remove the marks" in one.text]


def test_a_stair_that_does_not_fit_is_missing(tmp_path):
    with_treads("Treppe", (4.8,)).document.saveas(tmp_path / "a.dxf")
    made = import_building([tmp_path / "a.dxf"], tmp_path / "case", people=8)
    assert any("'drawn stair 1'" in one for one in made.missing)


def test_a_door_at_no_wall_is_missing(tmp_path):
    drawing = double_lines("m", None, "walls", "doors")
    drawing.swing((7.2, 2.2), 0.9, 0.0, "doors", leaf=0.0)  # where people walk
    drawing.swing((10.2, 2.2), 0.9, 0.0, "doors", leaf=0.0)
    drawing.swing((2.8, 2.2), 0.3, 0.0, "doors")  # of a cupboard
    drawing.document.saveas(tmp_path / "a.dxf")
    made = import_building([tmp_path / "a.dxf"], tmp_path / "case", people=8)
    (missing,) = made.missing
    assert "0.90 m" in missing


def test_a_plan_that_is_not_closed_is_missing(tmp_path):
    drawing = two_plans()
    drawing.line([(54, 0), (40, 0), (40, 4), (54, 4)], "WALL")
    drawing.line([(70, 0), (71, 0)], "WALL")  # of a legend
    drawing.swing((42.0, 0.0), 0.9, 0.0, "DOOR", leaf=90.0)
    drawing.document.saveas(tmp_path / "a.dxf")
    made = import_building([tmp_path / "a.dxf"], tmp_path / "case", people=8, options={"plan": "1"})
    assert any("enclose no room" in one for one in made.missing)
    assert any(one.kind == "left out" and one.place and one.place[0] >= 70 for one in made.findings)


def test_a_plan_is_above_another_one_where_their_walls_are(tmp_path):
    """The upper storeys end at the inner wall, the doors of two swing out to the left, and the last one is shorter."""
    drawing = Drawing("m")
    drawing.rings(BODY, "WALL")
    drawing.doors("DOOR")
    door, end = shapely.box(0.0, 2.0, 0.3, 3.0), shapely.box(0.3, 0.3, 5.3, 2.3)
    whole = shapely.box(0, 0, 5.6, 4.6).difference(LEFT | door)
    for x, upper in ((20.0, whole), (40.0, whole), (60.0, shapely.box(0, 0, 5.6, 2.6).difference(end))):
        drawing.rings(shapely.transform(upper, lambda xy, x=x: xy + np.array([x, 0.0])), "WALL")
    for x in (20.0, 40.0):
        drawing.swing((x, 2.0), 1.0, 90.0, "DOOR", leaf=180.0)
    drawing.document.saveas(tmp_path / "a.dxf")
    made = import_building([tmp_path / "a.dxf"], tmp_path / "case", people=8, partial=True)
    grounds = [shapely.union_all([one.polygon for one in made.building.levels if one.z_min == z]) for z in (0, 3, 6, 9)]
    assert grounds[0].intersection(LEFT).area == pytest.approx(LEFT.area, rel=0.01)
    for upper in grounds[1:3]:
        assert upper.symmetric_difference(LEFT | door).area == pytest.approx(0.0, abs=0.2)
    assert grounds[3].symmetric_difference(end).area == pytest.approx(0.0, abs=0.2)
    told = [one.text for one in made.findings if one.text.startswith("moved by")]
    assert [re.search(r"whose walls (\d+)%", text)[1] for text in told][1] == "100"


def test_the_report_says_how_each_layer_is_taken_and_an_option_mends_it(tmp_path):
    drawing = double_lines("m", None, "concrete", "A-DOOR")
    drawing.line([(1, 1), (4, 1), (4, 3), (1, 3)], "wall paper", close=True)
    drawing.document.saveas(tmp_path / "a.dxf")
    made = import_building([tmp_path / "a.dxf"], tmp_path / "a", options={"walls": "concrete"})
    assert sum(level.polygon.area for level in made.building.levels) == pytest.approx(FLOOR, rel=0.02)
    taken = {str(one) for one in made.findings if one.text.startswith("layer")}
    assert {word for one in taken for word in ("as walls", "as doors", "as nothing") if word in one} == {
        "as walls",
        "as doors",
        "as nothing",
    }
