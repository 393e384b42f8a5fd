"""FDS decks: storeys at slabs, walls with holes, exits and start areas of old evacuation lines."""

import pytest

import evac
from evac import import_building, read_building

pytestmark = pytest.mark.usefixtures("unpictured")

DECK = """&HEAD CHID='office', TITLE='two storeys / one deck' /
&MESH IJK=50,40,30, XB=0.0,10.0,0.0,8.0,0.0,6.0 /
&MESH IJK=50,40,1, XB=0.0,10.0,0.0,8.0,0.4,1.6, EVACUATION=.TRUE., EVAC_HUMANS=.TRUE. /
&OBST XB=0.0,10.0,0.0,8.0,2.8,3.0, SURF_ID='SLAB' / the slab
&OBST XB=5.0,5.2,0.0,8.0,0.0,2.8 / an inner wall
&HOLE XB=4.9,5.3,3.0,4.0,0.0,2.1 /
&OBST XB=1.0,2.0,6.0,7.0,0.0,0.8 / a table
&OBST XB=7.0,7.2,0.0,8.0,3.0,6.0 / a wall upstairs
&VENT MB='XMAX', SURF_ID='OPEN' /
&VENT XB=10.0,10.0,2.0,3.0,3.0,5.0, SURF_ID='OPEN' /
&VENT XB=0.0,0.0,2.0,3.0,3.0,5.0, SURF_ID='OPEN' /
&EVAC ID='staff', NUMBER_INITIAL_PERSONS=5, XB=6.0,9.0,1.0,7.0,0.4,1.6 /
&EXIT ID='main', IOR=-1, XB=0.0,0.0,2.0,3.2,0.4,1.6 /
&TAIL /
"""


def test_storeys_walls_exits_and_start_areas(tmp_path):
    (tmp_path / "a.fds").write_text(DECK)
    building = read_building(tmp_path / "a.fds")
    floors = {level.name: (level.z_min, level.polygon.area) for level in building.levels}
    # 80 m2 less the wall of 0.2 m, whose hole is 1 m wide, and the table of 1 m2.
    assert floors["floor 1"] == (0.0, pytest.approx(80.0 - 0.2 * 7.0 - 1.0, rel=1e-3))
    upper = [area for name, (z, area) in floors.items() if z == 3.0]
    assert sum(upper) == pytest.approx(80.0 - 0.2 * 8.0, rel=1e-3)
    assert [(way.name, round(way.width, 2)) for way in building.exits] == [("main (line 13)", 1.2)]
    assert [area.polygon.area for area in building.areas] == [pytest.approx(18.0)]


def test_open_vents_are_offered_as_exits(tmp_path):
    (tmp_path / "a.fds").write_text(DECK)
    made = import_building([tmp_path / "a.fds"], tmp_path / "case", exits=[1, 2], people=10)
    assert made.missing == ()
    assert len(made.building.exits) == 3


def test_repeated_lines_thin_walls_and_other_ways_of_writing(tmp_path):
    (tmp_path / "a.fds").write_text("""! two meshes side by side, as copies of one
&mult id='row' dx=5.0, i_upper=1 /
&MESH ID='m/1', IJK=50,40,30
      XB = 0 5. 0.0,8.0
           .0,3.0E0, MULT_ID='Row' / a comment with & in it
!&OBST XB=0.0,10.0,0.0,8.0,0.0,3.0 /
&MULT ID='columns', DXB=2.0,2.0,0.0,0.0,0.0,0.0, N_LOWER=0, N_UPPER=2 /
&obst xb=1.0,1.5,1.0,1.5,0,3, mult_id='columns' /
&OBST XB=5.0,5.0,0.0,8.0,0.0,3.0 / a wall without a thickness
&HOLE XB=4.9,5.1,3.0,4.0,0.0,2.1 /
&EXIT ID='out', IOR=1, XB=10.0,10.0,3.0,4.0,0.0,2.0 /
&STRS ID='up', XB=0,1,0,1,0,3 /
&TAIL /
&OBST XB=0.0,10.0,0.0,8.0,0.0,3.0 /
""")
    building = read_building(tmp_path / "a.fds")
    assert [level.polygon.area for level in building.levels] == [pytest.approx(80.0 - 3 * 0.25 - 0.05 * 7.0, rel=1e-3)]
    assert len([one for one in building.findings if "&STRS up (line 12)" in one.text]) == 1


def test_an_open_side_of_the_meshes_is_told(tmp_path):
    (tmp_path / "a.fds").write_text(DECK)
    told = [one.text for one in read_building(tmp_path / "a.fds").findings if one.kind == "warning"]
    assert len([text for text in told if "open at a side (&VENT, line 9)" in text]) == 1


WALLS = """&OBST XB=0.0,12.0,0.0,0.2,0.0,7.0 /
&OBST XB=0.0,12.0,7.8,8.0,0.0,7.0 /
&OBST XB=0.0,0.2,0.0,8.0,0.0,7.0 /
&OBST XB=11.8,12.0,0.0,8.0,0.0,7.0 /
&HOLE XB=11.7,12.1,3.4,4.6,0.0,2.0 /
"""
FIRE = "&MESH IJK=60,40,15, XB=0.0,12.0,0.0,8.0,{} /\n"
THIN = "&MESH IJK=60,40,1, XB=0.0,12.0,0.0,8.0,0.9,1.1, EVACUATION=.TRUE., EVAC_HUMANS=.TRUE., EVAC_Z_OFFSET=1.0 /\n"
PEOPLE = "&EXIT ID='door', XB=12.0,12.0,3.4,4.6,{0}, IOR=1 /\n&EVAC ID='crowd', XB=1.0,5.0,1.0,7.0,{0} /\n"
SLAB = "&OBST XB=0.0,12.0,0.0,8.0,-0.2,0.0 /\n&OBST XB=6.0,6.2,0.2,7.8,0.0,0.15 /\n"  # and a duct that one steps over
SCREEN = "&OBST XB=8.0,8.2,0.2,7.8,0.0,3.0, EVACUATION=.FALSE. /\n"
COUNT = "&EXIT ID='counter', COUNT_ONLY=.TRUE., XB=6.0,6.0,0.2,7.8,0.4,1.6 /\n"


@pytest.mark.parametrize(
    "deck",
    [
        THIN + PEOPLE.format("0.9,1.1"),
        FIRE.format("0.0,3.0") + THIN + PEOPLE.format("0.9,1.1"),
        FIRE.format("3.2,7.2") + THIN + PEOPLE.format("0.9,1.1"),
        FIRE.format("-0.2,3.0") + SLAB + PEOPLE.format("0.4,1.6"),
        FIRE.format("-0.6,3.0") + SLAB + PEOPLE.format("0.0,2.0"),
        FIRE.format("0.0,3.0") + SCREEN + PEOPLE.format("0.0,2.0"),
        FIRE.format("0.0,3.0") + COUNT + PEOPLE.format("0.9,1.1"),
        THIN + PEOPLE.format("0.9,1.1").replace("IOR=1", "IOR=9"),  # no direction
    ],
)
def test_decks_of_fds_evac_give_the_room_that_they_mean(tmp_path, deck):
    """A room of 11.6 x 7.6 m, with a door of 1.2 m in a wall of 0.2 m."""
    (tmp_path / "a.fds").write_text(WALLS + deck)
    made = import_building([tmp_path / "a.fds"], tmp_path / "case", people=5)
    (level,), (way,), (area,) = made.building.levels, made.building.exits, made.building.areas
    assert (made.missing, level.z_min) == ((), 0.0)
    assert level.polygon.area == pytest.approx(11.6 * 7.6 + 0.2 * 1.2, rel=1e-3)
    assert (way.name.partition(" ")[0], way.width, area.polygon.area) == (
        "door",
        pytest.approx(1.2),
        pytest.approx(24.0),
    )
    lines = [(one.name, one.segment) for one in evac.load(made.folder).line]
    assert lines == ([("counter (line 7)", ((6.0, 0.2), (6.0, 7.8)))] if "COUNT_ONLY" in deck else [])


@pytest.mark.parametrize(("exits", "heights"), [("", [0.0]), (PEOPLE.format("3.9,4.1"), [0.0, 3.0])])
def test_a_mesh_of_stairs_is_a_storey_only_if_people_start_or_leave_in_it(tmp_path, exits, heights):
    well = THIN.replace("0.9,1.1", "3.9,4.1").replace("&MESH", "&MESH ID='Well'")
    stair = "&STRS ID='up', XB=0.2,3.0,0.2,7.8,3.9,4.1, MESH_ID='Well' /\n"
    (tmp_path / "a.fds").write_text(WALLS + THIN + well + stair + PEOPLE.format("0.9,1.1") + exits)
    building = read_building(tmp_path / "a.fds")
    assert [level.z_min for level in building.levels] == heights
    assert [one.kind for one in building.findings if "&STRS up" in one.text] == ["missing"]


@pytest.mark.parametrize("height", ["6.0,7.0", "-3.0,-2.0"])
def test_an_exit_on_no_storey_makes_a_deck_incomplete(tmp_path, height):
    (tmp_path / "a.fds").write_text(WALLS + THIN + PEOPLE.format(height))
    made = import_building([tmp_path / "a.fds"], tmp_path / "case", people=5)
    assert [line for line in made.missing if "EXIT door" in line]


def test_the_people_of_evac_lines_start_and_a_corridor_between_storeys_is_named_with_its_ends(tmp_path):
    crowd = "&EVAC ID='crowd', NUMBER_INITIAL_PERSONS=7, XB=1.0,5.0,1.0,7.0,0.4,1.6 /\n"
    door = "&EXIT ID='door', XB=12.0,12.0,3.4,4.6,0.4,1.6, IOR=1 /\n"
    geometry = "&GEOM ID='column', VERTS=5,3,0, 6,3,0, 6,4,0, 5,4,0, 5.5,3.5,2, FACES=1,2,5, 2,3,5, 3,4,5, 4,1,5 /\n"
    down = (
        "&DOOR ID='Down', IOR=-1, XB=0.2,0.2,3.0,4.2,3.4,4.6, TO_NODE='Way' /\n"
        "&CORR ID='Way', EFF_LENGTH=8.0, TO_NODE='In' /\n"
        "&ENTR ID='In', IOR=1, XB=0.2,0.2,5.0,6.2,0.4,1.6 /\n"
    )
    (tmp_path / "a.fds").write_text(WALLS + FIRE.format("0.0,3.0") + door + crowd)
    made = import_building([tmp_path / "a.fds"], tmp_path / "case")
    assert (made.missing, [room.number for room in made.rooms]) == ((), [7])
    (tmp_path / "a.fds").write_text(WALLS + FIRE.format("0.0,3.0") + door + crowd + down + geometry)
    made = import_building([tmp_path / "a.fds"], tmp_path / "other")
    assert [text.partition(" (")[0] for text in made.missing] == ["&CORR Way", "&GEOM column"]
    told = [one.text for one in made.findings if one.kind == "left out"]
    assert [text for text in told if "&DOOR Down (line 9), to WAY, at [[0.2, 3.0], [0.2, 4.2]], z = 3.00 m" in text]
    assert [text for text in told if "&ENTR In (line 11), at [[0.2, 5.0], [0.2, 6.2]], z = 0.00 m" in text]
    assert 1.2 not in [round(one.width, 2) for one in made.openings]


ROOMS = WALLS.replace("7.0 /", "6.4 /") + "&OBST XB=0.0,12.0,0.0,8.0,2.8,3.0 /\n&HOLE XB=3.0,{},1.0,3.6,2.7,3.1 /\n"
UP = "&EVAC ID='up', NUMBER_INITIAL_PERSONS=5, XB=8.0,11.0,4.0,7.0,3.4,4.6 /\n"
DOOR = "&EXIT ID='door', XB=12.0,12.0,3.4,4.6,0.4,1.6, IOR=1 /\n"
LONG = [(3.0 + 0.3 * k, 3.3 + 0.3 * k, 1.0, 2.2, 0.0, 0.2 * (k + 1)) for k in range(14)]
TURNED = [
    *LONG[:7],
    (5.1, 6.3, 1.0, 3.6, 1.4, 1.6),
    *[(4.8 - 0.3 * k, 5.1 - 0.3 * k, 2.4, 3.6, 1.75 + 0.2 * k, 1.8 + 0.2 * k) for k in range(6)],
]
STACKED = [(x, 7.2, *rest[1:3], z - 0.2, z) for x, *rest, z in LONG]
COPIES = "&MULT ID='up', DX=0.3, DZ=0.2, N_UPPER=13 /\n&OBST XB=3.0,3.3,1.0,2.2,0.0,0.2, MULT_ID='up' /\n"


def _deck(hole, steps):
    lines = steps if isinstance(steps, str) else "".join(f"&OBST XB={','.join(map(str, box))} /\n" for box in steps)
    return FIRE.format("0.0,6.4") + ROOMS.format(hole) + lines + UP + DOOR


@pytest.mark.parametrize(
    ("hole", "steps", "flights"), [(7.2, LONG, 1), (6.6, TURNED, 2), (7.2, STACKED, 1), (7.2, COPIES, 1)]
)
def test_steps_between_storeys_are_a_stair(hole, steps, flights, tmp_path):
    (tmp_path / "a.fds").write_text(_deck(hole, steps))
    made = import_building([tmp_path / "a.fds"], tmp_path / "case")
    assert made.missing == ()
    pieces = [level for level in made.building.levels if level.stair == "stair 1"]
    assert len([piece for piece in pieces if piece.kind == "flight"]) == flights
    assert (min(one.z_min for one in pieces), max(one.z_max for one in pieces)) == pytest.approx((0.0, 3.0))
    # People start only where the deck says so.
    results = evac.run(tmp_path / "case")
    assert (results.number_of_people, results.evacuated) == (5, 5)


@pytest.mark.parametrize("rise", [0.25, 0.09])  # the low ones end near the floor on which they stand
def test_steps_that_reach_no_storey_are_obstacles(rise, tmp_path):
    seats = [(3.0 + 0.8 * k, 3.8 + 0.8 * k, 1.0, 3.0, 0.0, rise * (k + 1)) for k in range(3)]
    (tmp_path / "a.fds").write_text(FIRE.format("0.0,3.2") + WALLS + _deck(7.2, seats).partition("&HOLE XB=3.0")[2])
    plan = read_building(tmp_path / "a.fds")
    assert not [level for level in plan.levels if level.stair]
    assert "stair" not in {one.element for one in plan.findings if one.kind == "missing"}


def test_a_slab_that_blocks_a_stair_is_cut_if_asked(tmp_path):
    (tmp_path / "a.fds").write_text(_deck(3.1, LONG))
    first = import_building([tmp_path / "a.fds"], tmp_path / "case")
    assert [one.element for one in first.findings if one.kind == "missing" and one.element] == ["stair"]
    assert any("cut_slabs" in text for text in first.missing)
    again = import_building([tmp_path / "a.fds"], tmp_path / "cut", options={"cut_slabs": True})
    assert again.missing == ()
