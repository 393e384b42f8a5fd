import numpy as np
import shapely

from evac.building.recover.bodies import Body, Rules, plan_of_bodies

#: Corners of the faces of a box, outwards.
FACES = ((0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6))
FACES = np.array([*FACES, (3, 0, 4), (3, 4, 7)])
RULES = Rules("auto", "ground", 0.0, 0.2, 0.01, False, False)


def test_a_space_whose_faces_are_not_oriented_alike_is_ground(tmp_path):
    corners = [(0, 0), (4, 0), (4, 3), (0, 3)]
    points = np.array([(x, y, z) for z in (0.0, 2.6) for x, y in corners])
    faces = FACES.copy()
    faces[:2] = faces[:2, ::-1]
    space = Body("space", "room", points, faces)
    assert [z for _, z in space.bottoms()] == [0.0, 2.6]
    plan = plan_of_bodies(tmp_path / "a.ifc", [space], [("L0", 0.0)], RULES, [])
    assert shapely.union_all(plan.storeys["L0"].polygons).area == 12.0
