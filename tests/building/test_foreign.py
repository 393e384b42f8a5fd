"""Meshes of other tools: y upwards, solid bodies, stairs of treads, unusual sizes, near misses."""

import numpy as np
import pytest
import shapely

from evac import BuildingError, import_building, read_building

RISER, GOING = 3.0 / 18, 0.28
UPRIGHT, Y_UPWARDS = np.eye(3), np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])


class Model:
    """Boxes and rectangles, written as an OBJ file."""

    def __init__(self):
        self.points, self.faces = [], []

    def box(self, x1, y1, z1, x2, y2, z2):
        first = len(self.points)
        self.points += [(x, y, z) for z in (z1, z2) for y in (y1, y2) for x in (x1, x2)]
        sides = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
        self.faces += [[first + corner for corner in side] for side in sides]

    def flat(self, x1, y1, x2, y2, z):
        first = len(self.points)
        self.points += [(x1, y1, z), (x2, y1, z), (x2, y2, z), (x1, y2, z)]
        self.faces.append([first, first + 1, first + 2, first + 3])

    def write(self, folder, turn=UPRIGHT, rng=None):
        points, faces = np.array(self.points, dtype=float) @ turn, list(self.faces)
        if rng is not None:
            faces = [faces[k][::-1] if rng.random() < 0.5 else faces[k] for k in rng.permutation(len(faces))]
            faces += [faces[k] for k in rng.integers(len(faces), size=3)]
        lines = ["v " + " ".join(map(repr, point)) for point in points.tolist()]
        lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in faces]
        (folder / "a.obj").write_text("\n".join(lines))
        return folder / "a.obj"

    def read(self, folder, turn=UPRIGHT, rng=None, **options):
        return read_building(self.write(folder, turn, rng), need_exit=False, **options)


def levels(building):
    return [(level.kind, round(level.z_min, 6), round(level.polygon.area, 3)) for level in building.levels]


def texts(building, kind):
    return [one.text for one in building.findings if one.kind == kind]


@pytest.fixture
def house():
    """Two slabs, two walls with a door between them, a table, and a solid stair of 17 treads."""
    model = Model()
    model.box(0, 0, -0.3, 12, 8, 0)
    for x1, y1, x2, y2 in ((0, 0, 12, 1), (0, 2.5, 12, 8), (0, 1, 2, 2.5), (2 + 17 * GOING, 1, 12, 2.5)):
        model.box(x1, y1, 2.7, x2, y2, 3.0)
    for k in range(17):
        model.box(2 + k * GOING, 1, 0, 2 + (k + 1) * GOING, 2.5, (k + 1) * RISER)
    model.box(0, 5, 0, 5, 5.2, 2.7)
    model.box(6.2, 5, 0, 12, 5.2, 2.7)
    model.box(9, 1, 0.72, 10, 2, 0.75)
    return model


@pytest.mark.parametrize("seed", [None, 0, 1])
def test_a_house_of_solid_bodies(house, tmp_path, seed):
    building = house.read(tmp_path, rng=None if seed is None else np.random.default_rng(seed))
    stair, walls, table = 17 * GOING * 1.5, 10.8 * 0.2, 1.0
    # Under the stair, the ground is taken by its bodies.
    assert levels(building) == [
        ("floor", 0.0, round(96.0 - stair - walls - table, 3)), ("flight", 0.0, round(stair, 3)),
        ("floor", 3.0, round(96.0 - stair, 3)),
    ]  # fmt: skip
    assert [portal.width for portal in building.portals] == pytest.approx([1.5, 1.5])
    assert building.levels[1].slope == pytest.approx(np.arctan2(3.0, 17 * GOING))
    assert any("17 treads" in text for text in texts(building, "assumed"))
    assert any("headroom" in text for text in texts(building, "left out"))
    assert any("solid bodies" in text for text in texts(building, "found"))


def test_y_upwards_is_turned(house, tmp_path):
    assert levels(house.read(tmp_path, Y_UPWARDS, up="y")) == levels(house.read(tmp_path))
    with pytest.raises(BuildingError, match=r"up"):
        house.read(tmp_path, up="x")


def test_without_headroom_solid_slabs_are_refused_with_a_place(house, tmp_path):
    with pytest.raises(BuildingError, match=r"\(\d+\.\d\d, \d+\.\d\d"):
        house.read(tmp_path, headroom=0.0, treads=False)


@pytest.mark.usefixtures("unpictured")
@pytest.mark.parametrize(
    ("unit", "height", "thick", "slabs", "scale"),
    [
        (1.0, 2.6, 0.2, (), 1.0),
        (1 / 0.3048, 2.6, 0.15, (), 0.3048),
        (1 / 0.3048, 3.5, 0.3, (3.5,), 0.3048),
        (1000.0, 3.0, 0.2, (3.0,), 0.001),
        (1.0, 8.5, 0.3, (), 1.0),  # a hall
        (1.0, 8.5, 0.4, (2.7, 5.5), 1.0),  # walls over three storeys
    ],
)
def test_units_are_recognised_by_the_heights_of_storeys_and_the_thickness_of_walls(
    tmp_path, unit, height, thick, slabs, scale
):
    model = Model()
    for x in (0, 6, 12):
        model.box(x, 0, 0, x + thick, 8, height)
    for z in (0, *slabs):
        model.box(0, 0, z - 0.2, 12, 8, z)
    turn = np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]]) * unit
    made = import_building([model.write(tmp_path, turn)], tmp_path / "case", partial=True)
    ground = sum(level.polygon.area for level in made.building.levels if level.z_min < 1.0)
    assert ground == pytest.approx(12 * 8 * (unit * scale) ** 2, rel=0.1)
    assert bool([one for one in made.findings if "scale)" in one.text]) == (scale != 1.0)


def test_a_mesh_without_a_floor_that_has_headroom_is_refused(tmp_path):
    model = Model()
    for x in (0, 6, 12):
        model.box(x, 0, 0, x + 0.4, 8, 8.5)
    for z in (0, 2.7, 5.5):
        model.box(0, 0, z - 0.2, 12, 8, z)
    with pytest.raises(BuildingError, match=r"no face is a floor .*building\.headroom"):
        model.read(tmp_path, up="y", scale=0.3048)


@pytest.mark.usefixtures("unpictured")
@pytest.mark.parametrize(
    ("unit", "scale", "height"), [(1.0, 1.0, 2.8), (1 / 0.0254, 0.0254, 2.8), (1000.0, 0.001, 9.0)]
)
def test_a_mesh_whose_y_axis_points_upwards_is_turned_if_its_walls_are_walls_then(tmp_path, unit, scale, height):
    model = Model()
    for low, high in (((0, 0), (10, 0.2)), ((0, 7.8), (10, 8)), ((0, 0.2), (0.2, 7.8)), ((9.8, 0.2), (10, 7.8))):
        model.box(*low, 0, *high, height)
    model.box(5, 0.2, 0, 5.2, 4, height)
    for z in (0.0, height + 0.2):
        model.box(0, 0, z - 0.2, 10, 8, z)
    turned = {"up": "y", "scale": scale} if height > 5.0 else {}  # of a hall, nothing is known
    made = import_building([model.write(tmp_path, unit * Y_UPWARDS)], tmp_path / "case", options=turned)
    assert sum(level.polygon.area for level in made.building.levels) == pytest.approx(9.6 * 7.6 - 0.2 * 3.8, rel=1e-3)
    assert bool([one for one in made.findings if "(up, scale)" in one.text]) == (not turned)


def test_a_bare_surface_is_left_as_it_is(tmp_path):
    model = Model()
    model.flat(0, 0, 4, 3, 0.0)
    model.flat(0, 0, 4, 3, 1.5)
    building = model.read(tmp_path)
    assert levels(building) == [("floor", 0.0, 12.0), ("floor", 1.5, 12.0)]
    assert building.findings == ()


def treads(count=8, turn=0.0, floors=("lower", "upper")):
    """Two floors, and treads without risers between them, each turned against the one before [degrees]."""
    model = Model()
    if "lower" in floors:
        model.flat(-4, 0, 0, 2, 0.0)
    for k in range(count):
        model.flat(k * GOING, k * turn, (k + 1) * GOING, 1.2 + k * turn, (k + 1) * RISER)
    if "upper" in floors:
        model.flat(count * GOING, 0, count * GOING + 4, 2 + count * turn, (count + 1) * RISER)
    return model


def test_treads_without_risers_are_a_flight_over_the_floor(tmp_path):
    model = treads()
    model.flat(0, 0, 8 * GOING, -2, 0.0)
    building = model.read(tmp_path)
    flight = next(level for level in building.levels if level.kind == "flight")
    assert (flight.z_min, flight.z_max) == pytest.approx((0.0, 9 * RISER))
    assert len(building.portals) >= 2


@pytest.mark.parametrize("floor", ["lower", "upper"])
def test_treads_that_join_one_floor_are_refused_with_both_heights_a_riser_beyond_them(tmp_path, floor):
    with pytest.raises(BuildingError, match=r"z = 0\.00 to 1\.50"):
        treads(floors=(floor,)).read(tmp_path)


def test_treads_stay_if_asked_for(tmp_path):
    assert [kind for kind, _, _ in levels(treads().read(tmp_path, treads=False))] == ["floor"] * 10


def test_a_stair_that_turns_is_warned_of_with_its_place(tmp_path):
    model = Model()
    model.flat(-4, -4, 0, 0, 0.0)
    for k in range(8):  # a spiral about the origin
        angles = np.radians([25.0 * k, 25.0 * (k + 1)])
        first = len(model.points)
        corners = [
            (r * np.cos(a), r * np.sin(a), (k + 1) * RISER)
            for r, a in zip((0.3, 1.5, 1.5, 0.3), angles[[0, 0, 1, 1]], strict=True)
        ]
        model.points += [tuple(map(float, corner)) for corner in corners]
        model.faces.append([first, first + 1, first + 2, first + 3])
    (warning,) = [one for one in model.read(tmp_path).findings if "turns" in one.text]
    assert (warning.kind, len(warning.place)) == ("warning", 3)


@pytest.mark.parametrize(
    ("size", "scale", "factor"), [(1e-3, 1.0, "1000"), (1e3, 1e-6, "0.001"), (1.0, 1e-3, "1"), (1.0, 1e-2, "1")]
)
def test_a_building_into_which_nobody_fits_is_refused_with_the_scale_that_helps(tmp_path, size, scale, factor):
    model = Model()
    model.flat(0, 0, 12 * size, 8 * size, 0.0)
    with pytest.raises(BuildingError, match=rf"measures {12 * size * scale:g} x .*building\.scale = {factor}, "):
        model.read(tmp_path, scale=scale)


def test_a_union_of_bodies_keeps_the_ground_of_shapely(tmp_path):
    rng = np.random.default_rng(3)
    model = Model()
    model.box(0, 0, -0.2, 20, 10, 0)
    ground = shapely.box(0, 0, 20, 10)
    for x in range(1, 19, 3):
        size = rng.uniform(0.2, 0.5, 2)
        model.box(x, 4, 0, x + size[0], 4 + size[1], rng.uniform(0.5, 3.0))
        ground = ground.difference(shapely.box(x, 4, x + size[0], 4 + size[1]))
    building = model.read(tmp_path, rng=rng)
    assert levels(building) == [("floor", 0.0, round(ground.area, 3))]


@pytest.mark.parametrize("foot", [0.0, -0.1, -0.5])
def test_walls_and_columns_stand_on_floors_or_in_them(tmp_path, foot):
    model = Model()
    model.box(0, 0, -0.2, 10, 10, 0)
    model.box(4, 0, foot, 4.2, 10, 5)
    model.box(7, 7, foot, 7.5, 7.5, 5)
    assert sorted(levels(model.read(tmp_path))) == [("floor", 0.0, 40.0), ("floor", 0.0, 57.75)]


def test_slabs_and_ramps_that_overlap_are_ground_once(tmp_path):
    model = Model()
    model.box(0, 0, -0.2, 10, 10, 0)
    model.box(9.9, 0, -0.2, 20, 10, 0)
    assert levels(model.read(tmp_path)) == [("floor", 0.0, 200.0)]
    first = len(model.points)
    model.box(12, 4, -0.8, 22, 6, -0.5)
    model.points[first + 5] = (22, 4, 1.5)
    model.points[first + 7] = (22, 6, 1.5)
    model.box(22, 0, 1.3, 30, 10, 1.5)
    building = model.read(tmp_path)
    assert levels(building) == [("floor", 0.0, 189.0), ("flight", 0.0, 15.0), ("floor", 1.5, 80.0)]
    assert len(building.portals) == 2


def test_walls_that_share_corners_with_their_slabs_are_cut_out(tmp_path):
    model = Model()
    for z in (0, 3):
        model.box(0, 0, z - 0.3, 10, 6, z)
        model.box(0, 0, z, 10, 0.2, z + 2.7)
        model.box(4, 0.2, z, 4.2, 6, z + 2.7)
    model.box(0, 0, 5.7, 10, 6, 6.0)
    index = {point: k for k, point in enumerate(dict.fromkeys(model.points))}
    model.faces = [[index[model.points[corner]] for corner in face] for face in model.faces]
    model.points = list(index)
    ground = [("floor", z, area) for z in (0.0, 3.0) for area in (23.2, 33.64)]
    model.box(1, 1, 0, 3, 2, 0.6)  # a table
    building = model.read(tmp_path)
    ground[0] = ("floor", 0.0, 21.2)
    assert sorted(levels(building)) == ground  # and no roof
    assert [one.place[2] for one in building.findings if one.kind == "left out"][-1] == 0.6


@pytest.mark.parametrize(("sides", "storeys"), [(1, [0.0, 3.0]), (3, [0.0])])
def test_a_bare_floor_that_touches_a_wall_is_no_roof_unless_walls_end_below_its_outline(tmp_path, sides, storeys):
    corners = [(0.0, 0.0), (10.0, 0.0), (10.0, 6.0), (0.0, 6.0)]
    model = Model()
    model.points = [(x, y, z) for z in (0.0, 3.0) for x, y in corners]
    model.faces = [[0, 1, 2, 3], [4, 5, 6, 7], *([k, (k + 1) % 4, (k + 1) % 4 + 4, k + 4] for k in range(sides))]
    assert levels(model.read(tmp_path)) == [("floor", z, 60.0) for z in storeys]
