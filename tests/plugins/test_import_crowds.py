"""Geometries of other crowd programs: JuPedSim's XML and scenarios of Vadere."""

import json

import pytest

from evac import BuildingError, import_building, read_building


def walls(*lines):
    vertices = ["".join(f"<vertex px='{x}' py='{y}'/>" for x, y in line) for line in lines]
    return "".join(f"<polygon caption='wall'>{one}</polygon>" for one in vertices)


def link(tag, number, ends, **keys):
    vertices = "".join(f"<vertex px='{x}' py='{y}'/>" for x, y in ends)
    return f"<{tag} id='{number}' {' '.join(f'{k}={chr(39)}{v}{chr(39)}' for k, v in keys.items())}>{vertices}</{tag}>"


def transition(number, ends, first, second):
    (room1, subroom1), (room2, subroom2) = first, second
    return link("transition", number, ends, room1_id=room1, subroom1_id=subroom1, room2_id=room2, subroom2_id=subroom2)


#: A hall in two subrooms that a crossing joins, an office behind a door, and a stair up to a gallery.
GEOMETRY = f"""<?xml version='1.0'?><geometry version='0.8' unit='m'><rooms>
<room id='0' caption='hall' zpos='0'>
 <subroom id='0' class='floor' A_x='0' B_y='0' C_z='0'>{walls([(4, 0), (0, 0), (0, 1)], [(0, 2), (0, 5), (4, 5)])}
  <obstacle id='0'>{walls([(1, 1), (2, 1), (2, 2), (1, 2), (1, 1)])}</obstacle></subroom>
 <subroom id='1' class='floor'>{walls([(4, 0), (8, 0), (8, 3)], [(8, 4.2), (8, 5), (6, 5)], [(5, 5), (4, 5)])}</subroom>
 <crossings>{link("crossing", 0, [(4, 0), (4, 5)], subroom1_id=0, subroom2_id=1)}</crossings></room>
<room id='1'><subroom id='0' class='floor'>{walls([(5, 5), (4, 5), (4, 9), (8, 9), (8, 5), (6, 5)])}</subroom></room>
<room id='2'>
 <subroom id='0' class='stair' A_x='0.5' B_y='0' C_z='\u22124'>{walls([(8, 3), (12, 3)], [(8, 4.2), (12, 4.2)])}
 <up px='12' py='3.6'/><down px='8' py='3.6'/></subroom></room>
<room id='3' zpos='2'>
 <subroom id='0' C_z='2'>{walls([(12, 3), (12, 0), (16, 0), (16, 6), (12, 6), (12, 4.2)])}</subroom></room>
</rooms><transitions>{transition(1, [(0, 1), (0, 2)], (0, 0), (-1, -1))}
{transition(2, [(5, 5), (6, 5)], (0, 1), (1, 0))}{transition(3, [(8, 3), (8, 4.2)], (0, 1), (2, 0))}
{transition(4, [(12, 3), (12, 4.2)], (3, 0), (2, 0))}</transitions></geometry>"""


def scenario(**more):
    """Return a hall within walls of 0.5 m, a wall across it with a stair of 12 treads in the gap, and a target."""

    def box(x, y, width, height):
        return {"type": "RECTANGLE", "x": x, "y": y, "width": width, "height": height}

    topography = {
        "attributes": {"bounds": {"x": 0, "y": 0, "width": 21, "height": 11}, "boundingBoxWidth": 0.5, "bounded": True},
        "obstacles": [{"id": 1, "shape": box(10, 0.5, 3, 4.5)}, {"id": 2, "shape": box(10, 6.5, 3, 4)}],
        "stairs": [{"id": 3, "shape": box(10, 5, 3, 1.5), "treadCount": 12, "upwardDirection": {"x": 1.0, "y": 0.0}}],
        "targets": [
            {"id": 4, "shape": box(0.5, 5, 0.5, 2), "absorber": {"enabled": True}},
            {"id": 5, "shape": {"type": "CIRCLE", "center": {"x": 5, "y": 5}, "radius": 0.5}, "absorbing": False},
        ],
        "sources": [
            {
                "id": 6,
                "shape": {"type": "POLYGON", "points": [{"x": x, "y": y} for x, y in ((15, 2), (18, 2), (18, 5))]},
            }
        ],
        "measurementAreas": [{"id": 7, "shape": box(1, 1, 2, 2)}],
    }
    return {"name": "hall", "scenario": {"topography": {**topography, **more}}}


def floors(building):
    return {round(level.z_min, 3): level.polygon.area for level in building.levels if level.kind == "floor"}


def test_jupedsim(tmp_path):
    (tmp_path / "a.xml").write_text(GEOMETRY, encoding="utf-8")
    made = import_building([tmp_path / "a.xml"], tmp_path / "case")
    building = made.building
    assert (made.fault, made.missing, list(building.stairs)) == ("", (), ["stair 2 0"])
    assert [(way.name, way.width) for way in building.exits] == [("transition 1", pytest.approx(1.0))]
    assert [(door.name, door.width) for door in building.doors] == [("transition 2", pytest.approx(1.0))]
    # The wall of 0.1 m between hall and office is 4 m long; the door opens 1 m of it.
    assert floors(building) == {0.0: pytest.approx(8 * 5 - 1 + 4 * 4 - 0.1 * 4 + 0.1, abs=0.02), 2.0: pytest.approx(24)}


def test_a_scenario_of_vadere(tmp_path):
    (tmp_path / "a.scenario").write_text(json.dumps(scenario()))
    made = import_building([tmp_path / "a.scenario"], tmp_path / "case")
    building = made.building
    assert (made.fault, made.missing, list(building.stairs)) == ("", (), ["stair 1"])
    assert floors(building) == {0.0: pytest.approx(9.5 * 10 - 1.0), 2.04: pytest.approx(7.5 * 10)}
    assert [way.width for way in building.exits] == [pytest.approx(2.0 + 2 * 0.5)]
    assert [(area.name, area.polygon.area) for area in building.areas] == [("source 6", pytest.approx(4.5))]
    left_out = [one.text for one in made.findings if one.kind == "left out"]
    assert sum("measurementAreas" in one or "absorb nobody" in one for one in left_out) == 2


def test_stairs_of_a_scenario_lead_to_stairs(tmp_path):
    """Two walls across the hall, of whose stairs the one in the file first goes up from where the other ends."""

    def across(x, number):
        boxes = [
            {"type": "RECTANGLE", "x": x, "width": 2, "y": y, "height": h} for y, h in ((0.5, 4.5), (5, 1.5), (6.5, 4))
        ]
        stair = {"id": number, "shape": boxes[1], "treadCount": 10, "upwardDirection": {"x": 1.0, "y": 0.0}}
        return stair, [{"shape": boxes[0]}, {"shape": boxes[2]}]

    (second, walls), (first, more) = across(14, 1), across(7, 2)
    given = scenario(stairs=[second, first], obstacles=walls + more, sources=[])
    (tmp_path / "a.scenario").write_text(json.dumps(given))
    assert [*floors(read_building(tmp_path / "a.scenario"))] == [0.0, 1.7, 3.4]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.xml", "<osm/>", "not a geometry of JuPedSim"),
        ("a.xml", "<geometry><rooms>", "not a geometry of JuPedSim"),
        ("a.xml", "<geometry><rooms/></geometry>", "no subroom that is a floor"),
        ("a.xml", GEOMETRY.replace("px='16'", "px='x'"), "'x' is not a number"),
        ("a.scenario", "{}", "not a scenario of Vadere"),
        ("a.scenario", "[", "not a scenario of Vadere"),
        ("a.scenario", json.dumps(scenario(obstacles=[{"shape": {"type": "RECTANGLE"}}])), "not a scenario of Vadere"),
    ],
)
def test_what_is_none_of_their_files_is_refused(tmp_path, name, text, message):
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(BuildingError, match=message):
        read_building(tmp_path / name, need_exit=False)
