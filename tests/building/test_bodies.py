from dataclasses import replace

import numpy as np
import pytest
import shapely

from evac.building.recover.bodies import Body, Rules, plan_of_bodies
from evac.building.recover.bodies.body import snapped

#: Corners of the faces of a box, outwards.
FACES = ((0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6))
FACES = np.array([*FACES, (3, 0, 4), (3, 4, 7)])
RULES = Rules("auto", "ground", 0.0, 0.2, 0.01, False, False)


def box(kind, name, x1, x2, z=0.0, height=2.6, use=""):
    points = np.array([(x, y, z + up) for up in (0.0, height) for x, y in ((x1, 0), (x2, 0), (x2, 3), (x1, 3))])
    return Body(kind, name, points, FACES, use=use)


def test_a_space_whose_faces_are_not_oriented_alike_is_a_room(tmp_path):
    faces = FACES.copy()
    faces[:2] = faces[:2, ::-1]
    space = replace(box("space", "room", 0, 4), triangles=faces)
    assert [z for _, z in space.bottoms()] == [0.0, 2.6]
    plan = plan_of_bodies(tmp_path / "a.ifc", [space], [("L0", 0.0)], RULES, [])
    assert [(room.name, room.storey, room.outline.area) for room in plan.rooms] == [("room", "L0", 12.0)]


def test_spaces_side_by_side_are_rooms_with_their_uses_and_one_without_a_floor_is_missing(tmp_path):
    spaces = [box("space", "a", 0, 4, use="office"), box("space", "b", 4, 10, use="hall"), box("space", "c", 20, 24)]
    slab = box("slab", "slab", 0, 10, z=-0.2, height=0.2)
    plan = plan_of_bodies(tmp_path / "a.ifc", [*spaces, slab], [("L0", 0.0)], RULES, [])
    assert [(room.name, room.use) for room in plan.rooms] == [("a", "office"), ("b", "hall")]
    assert [room.outline.area for room in plan.rooms] == pytest.approx([12.0, 18.0], rel=0.01)
    assert [one.text.partition(" is")[0] for one in plan.findings if one.kind == "missing"] == ["'c'"]
    assert plan.building(need_exit=False).levels[0].polygon.area == pytest.approx(30.0)


def test_a_hole_as_wide_as_its_rounding_is_filled():
    sliver = [(2.107, 1.417), (2.108, 1.417), (2.098, 1.4)]
    plan = shapely.Polygon(shapely.box(0, 0, 5, 4).exterior, [sliver, shapely.box(3, 1, 4, 2).exterior.coords])
    assert snapped(plan).area == 19.0
